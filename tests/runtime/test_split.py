"""The part of a function that does not depend on the states: with the rest it makes the whole function again."""

from __future__ import annotations

import ast
import math
from collections.abc import Collection

import numpy as np
import pytest
from machine_code import definition
from random_text import random_function

from hierc.runtime.machine.split import depends, narrowed, split

RNG = np.random.default_rng(11)


def run(function: ast.FunctionDef, arguments: dict[str, object]) -> None:
    names: dict[str, object] = {"math": math}
    exec(compile(ast.fix_missing_locations(ast.Module([function], [])), "split", "exec"), names)
    names[function.name](*[arguments[a.arg] for a in function.args.args])


def states_only(array: str, index: int) -> bool:
    return array != "x"


def all_but_one_state(array: str, index: int) -> bool:
    return (array, index) != ("x", 1)


def nothing_fixed(array: str, index: int) -> bool:
    return False


def only_values(array: str, index: int) -> bool:
    return array == "p"


@pytest.mark.parametrize("fixed", [states_only, all_but_one_state, nothing_fixed, only_values])
@pytest.mark.parametrize("seed", range(15))
def test_the_parts_make_the_whole(seed: int, fixed) -> None:
    whole = definition(random_function(seed))
    pieces = split(whole, "dx", fixed)
    arguments = {
        "t": 0.7, "x": RNG.normal(size=2).tolist(), "u": RNG.normal(size=1).tolist(), "p": RNG.normal(size=2).tolist(),
        "v": [math.nan] * pieces.saved,
    }  # fmt: skip
    wanted, found = [math.nan] * 6, [math.nan] * 6
    run(whole, {**arguments, "dx": wanted})
    run(pieces.before, {**arguments, "dx": None})
    run(pieces.after, {**arguments, "dx": found})
    assert found == wanted


@pytest.mark.parametrize("seed", range(15))
def test_the_first_part_may_tell_what_is_fixed(seed: int) -> None:
    whole = definition(random_function(seed))
    pieces = split(whole, "dx", all_but_one_state, telling=True)
    arguments = {
        "t": 0.7, "x": [0.4, math.nan], "u": [0.3], "p": [0.1, -0.4], "v": [math.nan] * pieces.saved,
    }  # fmt: skip
    wanted, found = [math.nan] * 6, [math.nan] * 6
    run(whole, {**arguments, "x": [0.4, -0.2], "dx": wanted})
    run(pieces.before, {**arguments, "dx": found})
    moving = depends(whole, "dx", all_but_one_state)
    assert [k for k in range(6) if math.isnan(found[k])] == sorted(moving)
    assert all(found[k] == wanted[k] for k in range(6) if k not in moving)


@pytest.mark.parametrize("seed", range(15))
def test_the_first_part_reads_nothing_that_moves(seed: int) -> None:
    pieces = split(definition(random_function(seed)), "dx", states_only)
    assert "x" not in {
        node.id for node in ast.walk(ast.Module(pieces.before.body, [])) if isinstance(node, ast.Name)
    }


@pytest.mark.parametrize("seed", range(15))
def test_what_depends_changes_and_nothing_else(seed: int) -> None:
    """Perturbing the states changes only entries said to depend on them."""
    whole = definition(random_function(seed))
    moving = depends(whole, "dx", states_only)
    arguments = {"t": 0.7, "u": [0.3], "p": [0.1, -0.4]}
    results = []
    for _ in range(20):
        dx = [math.nan] * 6
        run(whole, {**arguments, "x": RNG.normal(size=2).tolist(), "dx": dx})
        results.append(dx)
    changing = {k for k in range(6) if len({row[k] for row in results}) > 1}
    assert changing <= moving


@pytest.mark.parametrize("entries", [[0], [3], [1, 5], [], range(6)])
@pytest.mark.parametrize("seed", range(15))
def test_a_function_for_some_of_its_results(seed: int, entries: Collection[int]) -> None:
    """Those are what they were; and no statement is left that none of them needs."""
    whole = definition(random_function(seed))
    part = narrowed(whole, "dx", entries)
    arguments = {"t": 0.7, "x": [0.4, -0.2], "u": [0.3], "p": [0.1, -0.4]}
    wanted, found = [math.nan] * 6, [math.nan] * 6
    run(whole, {**arguments, "dx": wanted})
    run(part, {**arguments, "dx": found})
    assert [found[k] for k in entries] == [wanted[k] for k in entries]
    assert [k for k in range(6) if math.isnan(found[k])] == [k for k in range(6) if k not in entries]
    kept = [ast.unparse(s) for s in part.body if not isinstance(s, ast.Pass)]
    for k, line in enumerate(kept):
        names = {
            n.id
            for n in ast.walk(ast.parse(line))
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
        }
        later = {n.id for text in kept[k + 1 :] for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Name)}
        assert "dx[" in line or names & later


def test_what_moves_out_and_what_stays() -> None:
    text = """
def rhs(t, x, u, d, p, dx):
    a = math.sin(p[0]*t)
    b = a*u[0]
    c = b + x[0]
    dx[0] = c*a
    dx[1] = b*2.0
"""
    pieces = split(definition(text), "dx", states_only)
    assert ast.unparse(pieces.before).splitlines()[1:] == [
        "    a = math.sin(p[0] * t)", "    b = a * u[0]", "    v[0] = b * 2.0", "    v[1] = a", "    v[2] = b",
    ]  # fmt: skip
    assert ast.unparse(pieces.after).splitlines()[1:] == [
        "    a = v[1]", "    b = v[2]", "    c = b + x[0]", "    dx[0] = c * a", "    dx[1] = v[0]",
    ]  # fmt: skip
    assert pieces.saved == 3
    assert depends(definition(text), "dx", states_only) == {0}


def test_a_branch_that_stores_stays_whole() -> None:
    """So do the names that it sets, wherever they are read."""
    text = """
def rhs(t, x, u, d, p, dx):
    if t > 1.0:
        a = 1.0
        dx[0] = 2.0
    else:
        a = 2.0
        dx[0] = 3.0
    b = a*2.0
    dx[1] = b + x[0]
"""
    pieces = split(definition(text), "dx", states_only)
    assert pieces.saved == 0
    found = [math.nan] * 2
    run(pieces.after, {"t": 2.0, "x": [10.0], "u": [], "d": [], "p": [], "v": [], "dx": found})
    assert found == [2.0, 12.0]
