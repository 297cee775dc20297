"""Units of machine code: functions lowered together, optimised, and cached as objects by content.

A `Unit` collects functions in one LLVM module. `finish` verifies and optimises it and returns object code; `load` links objects into the process and
gives the functions' addresses. Nothing here knows what the functions are for.
"""

from __future__ import annotations

import ast
import functools
import inspect
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any, get_type_hints

import llvmlite
import llvmlite.binding as llvm
from llvmlite import ir
from llvmlite.ir.instructions import CallInstr

from hierc.runtime.machine import builtins
from hierc.runtime.machine.lower import Lowering
from hierc.runtime.machine.translate import Translation
from hierc.runtime.machine.types import (
    DOUBLE,
    I64,
    Emitted,
    Float,
    Int,
    PerLane,
    Pointer,
    Type,
    UnsupportedCode,
    Value,
    from_annotation,
    llvm_type,
)

#: Calls of `math` in a function from which on these are called rather than written out.
CROWDED = 40

Names = Mapping[str, Any]
NO_NAMES: Names = {}


class Unit:
    """A module of machine code under construction. `timed`: with timers, see `timing.py`."""

    def __init__(self, name: str, *, timed: bool = False) -> None:
        self.timed = timed
        self.module = ir.Module(name)
        self.module.triple = llvm.get_process_triple()
        self.made: dict[Any, tuple[ir.Function, tuple[Type, ...], Type | None]] = {}
        #: What functions of a generated module may call by name, beside `math`.
        self.callees: dict[str, PerLane] = {}
        #: Functions of generated modules, with their text, which is known by its identity and must therefore live.
        self._modelled: dict[Any, tuple[ast.FunctionDef, ir.Function]] = {}
        self._held: list[
            Names
        ] = []  # functions are known by the identity of their constants, which must therefore live

    def lower(
        self,
        function: Callable[..., Any],
        *,
        lanes: int = 1,
        constants: Names | None = None,
        export: str | None = None,
    ) -> ir.Function:
        """Lower an annotated function of the dialect, with `constants` over its globals; `export` makes it callable by that name."""
        return self._dialect(function, lanes, constants or NO_NAMES, export)[0]

    def dialect(self, function: Callable[..., Any], lanes: int, constants: Names) -> Emitted:
        """A function of the dialect as one that emitted code can call."""
        return Emitted(*self._dialect(function, lanes, constants))

    def _dialect(
        self, function: Callable[..., Any], lanes: int, constants: Names, export: str | None = None
    ) -> tuple[ir.Function, tuple[Type, ...], Type | None]:
        key = (function, lanes, id(constants), export)
        if key in self.made:
            return self.made[key]
        self._held.append(constants)
        kinds, returns = _signature(function, lanes)
        result = ir.VoidType() if returns is None else llvm_type(returns)
        name = export or self.module.get_unique_name(f"{function.__name__}.{lanes}")
        made = ir.Function(self.module, ir.FunctionType(result, [llvm_type(k) for k in kinds.values()]), name)
        standalone = hasattr(function, "standalone")
        inline = export is None and not standalone and not hasattr(function, "outlined")
        _mark(made, inline=inline, pure=standalone)
        if hasattr(function, "rare"):
            made.attributes.add("cold")
        if export is None:
            made.linkage = "internal"
        self.made[key] = (made, tuple(kinds.values()), returns)

        def resolve(callee: Callable[..., Any]) -> tuple[ir.Function, tuple[Type, ...], Type | None]:
            return self._dialect(callee, lanes, constants)

        names = {**function.__globals__, **constants}
        contract = not hasattr(function, "exact")
        low = Lowering(made, kinds, returns, names, lanes, resolve, contract=contract, timed=self.timed)
        low.run(parse_function(function).body)
        return self.made[key]

    def model_function(
        self, definition: ast.FunctionDef, types: Mapping[str, Type], lanes: int
    ) -> ir.Function:
        """Lower one function of a generated module, inlined wherever it is used: no contraction, no other names than `math` and `callees`."""
        key = (id(definition), tuple(types.items()), lanes)
        if key in self._modelled:
            return self._modelled[key][1]
        name = self.module.get_unique_name(definition.name)
        made = ir.Function(
            self.module, ir.FunctionType(ir.VoidType(), [llvm_type(k) for k in types.values()]), name
        )
        made.linkage = "internal"
        _mark(made, inline=True, pure=False)
        self._modelled[key] = (definition, made)

        def resolve(callee: Callable[..., Any]) -> tuple[ir.Function, tuple[Type, ...], Type | None]:
            return self._dialect(callee, lanes, NO_NAMES)

        apart = _is_crowded(definition)
        Lowering(made, types, None, self.callees, lanes, resolve, contract=False, apart=apart).run(
            definition.body
        )
        return made

    def translated(self, translation: Translation) -> Emitted:
        """A user's function over scalars, inlined where it is called, rounding as CPython does."""
        names = {name: self.translated(callee) for name, callee in translation.callees.items()}
        kinds = dict.fromkeys(translation.arguments, Float())
        name = self.module.get_unique_name(f"extern_{translation.definition.name}")
        made = ir.Function(self.module, ir.FunctionType(DOUBLE, [DOUBLE] * len(kinds)), name)
        made.linkage = "internal"
        _mark(made, inline=True, pure=False)

        def resolve(callee: Callable[..., Any]) -> tuple[ir.Function, tuple[Type, ...], Type | None]:
            raise UnsupportedCode(f"{callee!r} is not called from here")

        Lowering(made, kinds, Float(), names, 1, resolve, contract=False).run(translation.definition.body)
        return Emitted(made, tuple(kinds.values()), Float())

    def table(self, name: str, numbers: Sequence[int]) -> Value:
        """A constant array of integers."""
        kind = ir.ArrayType(I64, len(numbers))
        made = ir.GlobalVariable(self.module, kind, self.module.get_unique_name(name))
        made.global_constant = True
        made.linkage = "internal"
        # Formatted here: as a constant of constants, a long table would take most of the time that compiling takes.
        made.initializer = ir.FormattedConstant(kind, f"[{', '.join(f'i64 {k}' for k in numbers)}]")
        made.type = ir.PointerType()
        return Value(made, Pointer(Int()))

    def text(self) -> str:
        """The module as LLVM text, callees before their callers.

        LLVM inlines in this order. Only what becomes part of a function before that becomes part of another keeps what is known of its arguments: that
        they do not overlap, so that what was read or computed once need not be again.
        """
        placed: dict[str, Any] = {}
        for value in self.module.globals.values():
            _place(value, placed)
        self.module.globals = placed
        return str(self.module)


def _place(value: Any, placed: dict[str, Any]) -> None:
    """Place a function or variable of a module after the functions that it calls."""
    if value.name in placed:
        return
    for block in getattr(value, "blocks", ()):
        for instruction in block.instructions:
            if isinstance(instruction, CallInstr) and isinstance(instruction.callee, ir.Function):
                _place(instruction.callee, placed)
    placed[value.name] = value


def _is_crowded(definition: ast.FunctionDef) -> bool:
    """Whether a function calls so many elementary functions that their code, a hundred instructions each, would be most of it."""
    calls = (node for node in ast.walk(definition) if isinstance(node, ast.Call))
    return sum(isinstance(call.func, ast.Attribute) for call in calls) > CROWDED


def _mark(function: ir.Function, *, inline: bool, pure: bool) -> None:
    function.attributes.add("alwaysinline" if inline else "noinline")
    function.attributes.add("nounwind")
    if pure:
        builtins.add_attribute(function, "memory(none)")
        builtins.add_attribute(function, "willreturn")
    for argument in function.args:
        if isinstance(argument.type, ir.PointerType) and inline:
            argument.add_attribute("noalias")


@functools.cache
def parse_function(function: Callable[..., Any]) -> ast.FunctionDef:
    """The syntax tree of a Python function's text."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    definition = tree.body[0]
    if not isinstance(definition, ast.FunctionDef):
        raise UnsupportedCode(f"{function!r} is not a plain function")
    return definition


@functools.cache
def _hints(function: Callable[..., Any]) -> dict[str, Any]:
    return get_type_hints(function)


def _signature(function: Callable[..., Any], lanes: int) -> tuple[dict[str, Type], Type | None]:
    hints = dict(_hints(function))
    returned = hints.pop("return", None)
    returns = None if returned in (None, type(None)) else from_annotation(returned, lanes)
    return {name: from_annotation(hint, lanes) for name, hint in hints.items()}, returns


# ---- object code --------------------------------------------------------------------------------


@functools.cache
def _target_machine() -> llvm.TargetMachine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=_features(), opt=2, jit=True, codemodel="jitdefault"
    )


@functools.cache
def _features() -> str:
    """The processor's features. Eight lanes are kept in one 512-bit register where there are such."""
    features = llvm.get_host_cpu_features()
    flags = str(features.flatten())
    return flags + ",-prefer-256-bit" if features.get("avx512f") else flags


def machine_key() -> str:
    """What object code depends on beside its text: processor, features, LLVM, and how it is optimised."""
    version = ".".join(map(str, llvm.llvm_version_info))
    return f"{llvm.get_host_cpu_name()} {_features()} llvm {version} llvmlite {llvmlite.__version__} O2"


def compile_object(text: str) -> bytes:
    """Optimised object code of LLVM text."""
    machine = _target_machine()
    module = llvm.parse_assembly(text)
    module.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    options.slp_vectorization = True
    options.loop_vectorization = False
    options.loop_unrolling = True
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return bytes(machine.emit_object(module))


class Loaded:
    """Objects linked into the process. Addresses stay valid as long as this lives."""

    def __init__(self, objects: list[bytes]) -> None:
        empty = llvm.parse_assembly("")
        _target_machine()
        self.engine = llvm.create_mcjit_compiler(empty, _engine_machine())
        for code in objects:
            self.engine.add_object_file(llvm.object_file.ObjectFileRef.from_data(code))
        self.engine.finalize_object()

    def variable(self, name: str) -> int:
        """Address of a variable that an object exports."""
        found = int(self.engine.get_global_value_address(name))
        if not found:
            raise KeyError(name)
        return found

    def address(self, name: str) -> int:
        """Address of an exported function."""
        found = int(self.engine.get_function_address(name))
        if not found:
            raise KeyError(name)
        return found


def _engine_machine() -> llvm.TargetMachine:
    # MCJIT takes ownership of its target machine, so each engine gets its own.
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=_features(), opt=2, jit=True, codemodel="jitdefault"
    )
