"""What one evaluation of a right-hand side costs:  python benchmarks/rhs_cost.py

The whole system as one group: as plain Python, as machine code for one state and for as many at once as a method has lanes; beside
them, with `--peers-dir` and `--peers-python`, C written by hand. Least of several, CPU time.
"""

from __future__ import annotations

import argparse
import ctypes
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from cases import CASES
from document import put
from tables import markdown

from hierc.runtime.contract import Group, Plan
from hierc.runtime.elements import expand
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.dialect import Array, Lanes, outlined
from hierc.runtime.machine.forms import wire
from hierc.runtime.machine.unit import Loaded, Unit, compile_object, parse_function
from hierc.runtime.model import Model

_COUNT = 200_000
_LANES = (2, 8)
_HAND_WRITTEN = """\
import sys
sys.path[:0] = sys.argv[1:3]
import cbuild, problems
problem = problems.get(sys.argv[3])
library = cbuild.rhs_lib(problem)
print(min(library.bench(-1, {count}, 0.37, problem.y0, problem.n) for _ in range(7)))
"""


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description="Measure evaluations of right-hand sides.")
    parser.add_argument("--peers-dir", type=Path, help="folder that holds cbuild.py")
    parser.add_argument("--problems-dir", type=Path, help="folder that holds problems.py")
    parser.add_argument("--peers-python", type=Path, help="interpreter with numpy for the peers")
    parser.add_argument("--into", type=Path, help="a document whose tables are to be replaced")
    options = parser.parse_args(argv)
    by_hand = options.peers_dir and options.problems_dir and options.peers_python
    head = ["ns an evaluation", "plain Python", *(f"{n} lanes" for n in _LANES), f"a lane of {_LANES[-1]}"]
    rows = []
    for case in CASES.values():
        model = case.load()
        lanes = [_machine_code(model, count) for count in _LANES]
        found = [_plain(model), *lanes, lanes[-1] / _LANES[-1]]
        row = [case.name, *(f"{1e9 * seconds:.4g}" for seconds in found)]
        if by_hand:
            folders = options.peers_python, options.peers_dir, options.problems_dir
            name = case.peer_name
            row.append(f"{1e9 * _hand_written(name, *folders):.4g}" if name else "")
        rows.append(row)
    table = markdown([*head, "C by hand"] if by_hand else head, rows)
    print(table)
    if options.into:
        put(options.into, "right-hand sides", table)


def _plain(model: Model) -> float:
    x = model.initial()
    return _least(lambda: model.rhs(0.37, x), 2000)


def _machine_code(model: Model, lanes: int) -> float:
    """Seconds an evaluation of all states on `lanes` points at once."""
    plan = one_group(model.plan)
    (wiring,) = wire(plan)
    unit = Unit("cost")
    composer = Composer(unit, "cost", wiring.form, plan.classes, parse_function, lanes)
    names = {"rhs": composer.rhs, "rhs_fixed": composer.rhs_fixed}
    unit.lower(_evaluations, lanes=lanes, constants=names, export="evaluations")
    code = Loaded([compile_object(unit.text())])
    call = ctypes.CFUNCTYPE(None, ctypes.c_int64, *[ctypes.c_void_p] * 5)(code.address("evaluations"))
    system = model.system()
    arrays = [
        np.full(lanes, 0.37),
        np.repeat(model.initial(), lanes),
        system.values_of(wiring.values[0]),
        np.zeros(composer.form.states * lanes),
        np.zeros(max(composer.saved, 1) * lanes),
    ]
    addresses = [array.ctypes.data for array in arrays]
    call(1, *addresses)
    expected = model.rhs(0.37, model.initial())
    np.testing.assert_allclose(arrays[3].reshape(-1, lanes).T, np.tile(expected, (lanes, 1)), 1e-12, 1e-12)
    return _least(lambda: call(_COUNT, *addresses), 1) / _COUNT


# Lowered to machine code. `rhs` and `rhs_fixed` are given then; there are no inputs, for which any array stands.


@outlined
def _evaluate(t: Lanes, x: Array[Lanes], p: Array[float], dx: Array[Lanes], v: Array[Lanes]) -> None:
    """A function of its own, so that no part of an evaluation whose result is overwritten can be left out."""
    rhs_fixed(t, dx, p, v)  # type: ignore[name-defined]  # noqa: F821
    rhs(t, x, dx, p, dx, v)  # type: ignore[name-defined]  # noqa: F821


def _evaluations(
    count: int, t: Array[Lanes], x: Array[Lanes], p: Array[float], dx: Array[Lanes], v: Array[Lanes]
) -> None:
    """Evaluations at times and states that move a little."""
    now = t[0]
    for _ in range(count):
        _evaluate(now, x, p, dx, v)
        x[0] = x[0] + 1e-12 * dx[0]
        now = now + 1e-6


def one_group(plan: Plan) -> Plan:
    """The same equations with all states in one group."""
    elements = expand(plan)
    nodes: list[int] = elements.order.tolist()
    read = [source for node in nodes for source in elements.read_by(node, -1)]
    outs = elements.order_parts([(node, k) for node, kind, k in read if kind == "out"], lambda _: True)
    calls = (*outs, *((node, -1) for node in nodes))
    return replace(plan, groups=(Group("all", tuple(nodes), calls),), order=None)


def _hand_written(name: str, python: Path, peers: Path, problems: Path) -> float:
    code = _HAND_WRITTEN.format(count=_COUNT * 5)
    command: list[str | Path] = [
        python.absolute(),
        "-c",
        code,
        peers.resolve(),
        problems.resolve(),
        name,
    ]
    return 1e-9 * float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def _least(work: Callable[[], object], count: int) -> float:
    """CPU seconds of one call of `work`: the least of seven means over `count` calls."""
    best = np.inf
    for _ in range(7):
        began = time.process_time()
        for _ in range(count):
            work()
        best = min(best, (time.process_time() - began) / count)
    return best


if __name__ == "__main__":
    main()
