"""Dense blocks of Newton matrices: in machine code against numpy, the same text under CPython, and how much of it is tables."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from llvmlite import ir
from machine_code import Floats, callable_from, room
from numpy.typing import NDArray

from hierc.runtime.machine import dense, irregular
from hierc.runtime.machine.bytable import TableCode
from hierc.runtime.machine.elimination import Elimination, eliminate
from hierc.runtime.machine.types import DOUBLE, POINTER, Float, Value, llvm_type
from hierc.runtime.machine.unit import Loaded, Unit, compile_object
from hierc.runtime.methods.radau_tables import RADAU5, RADAU9, RADAU13, Tables

RNG = np.random.default_rng(11)
Pattern = set[tuple[int, int]]
METHODS = pytest.mark.parametrize("tables", [RADAU5, RADAU9, RADAU13], ids=lambda t: f"radau{t.order}")


def square(*rows: int) -> Pattern:
    return {(i, j) for i in rows for j in rows}


def scattered(n: int, density: float) -> Pattern:
    return {(int(i), int(j)) for i, j in zip(*np.nonzero(RNG.random((n, n)) < density), strict=True)}


def bordered(inner: int, border: int) -> Pattern:
    """States of which each reads its successor and all of the border, which reads all."""
    edge = range(inner, inner + border)
    coupled = {(i, j) for i in range(inner) for j in edge} | {(j, i) for i in range(inner) for j in edge}
    return coupled | square(*edge) | {(i, i + 1) for i in range(inner - 1)}


#: Rows, nonzeros, and how many rows are in blocks at least.
PATTERNS: dict[str, tuple[int, Pattern, int]] = {
    "full": (31, square(*range(31)), 31),
    "nearly full": (40, scattered(40, 0.85), 37),
    "bordered": (70, bordered(40, 30), 30),
    "two, interleaved": (60, square(*range(0, 60, 2)) | square(*range(1, 60, 2)), 60),
    "two and what reads both": (
        90,
        square(*range(30)) | square(*range(30, 70)) | {(i, j) for i in range(70, 90) for j in range(90)},
        40,
    ),
}


class Tabled:
    """The pieces of a factorisation by tables, of lambda I - h J with the entries of J in order of `pattern`."""

    def __init__(self, n: int, pattern: Pattern, tables: Tables) -> None:
        self.tables, self.pattern = tables, sorted(pattern)
        self.plan = eliminate(n, frozenset(pattern))
        self.units = {name: Unit(name) for name in ("factor", "solve", "solve_real")}
        for name, unit in self.units.items():
            self._emit(name, TableCode(self.plan, tables.lanes, unit))
        self.size = TableCode(self.plan, tables.lanes, Unit("size")).layout.size

    def _emit(self, name: str, code: TableCode) -> None:
        kind = ir.FunctionType(ir.VoidType(), [POINTER] * 3)
        builder = ir.IRBuilder(ir.Function(code.unit.module, kind, "entry").append_basic_block("entry"))
        h, b, memory = builder.function.args
        if name == "factor":
            lanes = Float(self.tables.lanes)
            eigenvalues = Value(ir.Constant(llvm_type(lanes), list(self.tables.eigenvalues)), lanes)
            slots = {entry: k for k, entry in enumerate(self.pattern)}
            step = Value(builder.load(h, typ=DOUBLE), Float())
            code.fill(builder, step, b, slots, eigenvalues, memory)
            code.factor(builder, memory)
        else:
            real = name == "solve_real"
            code.solve(builder, b, memory, 1 if real else self.tables.lanes, real=real)
        builder.ret_void()

    def compiled(self) -> dict[str, Callable[..., None]]:
        return {n: callable_from(Loaded([compile_object(u.text())])) for n, u in self.units.items()}

    def numbers(self) -> int:
        """How many numbers stand in tables."""
        variables = [g for u in self.units.values() for g in u.module.globals.values()]
        return sum(g.value_type.count for g in variables if isinstance(g, ir.GlobalVariable))


def complex_of(lanes: Floats) -> NDArray[np.complex128]:
    half = lanes.shape[-1] // 2
    return lanes[..., :half] + 1j * lanes[..., half:]


@METHODS
@pytest.mark.parametrize("name", PATTERNS)
def test_against_numpy(name: str, tables: Tables) -> None:
    n, pattern, in_blocks = PATTERNS[name]
    tabled = Tabled(n, pattern, tables)
    assert sum(map(len, tabled.plan.blocks)) >= in_blocks
    code, h = tabled.compiled(), np.array([0.3])
    values = RNG.normal(0, 1 / n, len(pattern))
    jacobian = np.zeros((n, n))
    for (i, j), value in zip(tabled.pattern, values, strict=True):
        jacobian[i, j] = value
    factors = room(tabled.size)
    code["factor"](h, values, factors)
    b = room(n, tables.lanes)
    b[:] = RNG.normal(size=b.shape)
    right, known = complex_of(b), b[:, 0].copy()
    code["solve"](h, b, factors)
    for k in range((tables.stages + 1) // 2):
        eigenvalue = complex_of(np.array(tables.eigenvalues))[k]
        expected = np.linalg.solve(eigenvalue * np.eye(n) - h[0] * jacobian, right[:, k])
        assert complex_of(b)[:, k] == pytest.approx(expected, rel=1e-12, abs=1e-13)
    expected = np.linalg.solve(tables.eigenvalues[0] * np.eye(n) - h[0] * jacobian, known)
    code["solve_real"](h, known, factors)
    assert known == pytest.approx(expected, rel=1e-12, abs=1e-13)


def test_machine_code_does_what_the_text_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under CPython, on numpy's lanes: but for products and sums that are rounded once, the same numbers."""
    n, lanes = 25, RADAU9.lanes
    tabled = Tabled(n, square(*range(n)), RADAU9)
    code, h = tabled.compiled(), np.array([0.2])
    values = RNG.normal(0, 1 / n, n * n)
    factors, b = room(tabled.size), room(n, lanes)
    b[:] = RNG.normal(size=b.shape)
    matrix = -h[0] * values.reshape(n * n, 1) * np.array([1.0] * (lanes // 2) + [0.0] * (lanes // 2))
    matrix[:: n + 1] += RADAU9.eigenvalues
    solution, real = b.copy(), b[:, :1].copy()
    found_real = real.copy()
    table = [0, n, *range(n)]
    monkeypatch.setattr(irregular, "SIGNS", np.repeat([-1.0, 1.0], lanes // 2), raising=False)
    monkeypatch.setattr(dense, "WIDTH", lanes, raising=False)
    dense.factor(matrix, table, 1)  # type: ignore[arg-type]
    for right, times in (
        (solution, lambda entry, known: irregular.times(entry[:lanes], known)),
        (real, irregular.real_times),
    ):
        monkeypatch.setattr(dense, "entry_times", times, raising=False)
        dense.solve(right, matrix.ravel(), table, 1)  # type: ignore[arg-type]
    code["factor"](h, values, factors)
    code["solve"](h, b, factors)
    code["solve_real"](h, found_real, factors)
    assert factors.reshape(n * n, lanes) == pytest.approx(matrix, rel=1e-12, abs=1e-14)
    assert b == pytest.approx(solution, rel=1e-12, abs=1e-14)
    assert found_real == pytest.approx(real, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("n", [100, 300])
def test_a_dense_matrix_needs_no_table_of_its_entries(n: int) -> None:
    """In each of three pieces a record of the block, that is all."""
    tabled = Tabled(n, square(*range(n)), RADAU5)
    assert tabled.plan == Elimination(n, (), (), (), (tuple(range(n)),))
    assert tabled.numbers() == 3 * (n + 2)
    assert tabled.size == n * n * RADAU5.lanes
