"""Values: literals, identities, arithmetic when compiling, limits; and that no text ever reaches sympy."""

import ast
import math
from pathlib import Path

import pytest
import sympy
from hand import SPAN, TIME, X, apply, choose, cos, exp, log, sin, single
from hypothesis import given
from hypothesis import strategies as st
from oracle import System, generate

import hierc.compiler
from hierc.compiler.emission.target import (
    Assign,
    Binary,
    Comment,
    Conditional,
    Constant,
    If,
    Name,
    Unary,
    show,
)
from hierc.compiler.expression import Apply, Number, State
from hierc.compiler.symbolic import graph as symbolic_graph
from hierc.compiler.symbolic.algebra import tidy
from hierc.compiler.symbolic.derive import derive
from hierc.compiler.symbolic.graph import Graph
from hierc.grammar.problems import ModelError


def rates(make, x):
    return System(generate(single(make, initial=[0.0] * len(x)))).rates(0.5, [list(x)], 0)


# ---- literals -----------------------------------------------------------------------------


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_literal_round_trips(value):
    text = show([Assign(Name("x"), Binary("*", Constant(value), Name("y")))])
    literal = eval(text.split("=")[1].split("*")[0])
    assert math.copysign(1.0, literal) == math.copysign(1.0, value)
    assert literal == value


@given(st.floats(allow_nan=False, allow_infinity=False, width=64))
def test_literals_reach_the_equations_unchanged(value):
    (found,) = rates(lambda x, u, p: [X(Number(SPAN, value)) + 0.0 * x[0]], [1.0])
    assert found == value


def test_a_third_keeps_its_bits():
    found = rates(lambda x, u, p: [x[0] / 3, x[1] * (1 / 3)], [1.0, 1.0])
    assert found == [1 / 3, 1 / 3]


@pytest.mark.parametrize(
    "make",
    [
        lambda: apply("pow", 9.0, apply("pow", 9.0, 9.0)),
        lambda: apply("mul", 1e308, 10.0),
        lambda: apply("div", 1.0, 0.0),
        lambda: apply("sqrt", -1.0),
        lambda: apply("pow", 10.0, 5000.0),
        lambda: apply("exp", 1000.0),
    ],
)
def test_numbers_without_a_finite_value_are_problems_with_a_place(make):
    with pytest.raises(ModelError) as caught:
        derive(single(lambda x, u, p: [make() * x[0]], initial=[0.0]))
    (problem,) = caught.value.problems
    assert problem.code == "E581"
    assert problem.span == SPAN
    assert "finite" in problem.title()


# ---- identities ------------------------------------------------------------------------------


def simplified(make):
    graph = Graph()
    graph.at(SPAN)
    x, y = graph.leaf("state", 0), graph.leaf("state", 1)
    return graph, make(graph, x, y)


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda g, x, y: g.apply("mul", g.number(0.0), g.apply("log", x)), "0.0"),
        (lambda g, x, y: g.apply("div", x, x), "1.0"),
        (lambda g, x, y: g.apply("sub", x, x), "0.0"),
        (lambda g, x, y: g.apply("add", x, g.number(0.0)), "x"),
        (lambda g, x, y: g.apply("mul", x, g.number(1.0)), "x"),
        (lambda g, x, y: g.apply("neg", g.apply("neg", x)), "x"),
        (lambda g, x, y: g.apply("pow", x, g.number(1.0)), "x"),
        (lambda g, x, y: g.apply("pow", x, g.number(0.0)), "1.0"),
        (lambda g, x, y: g.choose(g.apply("lt", x, y), x, x), "x"),
        (lambda g, x, y: g.choose(g.number(1.0), x, y), "x"),
        (lambda g, x, y: g.apply("max", x, x), "x"),
        (lambda g, x, y: g.apply("div", g.number(0.0), y), "0.0"),
        (lambda g, x, y: g.choose(g.apply("lt", x, y), g.choose(g.apply("lt", x, y), x, y), x), "x"),
    ],
)
def test_identities_over_the_reals(make, expected):
    graph, value = simplified(make)
    found = graph.values[value]
    assert ("x" if found.op == "state" and found.index == 0 else repr(found.number)) == expected


def test_functions_are_not_undone():
    """`exp(log(x))` keeps its domain: it is not an identity over the reals."""
    with pytest.raises(ValueError, match=r"domain|positive"):
        rates(lambda x, u, p: [exp(log(x[0]))], [-1.0])


def test_equal_subexpressions_are_one_value():
    graph, value = simplified(
        lambda g, x, y: g.apply("sub", g.apply("mul", x, y), g.apply("mul", y, x))  # to the last bit
    )
    assert graph.literal(value) == 0.0


def test_a_quotient_stays_a_quotient():
    text = generate(
        single(lambda x, u, p: [x[0] / 3 + x[1] / 3, x[1] / p[0]], initial=[0.0, 0.0], parameters=[3.0])
    )
    body = next(f for f in ast.parse(text).body if getattr(f, "name", "") == "Single_rhs")
    assert sum(isinstance(n, ast.Div) for n in ast.walk(body)) == 3


def test_sums_keep_their_order():
    found = rates(lambda x, u, p: [(x[0] + 1e16) - 1e16, x[0] + (1e16 - 1e16)], [1.0, 0.0])
    assert found == [(1.0 + 1e16) - 1e16, 1.0]


@pytest.mark.parametrize("exponent", [2, 3, 5, 7, 16, 31, -1, -3, 0.5, 1.5, -0.5, 2.5, 40, -40, 1.25])
def test_powers(exponent):
    for base in (0.3, 1.0, 2.7):
        (found,) = rates(lambda x, u, p: [x[0] ** exponent], [base])
        assert found == pytest.approx(base**exponent, rel=2e-15)


def test_powers_of_negative_numbers():
    assert rates(lambda x, u, p: [x[0] ** 3, x[1] ** -2], [-2.0, -2.0]) == [-8.0, 0.25]
    with pytest.raises(
        ValueError, match=r"domain|nonnegative"
    ):  # not the complex number that Python's ** would give
        rates(lambda x, u, p: [x[0] ** 1.5], [-1.0])


# ---- size ---------------------------------------------------------------------------------------


def deep(op, count):
    tree = State(SPAN, 0)
    for _ in range(count):
        tree = Apply(SPAN, op, (tree, State(SPAN, 1)))
    return X(tree)


def test_long_sums_do_not_recurse():
    text = generate(single(lambda x, u, p: [deep("add", 8000), sin(deep("mul", 1500))], initial=[0.0, 0.0]))
    system = System(text)
    assert system.rates(0, [[1.0, 0.5]], 0) == [4001.0, math.sin(0.5**1500)]
    assert system.jacobian(0, [[1.0, 0.5]], 0)[0, 1] == 8000.0


def test_deep_functions_do_not_recurse():
    def make(x, u, p):
        tree = x[0]
        for _ in range(2000):
            tree = sin(tree)
        return [tree]

    (found,) = rates(make, [1.0])
    expected = 1.0
    for _ in range(2000):
        expected = math.sin(expected)
    assert found == expected


def test_derivatives_do_not_swell():
    """Products of sums, 60 deep: written out, the derivative would have 2**60 terms."""

    def make(x, u, p):
        a, b = x
        for _ in range(60):
            a, b = a * cos(b), b + sin(a)
        return [a, b]

    form = derive(single(make, initial=[0.5, 0.5])).forms[0]
    assert len(form.jac.block.steps) < 60 * 30


def test_a_budget_ends_what_grows_too_far(monkeypatch):
    monkeypatch.setattr(symbolic_graph, "BUDGET", 500)
    with pytest.raises(ModelError) as caught:
        derive(growing())
    (problem,) = caught.value.problems
    assert (problem.code, problem.span is None) == ("E582", False)
    assert "symbolic" in problem.title()


def growing():
    def make(x, u, p):
        value = x[0]
        for k in range(600):
            value = value * x[1] + float(k)
        return [value, 0.0 * TIME]

    return single(make, initial=[0.0, 0.0])


def test_choices_that_would_be_written_again_and_again_are_refused():
    """Each choice stands in two branches that exclude nothing: the text would double at every level."""

    def make(x, u, p):
        value = x[0]
        for k in range(40):
            a, b = x[0] > float(k), x[1] > float(k)
            value = choose(a, sin(value), 1.0) + choose(b, value, 2.0)
        return [value, 0.0 * TIME]

    with pytest.raises(ModelError, match=r"E582|E583"):
        derive(single(make, initial=[0.0, 0.0]))


# ---- sympy -------------------------------------------------------------------------------------------


def test_sympy_collects_what_differentiation_left():
    graph = Graph()
    graph.at(SPAN)
    a, b, c = (graph.apply(op, graph.leaf("state", k)) for k, op in enumerate(("sin", "cos", "exp")))
    product = graph.apply("mul", a, b)
    value = graph.apply("sub", graph.apply("add", product, c), product)
    assert tidy(graph, [value], [a, b, c]) == [c]


def test_sympy_never_does_arithmetic_on_numbers_or_enters_functions():
    graph = Graph()
    graph.at(SPAN)
    x = graph.leaf("state", 0)
    big = graph.apply("mul", graph.number(1e300), x)
    value = big
    for _ in range(12):  # as integers: 10**(300*2**12)
        value = graph.apply("mul", value, value)
    (found,) = tidy(graph, [value], [])
    assert math.isfinite(max(v.number for v in graph.values))
    assert found <= len(graph.values)


SYMPY = {"sympify", "S", "parse_expr", "lambdify", "simplify", "symbols", "var", "Function"}
PYTHON = {"eval", "exec", "compile", "sympify", "parse_expr", "lambdify"}


def test_no_text_reaches_sympy():
    """sympify and its kin evaluate text; `symbols` splits it. Symbols are made one by one, with names of ours."""
    sources = list(Path(hierc.compiler.__file__).parent.rglob("*.py"))
    assert len(sources) > 40
    for path in sources:
        for node in ast.walk(ast.parse(path.read_text())):
            if (
                isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Name)
                and node.value.id == "sympy"
            ):
                assert node.attr not in SYMPY, path
            if isinstance(node, ast.ImportFrom):
                assert (node.module or "").split(".")[0] != "sympy", path
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in PYTHON, path


def test_names_of_symbols_are_ours(monkeypatch):
    made = []
    symbol = sympy.Symbol
    monkeypatch.setattr(
        sympy.Symbol, "__new__", lambda cls, name, **k: made.append(name) or symbol.__xnew__(cls, name, **k)
    )
    evil = 'print("gotcha")'
    derive(
        single(
            lambda x, u, p: [sin(x[0]) * x[0] * x[1], cos(x[1]) * x[0]], initial=[0.0, 0.0], names=[evil, "E"]
        )
    )
    assert made
    assert all(name[0] in "sc" and name[1:].isdigit() for name in made)


# ---- the printer -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tree", "text"),
    [
        (Binary("-", Name("a"), Binary("-", Name("b"), Name("c"))), "a - (b - c)"),
        (Binary("-", Binary("-", Name("a"), Name("b")), Name("c")), "a - b - c"),
        (Binary("*", Binary("+", Name("a"), Name("b")), Name("c")), "(a + b)*c"),
        (Binary("/", Name("a"), Binary("*", Name("b"), Name("c"))), "a/(b*c)"),
        (Binary("*", Name("a"), Binary("/", Name("b"), Name("c"))), "a*(b/c)"),
        (Unary("-", Binary("+", Name("a"), Name("b"))), "-(a + b)"),
        (Unary("-", Unary("-", Name("a"))), "--a"),
        (Unary("-", Constant(-2.0)), "--2.0"),
        (Binary("*", Constant(-2.0), Name("a")), "-2.0*a"),
        (Binary("<", Binary("<", Name("a"), Name("b")), Name("c")), "(a < b) < c"),
        (Unary("not ", Binary("and", Name("a"), Name("b"))), "not (a and b)"),
        (Binary("or", Name("a"), Binary("and", Name("b"), Name("c"))), "a or b and c"),
        (Binary("and", Name("a"), Binary("or", Name("b"), Name("c"))), "a and (b or c)"),
        (Binary("+", Conditional(Name("a"), Name("b"), Name("c")), Name("d")), "(b if a else c) + d"),
        (
            Conditional(Name("a"), Name("b"), Conditional(Name("c"), Name("d"), Name("e"))),
            "b if a else d if c else e",
        ),
    ],
)
def test_parentheses(tree, text):
    assert show([Assign(Name("x"), tree)]) == f"x = {text}\n"
    ast.parse(text)


def test_no_infinite_literals():
    with pytest.raises(ValueError, match="literal"):
        show([Assign(Name("x"), Constant(math.inf))])


def test_comments_stay_on_their_line():
    text = show([Assign(Name("x"), Constant(1.0), "a\nimport os\r\x85b"), Comment("c\nd"), If(Name("x"), ())])
    assert text.splitlines() == ["x = 1.0  # a?import os??b", "# c?d", "if x:", "    pass"]
