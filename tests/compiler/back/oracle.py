"""What generated modules are compared with: a plain interpreter of models, and a plain reader of a module's tables.

`Interpreter` follows the user's expressions as they stand, over any number library (`math`, `mpmath`). `System` does what the contract says a
runtime does, slowly: it knows nothing of how the tables came about.
"""

from __future__ import annotations

import base64
import math
import sys
import types
import zlib
from unittest import mock

import mpmath
import numpy as np

from hierc.compiler import expression as e
from hierc.compiler import model as m
from hierc.compiler.emission.emit import emit
from hierc.compiler.emission.plan import plan
from hierc.compiler.symbolic.derive import derive
from hierc.runtime import contract


def generate(model: m.Model) -> str:
    return emit(plan(model, derive(model)))


class StubModel:
    """Stands in for the runtime's model: keeps the plan and what it is called with."""

    def __init__(self, plan, file):
        self.plan, self.file, self.calls = plan, file, []

    def __getattr__(self, name):
        return lambda *args, **kwargs: self.calls.append((name, args, kwargs))


def load(text: str) -> dict:
    """Executes a module's text and gives its names."""
    stub = types.ModuleType("hierc.runtime.model")
    stub.Model = StubModel
    names = {"__file__": "generated.py", "__name__": "generated"}
    with mock.patch.dict(sys.modules, {"hierc.runtime.model": stub}):
        exec(compile(text, "generated.py", "exec"), names)
    return names


# ---- the user's expressions, as they stand ---------------------------------------------------


def _round(lib, x):
    return lib.copysign(lib.floor(abs(x)) + (1 if abs(x) - lib.floor(abs(x)) >= 0.5 else 0), x)


def _mp_copysign(x, y):
    return abs(x) if y >= 0 else -abs(x)


class MP:
    """mpmath under the names of `math`, for real numbers only."""

    copysign = staticmethod(_mp_copysign)

    def __getattr__(self, name):
        function = {"pow": mpmath.power, "log10": lambda x: mpmath.log(x, 10)}.get(name) or getattr(
            mpmath.mp, name
        )

        def real(*args):
            if any(abs(a) > 1e15 for a in args):
                raise ValueError(
                    "beyond what differences can resolve"
                )  # mpmath may need all memory for such powers
            result = function(*args)
            if isinstance(result, mpmath.mpc):
                raise ValueError(f"{name}: not a real number")
            return result

        return real


class Interpreter:
    """Evaluates a model's expressions: states[node][k], parameters q."""

    def __init__(self, model: m.Model, t, states, q, lib=math):
        self.model, self.t, self.states, self.q, self.lib = model, t, states, q, lib
        self.memo = {}

    def source(self, s: m.Source):
        match s.kind:
            case "state":
                return self.states[s.node][s.index]
            case "rate":
                return self.value(s.node, self.model.nodes[s.node].states[s.index].rate)
            case "local":
                return self.value(s.node, self.model.nodes[s.node].definitions[s.index].value)

    def rates(self, node: int):
        return [self.value(node, s.rate) for s in self.model.nodes[node].states]

    def value(self, n: int, x: e.Expr):
        node = self.model.nodes[n]
        match x:
            case e.Number(value=v):
                return v
            case e.Time():
                return self.t
            case e.State(index=k):
                return self.states[n][k]
            case e.Parameter(index=k):
                return self.q[node.parameters[k]]
            case e.Input(index=k):
                return self.source(node.inputs[k])
            case e.Rate(index=k):
                return self.value(n, node.states[k].rate)
            case e.Local(index=k):
                if (n, k) not in self.memo:
                    self.memo[n, k] = self.value(n, node.definitions[k].value)
                return self.memo[n, k]
            case e.Choose(condition=c, then=a, other=b):
                return self.value(n, a if self.value(n, c) else b)
            case e.Apply(op="and", args=(a, b)):
                return 1.0 if self.value(n, a) and self.value(n, b) else 0.0
            case e.Apply(op="or", args=(a, b)):
                return 1.0 if self.value(n, a) or self.value(n, b) else 0.0
            case e.Apply(op=op, args=args):
                return self.apply(op, *(self.value(n, a) for a in args))

    def apply(self, op, *a):
        lib = self.lib
        match op, a:
            case "add", (x, y):
                return x + y
            case "sub", (x, y):
                return x - y
            case "mul", (x, y):
                return x * y
            case "div", (x, y):
                return x / y
            case "neg", (x,):
                return -x
            case "abs", (x,):
                return abs(x)
            case "sign", (x,):
                return (x > 0) - (x < 0) + 0.0
            case "round", (x,):
                return _round(lib, x)
            case "mod", (x, y):
                return x - y * lib.floor(x / y) if lib is not math else x % y
            case "quotient", (x, y):
                return lib.floor(x / y) + 0.0
            case "floor" | "ceil", (x,):
                return getattr(lib, op)(x) + 0.0
            case "max", (x, y):
                return max(y, x)
            case "min", (x, y):
                return min(y, x)
            case "not", (x,):
                return 0.0 if x else 1.0
            case (("lt" | "le" | "gt" | "ge" | "eq" | "ne"), (x, y)):
                same = {"lt": x < y, "le": x <= y, "gt": x > y, "ge": x >= y, "eq": x == y, "ne": x != y}
                return 1.0 if same[op] else 0.0
        return getattr(lib, op)(*a)


# ---- a module's tables, as the contract says -------------------------------------------------


def integers(index: contract.Index, count: int) -> list[int]:
    """One integer for each of `count` elements."""
    match index:
        case int():
            return [index] * count
        case contract.Steps(first, step):
            return [first + k * step for k in range(count)]
        case contract.Packed(text):
            differences = np.frombuffer(zlib.decompress(base64.b64decode(text)), "<i4")
            found = np.cumsum(differences.astype(np.int64)).tolist()
        case _:
            found = list(index)
    assert len(found) == count
    return found


def elements(node: contract.Node) -> list[contract.Node]:
    """The elements of a block, each as a block of one."""
    parameters = [integers(p, node.count) for p in node.parameters]
    sources = [(integers(n, node.count), what, integers(i, node.count)) for n, what, i in node.sources]
    return [
        contract.Node(
            node.path,
            node.kind,
            tuple(p[k] for p in parameters),
            tuple((n[k], what, i[k]) for n, what, i in sources),
        )
        for k in range(node.count)
    ]


def groups(family: contract.Group) -> list[contract.Group]:
    """The groups of a family, each as a family of one."""

    def members(entry) -> list[list[int]]:
        if isinstance(entry, contract.Run):
            row = [entry.first + k * entry.step for k in range(entry.count)]
            return [[n + g * entry.shift for n in row] for g in range(family.count)]
        return [[n] for n in integers(entry, family.count)]

    nodes = [members(entry) for entry in family.nodes]
    calls = [(members(entry), part) for entry, part in family.calls]
    return [
        contract.Group(
            family.name,
            tuple(n for entry in nodes for n in entry[g]),
            tuple((n, part) for entry, part in calls for n in entry[g]),
        )
        for g in range(family.count)
    ]


class System:
    """A loaded module with its parameters set."""

    def __init__(self, text: str, given: dict[int, float] | None = None):
        self.names = load(text)
        self.plan: contract.Plan = self.names["MODEL"].plan
        self.q = [math.nan] * self.plan.parameter_count
        for k, value in (given or {}).items():
            self.q[k] = value
        for first, count, index in self.plan.constants:
            self.q[first : first + count] = integers(index, count)
        self.plan.parameters_function(self.q)
        for defaults in self.plan.defaults:
            self.complete(defaults)
        self.nodes = [element for node in self.plan.nodes for element in elements(node)]
        self.groups = [group for family in self.plan.groups for group in groups(family)]
        self.p = [self.fill(n) for n in range(len(self.nodes))]

    def complete(self, defaults: contract.Defaults) -> None:
        given = [integers(i, defaults.count) for i in defaults.given]
        entries = [integers(i, defaults.count) for i in defaults.entries]
        for k in range(defaults.count):
            v = [self.q[column[k]] for column in entries]
            defaults.function([self.q[column[k]] for column in given], v)
            for column, value in zip(entries, v, strict=True):
                self.q[column[k]] = value

    def form(self, n: int) -> contract.Class:
        return self.plan.classes[self.nodes[n].kind]

    def fill(self, n: int) -> list[float]:
        p = [math.nan] * self.form(n).values
        self.form(n).fill([self.q[k] for k in self.nodes[n].parameters], p)
        return p

    def initial(self, t: float = 0.0):
        """Initial values by the passes that the plan asks for."""
        states = [[math.nan] * len(self.form(n).states) for n in range(len(self.nodes))]
        order = self.plan.start_order
        for _ in range(self.plan.start_passes):
            outs: dict = {}
            for n in range(len(self.nodes)) if order is None else integers(order, len(self.nodes)):
                u = [self.tolerant(t, states, outs, s) for s in self.nodes[n].sources]
                self.form(n).start(t, u, self.p[n], states[n])
        return states

    def tolerant(self, t, states, outs, source):
        try:
            return self.read(t, states, {}, source)
        except (ValueError, ZeroDivisionError):
            return math.nan

    def read(self, t, states, outs, source):
        node, kind, index = source
        if kind == "state":
            return states[node][index]
        if (node, index) not in outs:
            form = self.form(node)
            part = next(p for p in form.parts if index in p.outs)
            u = [math.nan] * form.inputs  # what a part does not declare it does not see
            for k in part.inputs:
                u[k] = self.read(t, states, outs, self.nodes[node].sources[k])
            y = [math.nan] * form.outs
            part.function(t, states[node], u, [], self.p[node], y)
            outs.update({(node, o): y[o] for o in part.outs})
        return outs[node, index]

    def inputs(self, t, states, n):
        outs: dict = {}
        return [self.read(t, states, outs, s) for s in self.nodes[n].sources]

    def rates(self, t, states, n):
        dx = [math.nan] * len(self.form(n).states)
        self.form(n).rhs(t, states[n], self.inputs(t, states, n), [], self.p[n], dx)
        return dx

    def observed(self, t, states, n):
        y = [math.nan] * self.form(n).observed
        if self.form(n).observe:
            self.form(n).observe(t, states[n], self.inputs(t, states, n), [], self.p[n], y)
        return y

    def jacobian(self, t, states, n):
        """Nonzeros by (row, column)."""
        J = [math.nan] * len(self.form(n).pattern)
        self.form(n).jac(t, states[n], self.inputs(t, states, n), [], self.p[n], J)
        return dict(zip(self.form(n).pattern, J, strict=True))

    def flat(self, t, x):
        """All rates as one vector, for integrators."""
        states, first = [], 0
        for n in range(len(self.nodes)):
            size = len(self.form(n).states)
            states.append([float(v) for v in x[first : first + size]])
            first += size
        outs: dict = {}
        found = []
        for n in range(len(self.nodes)):
            u = [self.read(t, states, outs, s) for s in self.nodes[n].sources]
            dx = [math.nan] * len(states[n])
            self.form(n).rhs(t, states[n], u, [], self.p[n], dx)
            found += dx
        return found

    def group(self, g: int, t, states):
        """Rates of a group by its calls alone; outs it does not set itself are channels, those it should set start as NaN."""
        group = self.groups[g]
        outs: dict = {}
        members = set(group.nodes)
        home = {n for other in self.groups for n in other.nodes} - members
        found = {}
        for n, part in group.calls:
            form = self.form(n)
            u = []
            for source, kind, index in self.nodes[n].sources:
                if kind == "out" and source not in home:
                    u.append(outs.get((source, index), math.nan))
                else:
                    u.append(self.read(t, states, {}, (source, kind, index)))
            if part < 0:
                found[n] = dx = [math.nan] * len(form.states)
                form.rhs(t, states[n], u, [], self.p[n], dx)
            else:
                y = [math.nan] * form.outs
                form.parts[part].function(t, states[n], u, [], self.p[n], y)
                outs.update({(n, o): y[o] for o in form.parts[part].outs})
        return found


def ulps(a: float, b: float) -> float:
    """Distance in units of the last place of the larger."""
    if a == b or (math.isnan(a) and math.isnan(b)):
        return 0.0
    if math.isnan(a) or math.isnan(b) or math.isinf(a) or math.isinf(b):
        return math.inf
    return abs(a - b) / math.ulp(max(abs(a), abs(b)))
