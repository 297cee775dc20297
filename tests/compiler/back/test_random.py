"""Random expressions through everything: right-hand sides against the plain interpreter, Jacobians against differences in 60 digits."""

import math

import mpmath
import pytest
from hand import SPAN, TIME, X, apply, choose, single
from hypothesis import Phase, assume, given, reject, settings
from hypothesis import strategies as st
from oracle import MP, Interpreter, System, generate

from hierc.compiler.expression import Number
from hierc.grammar.problems import ModelError

UNARY = [
    "neg",
    "sqrt",
    "exp",
    "log",
    "log10",
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "sinh",
    "cosh",
    "tanh",
]
UNARY += ["abs", "sign", "floor", "ceil", "round"]
BINARY = [
    "add",
    "sub",
    "mul",
    "div",
    "pow",
    "atan2",
    "mod",
    "quotient",
    "min",
    "max",
    "add",
    "sub",
    "mul",
    "div",
]
COMPARE = ["lt", "le", "gt", "ge"]
STATES, INPUTS, PARAMETERS = 3, 2, [0.7, -1.3]

#: Shrinking such trees takes minutes; what fails is printed as it is.
PHASES = (Phase.explicit, Phase.generate)

#: A recipe for an expression, as nested tuples; leaves are ("x", 0), ("u", 1), ("p", 0), ("t",), ("c", 2.5).
leaves = st.one_of(
    st.tuples(st.just("x"), st.integers(0, STATES - 1)),
    st.tuples(st.just("u"), st.integers(0, INPUTS - 1)),
    st.tuples(st.just("p"), st.integers(0, 1)),
    st.just(("t",)),
    st.tuples(st.just("c"), st.sampled_from([0.0, 1.0, -1.0, 2.0, 3.0, 0.5, -2.5, 0.1, 7.0])),
)


def grow(inner):
    test = st.tuples(st.sampled_from(COMPARE), inner, inner)
    test = st.one_of(
        test, st.tuples(st.just("not"), test), st.tuples(st.sampled_from(["and", "or"]), test, test)
    )
    return st.one_of(
        st.tuples(st.sampled_from(UNARY), inner),
        st.tuples(st.sampled_from(BINARY), inner, inner),
        st.tuples(st.just("power"), inner, st.sampled_from([2.0, 3.0, -1.0, 0.5, 1.5, -2.0, 4.0, 2.5, 7.0])),
        st.tuples(st.just("if"), test, inner, inner),
    )


recipes = st.recursive(leaves, grow, max_leaves=14)
# No -0.0: a power made of products and a root may lose its sign.
points = st.floats(-3, 3).map(lambda v: round(v, 6) + 0.0)


def cook(recipe, x, u, p) -> X:
    match recipe:
        case ("x", k):
            return x[k]
        case ("u", k):
            return u[k]
        case ("p", k):
            return p[k]
        case ("t",):
            return TIME
        case ("c", value):
            return X(Number(SPAN, value))
        case ("power", base, exponent):
            return apply("pow", cook(base, x, u, p), exponent)
        case ("if", test, a, b):
            return choose(*(cook(r, x, u, p) for r in (test, a, b)))
        case (op, *args):
            return apply(op, *(cook(r, x, u, p) for r in args))
    raise AssertionError(recipe)


def modelled(*trees):
    def rates(x, u, p):
        return [cook(r, x, u, p) for r in trees]

    return single(rates, parameters=PARAMETERS, inputs=INPUTS, initial=[0.0] * STATES)


def generated(model):
    try:
        return generate(model)
    except ModelError as error:  # a branch never taken may hold a number that is none, say 1/0
        if {p.code for p in error.problems} == {"E581"}:
            reject()
        raise


class Rounded(Interpreter):
    """Powers with one rounding more: how much that changes the result."""

    def apply(self, op, *a):
        return super().apply(op, *a) * (1 + 4e-16 if op == "pow" else 1)


def plainly(model, t, states, q):
    """The rates as they stand in the text, and what a rounding of powers does to them; None where they are undefined."""
    try:
        values = Interpreter(model, t, states, q).rates(1)
        near = Rounded(model, t, states, q).rates(1)
    except (ValueError, ArithmeticError):
        return None
    if not all(math.isfinite(v) for v in values):
        return None
    return [(v, abs(v - n)) for v, n in zip(values, near, strict=True)]


@settings(max_examples=300, deadline=None, derandomize=True, phases=PHASES)
@given(recipes, recipes, recipes, st.lists(points, min_size=6, max_size=6))
def test_right_hand_sides(a, b, c, at):
    model = modelled(a, b, c)
    t, states = at[5], [at[:2], at[2:5]]
    expected = plainly(model, t, states, PARAMETERS)
    assume(expected is not None)
    text = generated(model)
    try:
        system = System(text)
        found = system.rates(t, states, 1)
    except (ValueError, ArithmeticError):
        # A power written as products may divide by an underflowing number; anything else is a fault.
        assert "pow" in str((a, b, c))
        return
    for ours, (theirs, wobble) in zip(found, expected, strict=True):
        # Powers are products, so rounded differently than `pow`; everything else is the same to the last bit.
        assert abs(ours - theirs) <= 20 * wobble + 4 * math.ulp(theirs)
        assert ours == theirs or "pow" in str((a, b, c))


@settings(max_examples=150, deadline=None, derandomize=True, phases=PHASES)
@given(recipes, st.lists(points, min_size=6, max_size=6))
def test_jacobians(a, at):
    model = modelled(a, ("x", 0), ("c", 0.0))
    t, states = at[5], [at[:2], at[2:5]]
    text = generated(model)
    try:
        system = System(text)
        found = system.jacobian(t, states, 1)
    except (ValueError, ArithmeticError):
        found = None
    with mpmath.workdps(60):
        columns = [*((1, k) for k in range(STATES)), *((0, k) for k in range(INPUTS))]
        expected = [difference(model, t, states, PARAMETERS, place) for place in columns]
        assume(None not in expected)
    if found is None and any(f in str(a) for f in ("sqrt", "pow", "asin", "acos")):
        reject()  # infinite slopes at the end of the domain, where the value may be constant
    assert found is not None
    for column, slope in enumerate(expected):
        assert found.get((0, column), 0.0) == pytest.approx(float(slope), rel=1e-6, abs=1e-9)


def difference(model, t, states, q, place):
    """The slope of the first rate; None where it is undefined, huge, or not smooth here."""

    def rate(h):
        moved = [[mpmath.mpf(v) for v in s] for s in states]
        node, k = place
        moved[node][k] += h
        return Interpreter(model, mpmath.mpf(t), moved, [mpmath.mpf(v) for v in q], MP()).rates(1)[0]

    h = mpmath.mpf("1e-15")
    try:
        left, here, right = (rate(s * h) for s in (-1, 0, 1))
    except (ValueError, ArithmeticError, TypeError, NotImplementedError):
        return None
    slopes = [(here - left) / h, (right - here) / h]
    if any(not isinstance(s, mpmath.mpf) or not mpmath.isfinite(s) or abs(s) > 1e8 for s in slopes):
        return None
    if abs(slopes[0] - slopes[1]) > 1e-6 * (1 + abs(slopes[0])):
        return None  # a kink or a jump
    return (slopes[0] + slopes[1]) / 2
