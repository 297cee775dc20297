"""Places: where everything that has a name in the model is found at run time.

In: sources with columns, and the forms of blocks. Out: (element, kind, index), again with columns. Guaranteed: the kind is one for all elements.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from hierc.compiler.arrays.columns import Index, column, expanded
from hierc.compiler.arrays.elements import Elements, distinct
from hierc.compiler.model import Model, Source
from hierc.compiler.symbolic.derive import Place, Symbolic

#: (element, "state" | "out" | "observed", index), a column each where elements differ.
Found = tuple[Index, str, Index]
_Kind = Literal["state", "rate", "local"]


class Places:
    """Finds what nodes read of each other, and what results name."""

    def __init__(self, model: Model, symbolic: Symbolic) -> None:
        self.elements = Elements(node.first for node in model.nodes)
        self._symbolic = symbolic

    def channel(self, source: Source, count: int) -> Found:
        """Where `count` elements find what they read of others."""
        return self._found(source, count, "channels")

    def record(self, source: Source, count: int) -> Found:
        """Where results find a scalar of `count` elements."""
        return self._found(source, count, "records")

    def _found(self, source: Source, count: int, table: Literal["channels", "records"]) -> Found:
        if isinstance(source.node, int) and isinstance(source.index, int):
            return source.node, *self._place(
                table, source.kind, self.elements.block(source.node), source.index
            )
        indices = expanded(source.index, count)
        blocks = self.elements.blocks(expanded(source.node, count))
        width = int(indices.max()) + 1
        codes = blocks * width + indices
        different = distinct(codes)
        found = [self._place(table, source.kind, *divmod(code, width)) for code in different.tolist()]
        kinds = {kind for kind, _ in found}
        if len(kinds) > 1:
            raise ValueError(f"elements find {source} in different kinds of places")
        places = np.array([index for _, index in found])[np.searchsorted(different, codes)]
        return source.node, kinds.pop(), column(places)

    def _place(self, table: Literal["channels", "records"], kind: _Kind, block: int, index: int) -> Place:
        form = self._symbolic.forms[self._symbolic.kinds[block]]
        return (form.channels if table == "channels" else form.records)[kind, index]
