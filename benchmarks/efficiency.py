"""What separate step sizes save in a chain of levels, each twice as fast as the one above: predicted by the paper's equation (9), and measured.

Esposito and Kumar's formula compares n levels of equal size with one integration of all at the finest step. CG are operations of making a polynomial, PE of
evaluating it, PC of predicting and correcting, RHS of the right-hand side, all for one state.
"""

from __future__ import annotations

from dataclasses import dataclass

from flops import prices, run, settings

import hierc
from hierc.runtime.model import Model

CG, PC, PE = 40.0, 11.0, 8.0
#: The finest step and the length of a measured run, s: many of the coarsest steps.
_STEP, _STOP = 0.01, 64.0
#: So loose that `max_step` alone decides on steps.
_LOOSE = 1e3


def predicted(levels: int, rhs: float) -> float:
    """Operations of multirate over those of single-rate integration, equation (9), for a right-hand side of `rhs` operations a state."""
    c1 = (2.0 - 2.0 ** (1 - levels)) / levels
    c3 = (2.0 ** (2 - levels) + 2 * levels - 4) / (2 * levels)
    return c1 + (c1 / 2.0 * CG + c3 * PE) / (rhs + PC)


def predicted_break_even(levels: int) -> float:
    """The right-hand side (operations a state) from which on separate steps pay, by equation (9)."""
    c1, at_zero = (2.0 - 2.0 ** (1 - levels)) / levels, predicted(levels, 0.0)
    return (at_zero - c1) * PC / (1.0 - c1) - PC


@dataclass(frozen=True, slots=True)
class Measured:
    """Method arithmetic, and evaluations of one state's right-hand side, of both ways to integrate the same chain."""

    levels: int
    multirate: tuple[float, float]
    single_rate: tuple[float, float]

    def efficiency(self, rhs: float) -> float:
        """Operations of multirate over those of single-rate integration, had the right-hand side so many operations a state."""
        (a, b), (c, d) = self.multirate, self.single_rate
        return (a + b * rhs) / (c + d * rhs)

    def break_even(self) -> float:
        """The right-hand side from which on separate steps pay; negative where they always do."""
        (a, b), (c, d) = self.multirate, self.single_rate
        return (a - c) / (d - b)


def measure(levels: int) -> Measured:
    """Both runs of a chain, with `abm5` and fixed steps."""
    chain, one = hierc.load(_chain(levels)), hierc.load(_one(levels))
    groups = {f"g{k}": {"max_step": _STEP * 2 ** (levels - 1 - k)} for k in range(levels)}
    return Measured(levels, _run(chain, levels, groups), _run(one, levels, {"all": {"max_step": _STEP}}))


def _run(model: Model, levels: int, groups: dict[str, dict[str, float]]) -> tuple[float, float]:
    """Method arithmetic and evaluations of one state's right-hand side."""
    named = dict(zip([g.name for g in model.plan.groups], groups.values(), strict=True))
    chosen = settings("abm5", _LOOSE)
    finished = run(model, _STOP, chosen, named)
    priced = prices(model, _STOP, chosen, named)
    works = [p.work(g.stats) for p, g in zip(priced, finished.groups, strict=True)]
    arithmetic = sum(w.total - w.right_hand_sides for w in works)
    evaluations = sum(len(g.initial) * g.stats["evaluations"] for g in finished.groups)
    return arithmetic, float(evaluations)


def _chain(levels: int) -> str:
    """A level reads all levels above, as the formula has it."""
    lines = []
    for k in range(levels):
        reads = "".join(f"read real u{j}; " for j in range(k))
        drive = "".join(f" + 0.1*u{j}" for j in range(k))
        lines.append(f"agent L{k}() {{ {reads}write real x = 0; diff {{ x' = (1{drive} - x)*1 [1/s]; }} }}")
    levels_text = []
    for k in range(levels):
        given = ", ".join(f"u{j} := a{j}.x" for j in range(k))
        levels_text.append(f"  level l{k} {{ agent a{k} = L{k}()" + (f" [{given}]" if given else "") + "; }")
    return "\n".join([*lines, "agent Top() {", *levels_text, "}"])


def _one(levels: int) -> str:
    """The same equations as one agent."""
    names = ", ".join(f"x{k} = 0" for k in range(levels))
    lines = [
        f"    x{k}' = (1{''.join(f' + 0.1*x{j}' for j in range(k))} - x{k})*1 [1/s];" for k in range(levels)
    ]
    return "\n".join(["agent One() {", f"  write real {names};", "  diff {", *lines, "  }", "}"])
