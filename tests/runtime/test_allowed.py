"""What a generated module's functions may say: indices within their arrays, names set once and before they are read, outputs set."""

from __future__ import annotations

import ast
from dataclasses import replace

import pytest
from machine_code import definition
from small_models import ARM

from hierc.runtime.machine.allowed import check_class, check_function
from hierc.runtime.machine.types import UnsupportedCode

ARRAYS = {"x": range(2), "u": (0, 2), "d": (), "p": range(3)}


def check(*lines: str) -> None:
    text = "def rhs(t, x, u, d, p, dx):\n" + "".join(f"    {line}\n" for line in lines)
    check_function(definition(text), ARRAYS, "dx", range(2))


def test_what_the_compiler_writes_passes() -> None:
    check(
        '"""Derivatives."""',
        "p0 = p[0]",
        "if x[0] > 0.0 and not (t < 1.0 or u[2] != p0):",
        "    a0 = math.sqrt(x[0])",
        "    a1 = 1.0 if x[1] >= 2.0 else -1.0",
        "else:",
        "    a1 = float(math.floor(x[0]))",
        "    a0 = max(math.atan2(u[0], p0), 3)",
        "dx[0] = a0*a1",
        "dx[1] = -x[0]/p[2]",
    )


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("a = x[2]", "no such entry"),
        ("a = x[-1]", "not allowed"),
        ("a = x[True]", "no such entry"),
        ("a = u[1]", "no such entry"),  # an input that this part does not declare
        ("a = d[0]", "no such entry"),
        ("a = p[3]", "no such entry"),
        ("a = x[int(t)]", "not allowed"),
        ("a = dx[0]", "no such entry"),
        ("a = w[0]", "no such entry"),
        ("a = x", "read before it is set"),
        ("a = b", "read before it is set"),
        ("a = math", "read before it is set"),
        ("dx[2] = 1.0", "no such entry"),
        ("x[0] = 1.0", "cannot be set"),
        ("p[0] = 1.0", "cannot be set"),
        ("t = 1.0", "cannot be set"),
        ("math = 1.0", "cannot be set"),
        ("x = 1.0", "cannot be set"),
        ("a = b = 1.0", "not allowed"),
        ("a += 1.0", "not allowed"),
        ("while t < 1.0: pass", "not allowed"),
        ("for k in range(3): pass", "not allowed"),
        ("return", "not allowed"),
        ("a = x[0] < 1.0", "not allowed"),
        ("a = True", "not allowed"),
        ("a = int(t)", "not allowed"),
        ("a = float(t, t)", "not allowed"),
        ("a = math.hypot(t, t)", "not allowed"),
        ("a = t.real", "not allowed"),
        ("a = invoke(t)", "not allowed"),
        ("a = 1.0 if t else 2.0", "not a condition"),
        ("a = 1.0 if t and t else 2.0", "not a condition"),
        ("import os", "not allowed"),
        ("exec('1')", "not allowed"),
        ("a = [t for t in x]", "not allowed"),
        ("a = (b := t)", "not allowed"),
        ("a = t**2", "not allowed"),
    ],
)
def test_refusals(line: str, why: str) -> None:
    with pytest.raises(UnsupportedCode, match=f"line 2: .*{why}"):
        check(line, "dx[0] = 0.0", "dx[1] = 0.0")


def test_a_name_is_set_on_every_path() -> None:
    with pytest.raises(UnsupportedCode, match="read before it is set"):
        check("if t > 0.0:", "    a = 1.0", "dx[0] = a", "dx[1] = 0.0")


def test_a_name_is_set_once() -> None:
    with pytest.raises(UnsupportedCode, match="set twice"):
        check("a = 1.0", "dx[0] = a", "a = 2.0", "dx[1] = a")


def test_every_output_is_set() -> None:
    with pytest.raises(UnsupportedCode, match=r"never sets dx\[1\]"):
        check("dx[0] = 0.0", "if t > 0.0:", "    dx[1] = 1.0")


@pytest.mark.parametrize(
    "signature", ["t, x", "t, x, u, d, p, dx=1.0", "t, x, u, d, p, *dx", "x, t, u, d, p, dx"]
)
def test_signatures(signature: str) -> None:
    with pytest.raises(UnsupportedCode, match="must take just"):
        check_function(definition(f"def rhs({signature}):\n    pass\n"), ARRAYS, "dx", ())


def test_decorators_are_refused() -> None:
    function = definition("def rhs(t, dx):\n    pass\n")
    function.decorator_list = [ast.Name("staticmethod", ast.Load())]
    with pytest.raises(UnsupportedCode):
        check_function(function, {}, "dx", ())


def test_tables_that_point_outside() -> None:
    kind = ARM
    check_class(kind)
    n, m = len(kind.states), kind.inputs
    part = kind.parts[1]
    bad_tables = [
        replace(kind, pattern=(*kind.pattern[:-1], (n + kind.outs, 0))),
        replace(kind, pattern=(*kind.pattern[:-1], (0, n + m))),
        replace(kind, pattern=(*kind.pattern, (0, 0))),  # an entry that jac never sets
        replace(kind, parts=(kind.parts[0], replace(part, inputs=(m,)))),
        replace(kind, parts=(kind.parts[0], replace(part, outs=(kind.outs,)))),
        replace(
            kind, parts=(kind.parts[0], replace(part, inputs=()))
        ),  # out reads an input it does not declare
        replace(kind, inputs=0, parts=()),
        replace(kind, values=0),
        replace(kind, states=("one",)),
    ]
    for bad in bad_tables:
        with pytest.raises(UnsupportedCode):
            check_class(bad)
