"""Functions of the dialect to LLVM: statements and expressions.

In: the `ast` of one function, the types of its arguments, and the names it may use. Out: a function in the unit's LLVM module. Anything that is
not listed here is refused with `UnsupportedCode`; nothing of the text is ever executed. This is what makes it safe to run a generated module in
the kernel, and it is the whole of the dialect's meaning.

With lanes, a branch whose condition differs from lane to lane is evaluated on both sides and blended; all operations are pure, so only the chosen
side is seen. Statements and expressions call each other, so they stand in one class and one file.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from llvmlite import ir

from hierc.runtime.machine import builtins, loops, matrices, timing
from hierc.runtime.machine.arithmetic import Arithmetic
from hierc.runtime.machine.storage import Locals, Slots, set_once
from hierc.runtime.machine.types import (
    I64,
    Bool,
    Emitted,
    Float,
    Int,
    LaneConstant,
    LaneTable,
    Operand,
    PerLane,
    Pointer,
    RecordRef,
    Type,
    UnsupportedCode,
    Value,
    from_annotation,
    llvm_type,
    size_of,
)

_FOLD: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_PREDICATES = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}

#: How the lowering finds or makes the functions it calls: LLVM function, types of its arguments, type of its result.
Resolver = Callable[[Callable[..., Any]], tuple[ir.Function, tuple[Type, ...], Type | None]]


class Lowering:
    """Lowers the body of one function. `names` are its globals; `resolve` supplies functions that it calls.

    `contract`: products may be rounded together with the sums they stand in; `apart`: elementary functions over lanes are called, not written out;
    `timed`: with timers around the calls that `timing.py` names.
    """

    def __init__(
        self,
        function: ir.Function,
        arguments: Mapping[str, Type],
        returns: Type | None,
        names: Mapping[str, Any],
        lanes: int,
        resolve: Resolver,
        contract: bool,
        apart: bool = False,
        timed: bool = False,
    ) -> None:
        self.function = function
        self.returns = returns
        self.names = names
        self.lanes = lanes
        self.resolve = resolve
        self.apart = apart
        self.timed = timed
        self.entry = function.append_basic_block("entry")
        self.builder = ir.IRBuilder(self.entry)
        self.math = Arithmetic(self.builder, contract)
        self.constants: dict[str, int | float] = {}
        self.loops: list[tuple[ir.Block, ir.Block]] = []  # (continue, break) targets
        self.live: Value | None = None  # the lanes whose side of a branch is being lowered; None: all
        self.arguments = arguments

    def run(self, body: list[ast.stmt]) -> None:
        """Lower the whole body and close the function."""
        self.locals = Locals(self.builder, self.math, set_once(self.arguments, body))
        for argument, (name, kind) in zip(self.function.args, self.arguments.items(), strict=True):
            self.locals.store(name, Value(argument, kind))
        self.block(body)
        if not self.builder.block.is_terminated:
            if self.returns is not None:
                self.builder.unreachable()
            else:
                self.builder.ret_void()

    # ---- statements -----------------------------------------------------------------------------

    def block(self, body: list[ast.stmt]) -> None:
        for statement in body:
            if self.builder.block.is_terminated:
                return  # after return, break or continue
            self.statement(statement)

    def statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=several)], value=value):
                for target, item in zip(several, matrices.substitute(self, value), strict=True):
                    self.assign(target, item)
            case ast.Assign(targets=[target], value=value):
                self.assign(target, self.expression(value))
            case ast.AugAssign(target=target, op=op, value=value):
                load = ast.parse(ast.unparse(target), mode="eval").body
                self.assign(target, self.binary(op, self.expression(load), self.expression(value), node))
            case ast.If(test=test, body=body, orelse=orelse):
                self.branch(test, body, orelse)
            case ast.While(test=test, body=body, orelse=[]):
                loops.while_loop(self, test, body)
            case ast.For(
                target=ast.Name(id=name),
                iter=ast.Call(func=ast.Name(id=kind), args=bounds),
                body=body,
                orelse=[],
            ):
                loops.for_loop(self, name, kind, [self.expression(b) for b in bounds], body, node)
            case ast.Return(value=None):
                self.builder.ret_void()
            case ast.Return(value=value) if value is not None and self.returns is not None:
                self.builder.ret(self.math.convert(self.expression(value), self.returns).ir)
            case ast.Break():
                self.builder.branch(self.loops[-1][1])
            case ast.Continue():
                self.builder.branch(self.loops[-1][0])
            case ast.Expr(value=ast.Constant(value=str())) | ast.Pass():
                pass  # a docstring
            case ast.Expr(value=ast.Call() as call):
                self.call(call)
            case _:
                raise _refused(node)

    def assign(self, target: ast.expr, value: Operand) -> None:
        match target:
            case ast.Name(id=name):
                self.locals.store(name, self.math.value(value))
            case ast.Subscript(value=base, slice=ast.Slice() as bounds):
                matrices.copy(
                    self,
                    self.math.value(value),
                    *matrices.slice_of(self, self.expression(base), bounds),
                )
            case ast.Subscript() | ast.Attribute():
                address, kind = self.place(target)
                self.builder.store(self.math.convert(value, kind).ir, address, align=8)
            case _:
                raise _refused(target)

    def branch(self, test: ast.expr, body: list[ast.stmt], orelse: list[ast.stmt]) -> None:
        condition = self.expression(test)
        if not isinstance(condition, Value):
            self.block(body if condition else orelse)
            return
        if isinstance(condition.type, Bool) and condition.type.lanes > 1:
            self.blend(condition, body, orelse)
            return
        then, other, after = (self.function.append_basic_block(n) for n in ("then", "else", "after"))
        self.builder.cbranch(self.math.truth(condition).ir, then, other)
        sides: list[tuple[ir.Block, Slots]] = []
        before = self.locals.slots
        for start, statements in ((then, body), (other, orelse)):
            self.locals.slots = dict(before)
            self.builder.position_at_end(start)
            self.block(statements)
            if not self.builder.block.is_terminated:
                sides.append((self.builder.block, self.locals.slots))
        self.locals.join(sides, after)
        if not sides:
            self.builder.unreachable()

    def blend(self, mask: Value, body: list[ast.stmt], orelse: list[ast.stmt]) -> None:
        """Both sides of a branch that differs from lane to lane, then lane by lane the chosen one."""
        targets = {ast.unparse(t): t for t in _targets(body) + _targets(orelse)}
        old = {key: self._current(t) for key, t in targets.items()}
        outer = self.live
        self.live = mask if outer is None else self.math.both(outer, mask)
        self.block(body)
        then = {key: self._current(t) for key, t in targets.items()}
        for key, target in targets.items():
            if (before := old[key]) is not None:
                self.assign(target, before)
        other = self.math.invert(mask)
        self.live = other if outer is None else self.math.both(outer, other)
        self.block(orelse)
        self.live = outer
        for key, target in targets.items():
            a, b = then[key], self._current(target)
            if a is not None and b is not None and not isinstance(a.type, Pointer):
                self.assign(target, self.math.select(mask, a, b))

    def _current(self, target: ast.expr) -> Value | None:
        if isinstance(target, ast.Name):
            return self.locals.load(target.id) if target.id in self.locals else None
        return self.load(target)

    # ---- expressions ----------------------------------------------------------------------------

    def expression(self, node: ast.expr) -> Operand:
        match node:
            case ast.Constant(value=bool() | int() | float() as value):
                return value
            case ast.Name(id=name):
                return self.name(name, node)
            case ast.BinOp(left=left, op=op, right=right):
                return self.binary(op, self.expression(left), self.expression(right), node)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                a = self.expression(operand)
                return self.math.negate(a) if isinstance(a, Value) else -a
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                a = self.expression(operand)
                return self.math.invert(a) if isinstance(a, Value) else not a
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return self.compare(op, self.expression(left), self.expression(right), node)
            case ast.BoolOp(op=op, values=values):
                return self.logic(isinstance(op, ast.And), values)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self.conditional(test, body, orelse)
            case ast.Subscript(value=ast.Name(id=name), slice=row) if isinstance(
                self.names.get(name), LaneTable
            ):
                index = self.expression(row)
                if not isinstance(index, int):
                    raise _refused(node, "tables are indexed by constants")
                return LaneConstant(self.names[name].rows[index]).value
            case ast.Subscript(value=base, slice=ast.Slice() as bounds):
                return matrices.slice_of(self, self.expression(base), bounds)[0]
            case ast.Subscript() if isinstance(known := self.static(node), int | float):
                return known
            case ast.Subscript() | ast.Attribute():
                return self.load(node)
            case ast.Call():
                result = self.call(node)
                if result is None:
                    raise _refused(node)
                return result
            case _:
                raise _refused(node)

    def static(self, node: ast.expr) -> Any:
        """An entry of a table of constants, at a constant index; None if it is not one."""
        match node:
            case ast.Name(id=name) if name not in self.locals:
                known = self.names.get(name)
                return known if isinstance(known, tuple) else None
            case ast.Subscript(value=base, slice=index):
                table = self.static(base)
                if isinstance(table, tuple):
                    where = self.expression(index)
                    if not isinstance(where, int):
                        raise _refused(node, "tables of constants are indexed by constants")
                    return table[where]
        return None

    def name(self, name: str, node: ast.expr) -> Operand:
        if name in self.constants:
            return self.constants[name]
        if name in self.locals:
            return self.locals.load(name)
        known = self.names.get(name)
        if isinstance(known, LaneConstant):
            return known.value
        if isinstance(known, Value | bool | int | float):
            return known
        raise _refused(node, f"unknown name {name!r}")

    def binary(self, op: ast.operator, a: Operand, b: Operand, node: ast.AST) -> Operand:
        if type(op) not in _FOLD:
            raise _refused(node)
        if not isinstance(a, Value) and not isinstance(b, Value) and not (isinstance(op, ast.Div) and b == 0):
            folded: int | float = _FOLD[type(op)](a, b)
            return folded
        return self.math.binary(type(op).__name__, a, b)

    def compare(self, op: ast.cmpop, a: Operand, b: Operand, node: ast.AST) -> Operand:
        if type(op) not in _PREDICATES:
            raise _refused(node)
        if not isinstance(a, Value) and not isinstance(b, Value):
            return bool(_FOLD[type(op)](a, b))
        return self.math.compare(_PREDICATES[type(op)], a, b)

    def logic(self, conjunction: bool, values: list[ast.expr]) -> Operand:
        """`and`, `or`: the operands are pure, so all are evaluated, except that a constant decides at once."""
        result: Operand = conjunction
        for node in values:
            value = self.expression(node)
            if not isinstance(value, Value):
                if bool(value) != conjunction:
                    return bool(value)
                continue
            if not isinstance(result, Value):
                result = self.math.truth(value)
            else:
                result = self.math.both(result, value) if conjunction else self.math.either(result, value)
        return result

    def conditional(self, test: ast.expr, body: ast.expr, orelse: ast.expr) -> Operand:
        condition = self.expression(test)
        if not isinstance(condition, Value):
            return self.expression(body if condition else orelse)
        if isinstance(condition.type, Bool) and condition.type.lanes > 1:
            return self.math.select(condition, self.expression(body), self.expression(orelse))
        then, other, after = (self.function.append_basic_block(n) for n in ("then", "else", "after"))
        self.builder.cbranch(self.math.truth(condition).ir, then, other)
        self.builder.position_at_end(then)
        a = self.math.value(self.expression(body))
        then_end = self.builder.block
        self.builder.position_at_end(other)
        b = self.math.value(self.expression(orelse))
        kind = self.math.common(a.type, b.type)
        b = self.math.convert(b, kind)
        other_end = self.builder.block
        self.builder.branch(after)
        self.builder.position_at_end(then_end)
        a = self.math.convert(a, kind)
        self.builder.branch(after)
        self.builder.position_at_end(after)
        phi = self.builder.phi(llvm_type(kind))
        phi.add_incoming(a.ir, then_end)
        phi.add_incoming(b.ir, other_end)
        return Value(phi, kind)

    # ---- memory ---------------------------------------------------------------------------------

    def place(self, node: ast.expr) -> tuple[ir.Value, Type]:
        """Address and type of what a subscript or attribute stands for."""
        match node:
            case ast.Subscript(value=base, slice=index):
                array = self.expression(base)
                if not isinstance(array, Value) or not isinstance(array.type, Pointer):
                    raise _refused(node, "only arrays are indexed")
                return self.item(array, self.expression(index)), array.type.item
            case ast.Attribute(value=base, attr=field):
                record = self.expression(base)
                if not isinstance(record, Value) or not isinstance(record.type, RecordRef):
                    raise _refused(node, "only records have fields")
                fields = record.type.record.fields()
                if field not in fields:
                    raise _refused(node, f"no field {field!r}")
                offset = ir.Constant(I64, list(fields).index(field))
                kind = from_annotation(fields[field], self.lanes)
                return self.builder.gep(record.ir, [offset], inbounds=True, source_etype=I64), kind
            case _:
                raise _refused(node)

    def item(self, array: Value, index: Operand) -> ir.Value:
        """Address of one item of an array."""
        assert isinstance(array.type, Pointer)
        words = ir.ArrayType(I64, size_of(array.type.item) // 8)
        where = self.math.convert(index, Int()).ir
        return self.builder.gep(array.ir, [where], inbounds=True, source_etype=words)

    def load(self, node: ast.expr) -> Value:
        address, kind = self.place(node)
        if isinstance(kind, RecordRef):
            return Value(address, kind)
        align = 8
        return Value(self.builder.load(address, typ=llvm_type(kind), align=align), kind)

    # ---- calls ----------------------------------------------------------------------------------

    def call(self, node: ast.Call) -> Operand | None:
        if node.keywords:
            raise _refused(node)
        part = timing.section(node) if self.timed and "g" in self.locals else None
        return self._call(node) if part is None else timing.timed(self, part, lambda: self._call(node))

    def _call(self, node: ast.Call) -> Operand | None:
        match node.func:
            case ast.Attribute(value=ast.Name(id="math"), attr=name):
                return builtins.elementary(self, name, [self.expression(a) for a in node.args], node)
            case ast.Attribute(value=ast.Name(id="linalg"), attr=name):
                return matrices.call(self, name, [self.expression(a) for a in node.args], node)
            case ast.Name(id="each_lane"):
                return self.each_lane(
                    node.args[0], [self.math.value(self.expression(a)) for a in node.args[1:]]
                )
            case ast.Name(id=name):
                known = self.names.get(name)
                if builtins.is_builtin(known) or (known is None and name in builtins.PYTHON):
                    return builtins.call(self, name, [self.expression(a) for a in node.args], node)
                if isinstance(known, PerLane):
                    return self.call_per_lane(known, [self.math.value(self.expression(a)) for a in node.args])
                if isinstance(known, Emitted):
                    return self.call_emitted(known, [self.expression(a) for a in node.args])
                if not callable(known):
                    raise _refused(node, f"{name!r} is not a function")
                return self.call_function(known, [self.math.value(self.expression(a)) for a in node.args])
            case _:
                raise _refused(node)

    def each_lane(self, function: ast.expr, args: list[Value]) -> Operand:
        """`each_lane(f, …)`: the scalar f applied lane by lane."""
        results = []
        for k in range(self.lanes_of(args)):
            scalars = [self.math.extract(a, k) for a in args]
            match function:
                case ast.Name(id=name) if callable(self.names.get(name)):
                    result = self.call_function(self.names[name], scalars)
                case ast.Attribute(value=ast.Name(id="math"), attr=name):
                    result = builtins.elementary(self, name, scalars, function)
                case _:
                    raise _refused(function)
            if result is None:
                raise _refused(function)
            results.append(result)
        return self.math.gather_lanes(results)

    def call_per_lane(self, function: PerLane, args: list[Value]) -> Value:
        """A function of scalars for each live lane; others get zero, which nobody sees."""
        live = self.live
        lanes = self.lanes_of([self.math.convert(a, Float()) if isinstance(a.type, Int) else a for a in args])
        if live is not None and isinstance(live.type, Bool):
            lanes = max(lanes, live.type.lanes)
        wide = [self.math.convert(a, Float(lanes)) for a in args]
        results = []
        for k in range(lanes):
            scalars = [self.math.extract(a, k) for a in wide]
            if live is None:
                result = self.call_emitted(function.callee, scalars)
                assert result is not None
            else:
                result = self.call_if(self.math.extract(live, k), function.callee, scalars)
            results.append(result)
        return self.math.gather_lanes(results)

    def call_if(self, condition: Value, callee: Emitted, args: list[Value]) -> Value:
        """A call that is made only if a condition holds; zero otherwise."""
        call, after = (self.function.append_basic_block(n) for n in ("call", "after"))
        before = self.builder.block
        self.builder.cbranch(condition.ir, call, after)
        self.builder.position_at_end(call)
        value = self.call_emitted(callee, args)
        assert value is not None
        self.builder.branch(after)
        self.builder.position_at_end(after)
        phi = self.builder.phi(llvm_type(value.type))
        phi.add_incoming(value.ir, call)
        phi.add_incoming(ir.Constant(llvm_type(value.type), 0.0), before)
        return Value(phi, value.type)

    @staticmethod
    def lanes_of(values: list[Value]) -> int:
        """The widest of some values."""
        return max(v.type.lanes for v in values if isinstance(v.type, Float))

    def call_function(
        self, function: Callable[..., Any], args: list[Value], *, apart: bool = False
    ) -> Value | None:
        """Call another function of the dialect, lowering it first if it is new."""
        return self.call_emitted(Emitted(*self.resolve(function)), args, apart=apart)

    def call_emitted(self, callee: Emitted, args: Sequence[Operand], *, apart: bool = False) -> Value | None:
        """Call a function of known signature; `apart`: it does not become part of this one."""
        converted = [self.math.convert(a, k).ir for a, k in zip(args, callee.kinds, strict=True)]
        result = self.builder.call(callee.function, converted, attrs=("noinline",) if apart else ())
        return None if callee.returns is None else Value(result, callee.returns)


def _targets(body: list[ast.stmt]) -> list[ast.expr]:
    """Everything that a list of assignments and branches assigns to."""
    found: list[ast.expr] = []
    for statement in body:
        match statement:
            case ast.Assign(targets=[ast.Tuple(elts=several)]):
                found += several
            case ast.Assign(targets=[target]):
                found.append(target)
            case ast.If(body=then, orelse=orelse):
                found += _targets(then) + _targets(orelse)
            case ast.Pass():
                pass
            case _:
                raise _refused(statement, "not allowed in a branch that differs from lane to lane")
    return found


def _refused(node: ast.AST, why: str = "not part of the dialect") -> UnsupportedCode:
    text = ast.unparse(node).splitlines()[0][:80]
    return UnsupportedCode(f"line {getattr(node, 'lineno', '?')}: {text}: {why}")
