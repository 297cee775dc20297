"""What a table was measured on, in general terms."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

import llvmlite.binding as llvm


def description() -> dict[str, str]:
    """Processor, cores, vector width, operating system, versions."""
    features = llvm.get_host_cpu_features()
    vectors = next((name for name in ("avx512f", "avx2", "neon") if features.get(name)), "baseline")
    return {
        "processor": f"{_processor()} ({llvm.get_host_cpu_name()}), {os.cpu_count()} cores, {vectors}",
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        **{name: version(name) for name in ("hierc", "numpy", "scipy", "llvmlite")},
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("model name")),
        platform.machine(),
    )
