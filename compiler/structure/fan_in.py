"""Fan-ins: sums and extremes over many agents of an array, as trees of nodes of their own.

A node joins some scalars, those of the next layer join these; all nodes of a layer are one block, or two where they join unequal numbers. So
neither the equations nor the generated code grow with the array, and who reads the same sum shares it. Part of the phase `flatten.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from hierc.compiler.arrays.columns import Integers, column
from hierc.compiler.arrays.domains import inner_domain
from hierc.compiler.expression import Apply, Choose, Expr, Gather, Number
from hierc.compiler.shapes.operations import Reduction
from hierc.compiler.structure.flat import FlatDefinition, FlatNode
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.slices import Row, Slices
from hierc.compiler.structure.storage import Kind, Storage
from hierc.grammar.source import Span

#: Most scalars that one node joins; fewer where the derivatives by them need conditions.
WIDTHS: dict[Reduction, int] = {"add": 32, "min": 8, "max": 8}
#: Scalars up to which a sum over an array is written out.
FEW = 32
#: What is joined: how, of which kind, and which scalars.
_Key = tuple[Reduction, Kind, tuple[int, ...], bytes]
_NAMES: dict[Reduction, str] = {"add": "sum", "min": "min", "max": "max"}


@dataclass(slots=True)
class FanIns:
    """The nodes and definitions made so far; they follow those of `storage`."""

    storage: Storage
    nodes: list[FlatNode] = field(default_factory=list)
    definitions: list[FlatDefinition] = field(default_factory=list)
    _made: dict[_Key, Integers] = field(default_factory=dict)
    _rows: dict[_Key, Row] = field(default_factory=dict)
    _count: int = 0

    def joined(
        self, operation: Reduction, kind: Kind, scalars: Integers, around: Instance, span: Span
    ) -> Integers:
        """For each row of `scalars`, numbers as `Gather` has them, the algebraic variable that joins it. Rows belong to the elements of `around`."""
        key = (operation, kind, scalars.shape, scalars.tobytes())
        if key not in self._made:
            at: Kind = kind
            layer = scalars
            while layer.shape[1] > 1:
                layer, at = self._layer(operation, at, layer, around, span), "algebraic"
            self._made[key] = layer[:, 0]
        return self._made[key]

    def sliced(
        self,
        operation: Reduction,
        kind: Kind,
        scalars: Integers,
        slices: Slices,
        around: Instance,
        span: Span,
    ) -> Integers:
        """The algebraic variables that join slices of the rows of `scalars`, each alone. The sum of nothing is 0."""
        key = (operation, kind, scalars.shape, scalars.tobytes())
        if key not in self._rows:

            def made(kind: Kind, scalars: Integers, sizes: Integers, places: Integers) -> Integers:
                return self._block(operation, kind, scalars, sizes, places, around, span)

            self._rows[key] = Row(made, kind, scalars)
        there = slices.first <= slices.last
        numbers = np.empty(len(there), np.int64)
        if there.any():
            numbers[there] = self._rows[key].joined(slices.taken(there))
        if not there.all():
            numbers[~there] = self._nothing(operation, around, span)
        return numbers

    def _nothing(self, operation: Reduction, around: Instance, span: Span) -> Integers:
        """A node that joins nothing."""
        assert operation == "add"
        domain = inner_domain(around.domain, np.zeros(1, np.int64))
        name = f"{_NAMES[operation]} of {span.text}"
        return self._add(name, _NAMES[operation], Number(span, 0.0), replace(around, domain=domain), span)

    def _layer(
        self, operation: Reduction, kind: Kind, scalars: Integers, around: Instance, span: Span
    ) -> Integers:
        """Nodes that join a few columns each; their variables, one a row for each."""
        width = scalars.shape[1]
        count = -(-width // WIDTHS[operation])
        if (
            operation != "add"
        ):  # an extreme may join the last one again and again: so all its nodes are of one form
            again = np.minimum(np.arange(count * WIDTHS[operation]), width - 1)
            return self._nodes(operation, kind, scalars[:, again], count, around, span)
        small, large = width // count, width % count  # `large` nodes join one more
        middle = large * (small + 1)
        parts = [self._nodes(operation, kind, scalars[:, :middle], large, around, span)] if large else []
        parts.append(self._nodes(operation, kind, scalars[:, middle:], count - large, around, span))
        return np.concatenate(parts, axis=1)

    def _nodes(
        self, operation: Reduction, kind: Kind, scalars: Integers, count: int, around: Instance, span: Span
    ) -> Integers:
        """`count` nodes for each row of `scalars`, which join equal parts of it."""
        columns = scalars.reshape(len(scalars) * count, -1)
        sizes, places = np.full(len(columns), columns.shape[1]), np.repeat(np.arange(len(scalars)), count)
        return self._block(operation, kind, columns, sizes, places, around, span).reshape(-1, count)

    def _block(
        self,
        operation: Reduction,
        kind: Kind,
        scalars: Integers,
        sizes: Integers,
        places: Integers,
        around: Instance,
        span: Span,
    ) -> Integers:
        """One block: a node for each row of `scalars`, in the element of `around` at its place, joining as many of the row as `sizes` says.

        Of what is left over in a row only the form counts: an extreme joins the first again.
        """
        domain = inner_domain(around.domain, places)
        name = f"{_NAMES[operation]} of {span.text}"
        terms: list[Expr] = []
        for k in range(scalars.shape[1]):
            inside = k < sizes
            term: Expr = Gather(span, kind, column(np.where(inside, scalars[:, k], scalars[:, 0])))
            if operation == "add" and not inside.all():
                size = Gather(span, "index", column(sizes))
                term = Choose(
                    span, Apply(span, "lt", (Number(span, float(k)), size)), term, Number(span, 0.0)
                )
            terms.append(term)
        while len(terms) > 1:  # by pairs: short ways from each term to the result, so short derivatives
            pairs = zip(terms[::2], terms[1::2], strict=False)
            odd = terms[-1:] if len(terms) % 2 else []
            terms = [*(Apply(span, operation, pair) for pair in pairs), *odd]
        expr = terms[0]
        return self._add(name, _NAMES[operation], expr, replace(around, domain=domain), span)

    def computed(self, expr: Expr, at: Instance, span: Span) -> Integers:
        """The variables, one for each element of `at`, of a block of nodes that compute an expression."""
        return self._add(f"each of {span.text}", "each", expr, at, span)

    def _add(self, name: str, template: str, expr: Expr, at: Instance, span: Span) -> Integers:
        first, domain = self._first(), at.domain
        node = len(self.storage.nodes) + len(self.nodes)
        place = (*at.place, (inf, len(self.nodes)))
        self.nodes.append(FlatNode(at, None, False, at.named(name), template, span, at.standing(None), place))
        self.definitions.append(
            FlatDefinition(name, at.named(name), expr, span, node, hidden=True, domain=domain, first=first)
        )
        self._count += domain.count
        return np.arange(first, first + domain.count)

    def _first(self) -> int:
        """The number of the next algebraic variable."""
        own = self.storage.algebraic
        last = own[-1].first + self.storage.nodes[own[-1].owner or 0].instance.domain.count if own else 0
        return last + self._count
