"""Units of expressions: what each is in, what does not agree, and how much work that is."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest
from unit_checks import codes, unit_of

from hierc.compiler.front import analyse, check_file
from hierc.compiler.units.quantity import Measured, Plain, Unknown, whole
from hierc.compiler.units.spelling import coherent_text, rate_text
from hierc.compiler.units.units import BASE, parse_unit
from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile, Span

PLAIN, UNKNOWN = "plain", "unknown"


def dimension(unit: str) -> tuple[Fraction, ...]:
    return parse_unit(unit, Span(SourceFile("test", unit), 0, len(unit))).exponents


#: Names: x, y, z [m], v [m/s], th [rad], F [N], te [ms], free (no unit), n (an int), P and V [m], M [kg], H without a unit.
MEANING = {
    "x": "m", "2*x": "m", "x/2": "m", "2/x": "1/m", "x*y": "m^2", "x/v": "s", "x - y": "m", "-x": "m", "x + 1": "m", "1 + x": "m",
    "1 + 2": PLAIN, "n*2": PLAIN, "pi": PLAIN, "sin(1)": PLAIN, "free": UNKNOWN, "free*x": UNKNOWN, "x + free": UNKNOWN, "free + 1": UNKNOWN,
    "n*x": "m", "time": "s", "x'": "m/s", "v'": "m/s^2", "P'": "m/s", "te'": "1", "free'": UNKNOWN, "3 [N*m]": "J", "5 [ms] + te": "s",
    "x^2": "m^2", "x^-1": "1/m", "x^0.5": "m^0.5", "x^(3/2)": "m^1.5", "x^(1/3)": "m^(1/3)", "x^two": "m^2", "x^n": UNKNOWN, "x^free": UNKNOWN,
    "x^0": "1", "2^3": PLAIN, "2^th": "1", "th^free": UNKNOWN, "F/x^1.5*max(z, 0)^1.5": "N", "sqrt(x*y)": "m", "sqrt(x)": "m^0.5", "sqrt(4)": PLAIN,
    "sin(th)": "1", "sin(90 [deg])": "1", "cos(v/x*time)": "1", "tan(free)": UNKNOWN, "asin(x/y)": "rad", "atan(1)": PLAIN, "atan2(x, y)": "rad",
    "atan2(x, 1)": "rad", "atan2(1, 2)": PLAIN, "exp(-time/te)": "1", "log(x/y)": "1", "tanh(th)": "1", "floor(x/y)": "1", "abs(v)": "m/s",
    "sign(v)": "1", "sign(2)": PLAIN, "min(x, y)": "m", "max(0, x, y)": "m", "max(1, 2)": PLAIN, "mod(x, 2)": "m", "mod(th, 2*pi)": "rad", "div(7, 2)": PLAIN,
    "clamp(x, 0, y)": "m", "smooth(F)": "N", "if x > y then x else 0": "m", "if n > 1 then 1 else 2": PLAIN, "if x > 0 then free else x": UNKNOWN,
    "if x > y and v > 0 then v else 1": "m/s", "P": "m", "P[1]": "m", "P[1..2]": "m", "P + V": "m", "2*P": "m", "v*P": "m^2/s", "P/te": "m/s",
    "[x, y]": "m", "[x, 0]": "m", "[0, 0]": PLAIN, "[x, 1]*v": "m^2/s", "[x, free]": UNKNOWN, "[k*x for k in 1..3]": "m",
    "sum(P)": "m", "sum([x, 1, y])": "m", "dot(P, V)": "m^2", "dot([x, v], [v, x])": "m^2/s", "dot([x, v], [x, v])": UNKNOWN,
    "cross([x, y, z], [F, F, F])": "N*m", "norm(P)": "m", "transpose(M)": "kg", "trace(M)": "kg", "trace([[x, v], [v, x]])": "m",
    "det([[x, y], [y, x]])": "m^2", "det([[x]])": "m", "det(M)": UNKNOWN, "det([[1, 2], [3, 4]])": PLAIN, "inverse(M)": "1/kg", "M*P": "kg*m",
    "M*M": "kg^2", "solve(M, [F, F])": "N/kg", "solve(H, P)": UNKNOWN, "eye(2)": PLAIN, "x*eye(2)": "m", "M + 2*eye(2)": "kg", "zeros(2) + P": "m",
    "P .* V": "m^2", "P ./ [x, y]": "1", "twice(x)": "m", "twice(twice(v))": "m/s",
    "twice(1)": PLAIN, "area(x, y)": "m^2", "area(1, y)": "m^2", "drag(v)": "m^2/s^2", "drag(free)": "m^2/s^2", "element(P, 1)": "m",
    "twice(P)": "m", "0*x": PLAIN, "te": "s", "te*2": "s", "1/te": "1/s", "2 [km/h]": "m/s", "1 [%]": "1", "x/(1 [h])": "m/s", "let_x": "m", "let_rate": "m/s",
    "both[2]": "m/s", "both[two]": "m/s", "both[n]": UNKNOWN, "columns[1,2]": "m", "columns[2,1]": "m/s",
}  # fmt: skip


@pytest.mark.parametrize("expression", MEANING)
def test_meaning(expression: str) -> None:
    unit, problems = unit_of(expression)
    expected = MEANING[expression]
    found = whole(unit)
    assert not problems
    if expected == PLAIN:
        assert isinstance(found, Plain)
    elif expected == UNKNOWN:
        assert isinstance(found, Unknown)
    else:
        assert isinstance(found, Measured)
        third = expected == "m^(1/3)"
        wanted = (Fraction(1, 3), *dimension("1")[1:]) if third else dimension(expected)
        assert dict(zip(BASE, found.dimension, strict=True)) == dict(zip(BASE, wanted, strict=True))


@pytest.mark.parametrize(
    ("expression", "items"),
    [
        ("[x, v]", ("m", "m/s")), ("2*[x, v]", ("m", "m/s")), ("[x, v]/te", ("m/s", "m/s^2")), ("v*[x, v]", ("m^2/s", "m^2/s^2")),
        ("[x, v] + [y, 1]", ("m", "m/s")), ("P ./ [x, v]", ("1", "s")), ("pair(x, v)", ("m", "m/s")), ("-[x, v]", ("m", "m/s")),
        ("if x > y then [x, v] else [0, v]", ("m", "m/s")), ("both", ("m", "m/s")), ("both[1..2]", ("m", "m/s")),
    ],
)  # fmt: skip
def test_items_of_lists_stay_apart(expression: str, items: tuple[str, ...]) -> None:
    quantity, problems = unit_of(expression)
    assert not problems
    assert [i.dimension for i in quantity.items] == [dimension(item) for item in items]


@pytest.mark.parametrize(
    ("expression", "code"),
    [
        ("v + x", "E401"), ("x - v", "E401"), ("x > time", "E401"), ("x == v", "E401"), ("if x > 0 then x else v", "E401"), ("min(x, 1, v)", "E401"),
        ("atan2(x, v)", "E401"), ("mod(x, te)", "E401"), ("[x, v] + [v, x]", "E401"), ("P + [x, v]", "E401"), ("sum([x, v])", "E401"),
        ("x + sin(th)", "E401"), ("x + th", "E401"), ("x + x*y", "E401"), ("clamp(x, 0, v)", "E401"), ("P[1] + V[2]*x", "E401"),
        ("both[1] + v", "E401"), ("spread(x, v)", "E401"), ("1 - x' + x", "E401"),
        ("sin(x)", "E403"), ("cos(te)", "E403"), ("exp(v)", "E403"), ("log(F)", "E403"), ("asin(x)", "E403"), ("round(x)", "E403"), ("2^x", "E403"),
        ("x^y", "E403"), ("drag(x)", "E403"), ("area(x, v)", "E403"),
        ("te + 1", "E406"), ("0.5 < te", "E406"), ("max(te, 2)", "E406"), ("2*te - 3", "E406"), ("[te, 2]", "E406"), ("area(x, 1) + 30 [deg] + 1", "E401"),
        ("30 [deg] + 1", "E406"), ("late(1)", "E406"), ("if free > 1 then te else 1", "E406"), ("te + (1 + 2)", "E406"),
    ],
)  # fmt: skip
def test_what_does_not_agree(expression: str, code: str) -> None:
    _, problems = unit_of(expression)
    assert [p.code for p in problems] == [code]


@pytest.mark.parametrize(
    "expression", ["x + 1", "x > 2", "max(x, 1)", "if x > 0 then x else 1", "area(x, 1)"]
)
def test_strict_units_leave_only_zero_without(expression: str) -> None:
    assert [p.code for p in unit_of(expression, strict=True)[1]] in (["E401"], ["E403"])
    zero = expression.replace("1", "0").replace("2", "0")
    for text in (expression, zero):
        assert not unit_of(text)[1]
    assert not unit_of(zero, strict=True)[1]


def test_strict_units_leave_ratios_and_angles_alone() -> None:
    for expression in (
        "th + 1",
        "sin(2*th + 1)",
        "1 - x/y",
        "2*x",
        "x^2",
        "x/y > 0.5",
        "x + free",
        "exp(1 - th)",
        "x - 0",
    ):
        assert not unit_of(expression, strict=True)[1], expression


def test_an_error_is_reported_once() -> None:
    """What did not agree is unknown from there on, in expressions and in `let`s."""
    text = """agent A() { write real x [m] = 0, v [m/s] = 0;
      let odd = x + v; let more = odd + x; let most = more + v;
      diff { x' = most + x*v; v' = sin(most); } }"""
    assert codes(text) == ["E401"]


def test_units_of_everything_that_has_a_value() -> None:
    """One of each: constants, defaults, initial and nominal values, `let`s, both kinds of equations, arguments, couplings, experiments."""
    text = """const real c [m] = 1 [s];
    func real f(real a [m] = 1 [s]) = a + 1 [s];
    agent In(real k [m] = 1 [s]) {
      const real d [m] = 1 [s];
      read real r [m];
      write real x [m] = 1 [s] nominal 1 [s];
      write real y [m];
      write real[3] z [m] = zeros(3);
      let l [m] = 1 [s];
      alge { y = 1 [s]; }
      diff { x' = 1 [s]; for i in 1..3 { z[i]' = i*r; } }
      inv { x > 1 [s] : "no"; }
    }
    agent Top() { read real q [m]; agent a = In(k = 1 [s]) [r := 1 [s]]; }
    """
    found = codes(text, agent=None)
    assert found.count("E401") == 10 + 1  # the last one is the invariant
    assert found.count("E402") == 2
    assert found.count("E405") == 1


def test_experiments() -> None:
    text = """agent In(real k [m]) { read real r [m]; write real x [m] = k; diff { x' = (r - x)/(1 [s]); } }
    agent Top(real k [m]) { read real q [m]; agent a = In(k = k) [r := q]; }
    experiment e of Top(k = 1 [s], a.k = 2 [kg]) [q := 1 [s]] {
      stop = 1 [m]; interval = 1; rtol = 1 [s]; group a { max_step = 1 [m]; } init { a.x = 1 [s]; } }"""
    assert sorted(codes(text)) == ["E401"] * 5 + ["E403", "E405"]


def test_the_second_experiment_is_checked_too() -> None:
    text = """agent A(real k [m] = 1) { write real x [m] = k; diff { x' = -x/(1 [s]); } }
    experiment a of A() { stop = 1; } experiment b of A(k = 1 [s]) { stop = 1; }"""
    file = parse(SourceFile("test.hier", text))
    analyse(file, experiment="a")
    with pytest.raises(ModelError) as caught:
        check_file(file)
    assert [p.code for p in caught.value.problems] == ["E401"]


def test_functions_that_nothing_calls_are_checked() -> None:
    assert codes("func real f(real x [m]) = x + 1 [s];", agent=None) == ["E401"]
    assert codes("func real f(real x) = x + 1 [s];", agent=None) == []


# ---- spelling ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "derivative"),
    [("m", "m/s"), ("m/s", "m/s^2"), ("m/s^2", "m/s^3"), ("N*m", "N*m/s"), ("1", "1/s"), ("1/s", "1/s^2"), ("rad", "rad/s"),
     ("1/(s*m)", "1/(s*m)/s"), ("mm", "mm/s")],
)  # fmt: skip
def test_spelling_of_derivatives(unit: str, derivative: str) -> None:
    assert rate_text(unit) == derivative
    span = Span(SourceFile("test", unit), 0, len(unit))
    parts = parse_unit(unit, span), parse_unit(derivative, span)
    assert parts[0] == parts[1].times(parse_unit("s", span))


@pytest.mark.parametrize(
    ("unit", "si"),
    [
        ("ms", "s"), ("km/h", "m/s"), ("deg", "rad"), ("deg/ms", "rad/s"), ("rpm", "rad/s"), ("rpm/s", "rad/s^2"), ("%", "1"), ("kN*mm", "N*m"),
        ("g/cm^3", "kg/m^3"), ("kHz", "Hz"), ("mm^0.5", "m^0.5"), ("mohm", "ohm"), ("1/rpm", "s"), ("min", "s"), ("daN", "N"), ("kg", "kg"),
    ],
)  # fmt: skip
def test_spelling_of_si(unit: str, si: str) -> None:
    span = Span(SourceFile("test", unit), 0, len(unit))
    assert coherent_text(unit, span) == si
    assert parse_unit(si, span).coherent
    assert parse_unit(si, span).exponents == parse_unit(unit, span).exponents


def test_units_are_shown_as_the_user_spells_them() -> None:
    text = """agent A(real T [N*m] = 1, real J [kg*m^2] = 1, real w [1/s] = 1) { write real a [m] = 0;
      diff { a' = J*w^2; } }"""
    with pytest.raises(ModelError) as caught:
        analyse(parse(SourceFile("test.hier", text)))
    (problem,) = caught.value.problems
    assert problem.title() == "`a' = J*w^2`: the derivative of `a` [m] is in m/s, but `J*w^2` is in N*m"


# ---- limits --------------------------------------------------------------------------------------


def test_long_chains() -> None:
    unit, problems = unit_of(" + ".join(["x"] * 5000))
    assert (whole(unit), problems) == (whole(unit_of("x")[0]), [])
    assert [p.code for p in unit_of(" + ".join(["x"] * 5000 + ["v"]))[1]] == ["E401"]
    assert whole(unit_of("*".join(["x"] * 100))[0]).dimension == dimension("m^50*m^50")
    assert isinstance(whole(unit_of("*".join(["x"] * 5000))[0]), Unknown)


def test_chains_of_names_and_calls() -> None:
    lets = " ".join(f"let a{i} = a{i + 1} + x;" for i in range(3000))
    consts = " ".join(f"const int c{i} = c{i + 1} + 1;" for i in range(3000))
    text = f"{consts} const int c3000 = 0; agent A() {{ write real x [m] = 1; {lets} let a3000 = x; diff {{ x' = a0*x^c0; }} }}"
    assert codes(text) == ["W511"] * 0
    funcs = " ".join(f"func real f{i}(real x) = f{i - 1}(x) + f{i - 1}(2*x);" for i in range(1, 60))
    text = f"func real f0(real x) = x + 1 [s]; {funcs} agent A() {{ write real x [m] = 1; let y = f59(x); diff {{ x' = 0; }} }}"
    assert "E401" not in codes(text)  # deeper than calls are followed
    assert "E401" in codes(text.replace("f59(x)", "f9(x)"))


def test_calls_with_ever_new_units_end() -> None:
    funcs = " ".join(
        f"func real f{i}(real x, real y) = f{i - 1}(x*y, y) + f{i - 1}(x, x*y);" for i in range(1, 40)
    )
    text = f"func real f0(real x, real y) = x; {funcs} agent A() {{ write real x [m] = 1, v [m/s] = 0; let z = f39(x, v); diff {{ x' = v; v' = 0; }} }}"
    assert set(codes(text)) <= {"E401", "W511"}


@pytest.mark.parametrize("exponent", ["1e-300", "1e300", "0.0000000000001", "1/0", "9^9^9"])
def test_odd_exponents(exponent: str) -> None:
    assert not unit_of(f"x^({exponent})")[1]


# ---- the language's own examples -----------------------------------------------------------------

EXAMPLES = sorted((Path(__file__).parents[2] / "grammar" / "examples").glob("*.hier"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_examples_agree(example: Path) -> None:
    """Also those that use what cannot run yet."""
    assert not [c for c in codes(example.read_text(encoding="utf-8"), agent=None) if c.startswith("E4")]
