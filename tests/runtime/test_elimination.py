"""The order of elimination, what it fills, and how it repeats itself; and loops over the rows of a table."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from llvmlite import ir
from machine_code import callable_from

from hierc.runtime.machine import elimination
from hierc.runtime.machine.elimination import Elimination, eliminate
from hierc.runtime.machine.repetitions import stretches
from hierc.runtime.machine.rows import each_row
from hierc.runtime.machine.types import DOUBLE, I64, POINTER
from hierc.runtime.machine.unit import Loaded, Unit, compile_object

Pattern = set[tuple[int, int]]
patterns = st.integers(1, 9).flatmap(
    lambda n: st.tuples(st.just(n), st.sets(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1))))
)


def chain(count: int, size: int) -> Pattern:
    """`count` agents of `size` states each, every state of which depends on all of its own and on one of either neighbour."""
    own = {(k * size + i, k * size + j) for k in range(count) for i in range(size) for j in range(size)}
    coupled = {(k * size + i, (k + d) * size) for k in range(count) for i in range(size) for d in (-1, 1)}
    return own | {(i, j) for i, j in coupled if 0 <= j < count * size}


# ---- order -------------------------------------------------------------------------------------------------------


@given(patterns, st.integers(2, 10))
def test_each_pivot_is_among_the_cheapest(given: tuple[int, Pattern], least: int) -> None:
    """By carrying the elimination out on the full set of nonzeros, with blocks of at least so many rows."""
    n, pattern = given
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(elimination, "BLOCK", least)
        plan = eliminate(n, frozenset(pattern))
    filled = {(i, j) for i, j in pattern if i != j}
    left = set(range(n))
    touched: Pattern = set()

    def cost(k: int) -> int:
        return sum(i in left for i, j in filled if j == k) * sum(j in left for i, j in filled if i == k)

    in_blocks = {k for block in plan.blocks for k in block}
    for step in plan.steps:
        assert cost(step.pivot) == min(cost(k) for k in left - in_blocks)
        left.remove(step.pivot)
        assert set(step.below) == {i for i, j in filled if j == step.pivot and i in left}
        assert set(step.right) == {j for i, j in filled if i == step.pivot and j in left}
        new = {(i, j) for i in step.below for j in step.right if i != j}
        filled |= new
        touched |= new
    assert sorted(left) == sorted(k for block in plan.blocks for k in block)
    dense = {(i, j) for block in plan.blocks for i in block for j in block}
    assert {(i, j) for i, j in filled if i in left and j in left} <= dense
    for block in plan.blocks:
        assert len(block) >= least
        inner = sum((i, j) in filled for i in block for j in block)
        assert inner >= elimination.FULL * len(block) * (len(block) - 1)
    assert set(plan.complex_entries) == touched - dense
    assert set(plan.real_entries) == filled - touched - dense


def depth(plan: Elimination) -> int:
    """How many pivots have to wait for each other at most."""
    waits = dict.fromkeys(range(plan.n), 1)
    for step in plan.steps:
        for k in (*step.below, *step.right):
            waits[k] = max(waits[k], waits[step.pivot] + 1)
    return max(waits.values())


@pytest.mark.parametrize("size", [1, 2, 4])
def test_chains_fill_in_proportion_to_their_length(size: int) -> None:
    plans = [eliminate(count * size, frozenset(chain(count, size))) for count in (50, 100, 200)]
    for facts in ([p.entries for p in plans], [p.updates for p in plans]):
        assert facts[2] - facts[1] == 2 * (facts[1] - facts[0])
    # From both ends: half as many pivots wait for each other as there are in a row.
    assert depth(plans[1]) <= 100 * size / 2 + size


def test_fill_of_a_banded_matrix() -> None:
    """Two above and two below the diagonal: nothing outside the band fills, whatever the length."""
    n = 300
    band = {(i, j) for i in range(n) for j in range(max(0, i - 2), min(n, i + 3))}
    assert eliminate(n, frozenset(band)).entries == len(band)


# ---- dense blocks ------------------------------------------------------------------------------------------------


def square(rows: range) -> Pattern:
    return {(i, j) for i in rows for j in rows}


def test_a_dense_matrix_is_one_block(monkeypatch: pytest.MonkeyPatch) -> None:
    """It costs what its elimination step by step does, and has none of its steps and entries."""
    plan = eliminate(30, frozenset(square(range(30))))
    assert plan == Elimination(30, (), (), (), (tuple(range(30)),))
    monkeypatch.setattr(elimination, "BLOCK", 31)
    stepwise = eliminate(30, frozenset(square(range(30))))
    assert len(stepwise.steps) == 30
    assert (plan.updates, plan.entries) == (stepwise.updates, stepwise.entries)


def test_dense_parts_are_blocks_of_their_own() -> None:
    crowds = square(range(30)) | square(range(30, 80))
    assert eliminate(80, frozenset(crowds)).blocks == (tuple(range(30)), tuple(range(30, 80)))


def test_what_a_crowd_needs_to_be_known_grows_as_its_jacobian() -> None:
    """Of each agent two states, all of which read the sum of the first: the second ones are eliminated, the first become a block."""

    def known(count: int) -> int:
        coupled = {(2 * i + 1, 2 * j) for i in range(count) for j in range(count)}
        own = {(2 * i, 2 * i + 1) for i in range(count)} | {(k, k) for k in range(2 * count)}
        plan = eliminate(2 * count, frozenset(coupled | own))
        assert [len(block) for block in plan.blocks] >= [count]
        listed = len(plan.complex_entries) + len(plan.real_entries)
        return listed + sum(1 + len(s.below) * len(s.right) for s in plan.steps)

    assert known(160) < 4.2 * known(80)


@pytest.mark.parametrize("size", [1, 4])
def test_chains_and_bands_have_no_blocks(size: int) -> None:
    assert eliminate(100 * size, frozenset(chain(100, size))).blocks == ()


# ---- repetitions -------------------------------------------------------------------------------------------------


@given(st.lists(st.sampled_from("ab"), max_size=60), st.integers(2, 5))
def test_stretches_cover_what_they_repeat(items: list[str], least: int) -> None:
    found = stretches(items, least)
    assert [k for s in found for k in range(s.first, s.end)] == list(range(len(items)))
    for stretch in found:
        body = items[stretch.first : stretch.first + stretch.period]
        assert items[stretch.first : stretch.end] == body * stretch.rounds
        assert stretch.rounds == 1 or stretch.rounds >= least
    assert all(a.rounds > 1 or b.rounds > 1 for a, b in pairwise(found))


def test_a_chain_repeats_itself() -> None:
    plan = eliminate(400, frozenset(chain(100, 4)))
    found = stretches([(len(s.below), len(s.right)) for s in plan.steps], 4)
    assert sum(s.period * s.rounds for s in found if s.rounds > 1) > 0.9 * 400
    assert sum(s.period for s in found) < 60


# ---- rows --------------------------------------------------------------------------------------------------------

COLUMNS = {
    "constant": [7, 7, 7, 7, 7],
    "evenly spaced": [3, 5, 7, 9, 11],
    "downwards": [12, 8, 4, 0, -4],
    "none of these": [5, 1, 9, 9, 2],
    "another": [0, 1, 0, 1, 0],
}


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_rows_of_a_table(count: int, backwards: bool) -> None:
    """Each round stores the row's numbers one after the other."""
    table = [list(row) for row in zip(*COLUMNS.values(), strict=True)][:count]
    unit = Unit("rows")
    function = ir.Function(unit.module, ir.FunctionType(ir.VoidType(), [POINTER]), "entry")
    builder = ir.IRBuilder(function.append_basic_block("entry"))
    next_place = builder.alloca(I64)
    builder.store(ir.Constant(I64, 0), next_place)
    with each_row(unit, builder, table, backwards=backwards) as numbers:
        for number in numbers:
            place = builder.load(next_place, typ=I64)
            value = ir.Constant(I64, number) if isinstance(number, int) else number
            address = builder.gep(function.args[0], [place], source_etype=DOUBLE)
            builder.store(builder.sitofp(value, DOUBLE), address)
            builder.store(builder.add(place, ir.Constant(I64, 1)), next_place)
    builder.ret_void()
    found = np.zeros(len(COLUMNS) * count)
    callable_from(Loaded([compile_object(unit.text())]))(found)
    assert found.reshape(count, -1).tolist() == (table[::-1] if backwards else table)
