"""What a whole `hierc run` costs, interpreter and imports included:  python benchmarks/startup.py

CPU and wall time of child processes: the first run ever (empty cache), runs after an edit of an equation, of a number and of a comment, and
runs of an unchanged model; beside them the interpreter alone, and a scipy script for the same problem. Least of several.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from cases import CASES
from document import put
from tables import markdown

_MODEL = CASES["cart"].model
_HERE = Path(__file__).parent
#: What the edits change, each in one place of the cart's text.
_EQUATION = "ex = cos(th)*(tx - x)"
_NUMBER = "real kv [1/s] = 30,"
_SCIPY = """\
from scipy.integrate import solve_ivp
from cases import CASES
case = CASES["cart"]
result = solve_ivp(lambda t, y: case.rhs(t, y.tolist()), (0, case.stop), case.start, "{method}", rtol=1e-6, atol=1e-6)
"""


@dataclass(frozen=True, slots=True)
class Cost:
    """Seconds of one process and its children."""

    cpu: float
    wall: float


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description="Measure whole processes of `hierc run`.")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--into", type=Path, help="a document whose tables are to be replaced")
    options = parser.parse_args(argv)
    rows = [
        [label, f"{1e3 * best.cpu:.0f}", f"{1e3 * best.wall:.0f}"]
        for label, best in _measurements(options.repeat)
    ]
    table = markdown(["whole process", "CPU ms", "wall ms"], rows)
    print(table)
    if options.into:
        put(options.into, "processes", table)


def _measurements(repeat: int) -> Iterator[tuple[str, Cost]]:
    yield "python, nothing else", _least(repeat, lambda _: _python("pass"))
    yield "python, import numpy", _least(repeat, lambda _: _python("import numpy"))
    text = _MODEL.read_text()
    with _workplace() as run:
        yield "hierc run, first ever on a machine", _least(repeat, lambda k: run(text, f"fresh{k}"))
    with _workplace() as run:
        run(text, "cache")
        yield (
            "hierc run, an equation edited",
            _least(
                repeat,
                lambda k: run(_edit(text, _EQUATION, f"ex = {k + 2}*cos(th)*(tx - x)/{k + 2}"), "cache"),
            ),
        )
        yield (
            "hierc run, a parameter's default edited",
            _least(repeat, lambda k: run(_edit(text, _NUMBER, f"real kv [1/s] = {31 + k},"), "cache")),
        )
        yield "hierc run, a comment edited", _least(repeat, lambda k: run(f"{text}// {k}\n", "cache"))
        yield "hierc run, nothing edited", _least(repeat, lambda _: run(text, "cache"))
    for method in ("LSODA", "Radau"):
        yield f"scipy script, {method}", _scipy(method, repeat)


def _scipy(method: str, repeat: int) -> Cost:
    return _least(repeat, lambda _: _python(_SCIPY.format(method=method)))


def _edit(text: str, old: str, new: str) -> str:
    if text.count(old) != 1:
        raise ValueError(f"`{old}` is not in the model once")
    return text.replace(old, new)


@contextmanager
def _workplace() -> Iterator[Callable[[str, str], Cost]]:
    """A function that runs a model's text with a named cache folder, in a temporary folder."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def run(text: str, cache: str) -> Cost:
            (folder / "cart.hier").write_text(text)
            command = [sys.executable, "-m", "hierc", "run", "cart.hier", "-o", "out.csv"]
            return _cost(command, folder, {"HIERC_CACHE": str(folder / cache)})

        yield run


def _python(code: str) -> Cost:
    return _cost([sys.executable, "-c", code], _HERE, {"PYTHONPATH": str(_HERE)})


def _cost(command: Sequence[str], folder: Path, variables: dict[str, str]) -> Cost:
    """Run a command. Raises CalledProcessError."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"} | variables
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Cost(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall)


def _least(repeat: int, measure: Callable[[int], Cost]) -> Cost:
    found = [measure(k) for k in range(repeat)]
    return Cost(min(cost.cpu for cost in found), min(cost.wall for cost in found))


if __name__ == "__main__":
    main()
