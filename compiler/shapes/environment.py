"""Environments: what evaluation needs to know: the names of a scope, how to share, and how much work is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from hierc.compiler.arrays.columns import Index, added, difference
from hierc.compiler.collector import Rejected
from hierc.compiler.expression import Expr
from hierc.compiler.resolve.declarations import Library
from hierc.compiler.resolve.errors import ModelTooLarge
from hierc.compiler.shapes.errors import NotAKnownInteger
from hierc.compiler.shapes.operations import Reduction, Sharing
from hierc.compiler.shapes.values import Value
from hierc.grammar import tree

#: Scalar operations that all expressions of a model may have before sharing.
MAX_OPERATIONS = 1_000_000

#: Functions that make one scalar of all elements of an array.
REDUCTIONS: Mapping[str, Reduction] = {"sum": "add", "min": "min", "max": "max"}


@dataclass(frozen=True, slots=True)
class Chosen:
    """Elements of an array of agents that a reference names by their indices: `car[i - 1]`, or several, `car[2..5]`."""

    indices: tuple[Index, ...]
    several: bool
    step: tree.Step


@dataclass(frozen=True, slots=True)
class Ends:
    """The ends of a range, in a subscript or after `in`, both included. Where they differ between elements, so may the length."""

    first: Index
    last: Index
    node: tree.Range

    @property
    def length(self) -> int | None:
        """How many indices there are; None if that differs."""
        longer = difference(self.last, self.first)
        return max(longer + 1, 0) if isinstance(longer, int) else None

    def indices(self) -> list[Index]:
        """All of them. Raises Rejected (E305) where the length differs."""
        length = self.length
        if length is None:
            raise Rejected(
                NotAKnownInteger(self.node.span, what="length of a range", text=self.node.span.text)
            )
        return [added(self.first, k) for k in range(length)]


#: What a subscript chooses: one index, or a range.
Axis = Index | Ends


class Scope(Protocol):
    """What names stand for."""

    def lookup(self, ref: tree.Ref, chosen: Chosen | None) -> Value:
        """The whole value that a reference names, before its last subscripts are applied."""
        ...

    def reduced(
        self, call: tree.Call, ref: tree.Ref, agents: Axis | None, axes: Sequence[Axis]
    ) -> Value | None:
        """A sum or extreme of a variable over many agents of an array, computed by itself; None where `ref` names no such thing, or few.

        `agents`: those that are chosen, None for all; `axes`: what the subscripts after the variable choose. Raises Rejected where slices of
        different lengths cannot be joined.
        """
        ...

    def reduced_over(
        self, call: tree.Call, comprehension: tree.Comprehension, indices: Axis, env: Environment
    ) -> Value | None:
        """The same of an expression for each of many indices; None where there are few, or it cannot be evaluated for all of them alike."""
        ...


class Gathering(Protocol):
    """How elements of an array take different scalars."""

    def leaf(self, expr: Expr) -> Expr:
        """A leaf as a `Gather` where that is possible; else as it is."""
        ...

    def table(self, numbers: tuple[float, ...]) -> int:
        """The first of the entries of the parameter vector that hold these numbers."""
        ...


class NoAgents:
    """Base of scopes without agents: there is nothing to sum over."""

    __slots__ = ()

    def reduced(
        self, call: tree.Call, ref: tree.Ref, agents: Axis | None, axes: Sequence[Axis]
    ) -> Value | None:
        """See `Scope`."""
        return None

    def reduced_over(
        self, call: tree.Call, comprehension: tree.Comprehension, indices: Axis, env: Environment
    ) -> Value | None:
        """See `Scope`."""
        return None


@dataclass(frozen=True, slots=True)
class Values(NoAgents):
    """A scope of values by name. `refused` has names with a problem that is reported where they are used; a name that is missing
    altogether had one that was reported.
    """

    by_name: Mapping[str, Value]
    refused: Mapping[str, Rejected] = field(default_factory=dict)

    def lookup(self, ref: tree.Ref, chosen: Chosen | None = None) -> Value:
        """The value of the name, at the place where it is used."""
        value = self.by_name.get(ref.path.text)
        if value is None:
            raise self.refused.get(ref.path.text, Rejected())
        return value.at(ref.span)


class Budget:
    """Counts the work of a compilation, so that no model can take all memory."""

    def __init__(self, limit: int = MAX_OPERATIONS) -> None:
        self._left = self._limit = limit

    def spend(self, count: int, node: tree.Node) -> None:
        """Take `count` from what is left; raises Rejected (E217) when nothing is."""
        self._left -= count
        if self._left < 0:
            raise Rejected(
                ModelTooLarge(node.span, what="operations in the equations of this model", limit=self._limit)
            )


@dataclass(frozen=True, slots=True)
class Environment:
    """All that evaluation needs. `indices` are the names bound by `for` and by function calls."""

    library: Library
    constants: Mapping[str, Value]  # of the file, and the built-in ones
    scope: Scope
    sharing: Sharing
    budget: Budget
    indices: Mapping[str, Value] = field(default_factory=dict)
    gathering: Gathering | None = None  # where there are arrays of agents

    def bind(self, name: str, value: Value) -> Environment:
        """The environment inside a `for`, where `name` is `value`."""
        return replace(self, indices={**self.indices, name: value})
