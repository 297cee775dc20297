"""What expressions may use of arrays of agents besides their vectors: sums and extremes over many, sums over as many as an index says."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING

from making.expressions import Leaf
from making.units import SECOND, over, times

if TYPE_CHECKING:
    from making.models import Sub, Variable

#: How many agents an array has that is looked at only as a whole: more than a sum over them is written out for.
MANY = ("34", "36")


def fans(rng: Random, sub: Sub, write: Variable, *, safe: bool = False) -> list[Leaf]:
    """Numbers made of one variable of all agents of an array, or of most."""
    name, w, last = sub.name, write.name, sub.count
    item = f"{name}[m].{w}"
    size = f"norm({item})" if len(write.shape) == 1 else f"abs({item})"
    found = [f"{f}({name}.{w})" for f in ("sum", "min", "max")] + [f"sum({name}[3..{last}].{w})"]
    leaves = [Leaf(text, (), write.unit) for text in found]
    if len(write.shape) < 2:
        each = (f"sum([{size} for m in 1..{last}])", f"max([{size} for m in 2..{last} - 1])")
        leaves += [Leaf(text, (), write.unit) for text in each]
        square = f"dot({item}, {item})" if write.shape else f"{item}^2"
        leaves.append(Leaf(f"sum([{square}/m for m in 1..{last}])", (), times(write.unit, write.unit)))
    return [Leaf(x.text, (), x.unit, safe, names=(name,)) for x in rng.sample(leaves, 2)]


def partial_sums(sub: Sub, index: str, others: list[Sub]) -> list[Leaf]:
    """For an element of an array: sums over the elements before it, over states of those after it, and over parts of arrays that are there already."""
    found: list[Leaf] = []
    for w in sub.agent.writes:
        found.append(_sum(sub, f"1..{index} - 1", w))
        if w.safe:
            found += [_sum(sub, f"{index}..{sub.count}", w), _sum(sub, f"1..{index} - 1", w, rate=True)]
    for other in others:
        for w in other.agent.writes:
            found += [_sum(other, f"1..{index}", w), _sum(other, f"{index} + 1..{other.count}", w)]
    return found


def _sum(sub: Sub, part: str, write: Variable, *, rate: bool = False) -> Leaf:
    unit = over(write.unit, SECOND) if rate else write.unit
    return Leaf(f"sum({sub.name}[{part}].{write.name}{chr(39) * rate})", (), unit, names=(sub.name,))
