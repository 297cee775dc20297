"""A compiled model beside the interpreter: where they differ by more than rounding.

Where the interpreter finds no finite number nothing is asked of the compiler, which may use identities over the reals (`0*x` is 0).
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from machine_code import compiled, room
from numpy.typing import NDArray
from plain.interpreter import Interpreter

from hierc.compiler.driver import compile_source
from hierc.compiler.imports.modules import Missing
from hierc.grammar.formatting import format_source
from hierc.grammar.parser import parse
from hierc.grammar.source import SourceFile
from hierc.loader import run_module
from hierc.runtime.elements import expanded, index_table, numbered
from hierc.runtime.machine.unit import parse_function
from hierc.runtime.model import Model

HERE = Path(__file__).parent

Floats = NDArray[np.float64]
Values = Mapping[str, Any]

#: Differences that are rounding: relative, and in terms of what the interpreter's own rounding does.
RELATIVE, OWN = 1e-11, 1e3
#: An interpreter so uncertain of a value judges nothing.
VAGUE = 1e-4


class Different(AssertionError):
    """What was compared, where, and both values."""


@dataclass(frozen=True)
class Files:
    """A reader of files of data in this folder, and of imported files that are just text."""

    texts: Mapping[str, str]
    elsewhere: Mapping[str, str] = field(default_factory=dict)

    def find(self, importer: str, module: str) -> SourceFile | Missing:
        """See `Reader`."""
        return SourceFile(f"{module}.hier", self.texts[module]) if module in self.texts else Missing(module)

    def data(self, importer: str, file: str) -> SourceFile:
        """See `Reader`."""
        return SourceFile(file, (HERE / "data" / file).read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Case:
    """One model text, compiled and interpreted. `params` are by path, in declared units; `files` are those that it imports, by module."""

    text: str
    run: str = "run"
    params: Mapping[str, object] | None = None
    files: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def source(self) -> SourceFile:
        return SourceFile("model.hier", self.text)

    @cached_property
    def model(self) -> Model:
        made = compile_source(self.source, self.run, self.params, reader=Files(self.files))
        model: Model = run_module(made.text, "model.hier").MODEL
        given = self.params or {}
        return model.with_parameters({path: v for path, v in given.items() if path not in made.structural})

    @cached_property
    def plain(self) -> Interpreter:
        return Interpreter(parse(self.source), self.run, self.params)

    @cached_property
    def fine(self) -> Interpreter:
        """The same with three more digits."""
        return Interpreter(parse(self.source), self.run, self.params, np.longdouble)

    # ---- values by name and in vectors ----------------------------------------------------------------------------------------------

    @cached_property
    def places(self) -> list[tuple[str, tuple[int, ...]]]:
        """The variable and element of each scalar state of state vectors."""
        found = []
        for name in self.model.states:
            path, subs = re.fullmatch(r"(.*?)(?:\[([\d,]+)\])?", name).groups()  # type: ignore[union-attr]
            found.append((path, tuple(int(k) - 1 for k in subs.split(",")) if subs else ()))
        return found

    def vector(self, values: Values) -> list[Any]:
        """Values by path as a state vector."""
        assert {path for path, _ in self.places} == set(values), "other states"
        return [np.asarray(values[path])[at] for path, at in self.places]

    def by_path(self, x: Any) -> dict[str, Any]:
        """A state vector by path."""
        sizes: dict[str, tuple[int, ...]] = {}
        for path, at in self.places:
            sizes[path] = tuple(
                max(a, b + 1) for a, b in zip(sizes.get(path, (0,) * len(at)), at, strict=True)
            )
        found = {path: np.zeros(shape, np.asarray(x).dtype) for path, shape in sizes.items()}
        for (path, at), value in zip(self.places, x, strict=True):
            found[path][at] = value
        return found

    # ---- comparisons ----------------------------------------------------------------------------------------------------------------

    def check_start(self, t: float) -> None:
        """Initial values and error scales."""
        found = self.model.system().initial(t)
        with np.errstate(all="ignore"):
            coarse, fine = (self.vector(i.initial(t)) for i in (self.plain, self.fine))
        agree("initial value", self.model.states, found, coarse, fine)
        system = self.model.system()
        scales = dict(zip(self.model.states, system.nominal, strict=True))
        for path, scale in self.fine.nominals().items():
            for (name, at), state in zip(self.places, self.model.states, strict=True):
                if name == path:
                    wanted = [np.asarray(scale)[at if np.ndim(scale) else ()]]
                    agree("nominal", [state], [scales[state]], wanted, wanted)

    def check_rates(self, t: float, x: Floats) -> Floats:
        """Derivatives and all variables at a time and state; returns the derivatives."""
        found = self.model.rhs(t, x)
        at = self.by_path(x)
        with np.errstate(all="ignore"):
            coarse, fine = (self.vector(i.rates(t, at)) for i in (self.plain, self.fine))
            agree("derivative", self.model.states, found, coarse, fine)
            coarse, fine = (i.variables(t, at) for i in (self.plain, self.fine))
        for path, values in self.observed(t, x).items():
            names = [path] * len(values)
            agree("variable", names, values, np.ravel(coarse[path]), np.ravel(fine[path]))
        return found

    def observed(self, t: float, x: Floats) -> dict[str, list[float]]:
        """All variables, by path, row by row."""
        system = self.model.system()
        world = system.world_at(t, x)
        seen = system.observe(t, world, range(system.elements.count))
        found = {}
        for v in self.model.plan.variables:
            scalars = [(expanded(e, v.count), what, expanded(i, v.count)) for e, what, i in v.elements]
            for k, row in enumerate(index_table(v.indices, v.count)):
                found[numbered(v.path, row)] = [
                    world[system.offsets[e[k]] + i[k]] if what == "state" else seen[int(e[k])][i[k]]
                    for e, what, i in scalars
                ]
        return found

    def check_jacobian(self, t: float, x: Floats, columns: Iterable[int]) -> None:
        """Some columns of the Jacobian, against differences of fourth order in more digits. Kinks are left out, and infinite slopes, which
        are NaN: the root of what happens to be 0."""
        found = self.model.jacobian(t, x)
        for column in columns:
            h = np.longdouble(2.0**-17)
            with np.errstate(all="ignore"):
                here, *moved = (np.array(self._fine_rates(t, x, column, k * h)) for k in (0, -2, -1, 1, 2))
                far, left, right, farther = moved
                near, wide = (right - left) / (2 * h), (farther - far) / (4 * h)
                slope = (4 * near - wide) / 3
                smooth = abs(right - 2 * here + left) / h < 1e-3 * (1 + abs(slope))
                known = np.isfinite(slope + found[:, column]) & smooth & (abs(slope) < 1e8)
            for row in np.flatnonzero(known):
                slack = 1e-9 * (1 + abs(slope[row])) + 10 * abs(near[row] - wide[row])
                if not abs(found[row, column] - slope[row]) <= slack:
                    names = self.model.states
                    raise Different(
                        f"d {names[row]}'/d {names[column]} at t={t}, x={list(x)}: {found[row, column]} for {slope[row]}"
                    )

    def _fine_rates(self, t: float, x: Floats, column: int, by: Any) -> list[Any]:
        moved = np.array(x, np.longdouble)
        moved[column] += by
        return self.vector(self.fine.rates(t, self.by_path(moved)))

    def check_format(self) -> None:
        """Formatting keeps the tree and is done once."""
        once = format_source(self.source, 100)
        assert format_source(SourceFile("model.hier", once), 100) == once, "formatting twice changes more"
        assert parse(SourceFile("model.hier", once)).items == parse(self.source).items, (
            "formatting changes the model"
        )

    def check_machine_code(self, rng: np.random.Generator) -> None:
        """Every function of every class as machine code, bit for bit what it is as Python."""
        for kind in self.model.plan.classes:
            n, u = len(kind.states), kind.inputs
            q = rng.uniform(0.5, 2, max(kind.parameters, 1))
            p = np.zeros(max(kind.values, 1))
            self._both(kind.fill, {"q": q}, p, kind.values)
            arguments = {
                "t": np.array([1.3]),
                "x": rng.normal(size=max(n, 1)),
                "u": rng.normal(size=max(u, 1)),
                "d": np.zeros(1),
                "p": p,
            }
            self._both(kind.rhs, arguments, np.zeros(max(n, 1)), n)
            self._both(kind.jac, arguments, np.zeros(max(len(kind.pattern), 1)), len(kind.pattern))
            for part in kind.parts:
                self._both(part.function, arguments, np.zeros(max(kind.outs, 1)), kind.outs)

    @staticmethod
    def _both(function: Any, arguments: Mapping[str, Floats], into: Floats, size: int) -> None:
        """`into` gets what the function computes."""
        definition: ast.FunctionDef = parse_function(function)
        names = [a.arg for a in definition.args.args]
        given = {k: float(v[0]) if k == "t" else v.tolist() for k, v in arguments.items()}
        result = [math.nan] * max(size, 1)
        try:
            function(*[given.get(a, result) for a in names])
        except (ArithmeticError, ValueError):
            return  # CPython has no answer
        out = room(max(size, 1))
        out[:] = math.nan
        packed = {k: np.ascontiguousarray(v, np.float64).reshape(-1, 1) for k, v in arguments.items()}
        compiled(definition)(*[packed.get(a, out) for a in names])
        if not np.array_equal(out[:, 0], result, equal_nan=True):
            raise Different(f"{definition.name}: {out[:, 0]} as machine code, {result} as Python")
        into[: len(result)] = result


def agree(what: str, names: Any, found: Any, coarse: Any, fine: Any) -> None:
    """`found` is `fine` to rounding, which is told by how far `coarse` is from it."""
    for name, ours, rough, exact in zip(names, found, coarse, fine, strict=True):
        if not (np.isfinite(exact) and np.isfinite(rough)) or abs(exact) > 1e100:
            continue
        own = abs(rough - exact)
        if own > VAGUE * (1 + abs(exact)):
            continue
        if not abs(ours - exact) <= RELATIVE * (1 + abs(exact)) + OWN * own:
            raise Different(f"{what} `{name}`: {ours} for {exact} ({rough} in double precision)")
