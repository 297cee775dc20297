"""Sharing: what is used more than once becomes a definition, and so does what is too deep. Part of the phase `flatten.py`."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from hierc.compiler.arrays.columns import column
from hierc.compiler.arrays.domains import Domain
from hierc.compiler.expression import Expr, Gather, Local, Rate, State
from hierc.compiler.shapes.terms import cut, rewritten
from hierc.compiler.shapes.values import Value, is_leaf
from hierc.compiler.structure.array_reads import View
from hierc.compiler.structure.flat import FlatDefinition
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.parameters import moved
from hierc.compiler.structure.storage import Storage
from hierc.grammar.source import Span


class Definitions:
    """The definitions of the flat model made so far: the algebraic variables of `storage`, still without values, and what is shared."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage
        self.made: list[FlatDefinition] = list(storage.algebraic)
        #: Definitions of an agent that were copied for the elements of an array inside it: by definition and domain.
        self._copies: dict[tuple[int, Domain], Expr] = {}

    def define(self, name: str, at: Instance, expr: Expr, span: Span, *, hidden: bool = False) -> Expr:
        """A leaf that stands for `expr`, which the elements of `at` use."""
        if is_leaf(expr):
            return expr
        value = self.shallow(expr, name, at)
        return self._add(name, at.named(name), value, span, at.domain, hidden=hidden)

    def shallow(self, expr: Expr, name: str, at: Instance) -> Expr:
        """`expr` with its deep parts cut out into definitions of their own."""

        def part(deep: Expr) -> Expr:
            span = deep.span or at.agent.definition.name.span
            return self._add(f"part of {name}", at.named(name), deep, span, at.domain, hidden=True)

        return cut(expr, part)

    def is_variable(self, leaf: Local) -> bool:
        """Whether a leaf is a variable of the user's, not a `let` or what was put in here."""
        return self.made[leaf.index].owner is not None

    def unfolded(self, expr: Expr) -> Expr:
        """`expr`, which is not deep, with the values of what was put in here, but not of what these use."""

        def value(leaf: Expr) -> Expr:
            if isinstance(leaf, Local) and not self.is_variable(leaf):
                return self.made[leaf.index].value
            return leaf

        return rewritten(expr, value)

    def placed(self, value: Value, span: Span) -> Value:
        """A `let` or coupling used at `span`. Variables in it stay where the text names them: that is what a problem points at."""
        elements = (
            replace(e, span=span) if isinstance(e, Local) and not self.is_variable(e) else e
            for e in value.elements
        )
        return replace(value, elements=tuple(elements))

    def brought(self, value: Value, view: View) -> Value:
        """A value of an agent as the elements of an array inside it have it.

        What is the same for all elements stays as it is; a `let` of an agent that has several elements is copied.
        """
        outer = view.domain.outer
        if outer is None or outer.count == 1:
            return value
        return replace(value, elements=tuple(self.brought_to(view, e) for e in value.elements))

    def brought_to(self, view: View, expr: Expr) -> Expr:
        """The same of an expression, whatever stands around the array."""
        return rewritten(expr, lambda leaf: self._brought(leaf, view))

    def _brought(self, leaf: Expr, view: View) -> Expr:
        storage, places = self._storage, view.places
        match leaf:
            case State(index=slot) | Rate(index=slot):
                kind: Literal["state", "rate"] = "state" if isinstance(leaf, State) else "rate"
                state = storage.states[slot]
                if storage.nodes[state.node].instance.domain.count == 1:
                    return leaf
                return Gather(leaf.span, kind, column(state.first + places))
            case Gather():
                return moved(leaf, places)
            case Local(index=index):
                return self._copied(leaf, index, view)
            case _:
                return leaf

    def _copied(self, leaf: Local, index: int, view: View) -> Expr:
        """A definition of the agent around an array, for the elements of the array."""
        definition = self.made[index]
        if definition.domain.count == 1:
            return leaf
        if definition.owner is not None:
            return Gather(leaf.span, "algebraic", column(definition.first + view.places))
        key = (index, view.domain)
        if key not in self._copies:
            value = self.brought_to(view, definition.value)
            self._copies[key] = value if is_leaf(value) else self._copy(definition, value, view.domain)
        return replace(self._copies[key], span=leaf.span)

    def _copy(self, definition: FlatDefinition, value: Expr, domain: Domain) -> Local:
        d = definition
        return self._add(d.name, d.path, value, d.span, domain, hidden=d.hidden)

    def _add(self, name: str, path: str, value: Expr, span: Span, domain: Domain, *, hidden: bool) -> Local:
        self.made.append(FlatDefinition(name, path, value, span, None, hidden, domain))
        return Local(span, len(self.made) - 1)
