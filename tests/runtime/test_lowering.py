"""Model text as machine code: bit for bit what CPython computes, over lanes too, branches blended."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from machine_code import Floats, compiled, definition, over_lanes, room, run_both
from random_text import random_function

from hierc.runtime.machine.storage import set_once
from hierc.runtime.machine.types import UnsupportedCode
from hierc.runtime.machine.unit import CROWDED, Unit

RNG = np.random.default_rng(20250611)


def same_bits(a: Floats, b: Floats) -> bool:
    """Equal with the sign of zeros; any NaN equals any other."""
    return bool(((a.view(np.int64) == b.view(np.int64)) | (np.isnan(a) & np.isnan(b))).all())


def ulps(a: Floats, b: Floats) -> float:
    """The largest distance in spacings of doubles at b."""
    return float(np.max(np.abs(a - b) / np.spacing(np.abs(b)), initial=0.0))


#: Functions of one argument, with an interval of their domain.
UNARY = {
    "sqrt": (0, 1e6), "fabs": (-9, 9), "exp": (-40, 40), "log": (1e-9, 1e9), "log10": (1e-9, 1e9),
    "sin": (-50, 50), "cos": (-50, 50), "tan": (-20, 20), "asin": (-1, 1), "acos": (-1, 1), "atan": (-30, 30),
    "sinh": (-20, 20), "cosh": (-20, 20), "tanh": (-5, 5), "floor": (-99, 99), "ceil": (-99, 99),
}  # fmt: skip
BINARY = ("atan2", "fmod", "copysign", "pow")
#: Over lanes these have code of their own; everything else is the C library's or exact.
OWN_CODE = {"sin", "cos", "exp"}


@pytest.mark.parametrize("lanes", [1, 4, 8])
@pytest.mark.parametrize("name", UNARY)
def test_functions_of_one_argument(name: str, lanes: int) -> None:
    low, high = UNARY[name]
    x = np.concatenate([RNG.uniform(low, high, 997), [0.0 if low == 0 else 1.0, (low + high) / 2, 1.0]])
    call = f"float(math.{name}(x[0]))"
    text = f"def rhs(t, x, dx):\n    dx[0] = {call}\n"
    expected, found = run_both(text, {"t": np.zeros(1000), "x": x[:, None]}, "dx", 1, lanes)
    if lanes > 1 and name in OWN_CODE:
        assert ulps(found, expected) <= 2.0
    else:
        assert same_bits(found, expected)


@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("name", BINARY)
def test_functions_of_two_arguments(name: str, lanes: int) -> None:
    x = RNG.normal(0, 30, (4000, 2))
    if name == "pow":
        x = np.abs(x) * [0.5, 0.1]
    text = f"def rhs(t, x, dx):\n    dx[0] = math.{name}(x[0], x[1])\n"
    expected, found = run_both(text, {"t": np.zeros(4000), "x": x}, "dx", 1, lanes)
    assert same_bits(found, expected)


@pytest.mark.parametrize("exponent", [2.0, 3.0, 0.5, -1.0, -0.5, 1.0, 1.5, 4.0])
def test_powers_with_constant_exponents(exponent: float) -> None:
    """The optimiser knows `pow`: its shortcuts must not cost a bit."""
    x = np.exp(RNG.uniform(-30, 30, 20000))[:, None]
    text = (
        f"def rhs(t, x, dx):\n    dx[0] = math.pow(x[0], {exponent})\n    dx[1] = math.pow(2.0, x[0]*1e-12)\n"
    )
    expected, found = run_both(text, {"t": np.zeros(len(x)), "x": x}, "dx", 2)
    assert same_bits(found, expected)


@pytest.mark.parametrize("lanes", [1, 4, 8])
@pytest.mark.parametrize("seed", range(12))
def test_random_functions(seed: int, lanes: int) -> None:
    """Mixed scalars and lanes, nested branches, on parameters, on states, on both."""
    text = random_function(seed)
    samples = 64
    arrays = {
        "t": RNG.uniform(0, 5, samples),
        "x": RNG.normal(0, 2, (samples, 2)),
        "u": np.round(RNG.normal(0, 2, (samples, 1))),
        "p": RNG.normal(0, 2, 2),
    }
    expected, found = run_both(text, arrays, "dx", 6, lanes)
    assert np.isfinite(expected).all()
    assert same_bits(found, expected)


@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_local_that_is_scalar_on_one_side_only(lanes: int, sign: float) -> None:
    text = """
def rhs(t, x, p, dx):
    if p[0] > 0.0:
        a = p[1]
        b = x[0]
    else:
        a = x[0]
        b = p[1]
    dx[0] = a
    dx[1] = b
"""
    arrays = {"t": np.zeros(8), "x": RNG.normal(size=(8, 1)), "p": np.array([sign, 5.0])}
    expected, found = run_both(text, arrays, "dx", 2, lanes)
    assert same_bits(found, expected)


@pytest.mark.parametrize("lanes", [1, 4, 8])
def test_the_side_not_chosen_does_no_harm(lanes: int) -> None:
    text = """
def rhs(t, x, dx):
    if x[0] >= 0.0:
        a = math.sqrt(x[0])
        b = math.log(x[0] + 1.0)/x[0] if x[0] > 0.0 else 1.0
    else:
        a = 0.0
        b = 1.0/x[0]
    dx[0] = a
    dx[1] = b
"""
    x = np.array([4.0, -1.0, 0.0, 9.0, -4.0, 2.0, -0.5, 1e-300])[:, None]
    expected, found = run_both(text, {"t": np.zeros(8), "x": x}, "dx", 2, lanes)
    assert np.isfinite(found).all()
    assert same_bits(found, expected)


@pytest.mark.parametrize("lanes", [1, 4])
def test_not_a_number_passes_every_guard(lanes: int) -> None:
    """No flag lets the optimiser assume that there is no NaN."""
    text = """
def rhs(t, x, dx):
    dx[0] = 1.0 if x[0] != x[0] else 0.0
    dx[1] = 1.0 if x[0] == x[0] else 0.0
    dx[2] = 1.0 if x[0] < 1.0 or x[0] >= 1.0 else 0.0
    dx[3] = x[0]*0.0
    dx[4] = x[0] - x[0]
    dx[5] = 1.0 if not (x[0] < 1.0) else 0.0
"""
    x = np.array([math.nan, math.inf, -math.inf, 0.5])[:, None]
    expected, found = run_both(text, {"t": np.zeros(4), "x": x}, "dx", 6, lanes)
    assert same_bits(found, expected)
    assert found[0].tolist()[:3] == [1.0, 0.0, 0.0]


@pytest.mark.parametrize("lanes", [1, 4])
def test_no_trap_where_cpython_raises(lanes: int) -> None:
    text = """
def rhs(t, x, dx):
    dx[0] = 1.0/x[0]
    dx[1] = math.log(x[0])
    dx[2] = math.sqrt(x[0] - 1.0)
    dx[3] = 1.0/0.0
    dx[4] = math.exp(x[0] + 1000.0)
    dx[5] = 0.0/x[0]
"""
    out = room(6, lanes)
    compiled(definition(text), lanes)(room(1, lanes), over_lanes(np.zeros((lanes, 1))), out)
    wanted = [math.inf, -math.inf, math.nan, math.inf, math.inf, math.nan]
    assert same_bits(out, np.repeat(np.array(wanted)[:, None], lanes, 1))


def test_products_and_sums_are_not_contracted() -> None:
    """a*b - c with one rounding less would differ from CPython in about half of all cases."""
    x = RNG.normal(size=(2000, 3))
    x[:, 2] = x[:, 0] * x[:, 1]
    text = "def rhs(t, x, dx):\n    dx[0] = x[0]*x[1] - x[2]\n    dx[1] = x[0]*x[1] + x[1]*x[2]\n"
    expected, found = run_both(text, {"t": np.zeros(2000), "x": x}, "dx", 2, 8)
    assert (expected[:, 0] == 0.0).all()
    assert same_bits(found, expected)


@pytest.mark.parametrize(
    "line",
    [
        "dx[0] = invoke(int(x[0]), 1.0)",
        "dx[0] = from_bits(1)",
        "dx[0] = __import__('os').system('true')",
        "dx[0] = exec('1')",
        "dx[0] = x.real",
        "dx[0] = math.sin.real",
        "dx[0] = math.gamma(x[0])",
        "dx[0] = sum(x[0])",
        "dx[0] = x[0]**2",
        "dx[0] = x[0]//2.0",
        "dx[0] = 'text'",
        "dx[0] = 1j",
        "dx[0] = [v for v in x]",
        "dx[0] = (lambda: 1.0)()",
        "dx[0] = (y := 1.0)",
        "dx[0] = max(*x)",
        "dx[0] = max(x[0], key=1.0)",
        "dx[0] = x[0:1]",
        "dx[0] = f'{x[0]}'",
        "dx[0] = x[0] < 1.0 < 2.0",
        "dx[0] = x[0] is None",
        "dx[0] = yield",
        "dx[0] = unknown",
        "dx[0], dx[0] = x[0], x[0]",
        "dx[0] = dx[0] = 1.0",
        "*dx, = x[0]",
        "global g",
        "del dx",
        "import os",
        "from os import system",
        "assert x[0]",
        "raise ValueError",
        "with x[0]: pass",
        "try: pass\n    finally: pass",
        "def f(): pass",
        "class C: pass",
        "for k in x: pass",
        "async def f(): pass",
        "print(x[0])",
        "x[0].y = 1.0",
    ],
)
def test_what_is_not_in_the_dialect_is_refused(line: str) -> None:
    """Refused while lowering, with nothing run: lowering never executes text."""
    text = f"def rhs(t, x, dx):\n    {line}\n"
    with pytest.raises(UnsupportedCode):
        compiled(definition(text))


def scalar_that_widens(x: np.ndarray) -> None:
    a = 0.0
    for _ in range(3):
        a = a + x


def test_a_scalar_that_gets_lanes_within_a_loop_is_refused() -> None:
    """The next round would read the scalar again."""
    scalar_that_widens.__annotations__ = {"x": np.ndarray, "return": None}
    from hierc.runtime.machine.dialect import Lanes

    scalar_that_widens.__annotations__["x"] = Lanes
    with pytest.raises(UnsupportedCode, match="scalar before a loop"):
        Unit("test").lower(scalar_that_widens, lanes=4, export="entry")


def test_which_locals_need_no_slot() -> None:
    """Those that one assignment sets, outside of branches and loops, and arguments that stay."""
    text = """
def f(a, b):
    once, pair = g(a)
    twice = a
    twice = once
    b += 1.0
    if once > 0.0:
        branch = 1.0
    else:
        branch = 2.0
    for k in range(3):
        inside = k
    counted = 0
    while counted < 3:
        counted += 1
    last = branch
    """
    assert set_once(["a", "b"], definition(text).body) == {"a", "once", "pair", "last"}


def test_many_elementary_functions_are_called_rather_than_written_out() -> None:
    """They give what they give when they are few."""
    count = CROWDED + 5
    lines = [
        f"    dx[{k}] = math.{name}(x[{k}] + x[0])\n"
        for k, name in zip(range(count), itertools.cycle(("sin", "cos", "exp")))
    ]
    text = "def rhs(t, x, dx):\n" + "".join(lines)
    few = "def rhs(t, x, dx):\n" + "".join(lines[:3])
    x = RNG.normal(0, 3, (64, count))
    expected, found = run_both(text, {"t": np.zeros(64), "x": x}, "dx", count, 8)
    _, alone = run_both(few, {"t": np.zeros(64), "x": x}, "dx", 3, 8)
    assert ulps(found, expected) <= 2.0
    assert same_bits(found[:, :3], alone)
