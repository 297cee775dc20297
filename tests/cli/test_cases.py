"""Golden cases of the command line: a command beside what it prints and its exit code.

A case is `cases/NAME.case`: the command after `$`, its stdout, stderr and exit code. The models it names lie beside it.
After a change, `pytest tests/cli --accept` rewrites what is expected; read the difference before committing it.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CASES = Path(__file__).parent / "cases"

#: What differs between runs, processors and versions of Python: times, counters, how `argparse` shows usage.
VARYING = (
    (
        re.compile(r"simulated in \S+ \S+ after \S+ \S+ of preparation"),
        "simulated in <time> after <time> of preparation",
    ),
    (re.compile(r"^compiling .*\n", re.MULTILINE), ""),
    (re.compile(r"^usage: .*\n(?: .*\n)*", re.MULTILINE), ""),
    (re.compile(r"^  group +method .*$", re.MULTILINE), "  group, method and counters"),
    (re.compile(r"^  group +error/tolerance .*$", re.MULTILINE), "  group and its error"),
    (re.compile(r"^(  \w+) +[\d.e-]+ +(\S+) +[\d.]+ \S?s$", re.MULTILINE), r"\1 <error> \2 <time>"),
    (re.compile(r"^(  \w+) +(?:radau|dop|tsit)\S+ .*$", re.MULTILINE), r"\1 <counters>"),
    (re.compile(r"smaller than \S+ s"), "smaller than <step> s"),
    (re.compile(r"(?<=choose from ).*(?=\))"), lambda found: found[0].replace("'", "")),
    (re.compile(r"\d+\.\d{6,}(?:e[+-]\d+)?"), lambda found: f"{float(found[0]):.6g}"),
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A current folder with all models, and with what cannot be a model."""
    for model in CASES.glob("*.hier"):
        shutil.copy(model, tmp_path)
    (tmp_path / "binary.hier").write_bytes(bytes(range(256)) * 4)
    (tmp_path / "folder.hier").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def hierc(command: str) -> subprocess.CompletedProcess[str]:
    """Run the command line as a user would."""
    plain = {"COLUMNS": "100", "NO_COLOR": "1", "PYTHONIOENCODING": "utf-8", "PYTHONWARNINGS": "default"}
    return subprocess.run(
        [sys.executable, "-m", "hierc", *shlex.split(command)],
        capture_output=True, text=True, encoding="utf-8", env={**os.environ, **plain}, timeout=300, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("case", sorted(CASES.glob("*.case")), ids=lambda case: case.stem)
def test_case(case: Path, folder: Path, request: pytest.FixtureRequest) -> None:
    expected = case.read_text(encoding="utf-8")
    command = expected.splitlines()[0].removeprefix("$ hierc ")
    ran = hierc(command)
    assert "Traceback" not in ran.stderr
    assert ran.returncode != 70, ran.stderr
    got = f"$ hierc {command}\n{ran.stdout}--- stderr\n{ran.stderr}--- exit {ran.returncode}\n"
    for pattern, replacement in VARYING:
        got = pattern.sub(replacement, got)
    if request.config.getoption("--accept"):
        case.write_text(got, encoding="utf-8")
    else:
        assert got == expected
