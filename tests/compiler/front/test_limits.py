"""Models made to exhaust the compiler: each ends in a model or in a problem, soon."""

from __future__ import annotations

import pytest
from helpers import model_of, node
from interpreter import Interpreter

from hierc.compiler.expression import Apply, Choose, Expr
from hierc.compiler.resolve.errors import NestedTooDeeply
from hierc.compiler.shapes.terms import MAX_DEPTH
from hierc.grammar.problems import ModelError


def depth(expr: Expr) -> int:
    parts = (
        expr.args
        if isinstance(expr, Apply)
        else (expr.then, expr.other, expr.condition)
        if isinstance(expr, Choose)
        else ()
    )
    return 1 + max(map(depth, parts)) if parts else 0


def codes(text: str) -> set[str]:
    with pytest.raises(ModelError) as caught:
        model_of(text)
    return {p.code for p in caught.value.problems}


def test_a_long_sum_is_cut() -> None:
    model = model_of(f"agent A() {{ write real x = 1; diff {{ x' = {' + '.join(['x'] * 5000)}; }} }}")
    (only,) = model.nodes
    assert max(depth(d.value) for d in only.definitions) <= MAX_DEPTH
    assert depth(only.states[0].rate) <= MAX_DEPTH
    interpreter = Interpreter(model)
    interpreter.set(0, {"x": 1.0})
    rest = 5000 - interpreter.definitions(only)[-1]
    assert depth(only.states[0].rate) == rest < MAX_DEPTH


def test_long_chains_of_lets_and_constants() -> None:
    lets = " ".join(f"let a{i} = a{i + 1} + x;" for i in range(3000))
    consts = " ".join(f"const real c{i} = c{i + 1} + 1;" for i in range(3000))
    text = f"{consts} const real c3000 = 0; agent A() {{ write real x = 1; {lets} let a3000 = c0; diff {{ x' = a0; }} }}"
    model = model_of(text)
    assert len(node(model, "").definitions) == 3000


def test_what_doubles_with_each_let_stays_small() -> None:
    lets = " ".join(f"let a{i} = a{i - 1}*a{i - 1};" for i in range(1, 60))
    model = model_of(f"agent A() {{ write real x = 1; let a0 = x + 1; {lets} diff {{ x' = a59; }} }}")
    assert len(node(model, "").definitions) == 60


def test_what_doubles_with_each_call_stays_small() -> None:
    funcs = " ".join(f"func real f{i}(real x) = f{i - 1}(x) + f{i - 1}(x + 1);" for i in range(1, 60))
    assert codes(
        f"func real f0(real x) = x; {funcs} agent A() {{ write real x = 1; diff {{ x' = f59(x); }} }}"
    ) == {"E217"}


def test_what_doubles_in_parameters_is_refused() -> None:
    lets = " ".join(f"let a{i} = a{i - 1}*a{i - 1};" for i in range(1, 60))
    text = f"agent B(real q) {{ write real x = 1; diff {{ x' = q; }} }} agent A(real k = 2) {{ let a0 = k; {lets} agent b = B(q = a59); }}"
    assert codes(text) == {"E217"}


@pytest.mark.parametrize(
    "nest", ["(1 + {})", "sin({})", "-{}", "[{}][1]", "if x > 0 then 1 else {}", "2^{}", "sum([{}])"]
)
def test_deep_nesting_is_refused(nest: str) -> None:
    inner = "x"
    for _ in range(120):
        inner = nest.replace("{}", inner)
    text = f"agent A() {{ write real x = 1; diff {{ x' = {inner}; }} }}"
    assert all(code == NestedTooDeeply.code or code.startswith("E1") for code in codes(text))


@pytest.mark.parametrize(
    "nest",
    ["(1 + {})", "sin({})", "if x > 0 then 1 else {}", "2^{}", "sum([{}, 1, 2, 3, 4])", "norm([{}, x])"],
)
def test_nesting_below_the_limit_compiles(nest: str) -> None:
    inner = "x"
    for _ in range(40):
        inner = nest.replace("{}", inner)
    model_of(f"agent A() {{ write real x = 1; diff {{ x' = {inner}; }} }}")


def test_nested_agents() -> None:
    chain = " ".join(f"agent A{i}() {{ agent a = A{i + 1}(); }}" for i in range(100))
    assert codes(
        f"agent Top() {{ agent a = A0(); }} {chain} agent A100() {{ write real x = 0; diff {{ x' = 1; }} }}"
    ) == {"E216"}


def test_a_long_chain_of_agents() -> None:
    lag = "agent Lag() { read real u; write real y; alge { y = 2*u; } }"
    chain = " ".join(f"agent a{i} = Lag() [u := a{i + 1}.y + 1];" for i in range(1500))
    model = model_of(
        f"{lag} agent Top() {{ write real x = 0; diff {{ x' = a0.y; }} {chain} agent a1500 = Lag() [u := x]; }}"
    )
    assert [n.path for n in model.nodes] == [*(f"a{i}" for i in range(1500, -1, -1)), ""]


@pytest.mark.parametrize(
    "text",
    [
        "agent A(int N = 100000) { write real[N,N] x = zeros(N, N); diff { x' = x; } }",
        "agent A() { write real x = 0; diff { x' = sum([sum([sum([i for i in 1..50000]) for j in 1..50000]) for k in 1..50000]); } }",
        "agent A() { write real[300,300] M = zeros(300, 300); diff { M' = M*M; } }",
        "const int c = 9^9^9; agent A() { write real[c] x = 1; diff { x' = x; } }",
        "agent A(int N = 2) { write real[N^70] x = 1; diff { x' = x; } }",
    ],
)  # fmt: skip
def test_sizes_are_limited(text: str) -> None:
    assert codes(text) <= {"E217", "E311", "E305", "E302"}
