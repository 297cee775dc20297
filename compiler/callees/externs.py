"""External functions: declarations become `Extern`s. Nothing is imported here: that is for whoever runs the model.

In: `extern` declarations. Out: an `Extern` for each that is right; E905 for the others.
"""

from __future__ import annotations

from collections.abc import Mapping

from hierc.compiler.callees.callee import Extern
from hierc.compiler.callees.errors import WrongExtern
from hierc.compiler.callees.tables import text_span
from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.units.units import scale_of
from hierc.grammar import tree
from hierc.grammar.source import Span

#: Most elements of a vector or matrix that is an argument.
MAX_ELEMENTS = 1000


def make_externs(declared: Mapping[str, tree.Extern], problems: Collector) -> dict[str, Extern]:
    """The external functions by name."""
    found: dict[str, Extern] = {}
    for name, item in declared.items():
        try:
            found[name] = _extern(item)
        except Rejected as rejection:
            problems.rejected(rejection)
    return found


def _extern(item: tree.Extern) -> Extern:
    module, colon, function = item.target.partition(":")
    paths = [*module.split("."), *function.split(".")]
    if not colon or not all(step.isidentifier() for step in paths):
        advice = 'write `"module:function"`, such as `"my_models.friction:coulomb"`'
        raise _refused(item, text_span(item), f"`{item.target}` names no function of a module", advice)
    if item.type.scalar != "real" or item.type.sizes:
        raise _refused(item, item.type.span, "the value of an external function is one `real`")
    if not item.params:
        raise _refused(
            item,
            item.name.span,
            "an external function has one argument at least",
            "give it one that it may ignore",
        )
    shapes = tuple(_shape(item, param) for param in item.params)
    scales = tuple(scale_of(param.unit) for param in item.params)
    return Extern(item.name.text, item.target, shapes, scales, scale_of(item.unit), text_span(item))


def _shape(item: tree.Extern, param: tree.Param) -> tuple[int, ...]:
    if param.type.scalar == "bool" or param.default is not None:
        raise _refused(item, param.span, "an argument is `real` or `int`, without a default")
    shape = []
    for size in param.type.sizes:
        known = int(size.value) if isinstance(size, tree.Number) and size.is_int else 0
        if not 1 <= known <= MAX_ELEMENTS or len(param.type.sizes) > 2:
            raise _refused(item, size.span, "the size of an argument is a number, such as `real[3]`")
        shape.append(known)
    return tuple(shape)


def _refused(item: tree.Extern, span: Span, reason: str, advice: str | None = None) -> Rejected:
    return Rejected(WrongExtern(span, item.name.text, item.target, reason, advice))
