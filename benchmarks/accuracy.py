"""Error over tolerance, for tolerances from 1e-3 to 1e-10: what runs achieve of what they were asked for.

    python benchmarks/accuracy.py [--method auto] [--into docs/benchmarks.md] [MODEL ...]

For a benchmark problem: the largest |y - y_ref|/scale over states and 101 times, over the tolerance (rtol = atol), from the reference solution of a right-hand
side written by hand (`reference.py`). For a model of the gallery: the largest difference from a run of `radau9` at 1e-13, at four places in every step, in
units of rtol*|x| + atol*nominal with |x| the state's largest size (`runtime/verification.py`); the tests compare such runs with other solvers.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from math import inf
from pathlib import Path

import numpy as np
from cases import CASES, Case
from document import put
from reference import output_times, reference
from tables import markdown

import hierc
from hierc.runtime.model import Model
from hierc.runtime.result import SimulationError
from hierc.runtime.run import FinishedRun
from hierc.runtime.verification import compare

_MODELS = Path(__file__).parents[1] / "models"
TOLERANCES = tuple(10.0**-k for k in range(3, 11))
#: Of the runs that stand for the truth.
_FINEST = 1e-13


def main() -> None:
    """Print or write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("models", metavar="MODEL", nargs="*", help="some only")
    parser.add_argument("--method", default="auto")
    parser.add_argument("--into", type=Path, help="a document with a place for the table")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    table = markdown(
        ["error/tolerance at", *(f"{tolerance:.0e}" for tolerance in TOLERANCES)],
        [list(row) for row in _rows(arguments.models, arguments.method)],
    )
    if arguments.into:
        put(arguments.into, "accuracy", table)
    else:
        print(table)


def _rows(chosen: list[str], method: str) -> Iterator[list[str]]:
    for case in CASES.values():
        if not chosen or case.name in chosen:
            yield [f"{case.name} (problem)", *(_cell(error) for error in _of_case(case, method))]
    for file in sorted(_MODELS.glob("*.hier")):
        if not chosen or file.stem in chosen:
            yield [file.stem, *(_cell(error) for error in _of_model(hierc.load(file), method))]


def _cell(error: float | None) -> str:
    return "failed" if error is None else f"{error:.2g}"


def _of_case(case: Case, method: str) -> Iterator[float | None]:
    truth, t = reference(case), output_times(case)
    model = case.load()
    for tolerance in TOLERANCES:
        try:
            r = model.simulate(case.stop, tolerance, tolerance, method=method)
        except SimulationError:
            yield None
            continue
        states = np.column_stack([r(name, t) for name in case.states])
        yield truth.error(states) / tolerance


def _of_model(model: Model, method: str) -> Iterator[float | None]:
    truth = _run(model, _FINEST, "radau9")
    for tolerance in TOLERANCES:
        run, asked = _run(model, tolerance, method), {"rtol": tolerance, "atol": tolerance}
        same = [asked] * model.engine.elements.groups
        yield compare(model.engine.elements, run, truth, same).error if run.status.ok else None


def _run(model: Model, tolerance: float, method: str) -> FinishedRun:
    """The model's experiment, without what it sets for single groups."""
    stop = model.plan.experiment.settings["stop"]
    settings = {
        "start": 0.0,
        "stop": stop,
        "rtol": tolerance,
        "atol": tolerance,
        "method": method,
        "max_step": inf,
        "min_step": 0.0,
    }
    return model.engine.run(model.system(), settings, {})


if __name__ == "__main__":
    main()
