"""While it steps, a run allocates nothing and touches no Python: its machine code calls itself and the C library's mathematics, nothing else."""

from __future__ import annotations

import pytest
from llvmlite import binding

import hierc
from hierc.runtime.machine import program

MATHEMATICS = {
    "acos", "asin", "atan", "atan2", "cos", "cosh", "exp", "floor", "fmod", "hypot", "log", "pow", "sin", "sinh", "sqrt", "tan", "tanh",
}  # fmt: skip


def called_outside(text: str) -> set[str]:
    """What a module calls but does not hold, without the processor's own operations."""
    module = binding.parse_assembly(text)
    declared = {f.name for f in module.functions if f.is_declaration}
    return {name for name in declared if not name.startswith("llvm.")}


def test_the_schedule_and_the_steps_call_nothing() -> None:
    _, unit = program._kernel()
    assert called_outside(unit.text()) <= MATHEMATICS
    for method in program.every_method().values():
        _, unit = program._step(method)
        assert called_outside(unit.text()) <= MATHEMATICS


@pytest.mark.parametrize("method", ["radau13", "dop853"])
@pytest.mark.parametrize("name", ["cart", "platoon", "quadrotor", "servo", "snake", "swarm"])
def test_the_pieces_of_a_step_call_mathematics_only(name: str, method: str) -> None:
    model = hierc.load(name)
    for wiring in model.engine.wiring:
        _, unit = program._form("g", model.plan.classes, wiring.form, program.every_method()[method])
        assert called_outside(unit.text()) <= MATHEMATICS
