"""Models written by hand, as the front half of the compiler would make them.

`AgentText` collects one node: names become expressions that Python's operators combine; every equation gets a line of a made-up source file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from hierc.compiler import expression as e
from hierc.compiler import model as m
from hierc.grammar.source import SourceFile, Span


@dataclass(frozen=True)
class X:
    """An expression that Python's operators build."""

    tree: e.Expr

    def __add__(self, other):
        return apply("add", self, other)

    def __radd__(self, other):
        return apply("add", other, self)

    def __sub__(self, other):
        return apply("sub", self, other)

    def __rsub__(self, other):
        return apply("sub", other, self)

    def __mul__(self, other):
        return apply("mul", self, other)

    def __rmul__(self, other):
        return apply("mul", other, self)

    def __truediv__(self, other):
        return apply("div", self, other)

    def __rtruediv__(self, other):
        return apply("div", other, self)

    def __pow__(self, other):
        return apply("pow", self, other)

    def __neg__(self):
        return apply("neg", self)

    def __lt__(self, other):
        return apply("lt", self, other)

    def __le__(self, other):
        return apply("le", self, other)

    def __gt__(self, other):
        return apply("gt", self, other)

    def __ge__(self, other):
        return apply("ge", self, other)


HERE = SourceFile("hand.hier", "0.0;\n")
SPAN = Span(HERE, 0, 3)


def tree(x) -> e.Expr:
    return x.tree if isinstance(x, X) else e.Number(SPAN, float(x))


def apply(op: str, *args) -> X:
    return X(e.Apply(SPAN, op, tuple(tree(a) for a in args)))


def choose(condition, then, other) -> X:
    return X(e.Choose(SPAN, tree(condition), tree(then), tree(other)))


def sin(x):
    return apply("sin", x)


def cos(x):
    return apply("cos", x)


def sqrt(x):
    return apply("sqrt", x)


def exp(x):
    return apply("exp", x)


def log(x):
    return apply("log", x)


TIME = X(e.Time(SPAN))


@dataclass
class Agent:
    """One node in the making. Declare parameters, states and inputs first, then equations."""

    path: str
    template: str
    parameters: dict[str, float | X] = field(default_factory=dict)
    states: dict[str, list] = field(default_factory=dict)  # initial, nominal, rate, line text
    definitions: list[tuple[str, X]] = field(default_factory=list)
    inputs: list[tuple[str, str, int | str]] = field(
        default_factory=list
    )  # path of the agent read, kind, index or name
    algebraic: list[str] = field(default_factory=list)

    def parameter(self, name, value):
        self.parameters[name] = value
        return X(e.Parameter(SPAN, len(self.parameters) - 1))

    def state(self, name, initial=0.0, nominal=1.0):
        self.states[name] = [initial, nominal, None, ""]
        return X(e.State(SPAN, len(self.states) - 1))

    def read(self, path, name, kind="state"):
        self.inputs.append((path, kind, name))
        return X(e.Input(SPAN, len(self.inputs) - 1))

    def let(self, name, value, *, algebraic=False):
        self.definitions.append((name, value))
        if algebraic:
            self.algebraic.append(name)
        return X(e.Local(SPAN, len(self.definitions) - 1))

    def alge(self, name, value):
        return self.let(name, value, algebraic=True)

    def rate(self, name):
        return X(e.Rate(SPAN, list(self.states).index(name)))

    def diff(self, name, rate, text=""):
        self.states[name][2] = rate
        self.states[name][3] = text or f"{name}' = ...;"


def build(name, agents, groups, *, doc="", settings=m.Settings(), record=(), save=()) -> m.Model:  # noqa: B008
    """A `Model` of agents in execution order; `groups` maps a name to the paths of its agents."""
    text, spans = [], {}
    for a in agents:
        for s, (_, _, _, line) in a.states.items():
            spans[a.path, s] = (sum(map(len, text)), len(line))
            text.append(line + "\n")
    file = SourceFile(f"{name.lower()}.hier", "".join(text) or "\n")

    def span(key):
        start, size = spans.get(key, (0, 1))
        return Span(file, start, start + size)

    order = {a.path: n for n, a in enumerate(agents)}
    by_path = {a.path: a for a in agents}

    def source(path, kind, key):
        if kind == "local":
            index = [d for d, _ in by_path[path].definitions].index(key)
        else:
            index = list(by_path[path].states).index(key)
        return m.Source(order[path], kind, index)

    parameters, nodes, variables, first = [], [], [], 0
    for n, a in enumerate(agents):
        entries = []
        for key, value in a.parameters.items():
            # A default may refer to the agent's earlier parameters, by their place in the whole vector.
            default = shifted(tree(value), entries)
            parameters.append(
                m.Parameter(f"{a.path}.{key}", "real", (), None, "", first, (default,), False, SPAN)
            )
            entries.append(first)
            first += 1
        states = tuple(
            m.StateEquation(s, tree(r), tree(i), tree(w), span((a.path, s)), span((a.path, s)))
            for s, (i, w, r, _) in a.states.items()
        )
        definitions = tuple(m.Definition(d, tree(v), SPAN) for d, v in a.definitions)
        sources = tuple(source(*i) for i in a.inputs)
        whole = Span(file, 0, 1)
        nodes.append(
            m.Node(
                n,
                a.path,
                a.template,
                states,
                definitions,
                sources,
                (SPAN,) * len(sources),
                tuple(entries),
                whole,
                n,
            )
        )
        variables += grouped(a, n)
    experiment = m.Experiment(None, settings, (), tuple(record), tuple(save))
    cascade = tuple(m.Group(g, tuple(order[p] for p in paths)) for g, paths in groups.items())
    return m.Model(
        name,
        doc,
        (file,),
        tuple(parameters),
        first,
        tuple(nodes),
        cascade,
        tuple(variables),
        experiment,
        (),
    )


def shifted(value, entries):
    match value:
        case e.Parameter(span, index):
            return e.Parameter(span, entries[index])
        case e.Apply(span, op, args):
            return e.Apply(span, op, tuple(shifted(a, entries) for a in args))
        case e.Choose(span, c, t, o):
            return e.Choose(span, *(shifted(a, entries) for a in (c, t, o)))
    return value


def grouped(agent, node):
    """Variables of results: `p[1]`, `p[2]` are the vector `p`."""
    found = {}
    for k, name in enumerate(agent.states):
        found.setdefault(re.sub(r"\[\d+\]$", "", name), []).append(m.Source(node, "state", k))
    for k, (name, _) in enumerate(agent.definitions):
        if name in agent.algebraic:
            found.setdefault(re.sub(r"\[\d+\]$", "", name), []).append(m.Source(node, "local", k))
    return [
        m.Variable(f"{agent.path}.{name}", (len(s),) if len(s) > 1 else (), None, "", "write", tuple(s), SPAN)
        for name, s in found.items()
    ]


# ---- the four-level cart ------------------------------------------------------------------


def planner(path="plan"):
    a = Agent(path, "Planner")
    A, B, w = a.parameter("A", 4.0), a.parameter("B", 2.0), a.parameter("w", 0.25)
    a.state("p[1]")
    a.state("p[2]")
    a.diff("p[1]", A * w * cos(w * TIME), "p' = [A*w*cos(w*time), 2*B*w*cos(2*w*time)];")
    a.diff("p[2]", 2 * B * w * cos(2 * w * TIME), "p' = [A*w*cos(w*time), 2*B*w*cos(2*w*time)];")
    return a


def unicycle(path="kin", plan="plan"):
    a = Agent(path, "Unicycle")
    L, k = a.parameter("L", 0.3), a.parameter("k", 2.0)
    x, y, th = a.state("x", -0.5), a.state("y", -0.3), a.state("th", 0.4)
    gx, gy = a.read(plan, "p[1]"), a.read(plan, "p[2]")
    rx, ry = a.read(plan, "p[1]", "rate"), a.read(plan, "p[2]", "rate")
    nx = a.let("nose[1]", x + L * cos(th))
    ny = a.let("nose[2]", y + L * sin(th))
    w1 = a.let("w[1]", rx + k * (gx - nx))
    w2 = a.let("w[2]", ry + k * (gy - ny))
    v = a.alge("v", cos(th) * w1 + sin(th) * w2)
    om = a.alge("om", (-sin(th) * w1 + cos(th) * w2) / L)
    a.diff("x", v * cos(th), "x'  = v*cos(th);")
    a.diff("y", v * sin(th), "y'  = v*sin(th);")
    a.diff("th", om, "th' = om;")
    return a


CART = {
    "d": 0.0,
    "k1": 4.0,
    "k2": 10.0,
    "k3": 5.0,
    "kv": 30.0,
    "kt": 150.0,
    "m": 10.0,
    "J": 1.0,
    "r": 0.1,
    "b": 0.25,
}
TAIL = {**CART, "d": 1.0, "k1": 8.0, "k2": 20.0, "k3": 10.0, "kv": 80.0, "kt": 400.0}


def dynamic_cart(path, leader, values, start, speed):
    a = Agent(path, "DynamicCart")
    d, k1, k2, k3, kv, kt, mass, J, r, b = (a.parameter(name, value) for name, value in values.items())
    x0, y0, th0 = (a.parameter(n, value) for n, value in zip(("x0", "y0", "th0"), start, strict=True))
    x, y, th, v, om = (a.state(n, i) for n, i in (("x", x0), ("y", y0), ("th", th0), ("v", 0), ("om", 0)))
    tau1, tau2 = a.state("tau[1]"), a.state("tau[2]")
    thr = a.read(leader, "th")
    xr, yr = a.read(leader, "x"), a.read(leader, "y")
    vr, omr = a.read(leader, "v", speed), a.read(leader, "om", speed)
    tx = a.let("tx", xr - d * cos(thr))
    ty = a.let("ty", yr - d * sin(thr))
    ex = a.let("ex", cos(th) * (tx - x) + sin(th) * (ty - y))
    ey = a.let("ey", -sin(th) * (tx - x) + cos(th) * (ty - y))
    eth = a.let("eth", thr - th)
    vc = a.let("vc", vr * cos(eth) + k1 * ex)
    oc = a.let("oc", omr + vr * (k2 * ey + k3 * sin(eth)))
    Fv = a.let("Fv", mass * kv * (vc - v))
    Fo = a.let("Fo", J * kv * (oc - om) / b)
    a.diff("x", v * cos(th), "x'   = v*cos(th);")
    a.diff("y", v * sin(th), "y'   = v*sin(th);")
    a.diff("th", om, "th'  = om;")
    a.diff("v", (tau1 + tau2) / (mass * r) - 0.1 * v, "v'   = (tau[1] + tau[2])/(m*r) - 0.1 [1/s]*v;")
    a.diff("om", b * (tau1 - tau2) / (J * r) - 0.1 * om, "om'  = b*(tau[1] - tau[2])/(J*r) - 0.1 [1/s]*om;")
    torque = "tau' = kt*(0.5*r*[Fv + Fo, Fv - Fo] - tau);"
    a.diff("tau[1]", kt * (0.5 * r * (Fv + Fo) - tau1), torque)
    a.diff("tau[2]", kt * (0.5 * r * (Fv - Fo) - tau2), torque)
    return a


def cart4() -> m.Model:
    """Problem P1: the four-level cart of Esposito & Kumar, ICRA 2001, Sect. 4."""
    agents = [
        planner(),
        unicycle(),
        dynamic_cart("cart", "kin", CART, (-0.6, -0.4, 0.3), "local"),
        dynamic_cart("tail", "cart", TAIL, (-1.8, -0.9, 0.2), "state"),
    ]
    groups = {"plan": ["plan"], "kin": ["kin"], "dyn": ["cart"], "chase": ["tail"]}
    settings = m.Settings(stop=50.0, rtol=1e-6, interval=0.1)
    record = ("plan.p", "kin.x", "kin.y", "cart.x", "cart.y", "tail.x", "tail.y")
    return build("Cart4", agents, groups, doc="Four-level cart.", settings=settings, record=record)


# ---- small models -----------------------------------------------------------------------------


def toy() -> m.Model:
    """Two agents in a cascade: a clock and one that follows it."""
    a = Agent("slow", "Clock")
    w = a.parameter("w", 0.5)
    x = a.state("x", 1.0)
    a.diff("x", -w * x + sin(TIME), "x' = -w*x + sin(time);")
    b = Agent("fast", "Follower")
    k = b.parameter("k", 20.0)
    y = b.state("y", 0.0)
    r = b.read("slow", "x")
    b.diff("y", k * (r - y), "y' = k*(r - y);")
    return build("Toy", [a, b], {"slow": ["slow"], "fast": ["fast"]})


def ring() -> m.Model:
    """Two agents that read each other's algebraic outputs, in one group, one of which needs no input; and a filter without states.

    a.free = 2 x_a (no input); b.g = b.y + a.free; a.h = a.free*b.g; both rates use both.
    """
    a = Agent("a", "Left")
    x = a.state("x", 0.3)
    g = a.read("b", "g", "local")
    free = a.alge("free", 2 * x)
    h = a.alge("h", free * g)
    a.diff("x", -x + h, "x' = -x + h;")
    f = Agent("f", "Filter")
    double = f.read("a", "free", "local")
    out = f.alge("out", 3 * double + TIME)
    b = Agent("b", "Right")
    y = b.state("y", -0.2)
    fo = b.read("f", "out", "local")
    ha = b.read("a", "h", "local")
    gb = b.alge("g", y + fo)
    b.diff("y", -y * gb + ha, "y' = -y*g + h;")
    assert out
    return build("Ring", [a, f, b], {"ring": ["a", "b"]})


def single(rates, *, parameters=None, inputs=0, initial=None, names=None, algebraic=()) -> m.Model:
    """One agent `a` whose rates are made by `rates(states, inputs, parameters)`; inputs are states of an agent `s` before it."""
    source = Agent("s", "Source")
    for k in range(inputs):
        source.state(f"z{k}", 0.1 * k)
        source.diff(f"z{k}", 0.0 * TIME)
    a = Agent("a", "Single")
    p = [a.parameter(f"p{k}", value) for k, value in enumerate(parameters or [])]
    u = [a.read("s", f"z{k}") for k in range(inputs)]
    count = len(initial) if initial is not None else 3
    names = names or [f"x{k}" for k in range(count)]
    x = [a.state(names[k], (initial or [0.0] * count)[k]) for k in range(count)]
    made = rates(x, u, p)
    for name, rate in zip(names, made, strict=True):
        a.diff(name, rate)
    agents = [source, a] if inputs else [a]
    groups = {agent.path: [agent.path] for agent in agents}
    return build("Single", agents, groups)
