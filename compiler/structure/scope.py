"""Scopes of agents whose variables have their places: what a name of an agent is, for the agent itself and for the elements of an array inside it.

Part of the phase `flatten.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from hierc.compiler.arrays.columns import Column, Index, Integers, column, expanded
from hierc.compiler.arrays.domains import Domain, indexed_domain
from hierc.compiler.arrays.errors import NotAnArray, OutOfArray, ShapesOfElements
from hierc.compiler.collector import Rejected
from hierc.compiler.equations.errors import DerivativeOfRead, NotAState
from hierc.compiler.expression import Expr, Gather, Rate, State
from hierc.compiler.resolve.declarations import Variable
from hierc.compiler.shapes.environment import Chosen, Environment, Reduction, Values
from hierc.compiler.shapes.evaluate import evaluate
from hierc.compiler.shapes.values import Shape, Value, index_value, scalar_of, size_of
from hierc.compiler.structure.instances import Array, Instance
from hierc.compiler.structure.storage import Storage
from hierc.compiler.walk import visit
from hierc.grammar import tree
from hierc.grammar.source import Span

Kind = Literal["state", "rate", "algebraic"]
#: Scalars of an array up to which a sum over them is written out.
FEW = 32


class Owner(Protocol):
    """What a scope asks for."""

    storage: Storage

    def instance(self, index: int) -> Instance:
        """The instance with this id."""
        ...

    def parameters_of(self, instance: Instance) -> Values:
        """Parameters, constants and `let`s of them."""
        ...

    def named_of(self, instance: Instance, name: str) -> Value | None:
        """A `let` or coupling; None if it was refused."""
        ...

    def placed(self, value: Value, span: Span) -> Value:
        """A `let` or coupling used at `span`."""
        ...

    def fan_in(
        self, operation: Reduction, kind: Kind, scalars: Integers, around: Instance, span: Span
    ) -> Integers:
        """The algebraic variables, one for each element of `around`, that join the scalars numbered in its row."""
        ...

    def spread(self, scope: InstanceScope, env: Environment) -> Environment:
        """`env` for elements of a domain of their own that see an agent as `scope` has it."""
        ...

    def computed(self, expr: Expr, around: Instance, domain: Domain, span: Span) -> Integers:
        """Algebraic variables, one for each element of `domain`, that stand for `expr`."""
        ...

    def brought(self, value: Value, view: View) -> Value:
        """A value of an agent as the elements of an array inside it have it."""
        ...


@dataclass(frozen=True, slots=True)
class View:
    """Elements of an array that look at the agent around them. `places`: where each stands in the agent's own domain; `index`: of the array."""

    domain: Domain
    places: Integers
    index: str


@dataclass(frozen=True, slots=True)
class InstanceScope:
    """The names of one agent: its parameters and constants, its variables and `let`s, the `write` variables of its sub-agents.

    `view`: whose elements see it; None for the agent itself.
    """

    owner: Owner
    instance: Instance
    view: View | None = None

    def lookup(self, ref: tree.Ref, chosen: Chosen | None) -> Value:
        """The value of a reference, without its last subscripts. Raises Rejected for what has none."""
        steps = ref.path.steps
        at, name = self.instance, steps[0].name.text
        if len(steps) > 1:
            if name in at.arrays:
                return self._elements(ref, at.arrays[name], chosen)
            if chosen is not None:
                raise Rejected(NotAnArray(chosen.step.span, name=name, arrays=tuple(at.arrays)))
            if name not in at.children:
                raise Rejected  # it was refused
            at, name = self.owner.instance(at.children[name]), steps[1].name.text
        value = self._of(ref, at, name)
        return value if self.view is None else self.owner.brought(value, self.view)

    def _of(self, ref: tree.Ref, at: Instance, name: str) -> Value:
        """A name of a single agent."""
        variable = at.agent.variables.get(name)
        if ref.prime:
            return self._rate(ref, at, name, variable)
        if variable is not None and variable.decl.access != "read":
            return self.owner.storage.value(at, name, ref.span)
        named = self.owner.named_of(at, name)
        if named is not None:
            return self.owner.placed(named, ref.span)
        value = (
            self.owner.parameters_of(at).by_name.get(name)
            if name not in at.agent.lets and variable is None
            else None
        )
        if value is None:
            raise Rejected
        return value.at(ref.span)

    def _rate(self, ref: tree.Ref, at: Instance, name: str, variable: Variable | None) -> Value:
        self._check_rate(ref, at, name, variable)
        value = self.owner.storage.value(at, name, ref.span)
        return replace(
            value, elements=tuple(Rate(ref.span, e.index) for e in value.elements if isinstance(e, State))
        )

    def _check_rate(self, ref: tree.Ref, at: Instance, name: str, variable: Variable | None) -> None:
        if variable is not None and variable.decl.access == "read":
            raise Rejected(DerivativeOfRead(ref.span, name=name, example=self._bound_to(name)))
        if variable is None or variable.declarator.initial is None:
            raise Rejected(NotAState(ref.span, name=ref.path.text, matrix=_is_matrix(at, name)))

    def _bound_to(self, name: str) -> str | None:
        """What the user's coupling gives for a read variable, if it is a single name."""
        if self.instance.instance is None:
            return None
        bound = (bind.value for bind in self.instance.instance.bindings if bind.name.text == name)
        value = next(bound, None)
        return value.path.text if isinstance(value, tree.Ref) and not value.prime else None

    # ---- arrays -------------------------------------------------------------------------------------------------------------------

    def _elements(self, ref: tree.Ref, array: Array, chosen: Chosen | None) -> Value:
        """A variable of elements of an array: of one, of a slice, or of all."""
        name, kind = self._variable(ref, array)
        indices: tuple[Index, ...] = chosen.indices if chosen is not None else tuple(_all(array))
        several = chosen is None or chosen.several
        places = [self._slots(array, index, chosen) for index in indices]
        shape = self._shape(array, name, ref, places)
        tables = self._tables(array, name, shape)
        leaves = tuple(
            self._own(array, name, k, place, kind, ref.span) or Gather(ref.span, kind, column(table[place]))
            for place in places
            for k, table in enumerate(tables)
        )
        return Value("real", (len(indices), *shape) if several else shape, leaves)

    def _variable(self, ref: tree.Ref, array: Array) -> tuple[str, Kind]:
        """The variable of an array's agents that a reference names, and what it is of it."""
        name = ref.path.steps[1].name.text
        first = self.owner.instance(array.blocks[0])
        variable = first.agent.variables.get(name)
        if ref.prime:
            self._check_rate(ref, first, name, variable)
        if variable is None or variable.decl.access == "read":
            raise Rejected  # not visible: reported
        return name, "rate" if ref.prime else "algebraic" if variable.declarator.initial is None else "state"

    def reduced(
        self, operation: Reduction, ref: tree.Ref, chosen: Chosen | None, subs: list[list[Index]]
    ) -> Value | None:
        """See `evaluate.Scope`. Elements of an array that look at the same agent around them share what it makes."""
        array = self.instance.arrays.get(ref.path.steps[0].name.text)
        if array is None or (chosen is not None and not chosen.several):
            return None
        name, kind = self._variable(ref, array)
        indices: Sequence[Index] = _all(array) if chosen is None else chosen.indices
        shape = self._shape(array, name, ref)
        picked = _picked(len(indices), shape, subs)
        if picked is None or len(picked[0]) * len(picked[1]) <= FEW:
            return None
        rows, scalars = picked
        numbers = [index for row in rows if isinstance(index := indices[row], int)]
        if len(numbers) < len(rows):
            return None  # every element has its own
        slots = np.array(numbers) - array.first
        outside = (slots < 0) | (slots >= array.size)
        if outside.any():
            self._slots(array, numbers[int(np.argmax(outside))], chosen)  # refuses it
        around = np.arange(self.instance.domain.count)[:, None] * array.size + slots
        tables = self._tables(array, name, shape)
        joined = np.concatenate([tables[k][around] for k in scalars], axis=1)
        made = self.owner.fan_in(operation, kind, joined, self.instance, ref.span)
        return scalar_of("real", self._seen(made, ref.span))

    def reduced_over(
        self, operation: Reduction, comprehension: tree.Comprehension, indices: list[Index], env: Environment
    ) -> Value | None:
        """See `evaluate.Scope`. The expression is evaluated once, for an array of elements that have nothing but their index."""
        numbers = [index for index in indices if isinstance(index, int)]
        if self.view is not None or len(numbers) < len(indices) or len(numbers) <= FEW:
            return None
        if not any(name in self.instance.arrays for name in _first_names(comprehension.item)):
            return None
        domain = indexed_domain(self.instance.domain, np.array(numbers))
        index = comprehension.over.index.text
        inner = self.owner.spread(replace(self, view=View(domain, domain.places, index)), env)
        try:
            value = evaluate(
                comprehension.item,
                inner.bind(index, scalar_of("int", index_value(column(domain.indices[-1])))),
            )
        except Rejected:
            return None  # what is wrong with it is said for a single index
        if value.shape != () or value.scalar == "bool":
            return None
        span = comprehension.span
        each = self.owner.computed(value.single, self.instance, domain, span)
        joined = each.reshape(self.instance.domain.count, -1)
        made = self.owner.fan_in(operation, "algebraic", joined, self.instance, span)
        return scalar_of(value.scalar, self._seen(made, span))

    def _seen(self, numbers: Integers, span: Span) -> Expr:
        """An algebraic variable of each element of the agent, as those that look at it see it."""
        return Gather(span, "algebraic", column(numbers if self.view is None else numbers[self.view.places]))

    def _shape(self, array: Array, name: str, ref: tree.Ref, places: Sequence[Integers] = ()) -> Shape:
        """The shape of a variable in the elements at these places, or in all."""
        found = [self.owner.storage.shapes[block].get(name) for block in array.blocks]
        shapes = [shape for shape in found if shape is not None]
        if len(shapes) < len(found):
            raise Rejected  # reported
        if len(set(shapes)) > 1 and places:
            asked = np.concatenate(places)
            shapes = [s for s, own in zip(shapes, array.slots, strict=True) if np.isin(asked, own).any()]
        if len(set(shapes)) > 1:
            raise Rejected(ShapesOfElements(ref.span, name=ref.span.text))
        return shapes[0]

    def _tables(self, array: Array, name: str, shape: Shape) -> list[Integers]:
        """For each scalar of a variable, its number in every element of the array that has this shape, in all elements of the agent around it."""
        total = sum(len(slots) for slots in array.slots)
        tables = [np.zeros(total, np.int64) for _ in range(size_of(shape))]
        for block, slots in zip(array.blocks, array.slots, strict=True):
            if self.owner.storage.shapes[block].get(name) == shape:
                numbers = self.owner.storage.numbers(self.owner.instance(block), name)
                for table, own in zip(tables, numbers, strict=True):
                    table[slots] = own
        return tables

    def _slots(self, array: Array, index: Index, chosen: Chosen | None) -> Integers:
        """The place of the element with this index, for each element that looks."""
        domain = self.view.domain if self.view is not None else self.instance.domain
        places = self.view.places if self.view is not None else np.arange(domain.count)
        wanted = expanded(index, domain.count)
        outside = (wanted < array.first) | (wanted >= array.first + array.size)
        if outside.any() and chosen is not None:
            raise Rejected(self._out_of(array, int(np.argmax(outside)), wanted, index, chosen.step))
        return places * array.size + wanted - array.first

    def _out_of(self, array: Array, at: int, wanted: Integers, index: Index, step: tree.Step) -> OutOfArray:
        name = self.view.index if self.view is not None and isinstance(index, Column) else None
        own = self.view.domain.indices[-1] if self.view is not None else None
        where = (f"{name} = {own[at]}",) if name is not None and own is not None else ()
        last = array.first + array.size - 1
        return OutOfArray(
            step.span,
            text=step.span.text,
            index=int(wanted[at]),
            first=array.first,
            last=last,
            where=where,
            index_name=name,
        )

    def _own(self, array: Array, name: str, k: int, places: Integers, kind: Kind, span: Span) -> Expr | None:
        """The elements' own variable, if that is what each of them names: then it is no other element's."""
        if self.view is None:
            return None
        for block, slots in zip(array.blocks, array.slots, strict=True):
            instance = self.owner.instance(block)
            if instance.domain is self.view.domain and np.array_equal(slots, places):
                leaf = self.owner.storage.value(instance, name, span).elements[k]
                return Rate(span, leaf.index) if kind == "rate" and isinstance(leaf, State) else leaf
        return None


def _picked(count: int, shape: Shape, subs: list[list[Index]]) -> tuple[list[int], list[int]] | None:
    """The agents, and of each the scalars, that subscripts after `car.p` choose; None where they are no such choice."""
    if not subs:
        return list(range(count)), list(range(size_of(shape)))
    chosen = [[index - 1 for index in axis if isinstance(index, int)] for axis in subs]
    sizes = (count, *shape)
    inside = all(0 <= i < size for axis, size in zip(chosen, sizes, strict=False) for i in axis)
    if (
        len(subs) != len(sizes)
        or not inside
        or any(len(c) < len(s) for c, s in zip(chosen, subs, strict=True))
    ):
        return None
    scalars = [0]
    for axis, size in zip(chosen[1:], shape, strict=True):
        scalars = [place * size + i for place in scalars for i in axis]
    return chosen[0], scalars


def _first_names(expr: tree.Expr) -> Iterator[str]:
    """The names that references in an expression start with."""
    return (here.node.path.steps[0].name.text for here in visit(expr) if isinstance(here.node, tree.Ref))


def _all(array: Array) -> range:
    return range(array.first, array.first + array.size)


def _is_matrix(owner: Instance, name: str) -> bool:
    """Whether a variable, parameter or constant is declared as a matrix."""
    agent = owner.agent
    declared = (
        agent.variables[name].decl
        if name in agent.variables
        else agent.params.get(name) or agent.consts.get(name)
    )
    return declared is not None and len(declared.type.sizes) == 2
