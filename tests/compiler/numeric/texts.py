"""Models from text, compiled, as systems of equations to compare with numpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from hierc.compiler.driver import compile_source
from hierc.grammar.source import SourceFile
from hierc.runtime.parameters import parameter_vector
from hierc.runtime.system import System

Floats = NDArray[np.float64]


def system(text: str, **given: object) -> System:
    """The system of a model's text, with these parameters."""
    names = {"__name__": "generated", "__file__": "generated.py"}
    exec(compile(module(text), "generated.py", "exec"), names)
    plan = names["MODEL"].plan
    return System(plan, parameter_vector(plan, given))


def module(text: str) -> str:
    """The generated module of a model's text."""
    return compile_source(SourceFile("test.hier", text)).text


def type_of(shape: tuple[int, ...]) -> str:
    """A declared type."""
    return f"real[{','.join(map(str, shape))}]" if shape else "real"


def model_of(
    expression: str, operands: Mapping[str, tuple[int, ...]], shape: tuple[int, ...], before: str = ""
) -> str:
    """A model whose last states have `expression` as their derivative, over states of these shapes."""
    lines = [f"write {type_of(s)} {name} = {zero(s)};" for name, s in operands.items()]
    still = " ".join(f"{name}' = 0*{name};" for name in operands)
    body = "\n  ".join([*lines, f"write {type_of(shape)} result = {zero(shape)};"])
    return f"{before}\nagent Test(real k = 0.75, int n = 3) {{\n  {body}\n  diff {{ {still} result' = {expression}; }}\n}}\n"


def zero(shape: tuple[int, ...]) -> str:
    """The initial value of a state of this shape."""
    return f"zeros({', '.join(map(str, shape))})" if shape else "0"


def rates(
    text: str, values: Mapping[str, Floats], shape: tuple[int, ...], time: float = 0.5
) -> tuple[Floats, Floats]:
    """The derivative of `result`, and its derivatives by all operands, (size, operands)."""
    made = system(text)
    count = int(np.prod(shape))
    x = np.concatenate([*(np.ravel(v) for v in values.values()), np.zeros(count)])
    jacobian = made.jacobian(time, x)
    return made.rhs(time, x)[-count:].reshape(shape), jacobian[-count:, : len(x) - count]


def differences(function: Callable[..., Floats], values: Mapping[str, Floats]) -> Floats:
    """Derivatives of a function of arrays by differences of fourth order, (size, operands)."""
    packed = np.concatenate([np.ravel(v) for v in values.values()])

    def at(x: Floats) -> Floats:
        given, first = [], 0
        for value in values.values():
            given.append(x[first : first + np.size(value)].reshape(np.shape(value)))
            first += np.size(value)
        return np.ravel(function(*given)).astype(np.float64)

    h = 2e-4
    columns = []
    for unit in np.eye(len(packed)):
        near, far = (at(packed + s * h * unit) - at(packed - s * h * unit) for s in (1.0, 2.0))
        columns.append((8.0 * near - far) / (12.0 * h))
    return np.array(columns).T
