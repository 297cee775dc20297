"""Other solvers on the same problems, measured by scripts kept elsewhere, in an environment of their own.

The folder of peers holds `run_peers.py`, which takes `--problem`, `--peers`, `--tols` and `--limit` (s), and writes
`peer-results/<problem>.json` in the current folder: a list of runs with `peer`, `method`, `tol`, and `err`, `cpu` (s), `evals` or `fail`.
"""

from __future__ import annotations

import json
import math
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cases import Case
from measure import Run


@dataclass(frozen=True, slots=True)
class Peers:
    """Where the peers are, and the interpreter that has them installed."""

    folder: Path
    python: Path
    limit: float  # s of wall time for one peer on one problem

    def run(self, peer: str, case: Case, tolerances: Sequence[float]) -> list[Run]:
        """All methods of one peer, on a case that has a name among them. Raises CalledProcessError if its script fails."""
        assert case.peer_name is not None
        command: list[str | Path] = [
            self.python, self.folder / "run_peers.py", "--problem", case.peer_name, "--peers", peer,
            "--tols", ",".join(f"{t:g}" for t in tolerances), "--limit", f"{self.limit:g}",
        ]  # fmt: skip
        with tempfile.TemporaryDirectory() as work:
            subprocess.run(command, cwd=work, check=True, stdout=subprocess.DEVNULL)
            found = json.loads(Path(work, "peer-results", f"{case.peer_name}.json").read_bytes())
        return [_run(case, record) for record in found if math.isfinite(record.get("err", math.nan))]

    def versions(self) -> dict[str, str]:
        """Versions of what is installed beside the interpreter that the peers may use."""
        code = (
            "import importlib.metadata as m, json, platform\n"
            "wanted = {'numpy', 'scipy', 'numba', 'sundials4py', 'numbalsoda', 'diffrax', 'jax'}\n"
            "found = {d.name: d.version for d in m.distributions() if d.name in wanted}\n"
            "print(json.dumps({'python': platform.python_version(), **found}))"
        )
        return dict(
            json.loads(subprocess.run([self.python, "-c", code], check=True, capture_output=True).stdout)
        )


def _run(case: Case, record: dict[str, Any]) -> Run:
    return Run(
        case.name, record["peer"], record["method"], record["tol"], record["err"], record["cpu"], None,
        tuple(record["evals"]),
    )  # fmt: skip
