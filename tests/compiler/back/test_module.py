"""The generated module as a text: its subset of Python, its face, and that nothing but the model decides it."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import hand
import pytest
from hand import TIME, Agent, apply, build, cart4, choose, ring, toy
from hand_arrays import platoon, robots, swarm, train
from oracle import StubModel, System, generate, load

from hierc.compiler.emission import emit
from hierc.compiler.emission.packing import CONSTRUCTORS as OF_ARRAYS
from hierc.compiler.emission.plan import plan
from hierc.compiler.symbolic.derive import derive
from hierc.runtime import contract

FACE = ("simulate", "rhs", "jacobian")
MATH = [
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
    "atan2",
    "sinh",
    "cosh",
    "tanh",
]
MATH += ["floor", "ceil", "fabs", "copysign", "pow", "fmod"]


def everything():
    """A model that uses every operation."""
    a = Agent("a", "Everything")
    x, y = a.state("x", 0.5), a.state("y", 0.25)
    k = a.parameter("k", 2.0)
    unary = [
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
        "abs",
        "sign",
        "floor",
        "ceil",
        "round",
    ]
    total = sum((apply(op, x) for op in unary), 0.0 * TIME)
    for op in ["add", "sub", "mul", "div", "pow", "atan2", "mod", "quotient", "min", "max"]:
        total = total + apply(op, x, y) + apply(op, y, k)
    for op in ["lt", "le", "gt", "ge", "eq", "ne"]:
        total = total + choose(
            apply("and", apply(op, x, y), apply("not", apply("or", x > 1, y > 1))), x, sqrt_of(y)
        )
    a.diff("x", total)
    a.diff("y", total**3 + x**-2 + y**2.5 - TIME)
    return build("Everything", [a], {"a": ["a"]})


def sqrt_of(x):
    return apply("sqrt", x)


MODELS = {
    "cart": cart4,
    "ring": ring,
    "toy": toy,
    "everything": everything,
    "platoon": lambda: platoon(8),
    "robots": lambda: robots(20),
    "swarm": lambda: swarm(40),
    "train": lambda: train(8),
}


@pytest.fixture(params=MODELS, scope="module")
def text(request):
    return generate(MODELS[request.param]())


# ---- the subset -----------------------------------------------------------------------------


def check_expression(node):
    match node:
        case ast.Constant(value=float()):
            pass
        case ast.Name(ctx=ast.Load()):
            pass
        case ast.Subscript(value=ast.Name(), slice=ast.Constant(value=int())):
            pass
        case ast.BinOp(left=a, op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div(), right=b):
            check_expression(a)
            check_expression(b)
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=a):
            check_expression(a)
        case ast.Compare(left=a, ops=[_], comparators=[b]):
            check_expression(a)
            check_expression(b)
        case ast.BoolOp(values=values):
            for v in values:
                check_expression(v)
        case ast.IfExp(test=test, body=a, orelse=b):
            for v in (test, a, b):
                check_expression(v)
        case ast.Call(func=ast.Attribute(value=ast.Name(id="math"), attr=name), args=args, keywords=[]):
            assert name in MATH
            for v in args:
                check_expression(v)
        case ast.Call(func=ast.Name(id="float"), args=[inner], keywords=[]):
            check_expression(inner)
        case _:
            raise AssertionError(ast.dump(node))


def check_statement(node):
    match node:
        case ast.Assign(
            targets=[ast.Name() | ast.Subscript(value=ast.Name(), slice=ast.Constant(value=int()))], value=v
        ):
            check_expression(v)
        case ast.If(test=test, body=then, orelse=other):
            check_expression(test)
            for s in (*then, *other):
                check_statement(s)
        case ast.Pass() | ast.Expr(value=ast.Constant(value=str())):
            pass
        case _:
            raise AssertionError(ast.dump(node))


def depth(node):
    return 1 + max((depth(c) for c in ast.iter_child_nodes(node) if isinstance(c, ast.expr)), default=0)


SIGNATURES = {
    "rhs": "t x u d p dx",
    "observe": "t x u d p y",
    "jac": "t x u d p J",
    "start": "t u p x",
    "values": "q p",
    "nominal": "p w",
    "defaults": "a v",  # of blocks
}


def test_functions_keep_to_the_subset(text):
    functions = [f for f in ast.parse(text).body if isinstance(f, ast.FunctionDef) and f.name not in FACE]
    for f in functions:
        role = f.name.rsplit("_", 1)[1]
        expected = "q" if f.name == "parameter_defaults" else SIGNATURES.get(role, "t x u d p y")
        assert [a.arg for a in f.args.args] == expected.split()
        assert not f.decorator_list
        for statement in f.body:
            check_statement(statement)
        assert all(depth(e) < 20 for e in ast.walk(f) if isinstance(e, ast.expr))


def test_names_are_assigned_once_and_before_use(text):
    """Apart from the two branches of an `if`, which set the same choices."""

    def walk(statements, known):
        for s in statements:
            if isinstance(s, ast.If):
                assert loads(s.test) <= known
                then, other = walk(s.body, set(known)), walk(s.orelse, set(known))
                known |= then & other
            elif isinstance(s, ast.Assign):
                assert loads(s.value) <= known
                if isinstance(s.targets[0], ast.Name):
                    assert s.targets[0].id not in known
                    known.add(s.targets[0].id)
        return known

    def loads(e):
        return {n.id for n in ast.walk(e) if isinstance(n, ast.Name)} - {"math", "float"}

    for f in ast.parse(text).body:
        if isinstance(f, ast.FunctionDef) and f.name not in FACE:
            walk(f.body, {a.arg for a in f.args.args})


def test_the_module_around_the_functions_is_tables(text):
    allowed = (
        ast.Constant,
        ast.Name,
        ast.Call,
        ast.Tuple,
        ast.Dict,
        ast.keyword,
        ast.Load,
        ast.UnaryOp,
        ast.USub,
    )
    for node in ast.parse(text).body:
        match node:
            case ast.Expr(value=ast.Constant(value=str())) | ast.FunctionDef():
                pass
            case ast.Import(names=[alias]):
                assert alias.name == "math"
            case ast.ImportFrom(module=module):
                assert module in ("hierc.runtime.contract", "hierc.runtime.model")
            case ast.Assign(targets=[ast.Name()], value=value):
                assert all(isinstance(n, allowed) for n in ast.walk(value))
                called = {n.func.id for n in ast.walk(value) if isinstance(n, ast.Call)}
                assert called <= {*emit.CONSTRUCTORS, *OF_ARRAYS, "Model"}
            case _:
                raise AssertionError(ast.dump(node))
        if isinstance(node, ast.FunctionDef) and node.name in FACE:
            assert isinstance(node.body[0], ast.Expr)
            assert isinstance(node.body[1], ast.Return)
            assert len(node.body) == 2


def test_tables_agree_with_each_other(text):
    system = System(text)
    p = system.plan
    assert p.contract == contract.CONTRACT == emit.CONTRACT
    for c in p.classes:
        rows, columns = len(c.states) + c.outs, len(c.states) + c.inputs
        assert all(0 <= r < rows and 0 <= k < columns for r, k in c.pattern)
        assert list(c.pattern) == sorted(set(c.pattern))
        assert sorted(o for part in c.parts for o in part.outs) == list(range(c.outs))
        assert len(c.lines) == len(c.states)
        w = [0.0] * len(c.states)
        c.nominal([1.0] * c.values, w)
        assert all(v > 0 for v in w)
    for node in system.nodes:
        c = p.classes[node.kind]
        assert (len(node.sources), len(node.parameters)) == (c.inputs, c.parameters)
        for source, kind, index in node.sources:
            other = system.form(source)
            assert index < (len(other.states) if kind == "state" else other.outs)


# ---- the face --------------------------------------------------------------------------------


def test_the_public_face():
    names = load(generate(cart4()))
    model = names["MODEL"]
    assert isinstance(model, StubModel)
    assert model.file == "generated.py"
    names["simulate"](10.0, rtol=1e-5, params={"cart.kv": 60.0}, max_step=0.1)
    names["rhs"](0.0, [0.0])
    names["jacobian"](0.0, [0.0], {"cart.kv": 1.0})
    assert model.calls == [
        ("simulate", (10.0, 1e-5, None, {"cart.kv": 60.0}), {"max_step": 0.1}),
        ("rhs", (0.0, [0.0], None), {}),
        ("jacobian", (0.0, [0.0], {"cart.kv": 1.0}), {}),
    ]
    assert names["GROUPS"] == ("plan", "kin", "dyn", "chase")
    assert len(names["STATES"]) == 19
    assert names["PARAMETERS"][0] == "plan.A"
    for word in ("plan.A", "tail.tau[2]", "chase", "rtol"):
        assert word in names["simulate"].__doc__
    assert "Four-level cart." in names["__doc__"]


def test_the_line_map():
    lines = generate(cart4()).splitlines()
    assert any(line.endswith("# cart4.hier:3  x' = v*cos(th);") for line in lines)
    assert any(line.endswith("# vc") for line in lines)  # definitions carry their names


def test_states_are_listed_as_vectors_hold_them():
    """Group by group, even where that is not the order of execution."""
    agents = []
    for name in ("a", "b", "c"):
        a = Agent(name, name.upper())
        a.diff("x", -a.state("x"))
        agents.append(a)
    names = load(generate(build("M", agents, {"one": ["a", "c"], "two": ["b"]})))
    assert names["STATES"] == ("a.x", "c.x", "b.x")


# ---- nothing but the model decides the text ------------------------------------------------------

SCRIPT = """
import sys
sys.path.insert(0, {folder!r})
import test_module
from oracle import generate
sys.stdout.buffer.write("".join(generate(m()) for m in test_module.MODELS.values()).encode())
"""


@pytest.mark.parametrize(("seed", "language"), [("1", "C"), ("4242", "tr_TR.UTF-8")])
def test_text_is_identical_whatever_seed_locale_and_folder(seed, language, tmp_path):
    folder = str(Path(hand.__file__).parent)
    environment = {**os.environ, "PYTHONHASHSEED": seed, "LC_ALL": language, "PYTHONDONTWRITEBYTECODE": "1"}
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(folder=folder)],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        check=True,
    )
    assert run.stdout == "".join(generate(m()) for m in MODELS.values()).encode()


def test_the_digest_follows_the_source():
    model = toy()
    texts = {emit.emit(plan(m, derive(m))) for m in (model, toy())}
    assert len(texts) == 1
    assert plan(model, derive(model)).digest != plan(cart4(), derive(cart4())).digest
