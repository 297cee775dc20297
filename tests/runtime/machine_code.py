"""Functions of model text as callables: under CPython, and as machine code over any number of lanes."""

from __future__ import annotations

import ast
import ctypes
import math
import textwrap
from collections.abc import Callable, Mapping

import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from hierc.runtime import linalg
from hierc.runtime.machine.dialect import aligned
from hierc.runtime.machine.types import POINTER, Emitted, Float, Pointer, llvm_type
from hierc.runtime.machine.unit import Loaded, Unit, compile_object

Floats = NDArray[np.float64]
#: Arguments that hold one value for all lanes.
NARROW = "pqm"


def definition(text: str) -> ast.FunctionDef:
    """The syntax tree of the one function in a text."""
    tree = ast.parse(textwrap.dedent(text)).body[-1]
    assert isinstance(tree, ast.FunctionDef)
    return tree


def interpreted(text: str) -> Callable[..., None]:
    """The same function as CPython has it."""
    names: dict[str, object] = {"math": math, "linalg": linalg}
    exec(textwrap.dedent(text), names)
    made = names[definition(text).name]
    assert callable(made)
    return made


def compiled(function: ast.FunctionDef, lanes: int = 1) -> Callable[..., None]:
    """A model function as machine code. Arrays are passed as numpy arrays (count, lanes); p and q are the same in all lanes; t is a time for all."""
    unit = Unit("test")
    add_entry(unit, function, lanes)
    return callable_from(Loaded([compile_object(unit.text())]))


def add_entry(unit: Unit, function: ast.FunctionDef, lanes: int) -> None:
    """A model function as the function `entry` of a unit, its arguments by address."""
    arguments = [a.arg for a in function.args.args]
    types = {
        a: Float(lanes) if a == "t" else Pointer(Float() if a in NARROW else Float(lanes)) for a in arguments
    }
    inner = unit.model_function(function, types, lanes)
    outer = ir.Function(unit.module, ir.FunctionType(ir.VoidType(), [POINTER] * len(arguments)), "entry")
    builder = ir.IRBuilder(outer.append_basic_block("entry"))
    given = [
        builder.load(a, typ=llvm_type(types[name]), align=8) if name == "t" else a
        for a, name in zip(outer.args, arguments, strict=True)
    ]
    builder.call(inner, given)
    builder.ret_void()


def exported(unit: Unit, emitted: Emitted) -> Callable[..., None]:
    """One composed function as machine code; values by address, as in `compiled`."""
    outer = ir.Function(unit.module, ir.FunctionType(ir.VoidType(), [POINTER] * len(emitted.kinds)), "entry")
    builder = ir.IRBuilder(outer.append_basic_block("entry"))
    given = [
        a if isinstance(kind, Pointer) else builder.load(a, typ=llvm_type(kind), align=8)
        for a, kind in zip(outer.args, emitted.kinds, strict=True)
    ]
    builder.call(emitted.function, given)
    builder.ret_void()
    return callable_from(Loaded([compile_object(unit.text())]))


def callable_from(code: Loaded) -> Callable[..., None]:
    """The function `entry` of loaded code; its arguments are arrays, passed by address."""
    address = code.address("entry")

    def call(*arrays: Floats) -> None:
        assert code  # keeps the machine code in memory
        prototype = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * len(arrays))
        prototype(address)(*[a.ctypes.data for a in arrays])

    return call


def room(count: int, lanes: int = 1) -> Floats:
    """An array (count, lanes) on a cache line, as the kernel has them."""
    return aligned(max(count, 1) * lanes).reshape(-1, lanes)


def over_lanes(values: Floats) -> Floats:
    """Samples (lanes, count) as an array (count, lanes)."""
    into = room(values.shape[1], values.shape[0])
    into[:] = values.T
    return into


def run_both(
    text: str, arrays: Mapping[str, Floats], output: str, size: int, lanes: int = 1
) -> tuple[Floats, Floats]:
    """Results (samples, size) of CPython and of machine code. `arrays`: (samples, n) each, p (n,), t (samples,)."""
    python, machine = interpreted(text), compiled(definition(text), lanes)
    order = [a.arg for a in definition(text).args.args]
    samples = len(next(v for k, v in arrays.items() if k not in NARROW))
    expected, found = np.zeros((samples, size)), np.zeros((samples, size))
    for s in range(samples):
        given = {
            k: float(v[s]) if k == "t" else (v if k in NARROW else v[s]).tolist() for k, v in arrays.items()
        }
        result = [math.nan] * size
        python(*[result if a == output else given[a] for a in order])
        expected[s] = result
    for first in range(0, samples, lanes):
        rows = np.arange(first, first + lanes) % samples
        out = room(size, lanes)
        packed = {k: v if k in NARROW else over_lanes(v[rows].reshape(lanes, -1)) for k, v in arrays.items()}
        machine(*[out if a == output else packed[a] for a in order])
        found[rows] = out.T
    return expected, found
