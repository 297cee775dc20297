"""Variables for results: those of single agents, and those of whole arrays.

In: instances with the places of their variables and what their reads are bound to. Out: a `FlatVariable` for each variable of the outline. Part of the phase
`flatten.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from hierc.compiler.arrays.columns import Integers, column, expanded
from hierc.compiler.expression import Expr, Gather, Local, State
from hierc.compiler.resolve.declarations import Variable
from hierc.compiler.shapes.values import Shape, Value
from hierc.compiler.structure.flat import FlatVariable
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.storage import Storage
from hierc.compiler.units.units import scale_of


def flat_variables(
    instances: Sequence[Instance], storage: Storage, named: Sequence[Mapping[str, Value]]
) -> Iterator[FlatVariable]:
    """All variables, in text order. `named`: what the `read` variables of each instance are."""
    blocks: dict[int, list[Instance]] = {}
    for instance in instances:
        blocks.setdefault(instance.outline, []).append(instance)
    finder = _Finder(storage, named)
    for family in blocks.values():
        for variable in family[0].agent.variables.values():
            for alike in _alike(family, variable.name, storage):
                yield finder.variable(alike, variable)


def _alike(family: Sequence[Instance], name: str, storage: Storage) -> list[list[Instance]]:
    """The blocks of an array, those together in which a variable has the same shape."""
    shapes: dict[Shape, list[Instance]] = {}
    for instance in family:
        shapes.setdefault(storage.shapes[instance.id][name], []).append(instance)
    return list(shapes.values())


class _Finder:
    """Finds the scalars of variables."""

    def __init__(self, storage: Storage, named: Sequence[Mapping[str, Value]]) -> None:
        self._storage = storage
        self._named = named

    def variable(self, blocks: Sequence[Instance], variable: Variable) -> FlatVariable:
        """One variable of all blocks, its elements in the order of their indices."""
        first = blocks[0]
        unit = variable.declarator.unit
        indices = [np.concatenate(c) for c in zip(*(b.domain.indices for b in blocks), strict=True)]
        order = np.lexsort(indices[::-1]) if indices else np.zeros(1, np.int64)
        return FlatVariable(
            first.named(variable.name), self._storage.shapes[first.id][variable.name],
            unit.text if unit else None, variable.decl.doc, variable.decl.access,
            self._elements(blocks, variable, order), variable.span, scale_of(unit),
            len(order), tuple(column(c[order]) for c in indices),
        )  # fmt: skip

    def _elements(
        self, blocks: Sequence[Instance], variable: Variable, order: Integers
    ) -> tuple[State | Local | Gather, ...] | None:
        """The leaves of a variable; those of a `read` only where it is bound to variables."""
        values = [self._value(block, variable) for block in blocks]
        if len(blocks) == 1 and blocks[0].domain.count == 1:
            found = [e for e in values[0].elements if self._is_variable(e)]
            own = tuple(e for e in found if isinstance(e, State | Local | Gather))
            return own if len(own) == len(values[0].elements) else None
        gathered: list[Gather] = []
        for scalar in zip(*(value.elements for value in values), strict=True):
            leaves = [self._storage.gathered(e) for e in scalar]
            found_gathers = [leaf for leaf in leaves if isinstance(leaf, Gather)]
            kinds = {leaf.kind for leaf in found_gathers}
            if len(found_gathers) < len(leaves) or len(kinds) > 1 or not kinds <= {"state", "algebraic"}:
                return None
            columns = [
                expanded(leaf.at, block.domain.count)
                for leaf, block in zip(found_gathers, blocks, strict=True)
            ]
            gathered.append(replace(found_gathers[0], at=column(np.concatenate(columns)[order])))
        return tuple(gathered)

    def _value(self, block: Instance, variable: Variable) -> Value:
        if variable.decl.access == "read":
            return self._named[block.id][variable.name]
        return self._storage.value(block, variable.name, variable.span)

    def _is_variable(self, leaf: Expr) -> bool:
        match leaf:
            case State():
                return True
            case Local(index=index):
                return index < len(self._storage.algebraic)
            case Gather(kind=kind):
                return kind in ("state", "algebraic")
            case _:
                return False
