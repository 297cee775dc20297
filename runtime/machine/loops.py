"""Loops of the dialect to LLVM: `while`, `range`, and `unroll`, which is written out."""

from __future__ import annotations

import ast
from typing import TYPE_CHECKING

from llvmlite import ir

from hierc.runtime.machine.types import I64, Int, Operand, UnsupportedCode, Value

if TYPE_CHECKING:
    from hierc.runtime.machine.lower import Lowering


def while_loop(low: Lowering, test: ast.expr, body: list[ast.stmt]) -> None:
    """Lower a `while`."""
    head, inside, after = (low.function.append_basic_block(n) for n in ("while", "body", "after"))
    low.builder.branch(head)
    low.builder.position_at_end(head)
    low.builder.cbranch(low.math.truth(low.expression(test)).ir, inside, after)
    low.builder.position_at_end(inside)
    _body(low, body, head, after)
    if not low.builder.block.is_terminated:
        low.builder.branch(head)
    low.builder.position_at_end(after)


def _body(low: Lowering, body: list[ast.stmt], again: ir.Block, after: ir.Block) -> None:
    low.loops.append((again, after))
    with low.locals.loop():
        low.block(body)
    low.loops.pop()


def for_loop(
    low: Lowering, name: str, kind: str, bounds: list[Operand], body: list[ast.stmt], node: ast.stmt
) -> None:
    """Lower a `for` over `range`, or over `unroll` with a constant count."""
    first, last = (0, bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
    if kind == "unroll" and isinstance(last, int):
        for k in range(last):
            low.constants[name] = k
            low.block(body)
        low.constants.pop(name, None)
        return
    if kind != "range":
        text = ast.unparse(node).splitlines()[0][:80]
        raise UnsupportedCode(f"line {node.lineno}: {text}: not part of the dialect")
    stop = low.math.convert(last, Int())
    with low.builder.goto_entry_block():
        counter = low.builder.alloca(I64)  # its own: the body may assign to the name, as in Python
    low.builder.store(low.math.convert(first, Int()).ir, counter)
    head, inside, step, after = (low.function.append_basic_block(n) for n in ("for", "body", "step", "after"))
    low.builder.branch(head)
    low.builder.position_at_end(head)
    current = low.builder.load(counter, typ=I64)
    low.builder.cbranch(low.builder.icmp_signed("<", current, stop.ir), inside, after)
    low.builder.position_at_end(inside)
    low.locals.store(name, Value(current, Int()))
    _body(low, body, step, after)
    if not low.builder.block.is_terminated:
        low.builder.branch(step)
    low.builder.position_at_end(step)
    low.builder.store(low.builder.add(current, ir.Constant(I64, 1), flags=("nsw",)), counter)
    low.builder.branch(head)
    low.builder.position_at_end(after)
