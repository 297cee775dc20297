"""External functions: where they come from, what is compiled of them, and what happens to those that are not."""

from __future__ import annotations

import math
import re

import extern_functions
import numpy as np
import pytest
from callees import machine_values

from hierc.runtime.errors import ExternError
from hierc.runtime.externs import Extern, Watch
from hierc.runtime.machine.translate import Translation, translate
from hierc.runtime.machine.types import UnsupportedCode

M = "extern_functions"
#: A branch that not all lanes take.
GUARDED = """
def rhs(t, x, dx):
    if x[0] > 0.0:
        a = callee0(x[0])
    else:
        a = 0.0
    dx[0] = a
"""


def extern(function: str, scales: tuple[float, ...] = (1.0,), scale: float = 1.0) -> Extern:
    return Extern("f", f"{M}:{function}", ((),) * len(scales), scales, scale)


# ---- where they come from -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        ("no_such_module:f", "there is no module `no_such_module`"),
        (f"{M}.inner:f", f"there is no module `{M}.inner`"),
        (f"{M}:nothing", f"`{M}` has no function `nothing`"),
        (f"{M}:Holder.nothing", f"`{M}` has no function `Holder.nothing`"),
        (f"{M}:constant", "`constant` is not a function"),
        (f"{M}:two", "`two(a: 'float', b: 'float') -> 'float'` cannot be called with 1 argument"),
    ],
)
def test_what_is_not_there(target: str, reason: str) -> None:
    with pytest.raises(ExternError) as caught:
        Extern("f", target, ((),), (1.0,))
    assert str(caught.value) == f"extern `f` ({target}): {reason}"


def test_a_module_that_cannot_be_imported(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "broken_module.py").write_text("import not_installed_at_all\n")  # type: ignore[operator]
    with pytest.raises(ExternError, match="`broken_module` cannot be imported: ModuleNotFoundError"):
        Extern("f", "broken_module:f", ((),), (1.0,))


def test_values_in_declared_units() -> None:
    assert extern("two", (0.5, 2.0), 10.0)(3.0, 8.0) == 10.0 * (6.0 / 17.0)
    assert extern("with_default")(3.0) == 6.0
    assert Extern("f", f"{M}:Holder.scaled", ((),), (1.0,))(3.0) == 6.0
    assert Extern("f", f"{M}:norm", ((2,), ()), (0.1, 1.0))(0.3, 0.4, 2.0) == pytest.approx(10.0, rel=1e-15)
    assert extern("of_array")(2.0) == 2.0
    assert Extern("f", "math:tanh", ((),), (1.0,))(1.0) == math.tanh(1.0)


def test_what_goes_wrong_is_told() -> None:
    with pytest.raises(
        ExternError, match=r"RuntimeError: the sensor fell off \(.*extern_functions.py, line \d+\)"
    ):
        extern("fails")(1.0)
    with pytest.raises(ExternError, match="returned 'fast', which is not a number"):
        extern("gives_text")(1.0)


# ---- what is compiled ---------------------------------------------------------------------------


@pytest.mark.parametrize("function", ["coulomb", "smooth", "two"])
@pytest.mark.parametrize("lanes", [1, 8])
def test_compiled_functions_have_the_very_bits(function: str, lanes: int) -> None:
    count = 2 if function == "two" else 1
    called = extern(function, (0.3, 7.0)[:count], 0.1)
    assert isinstance(called.translation, Translation)
    points = np.random.default_rng(2).normal(0, 3, (400, count))
    points[:4, 0] = [0.0, 0.45, 0.3, -0.3]
    arguments = ", ".join(f"x[{k}]" for k in range(count))
    found, links = machine_values(
        f"def rhs(t, x, dx):\n    dx[0] = callee0({arguments})", {"callee0": called}, points, lanes
    )
    assert found[:, 0].tolist() == [called(*p) for p in points]
    assert not links.called_back


def test_what_cpython_refuses_is_infinite_in_machine_code() -> None:
    called = extern("inverse")
    found, _ = machine_values(
        "def rhs(t, x, dx):\n    dx[0] = callee0(x[0])", {"callee0": called}, np.zeros((1, 1)), 1
    )
    assert found[0, 0] == math.inf
    with pytest.raises(ExternError, match="ZeroDivisionError"):
        called(0.0)


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        ("with_list", "[v, 1.0]: not compiled"),
        ("with_loop", "for k in range(3):: not compiled"),
        ("with_numpy", "np.tanh(v): functions of `math` and plain functions of the same module are compiled"),
        ("with_root", "only powers with a whole number are compiled; `math.pow` takes any"),
        ("no_return", "it can end without a `return`"),
        ("unset", "w: may not be set here"),
        ("with_default", "only functions of just 1 plain arguments are compiled"),
        ("huge", "HUGE: too large for a float"),
        ("as_value", "v or 1.0: not compiled"),
    ],
)
def test_what_is_not_compiled_is_named_with_its_line(function: str, reason: str) -> None:
    chosen = getattr(extern_functions, function)
    with pytest.raises(UnsupportedCode) as caught:
        translate(chosen, 1)
    line = re.match(r"line (\d+): ", str(caught.value))
    assert line is not None
    assert 0 <= int(line[1]) - chosen.__code__.co_firstlineno <= 3
    assert reason in str(caught.value)


def test_what_is_no_plain_function_is_not_compiled() -> None:
    k = 2.0

    def closure(v: float) -> float:
        return k * v

    namespace: dict[str, object] = {}
    exec("def f(v):\n    return v", namespace)
    for function in (closure, math.tanh, extern_functions.cached, namespace["f"]):
        with pytest.raises(UnsupportedCode):
            translate(function, 1)  # type: ignore[arg-type]


# ---- calling back -------------------------------------------------------------------------------


@pytest.mark.parametrize("lanes", [1, 8])
def test_a_branch_not_taken_is_not_called(lanes: int) -> None:
    extern_functions.calls.clear()
    points = np.random.default_rng(3).normal(0, 1, (64, 1))
    found, links = machine_values(GUARDED, {"callee0": extern("recorded")}, points, lanes)
    assert list(links.called_back)
    positive = points[points > 0]
    assert found[:, 0].tolist() == np.where(points > 0, 2 * points, 0.0)[:, 0].tolist()
    assert sorted(extern_functions.calls) == sorted(positive.tolist())


def test_vectors_are_called_back_with_arrays() -> None:
    called = Extern("f", f"{M}:norm", ((2,), ()), (1.0, 1.0), 0.5)
    points = np.random.default_rng(3).normal(0, 1, (16, 3))
    text = "def rhs(t, x, dx):\n    dx[0] = callee0(x[0], x[1], x[2])"
    found, _ = machine_values(text, {"callee0": called}, points, 8)
    assert found[:, 0].tolist() == [called(*p) for p in points]


def test_an_exception_is_kept_and_raised_after_the_machine_code() -> None:
    abandoned: list[bool] = []
    watch = Watch(lambda: abandoned.append(True))
    points = np.array([[0.25], [0.75], [0.25], [0.9]])
    with pytest.raises(ExternError, match="the sensor fell off"), watch.over():
        found, _ = machine_values(GUARDED, {"callee0": extern("fails")}, points, 1)
    assert found[0, 0] == -0.25
    assert np.isnan(found[1:, 0]).all()  # once one has failed nothing more is called
    assert abandoned == [True]
