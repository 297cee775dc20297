"""What an agent sees of the arrays of agents in it: numbers of variables, element by element, on whole columns.

Part of the phase `flatten.py`; names of single agents are in `scope.py`, sums and extremes in `reductions.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hierc.compiler.arrays.columns import Column, Index, Integers, column, expanded
from hierc.compiler.arrays.domains import Domain
from hierc.compiler.arrays.errors import OutOfArray, ShapesOfElements
from hierc.compiler.collector import Rejected
from hierc.compiler.equations.errors import DerivativeOfRead, NotAState
from hierc.compiler.expression import Expr, Gather, Rate, State
from hierc.compiler.resolve.declarations import Variable
from hierc.compiler.shapes.environment import Chosen, Environment, Values
from hierc.compiler.shapes.values import Shape, Value, size_of
from hierc.compiler.structure.fan_in import FanIns
from hierc.compiler.structure.instances import Array, Instance
from hierc.compiler.structure.storage import Kind, Storage
from hierc.compiler.walk import subscripts, visit
from hierc.grammar import tree
from hierc.grammar.source import Span


class Owner(Protocol):
    """What a scope asks for."""

    storage: Storage
    fan_ins: FanIns

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

    def spread(self, instance: Instance, view: View, env: Environment) -> Environment:
        """`env` for elements of a domain of their own that see an agent."""
        ...

    def deciding(self, instance: Instance, domain: Domain, env: Environment) -> Environment:
        """`env` for what elements of such a domain know of an agent when compiling."""
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
class Reader:
    """Who looks: an agent, or with `view` the elements of an array inside it."""

    owner: Owner
    instance: Instance
    view: View | None

    def elements(self, ref: tree.Ref, array: Array, chosen: Chosen | None) -> Value:
        """A variable of elements of an array: of one, of a slice, or of all."""
        name, kind = self.variable(ref, array)
        indices: tuple[Index, ...] = chosen.indices if chosen is not None else tuple(all_of(array))
        several = chosen is None or chosen.several
        places = [self.slots(array, index, chosen) for index in indices]
        shape = self.shape(array, name, ref, places)
        tables = self.tables(array, name, shape)
        leaves = tuple(
            self._own(array, name, k, place, kind, ref.span) or Gather(ref.span, kind, column(table[place]))
            for place in places
            for k, table in enumerate(tables)
        )
        return Value("real", (len(indices), *shape) if several else shape, leaves)

    def variable(self, ref: tree.Ref, array: Array) -> tuple[str, Kind]:
        """The variable of an array's agents that a reference names, and what it is of it."""
        name = ref.path.steps[1].name.text
        first = self.owner.instance(array.blocks[0])
        variable = first.agent.variables.get(name)
        if ref.prime:
            self.check_rate(ref, first, name, variable)
        if variable is None or variable.decl.access == "read":
            raise Rejected  # not visible: reported
        return name, "rate" if ref.prime else "algebraic" if variable.declarator.initial is None else "state"

    def seen(self, numbers: Integers, span: Span) -> Expr:
        """An algebraic variable of each element of the agent, as those that look at it see it."""
        return Gather(span, "algebraic", column(numbers if self.view is None else numbers[self.view.places]))

    def shape(self, array: Array, name: str, ref: tree.Ref, places: Sequence[Integers] = ()) -> Shape:
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

    def tables(self, array: Array, name: str, shape: Shape) -> list[Integers]:
        """For each scalar of a variable, its number in every element of the array that has this shape, in all elements of the agent around it."""
        total = sum(len(slots) for slots in array.slots)
        tables = [np.zeros(total, np.int64) for _ in range(size_of(shape))]
        for block, slots in zip(array.blocks, array.slots, strict=True):
            if self.owner.storage.shapes[block].get(name) == shape:
                numbers = self.owner.storage.numbers(self.owner.instance(block), name)
                for table, own in zip(tables, numbers, strict=True):
                    table[slots] = own
        return tables

    @property
    def domain(self) -> Domain:
        """The elements that look."""
        return self.instance.domain if self.view is None else self.view.domain

    @property
    def places(self) -> Integers:
        """Where each of them stands in the agent's domain."""
        return np.arange(self.instance.domain.count) if self.view is None else self.view.places

    def slots(self, array: Array, index: Index, chosen: Chosen | None) -> Integers:
        """The place of the element with this index, for each element that looks."""
        wanted = expanded(index, self.domain.count)
        outside = (wanted < array.first) | (wanted >= array.first + array.size)
        if outside.any() and chosen is not None:
            raise Rejected(self._out_of(array, int(np.argmax(outside)), wanted, index, chosen.step))
        return self.places * array.size + wanted - array.first

    def _out_of(self, array: Array, at: int, wanted: Integers, index: Index, step: tree.Step) -> OutOfArray:
        """The problem of an index that is not there, with the first element that asks for it, where the element decides."""
        name: str | None = None
        where: tuple[str, ...] = ()
        if self.view is not None and (isinstance(index, Column) or _uses(step, self.view.index)):
            name = self.view.index
            where = (f"{name} = {self.view.domain.indices[-1][at]}",)
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

    def check_rate(self, ref: tree.Ref, at: Instance, name: str, variable: Variable | None) -> None:
        """Refuse the derivative of what is no state."""
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


def all_of(array: Array) -> range:
    """The indices of an array."""
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


def _uses(step: tree.Step, index: str) -> bool:
    """Whether a subscript is computed with an index, even where all that ask have the same."""
    used = (here.node for sub in subscripts(step.subs) for here in visit(sub))
    return any(isinstance(node, tree.Ref) and node.path.text == index for node in used)
