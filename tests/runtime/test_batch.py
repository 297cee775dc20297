"""Algebraic variables of many elements at many times: machine code has the very bits of the generated functions under CPython."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
from array_models import a_model, plan_of, platoon
from numpy.typing import NDArray
from running import run
from small_models import a_class, function

from hierc.runtime import batch, ieee, observation
from hierc.runtime.contract import Class, Group, Node, Plan, Steps, Variable
from hierc.runtime.externs import Extern
from hierc.runtime.run import FinishedRun
from hierc.runtime.tables import Axis, Table

Floats = NDArray[np.float64]
ALWAYS, NEVER = 1, 10**15
SPRING = Table("spring", "cubic", (Axis("x", (-1.0, -0.2, 0.3, 1.0)),), (3.0, 0.5, -0.5, -2.0))
COMPILED = Extern("rub", "extern_functions:coulomb", ((),), (0.1,), 10.0)
CALLED = Extern("told", "extern_functions:recorded", ((),), (1.0,))


def swinging(observed: list[str], names: Mapping[str, object] | None = None) -> Class:
    """Swings about zero, each element at its own rate, and shows what is observed."""
    kind = a_class(
        "Swinging",
        {"x": "p[0]*x[1]", "v": "-p[0]*x[0]"},
        {(0, 1): "p[0]", (1, 0): "-p[0]"},
        start=["0.0", "1.0"],
        values=["1.0 + q[0]"],
    )
    lines = [f"a{k} = {text}" for k, text in enumerate(observed)]
    lines += [f"y[{k}] = a{k}" for k in range(len(observed))]
    observe = function("Swinging_observe", "t, x, u, d, p, y", lines)
    observe.__globals__.update(names or {})
    return replace(kind, observe=observe, observed=len(observed))


def many(kind: Class, count: int) -> Plan:
    """Some elements of a class, each a group, with numbers of their own for a parameter."""
    variables = [
        Variable(f"one[].{name}", (), ((Steps(0), what, k),), count=count, indices=(Steps(1),))
        for what, names in (("state", kind.states), ("observed", [f"y{k}" for k in range(kind.observed)]))
        for k, name in enumerate(names)
    ]
    return plan_of(
        (kind,),
        (Node("one[]", 0, (Steps(0),), (), count, (Steps(1),)),),
        (Group("one[]", (Steps(0),), ((Steps(0), -1),), count, (Steps(1),)),),
        variables=tuple(variables),
        parameter_count=count,
        constants=((0, count, tuple(1.0 / (1 + k) for k in range(count))),),
    )


#: Follows its neighbour, and passes on half of what that passes on.
LINK = a_class(
    "Link",
    {"x": "p[0]*(u[0] - x[0])"},
    {(0, 0): "-p[0]", (0, 1): "p[0]", (1, 0): "math.cos(x[0])", (1, 1): "0.5"},
    start=["0.1"],
    inputs=1,
    values=["1.0 + 0.1*q[0]"],
    outs=[("0.5*u[0] + math.sin(x[0])", (0,))],
    observed=["u[0]*x[0]", "math.atan2(u[0], p[0])"],
)
HEAD = a_class(
    "Head",
    {"x": "math.cos(t)"},
    {(1, 0): "1.0/x[0]"},
    start=["1.5"],
    outs=[("math.log(x[0])", ())],
)


def chain(count: int, *, backwards: bool) -> Plan:
    """Links whose outs go through each other, from the first to the last or the other way; the head is the first element or the last."""
    first = 0 if backwards else 1
    head = Node("head", 0, (), ())
    links = Node("link[]", 1, (Steps(0),), ((Steps(1 if backwards else 0), "out", 0),), count, (Steps(1),))
    lead = Group("head", (count if backwards else 0,), ((count if backwards else 0, -1),))
    others = Group("link[]", (Steps(first),), ((Steps(first), -1),), count, (Steps(1),))
    variables = tuple(
        Variable(f"link[].y{k}", (), ((Steps(first), "observed", k),), count=count, indices=(Steps(1),))
        for k in range(2)
    )
    return plan_of(
        (HEAD, LINK),
        (links, head) if backwards else (head, links),
        (others, lead) if backwards else (lead, others),
        variables=variables,
        parameter_count=count,
        constants=((0, count, Steps(1)),),
        order=Steps(count, -1) if backwards else None,
    )


ORDINARY = swinging(
    [
        "math.sin(x[0]) + math.exp(x[1])*p[0]",
        "x[0]*x[1] if x[0] > 0.0 or x[1] < -0.5 else math.pow(math.fabs(x[0]), 1.3) - t",
        "max(min(x[0], 0.5), -0.5) + math.fmod(7.0*x[1], 0.3) + float(math.floor(3.0*x[0]))",
        "0.1*x[0] + 0.2*x[1]*x[1] - 0.3*x[0]*x[0]",  # would differ if contracted
    ]
)
CALLING = swinging(
    ["spring(1.5*x[0])", "rub(x[0]) if x[1] > 0.0 else spring(x[1])"],
    {"spring": SPRING, "rub": COMPILED},
)
FAULTS = swinging(
    [
        "math.sqrt(x[0])",
        "min(1.0/math.fabs(x[0] - x[0]), 3.0 + math.sin(x[1]))",
        "math.exp(800.0*x[0])",
        "math.tan(x[1]) + math.atan(x[0])",
        "x[0]*1e308*10.0",
    ]
)
OVERFLOW = swinging(["x[0]*1e308*10.0", "math.tan(x[1])"])

PLANS: dict[str, Callable[[], Plan]] = {
    "platoon": lambda: platoon(9),
    "ordinary functions": lambda: many(ORDINARY, 7),
    "tables and externs": lambda: many(CALLING, 5),
    "faults": lambda: many(FAULTS, 5),
    "infinite without a fault": lambda: many(OVERFLOW, 5),
    "outs along an array": lambda: chain(8, backwards=False),
    "outs along an array, backwards": lambda: chain(8, backwards=True),
}


def values(finished: FinishedRun, t: Floats, many: int, monkeypatch: pytest.MonkeyPatch) -> dict[str, Floats]:
    names = [v.path.replace("[]", "") for v in finished.plan.variables]
    monkeypatch.setattr(observation, "MANY", many)
    return finished.evaluate(names, t)


@pytest.mark.parametrize("name", PLANS)
@pytest.mark.parametrize("held", [batch.HELD, 100])
def test_the_same_bits(name: str, held: int, monkeypatch: pytest.MonkeyPatch) -> None:
    finished = run(a_model(PLANS[name]()), 4.0)
    assert finished.status.ok
    t = np.linspace(0.0, 4.0, 101)
    monkeypatch.setattr(batch, "HELD", held)
    plain = values(finished, t, NEVER, monkeypatch)
    with monkeypatch.context() as patch:
        patch.setattr("hierc.runtime.system.System.observe", None)  # who comes there is not compiled
        compiled = values(finished, t, ALWAYS, monkeypatch)
    for key, expected in plain.items():
        assert np.isnan(compiled[key]).tolist() == np.isnan(expected).tolist(), key
        assert np.nan_to_num(compiled[key]).tobytes() == np.nan_to_num(expected).tobytes(), key


def test_faults_are_where_cpython_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    finished = run(a_model(many(FAULTS, 2)), 4.0)
    t = np.linspace(0.0, 4.0, 101)
    found = values(finished, t, ALWAYS, monkeypatch)
    assert np.isnan(found["one.y0"]).tolist() == (found["one.x"] < 0.0).tolist()
    assert found["one.y1"] == pytest.approx(np.minimum(3.0 + np.sin(found["one.v"]), np.inf), rel=1e-15)
    infinite = values(run(a_model(many(OVERFLOW, 2)), 4.0), t, ALWAYS, monkeypatch)["one.y0"]
    assert np.isinf(infinite).any()


def test_a_fault_is_passed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """The head's logarithm has no value while its state is negative; then nobody along the chain has one."""
    plan = chain(5, backwards=False)
    head = replace(HEAD, start=function("start", "t, u, p, x", ["x[0] = 0.5"]))
    finished = run(a_model(replace(plan, classes=(head, LINK))), 3.0)
    t = np.linspace(0.0, finished.t_reached, 31)
    plain = values(finished, t, NEVER, monkeypatch)
    assert np.array_equal(
        values(finished, t, ALWAYS, monkeypatch)["link.y1"], plain["link.y1"], equal_nan=True
    )


def test_externs_that_are_called_back_stay_with_cpython(monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(CALLED.translation, str)
    finished = run(a_model(many(swinging(["told(x[0])"], {"told": CALLED}), 3)), 1.0)
    monkeypatch.setattr(observation, "MANY", ALWAYS)
    assert batch.batch(finished.system, [], [0, 1, 2], 1) is None
    t = np.linspace(0.0, 1.0, 11)
    found = finished.evaluate(["one.y0", "one.x"], t)
    assert found["one.y0"].tolist() == (2.0 * found["one.x"]).tolist()


def test_few_are_not_worth_their_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two functions, one element each."""
    finished = run(a_model(chain(1, backwards=False)), 1.0)
    assert batch.batch(finished.system, [(0, 0)], [1], 1) is None
    assert batch.batch(finished.system, [(0, 0)], [1], 2) is not None
    asked = []
    monkeypatch.setattr(batch, "batch", lambda *given: asked.append(given[-1]))
    for count in (observation.MANY // 2 - 1, observation.MANY // 2, observation.MANY):
        finished.evaluate(["link.y0"], np.linspace(0.0, 1.0, count))
    assert asked == [1, 2]


@pytest.mark.parametrize("name", ["floor", "ceil", "sin", "exp", "pow", "atan2", "log", "fmod"])
def test_functions_at_faults_are_those_of_math_elsewhere(name: str) -> None:
    """The first entry is at fault, so that all are computed in the machine's arithmetic."""
    count = 2 if name in ("pow", "atan2", "fmod") else 1
    rng = np.random.default_rng(5)
    points = np.abs(rng.normal(0, 3, (50, count)))
    arguments = ", ".join(f"x[{k}]" for k in range(count))
    f = function("f", "x, y", ["y[0] = 1.0/(x[0] - x[0])", f"y[1] = float(math.{name}({arguments}))"])
    for point in points.tolist():
        y = [0.0, 0.0]
        ieee.call(f, point, y)
        assert math.isnan(y[0])
        assert y[1] == getattr(math, name)(*point)
