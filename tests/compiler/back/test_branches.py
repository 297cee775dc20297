"""Conditions: what is guarded is never evaluated outside its guard, and what is shared is evaluated once."""

import ast
import math

import pytest
from hand import TIME, Agent, apply, build, choose, log, single, sqrt
from oracle import System, generate

from hierc.compiler.symbolic.derive import derive
from hierc.grammar.problems import ModelError


def rate(make, x, **options):
    """The first rate at states x."""
    text = generate(single(make, initial=[0.0] * len(x), **options))
    return System(text).rates(0.5, [list(x)], 0), text


def functions(text):
    return {f.name: f for f in ast.parse(text).body if isinstance(f, ast.FunctionDef)}


def test_a_guarded_root_stays_in_its_branch():
    def make(x, u, p):
        return [choose(x[0] > 0, sqrt(x[0]) * x[1], 0.0), choose(x[0] > 0, sqrt(x[0]), 1.0)]

    text = generate(single(make, initial=[0.0, 0.0]))
    system = System(text)
    assert system.rates(0, [[4.0, 3.0]], 0) == [6.0, 2.0]
    assert system.rates(0, [[-4.0, 3.0]], 0) == [0.0, 1.0]  # CPython would raise at sqrt(-4)
    assert system.jacobian(0, [[4.0, 3.0]], 0) == {(0, 0): 0.75, (0, 1): 2.0, (1, 0): 0.25}
    assert system.jacobian(0, [[-4.0, 3.0]], 0) == {(0, 0): 0.0, (0, 1): 0.0, (1, 0): 0.0}
    body = functions(text)["Single_rhs"].body
    assert sum(isinstance(s, ast.If) for s in body) == 1  # one condition, one `if`
    assert text.count("math.sqrt(") == 2  # once in rhs, once in jac


def test_what_is_used_outside_is_computed_outside():
    def make(x, u, p):
        root = sqrt(x[0])
        return [choose(x[1] > 0, root, -root) + 1.0, root]

    _, text = rate(make, [4.0, -1.0])
    body = functions(text)["Single_rhs"].body
    assert not any("sqrt" in ast.unparse(s) for s in body if isinstance(s, ast.If))
    assert ast.unparse(functions(text)["Single_rhs"]).count("sqrt") == 1


def test_what_both_branches_need_is_computed_before():
    def make(x, u, p):
        return [choose(x[0] > 0, log(x[1]) + 1.0, 2.0 * log(x[1])), 0.0 * TIME]

    (first, _), text = rate(make, [-1.0, math.e])
    assert first == 2.0
    assert ast.unparse(functions(text)["Single_rhs"]).count("log") == 1


def test_lets_used_in_one_branch_are_evaluated_there():
    a = Agent("a", "A")
    x = a.state("x", -1.0)
    root = a.let("root", sqrt(x))
    a.diff("x", choose(x >= 0, root, x))
    assert System(generate(build("M", [a], {"a": ["a"]}))).rates(0, [[-1.0]], 0) == [-1.0]


@pytest.mark.parametrize("x", [-1.0, 0.5, 4.0])
def test_and_or_do_not_evaluate_what_they_need_not(x):
    def make(s, u, p):
        both = apply("and", s[0] > 0, log(s[0]) < 1)
        either = apply("or", s[0] <= 0, log(s[0]) < 1)
        return [choose(both, 1.0, 0.0), choose(either, 1.0, 0.0)]

    found, _ = rate(make, [x, 0.0])
    assert found == [float(x > 0 and math.log(x) < 1), float(x <= 0 or math.log(x) < 1)]


def test_conditions_as_numbers():
    def make(s, u, p):
        positive = s[0] > 0
        return [apply("not", positive) + 2.0 * positive, apply("and", positive, s[1] < 1) * s[1]]

    assert rate(make, [3.0, -1.0])[0] == [2.0, -1.0]
    assert rate(make, [-3.0, -1.0])[0] == [1.0, -0.0]


@pytest.mark.parametrize(
    ("value", "expected"),
    [(-2.5, -3.0), (-0.5, -1.0), (-0.2, 0.0), (0.49999999999999994, 0.0), (0.5, 1.0), (1.5, 2.0), (2.5, 3.0)],
)
def test_round_is_half_away_from_zero(value, expected):
    assert rate(lambda x, u, p: [apply("round", x[0])], [value])[0] == [expected]


@pytest.mark.parametrize(
    ("a", "b"), [(7.5, 2.0), (-7.5, 2.0), (7.5, -2.0), (-7.5, -2.0), (6.0, 3.0), (-6.0, 3.0)]
)
def test_mod_has_the_divisors_sign(a, b):
    found, _ = rate(lambda x, u, p: [apply("mod", x[0], x[1]), apply("quotient", x[0], x[1])], [a, b])
    assert found == [a - b * math.floor(a / b), float(math.floor(a / b))]


@pytest.mark.parametrize(
    ("a", "b"), [(math.nan, 1.0), (1.0, math.nan), (math.nan, math.nan), (1.0, 2.0), (2.0, 1.0), (2.0, 2.0)]
)
def test_extremes_hand_nan_on(a, b):
    found, _ = rate(lambda x, u, p: [apply("max", x[0], x[1]), apply("min", x[0], x[1])], [a, b])
    if math.isnan(a) or math.isnan(b):
        assert all(map(math.isnan, found))
    else:
        assert found == [max(a, b), min(a, b)]


@pytest.mark.parametrize(("x", "expected"), [(2.0, 1.0), (-3.0, -1.0), (0.0, 0.0)])
def test_sign(x, expected):
    assert rate(lambda s, u, p: [apply("sign", s[0])], [x])[0] == [expected]
    assert math.isnan(rate(lambda s, u, p: [apply("sign", s[0])], [math.nan])[0][0])


def test_derivatives_of_steps_and_kinks():
    def make(x, u, p):
        contact = 1e6 * apply("max", x[0], 0.0) ** 1.5
        return [contact, apply("abs", x[1]) + apply("floor", x[0]), apply("min", sqrt(x[0] + 4), x[1])]

    system = System(generate(single(make, initial=[0.0] * 3)))
    assert system.jacobian(0, [[-1.0, -2.0, 0.0]], 0) == {(0, 0): 0.0, (1, 1): -1.0, (2, 0): 0.0, (2, 1): 1.0}
    inside = system.jacobian(0, [[0.25, 9.0, 0.0]], 0)
    assert inside == {(0, 0): 1.5e6 * 0.5, (1, 1): 1.0, (2, 0): 0.5 / math.sqrt(4.25), (2, 1): 0.0}
    # At the tip of a root the derivative of what is not taken must not spoil the rest.
    assert system.jacobian(0, [[-4.0, -2.0, 0.0]], 0)[2, 0] == 0.0


def test_parameters_guarded_by_a_condition_are_not_computed_in_vain():
    def make(x, u, p):
        return [choose(p[0] > 0, sqrt(p[0]) * x[0], x[0] / 2)]

    text = generate(single(make, initial=[0.0], parameters=[4.0]))
    assert System(text).rates(0, [[3.0]], 0) == [6.0]
    assert System(text, {0: -4.0}).rates(0, [[3.0]], 0) == [1.5]


def test_a_recorded_variable_without_a_value_does_not_stop_the_rest():
    a = Agent("a", "A")
    k = a.parameter("k", 0.0)
    x = a.state("x", 1.0)
    a.alge("time_constant", 1.0 / k)
    a.diff("x", -k * x)
    system = System(generate(build("M", [a], {"a": ["a"]})))
    assert system.rates(0, [[2.0]], 0) == [-0.0]
    with pytest.raises(ZeroDivisionError):
        system.observed(0, [[2.0]], 0)


def test_long_chains_of_choices_keep_their_order():
    """Each choice uses the one before in a branch, on alternating conditions."""

    def make(x, u, p):
        value = x[0]
        for k in range(40):
            value = choose(x[k % 2] > 0, value + 1.0, value * 2.0)
        return [value, 0.0 * TIME]

    for x in ([1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]):
        expected = x[0]
        for k in range(40):
            expected = expected + 1.0 if x[k % 2] > 0 else expected * 2.0
        assert rate(make, x)[0] == [expected, 0.0]


def nested(depth):
    def make(x, u, p):
        value = x[0]
        for k in range(depth):
            value = choose(x[0] > float(k), log(value + k) + value, x[0] + float(k))
        return [value]

    return single(make, initial=[0.0])


def test_nesting_within_the_limit_is_valid_python():
    System(generate(nested(50)))


def test_nesting_beyond_the_limit_is_a_problem():
    def make(x, u, p):
        value = x[0]
        for k in range(70):
            value = choose(x[0] > float(k), sqrt(value), float(k))
        return [value]

    with pytest.raises(ModelError, match="E583"):
        derive(single(make, initial=[0.0]))
