"""Models with arrays of agents written by hand: blocks of elements, and what they differ in as columns.

`Block` is one block of an array; `build_arrays` puts blocks (and single agents) together; `unrolled` gives the same model without any block.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from hand import SPAN, Agent, X, tree

from hierc.compiler import expression as e
from hierc.compiler import model as m
from hierc.compiler.arrays.columns import Column, column, expanded
from hierc.grammar.source import SourceFile, Span


@dataclass
class Block(Agent):
    """Agents of an array that say the same thing. `indices`: for each `[]` in the path, the elements' indices."""

    indices: tuple = ()
    constants: dict[int, np.ndarray] = field(default_factory=dict)

    @property
    def count(self):
        return len(self.indices[0]) if self.indices else 1

    def index(self, values):
        """Numbers that differ from element to element, as an expression."""
        self.constants[len(self.parameters)] = np.asarray(values)
        return self.parameter(f"(index {len(self.parameters)})", 0.0)

    def read(self, path, name, kind="state", at=None):
        """`at`: for each `[]` in the path, which element each one reads."""
        self.inputs.append((path, kind, name, at))
        return X(e.Input(SPAN, len(self.inputs) - 1))


class Builder:
    """Numbers elements and entries of the parameter vector."""

    def __init__(self, blocks):
        self.blocks = blocks
        self.firsts = np.cumsum([0, *(count(b) for b in blocks)]).tolist()
        self.at = {}  # by path and indices: the element's number, and its block
        for b, first in zip(blocks, self.firsts, strict=False):
            for k, where in enumerate(zip(*indices(b), strict=True) if indices(b) else [()]):
                self.at[b.path, tuple(map(int, where))] = first + k, b
        self.parameters, self.constants, self.entries = [], [], 0

    def numbers(self, path, *at):
        """The numbers of elements, by columns of indices."""
        return Column(
            [self.at[path, where][0] for where in zip(*(np.asarray(a).tolist() for a in at), strict=True)]
        )

    def source(self, path, kind, key, at=None):
        found = [self.at[path, where] for where in (zip(*map(np.ravel, at), strict=True) if at else [()])]
        places = {id(b): place(b, kind, key) for _, b in found}
        at = [n for n, _ in found], [places[id(b)] for _, b in found]
        return m.Source(column(np.array(at[0])), kind, column(np.array(at[1])))

    def vector(self, b):
        """The block's entries of the parameter vector."""
        own = []
        for k, (key, value) in enumerate(b.parameters.items()):
            entries = self.entries + np.arange(count(b))
            if k in getattr(b, "constants", {}):
                self.constants.append(m.Constants(self.entries, Column(b.constants[k])))
            else:
                default = gathered(tree(value), own, bool(indices(b)))
                shown = {"count": count(b), "indices": columns(b)}
                self.parameters.append(
                    m.Parameter(
                        f"{b.path}.{key}",
                        "real",
                        (),
                        None,
                        "",
                        self.entries,
                        (default,),
                        False,
                        SPAN,
                        **shown,
                    )
                )
            own.append(column(entries))
            self.entries += count(b)
        return tuple(own)

    def node(self, number, b, file):
        span = Span(file, 0, 1)
        inputs = tuple(self.source(*given) for given in b.inputs)
        return m.Node(
            id=number,
            path=b.path,
            template=b.template,
            states=tuple(
                m.StateEquation(s, tree(r), tree(i), tree(w), span, span)
                for s, (i, w, r, _) in b.states.items()
            ),
            definitions=tuple(m.Definition(d, tree(v), SPAN) for d, v in b.definitions),
            inputs=inputs,
            input_spans=(SPAN,) * len(inputs),
            parameters=self.vector(b),
            span=span,
            first=self.firsts[number],
            count=count(b),
            indices=columns(b),
        )

    def variables(self):
        """One for all blocks of an array, in the order of their indices."""
        found = {}
        for b in self.blocks:
            for kind, names in (("state", b.states), ("local", b.algebraic)):
                for name in names:
                    found.setdefault((b.path, kind, name), []).append(b)
        for (path, kind, name), blocks in found.items():
            where = sorted({w for b in blocks for w in zip(*indices(b), strict=True)})
            at = [np.array(column) for column in zip(*where, strict=True)]
            shown = {"count": len(where) or 1, "indices": tuple(map(column, at))}
            source = self.source(path, kind, name, at)
            yield m.Variable(f"{path}.{name}", (), None, "", "write", (source,), SPAN, **shown)


def count(b):
    return b.count if isinstance(b, Block) else 1


def indices(b):
    return b.indices if isinstance(b, Block) else ()


def columns(b):
    return tuple(column(np.asarray(i)) for i in indices(b))


def place(b, kind, key):
    return [d for d, _ in b.definitions].index(key) if kind == "local" else list(b.states).index(key)


def gathered(value, own, in_block):
    """A default over the parameter vector."""
    match value:
        case e.Parameter(span, index):
            entry = own[index]
            return e.Gather(span, "parameter", entry) if in_block else e.Parameter(span, entry)
        case e.Apply(span, op, args):
            return e.Apply(span, op, tuple(gathered(a, own, in_block) for a in args))
    return value


def build_arrays(name, blocks, groups, *, order=None, settings=m.Settings()) -> m.Model:  # noqa: B008
    """A model of blocks in execution order; `groups(numbers)` makes its groups, `numbers(path, *indices)` gives elements."""
    file = SourceFile(f"{name.lower()}.hier", "\n")
    made = Builder(blocks)
    singles_first = sorted(range(len(blocks)), key=lambda n: bool(indices(blocks[n])))
    nodes = {n: made.node(n, blocks[n], file) for n in singles_first}
    experiment = m.Experiment(None, settings, (), (), ())
    return m.Model(
        name,
        "",
        (file,),
        tuple(made.parameters),
        made.entries,
        tuple(nodes[n] for n in range(len(blocks))),
        tuple(groups(made.numbers)),
        tuple(made.variables()),
        experiment,
        (),
        constants=tuple(made.constants),
        order=order,
    )


# ---- the same model without blocks -------------------------------------------------------------


def unrolled(model: m.Model) -> m.Model:
    """The model with a node for each element, a group for each group of a family."""
    nodes = [element(node, k) for node in model.nodes for k in range(node.count)]
    parameters = []
    for c in model.constants:
        values = c.values if isinstance(c.values, tuple) else c.values.values.tolist()
        for k, value in enumerate(values):
            number = e.Number(SPAN, float(value))
            parameters.append(
                m.Parameter(
                    f"(constant {c.first + k})", "real", (), None, "", c.first + k, (number,), False, SPAN
                )
            )
    for p in model.parameters:
        size = len(p.values)
        for k in range(p.count):
            values = tuple(single(v, k) for v in p.values)
            path = named(p.path, p.indices, k)
            parameters.append(
                replace(p, path=path, first=p.first + k * size, values=values, count=1, indices=())
            )
    groups = [group for g in model.groups for group in ungrouped(g)]
    if model.order is not None:
        groups = [groups[k] for k in expanded(model.order, len(groups))]
    variables = [
        replace(
            v,
            path=named(v.path, v.indices, k),
            elements=tuple(at(s, k) for s in v.elements),
            count=1,
            indices=(),
        )
        for v in model.variables
        for k in range(v.count)
    ]
    return replace(
        model,
        nodes=tuple(replace(node, id=n) for n, node in enumerate(nodes)),
        parameters=tuple(parameters),
        groups=tuple(groups),
        variables=tuple(variables),
        constants=(),
        order=None,
    )


def element(node, k):
    return replace(
        node,
        path=named(node.path, node.indices, k),
        inputs=tuple(at(s, k) for s in node.inputs),
        parameters=tuple(item(p, k) for p in node.parameters),
        first=node.first + k,
        count=1,
        indices=(),
    )


def ungrouped(group):
    rows = [expanded(nodes, group.count).reshape(group.count, -1) for nodes in group.nodes]
    for g in range(group.count):
        nodes = tuple(int(n) for r in rows for n in r[g])
        yield m.Group(named(group.name, group.indices, g), nodes)


def single(value, k):
    match value:
        case e.Gather(span, "parameter", where):
            return e.Parameter(span, item(where, k))
        case e.Apply(span, op, args):
            return e.Apply(span, op, tuple(single(a, k) for a in args))
    return value


def at(source, k):
    return m.Source(item(source.node, k), source.kind, item(source.index, k))


def item(index, k):
    return index if isinstance(index, int) else int(index.values[k])


def named(path, indices, k):
    for index in indices:
        path = path.replace("[]", f"[{item(index, k)}]", 1)
    return path


# ---- models ------------------------------------------------------------------------------------


def platoon(n, *, each=True) -> m.Model:
    """A leader and n cars; each follows the one ahead by its place, speed and acceleration. The first follows the leader."""
    lead = Agent("lead", "Lead")
    w = lead.parameter("w", 0.5)
    v = lead.state("v", 20.0)
    lead.state("x", 0.0)
    lead.diff("v", sin_of(w * e_time()))
    lead.diff("x", v)
    first = car(Block("car[]", "Car", indices=([1],)), "lead", None, lead.parameters["w"])
    numbers = np.arange(2, n + 1)
    rest = car(Block("car[]", "Car", indices=(numbers,)), "car[]", (numbers - 1,), None)

    def groups(number):
        yield m.Group("lead", (0,))
        if each:
            yield m.Group("car[]", (1,), 1, (1,))
            yield m.Group("car[]", (number("car[]", numbers),), n - 1, (column(numbers),))
        else:
            yield m.Group("cars", (number("car[]", np.arange(1, n + 1)),))

    return build_arrays("Platoon", [lead, first, rest], groups)


def car(block, ahead, at, _):
    numbers = block.indices[0]
    i = block.index(numbers)
    tau = block.parameter("tau", 0.5)
    k = block.parameter("k", 2 / tau)
    x, v = block.state("x", -10 * i), block.state("v", 20.0)
    xa, va, aa = (
        block.read(ahead, s, kind, at) for s, kind in (("x", "state"), ("v", "state"), ("v", "rate"))
    )
    gap = block.alge("gap", xa - x - 5)
    block.diff("x", v)
    block.diff("v", k * (gap - tau * v + (va - v)) + 0.5 * aa)
    return block


def sin_of(x):
    return X(e.Apply(SPAN, "sin", (tree(x),)))


def e_time():
    return X(e.Time(SPAN))


def rod(n) -> m.Model:
    """Cells that read both neighbours, in one group; the ends read one."""
    ends = {1: (2,), n: (n - 1,)}
    blocks = []
    for numbers in ([1], np.arange(2, n), [n]):
        b = Block("cell[]", "Cell", indices=(numbers,))
        k = b.parameter("k", 3.0)
        T = b.state("T", 1.0 / b.index(numbers))
        beside = [(np.asarray(numbers) + d,) for d in (-1, 1)] if len(numbers) == n - 2 else None
        beside = beside or [([j],) for j in ends[numbers[0]]]
        flow = 0.0 * T
        for at in beside:
            flow = flow + k * (b.read("cell[]", "T", "state", at) - T)
        b.diff("T", flow)
        blocks.append(b)
    return build_arrays(
        "Rod", blocks, lambda number: [m.Group("rod", (number("cell[]", np.arange(1, n + 1)),))]
    )


def train(n, *, back=False) -> m.Model:
    """Wagons whose pull passes through all before them (`back`: behind them), in one group: an out needs an out of the same block."""
    numbers = np.arange(1, n + 1)
    end, rest = (n, numbers[:-1]) if back else (1, numbers[1:])
    blocks = []
    for where in ([end], rest):
        b = Block("wagon[]", "Wagon", indices=(where,))
        v = b.state("v", 0.1 * b.index(where))
        if len(where) > 1:
            pull = b.read("wagon[]", "pull", "local", (where + (1 if back else -1),))
            b.alge("pull", 0.9 * pull - v)
        else:
            b.alge("pull", sin_of(e_time()) - v)
        b.diff("v", X(e.Local(SPAN, 0)) - v)
        blocks.append(b)
    return build_arrays("Train", blocks, lambda number: [m.Group("train", (number("wagon[]", numbers),))])


def robots(n, joints=3) -> m.Model:
    """Arms of several joints, a group each; a joint's torque passes on to the next; a stateless sum of each arm; the first joint follows the arm's plan."""
    arm = Block("robot[]", "Robot", indices=(np.arange(1, n + 1),))
    q = arm.state("q", 0.1 * arm.index(np.arange(1, n + 1)))
    arm.diff("q", -q)

    def pairs(*which):
        return np.repeat(np.arange(1, n + 1), len(which)), np.tile(which, n)

    own = pairs(1)
    first = Block("robot[].joint[]", "Joint", indices=own)
    plan = first.read("robot[]", "q", "rate", (own[0],))
    tau = first.alge("tau", 2 * plan)
    z = first.state("z", 1.0)
    first.diff("z", tau - z)
    here = pairs(*range(2, joints + 1))
    rest = Block("robot[].joint[]", "Joint", indices=here)
    before = rest.read("robot[].joint[]", "tau", "local", (here[0], here[1] - 1))
    z = rest.state("z", 1.0 + rest.index(here[1]))
    tau = rest.alge("tau", 0.5 * before + z)
    rest.diff("z", tau - z)
    total = Block("robot[].sum", "Sum", indices=(np.arange(1, n + 1),))
    parts = [total.read("robot[].joint[]", "tau", "local", (pairs(j))) for j in range(1, joints + 1)]
    total.alge("all", sum(parts, 0.0 * e_time()))
    tool = Block("robot[].tool", "Tool", indices=(np.arange(1, n + 1),))
    y = tool.state("y", 0.0)
    tool.diff("y", tool.read("robot[].sum", "all", "local", (np.arange(1, n + 1),)) - y)

    def groups(number):
        every = pairs(*range(1, joints + 1))
        yield m.Group("robot[]", (number("robot[]", np.arange(1, n + 1)),), n, (column(np.arange(1, n + 1)),))
        joined = (number("robot[].joint[]", *every), number("robot[].tool", np.arange(1, n + 1)))
        yield m.Group("robot[].arm", joined, n, (column(np.arange(1, n + 1)),))

    return build_arrays("Robots", [arm, first, rest, total, tool], groups)


def mean(n) -> m.Model:
    """Cars that drive alone, and a reader of the sum of their speeds and of an output of the last."""
    numbers = np.arange(1, n + 1)
    cars = Block("car[]", "Car", indices=(numbers,))
    v = cars.state("v", 1.0 * cars.index(numbers))
    a = cars.alge("a", -0.1 * v)
    cars.diff("v", a)
    sink = Agent("sink", "Sink")
    total = sum((X(e.Input(SPAN, k)) for k in range(n)), 0.0 * e_time())
    sink.inputs = [("car[]", "state", "v", ([k],)) for k in numbers] + [("car[]", "local", "a", ([n],))]
    s = sink.state("s", 0.0)
    sink.diff("s", total / n - s + X(e.Input(SPAN, n)))

    def groups(number):
        yield m.Group("car[]", (number("car[]", numbers),), n, (column(numbers),))
        yield m.Group("sink", (n,))

    return build_arrays("Mean", [cars, sink], groups)


def sensed(n) -> m.Model:
    """Cars that read the car ahead through a stateless sensor, the first of which is another; a group each."""
    numbers = np.arange(1, n + 1)
    head = Block("car[]", "Car", indices=([1],))
    head.diff("v", 1.0 - head.state("v", 0.0))
    front = Block("sensor[]", "Sensor", indices=([1],))
    front.alge("v", 2 * front.read("car[]", "v", "state", ([1],)))
    others = Block("sensor[]", "Sensor", indices=(numbers[1:-1],))
    others.alge(
        "v",
        others.read("car[]", "v", "state", (numbers[1:-1],))
        + 0.5 * others.read("car[]", "v", "rate", (numbers[:-2],)),
    )
    rest = Block("car[]", "Car", indices=(numbers[1:],))
    rest.diff(
        "v",
        rest.read("sensor[]", "v", "local", (numbers[:-1],)) - rest.state("v", 0.1 * rest.index(numbers[1:])),
    )

    def groups(number):
        yield m.Group("car[]", (0,), 1, (1,))
        yield m.Group("car[]", (number("car[]", numbers[1:]),), n - 1, (column(numbers[1:]),))

    return build_arrays("Sensed", [head, front, others, rest], groups)


def swarm(n, seed=0) -> m.Model:
    """Each reads an output of two earlier ones chosen by lot, some of them twice; one group, numbered as it comes."""
    rng = np.random.default_rng(seed)
    name = rng.permutation(n) + 1  # of the one at each place
    order = np.sort(name[3:])
    where = {int(k): p for p, k in enumerate(name)}
    ahead = [np.array([name[rng.integers(where[int(k)])] for k in order]) for _ in range(2)]
    first = Block("bee[]", "Bee", indices=(np.sort(name[:3]),))
    x = first.state("x", first.index(np.sort(name[:3])))
    first.alge("out", 2 * x)
    first.diff("x", -x)
    rest = Block("bee[]", "Bee", indices=(order,))
    x = rest.state("x", rest.read("bee[]", "x", "state", (ahead[0],)) + 1)
    a, b = (rest.read("bee[]", "out", "local", (at,)) for at in ahead)
    out = rest.alge("out", a - 0.5 * b + x)
    rest.diff("x", out - x)
    return build_arrays(
        "Swarm", [first, rest], lambda number: [m.Group("swarm", (number("bee[]", np.arange(1, n + 1)),))]
    )


def queue(n) -> m.Model:
    """Places count from the last one on: all but one need the initial place of a later element. A group each, the last one first."""
    numbers = np.arange(1, n + 1)
    rest = Block("man[]", "Man", indices=(numbers[:-1],))
    x = rest.state("x", rest.read("man[]", "x", "state", (numbers[1:],)) + 1)
    rest.diff("x", -x)
    last = Block("man[]", "Man", indices=([n],))
    last.diff("x", -last.state("x", 5.0))

    def groups(number):
        yield m.Group("man[]", (number("man[]", numbers[:-1]),), n - 1, (column(numbers[:-1]),))
        yield m.Group("man[]", (n - 1,), 1, (n,))

    return build_arrays("Queue", [rest, last], groups, order=Column(np.arange(n)[::-1]))


def mixed(n) -> m.Model:
    """What the first publishes is just a state, what the others do is not; one is read as a state alone as well."""
    numbers = np.arange(1, n + 1)
    first = Block("car[]", "Car", indices=([1],))
    v = first.state("v", 1.0)
    first.alge("speed", 1.0 * v)
    first.diff("v", -v)
    rest = Block("car[]", "Car", indices=(numbers[1:],))
    v = rest.state("v", 2.0)
    ahead = rest.read("car[]", "speed", "local", (numbers[:-1],))
    rest.alge("speed", v + ahead)
    rest.diff("v", ahead - v)
    watcher = Agent("watcher", "Watcher")
    watcher.inputs = [("car[]", "local", "speed", ([1],)), ("car[]", "state", "v", ([1],))]
    w = watcher.state("w", 0.0)
    watcher.diff("w", X(e.Input(SPAN, 0)) * X(e.Input(SPAN, 1)) - w)

    def groups(number):
        yield m.Group("cars", (number("car[]", numbers),))
        yield m.Group("watcher", (n,))

    return build_arrays("Mixed", [first, rest, watcher], groups)


def relay(n) -> m.Model:
    """Engines driven by stateless controls that read the acceleration of the engine ahead: all in one group, so that outs of two arrays take turns."""
    numbers = np.arange(1, n + 1)
    head = Block("control[]", "Control", indices=(numbers[:1],))
    head.alge("u", sin_of(e_time()))
    rest = Block("control[]", "Control", indices=(numbers[1:],))
    rest.alge("u", 0.8 * rest.read("engine[]", "v", "rate", (numbers[:-1],)))
    engine = Block("engine[]", "Engine", indices=(numbers,))
    u = engine.read("control[]", "u", "local", (numbers,))
    engine.diff("v", u - engine.state("v", 0.1 * engine.index(numbers)))
    return build_arrays(
        "Relay", [head, rest, engine], lambda number: [m.Group("all", (number("engine[]", numbers),))]
    )


def ladder(n) -> m.Model:
    """x of rung i starts at z of rung i - 1, z at twice y of post i, y at x of rung i and one more: rungs and posts need each other's."""
    numbers = np.arange(1, n + 1)
    blocks = []
    for where in (numbers[:1], numbers[1:]):
        rung = Block("rung[]", "Rung", indices=(where,))
        y = rung.read("post[]", "y", "state", (where,))
        start = rung.read("rung[]", "z", "state", (where - 1,)) if where[0] > 1 else 3.0
        rung.diff("x", -rung.state("x", start))
        rung.diff("z", -rung.state("z", 2 * y))
        blocks.append(rung)
    post = Block("post[]", "Post", indices=(numbers,))
    post.diff("y", -post.state("y", post.read("rung[]", "x", "state", (numbers,)) + 1))
    every = [("rung[]", numbers), ("post[]", numbers)]
    return build_arrays(
        "Ladder", [*blocks, post], lambda number: [m.Group("all", tuple(number(*some) for some in every))]
    )


def lottery(seed) -> m.Model:
    """Arrays drawn by lot: blocks in any order, reading any states, and outputs and rates of what comes before in a secret order."""
    rng = np.random.default_rng(seed)
    sizes = {f"{name}[]": int(rng.integers(1, 8)) for name in ("a", "b", "c")}
    stateless = {path for path in sizes if path != "a[]" and rng.random() < 0.3}
    elements = [(path, k) for path, size in sizes.items() for k in range(1, size + 1)]
    rank = dict(zip(elements, rng.permutation(len(elements)).tolist(), strict=True))
    blocks = [
        Block(path, path[0].upper(), indices=(np.sort(some),))
        for path, size in sizes.items()
        for some in np.array_split(rng.permutation(size) + 1, rng.integers(1, 4))
        if len(some)
    ]
    blocks = [blocks[k] for k in rng.permutation(len(blocks))]
    for b in blocks:
        _drawn(rng, b, sizes, stateless, rank)

    def groups(number):
        moving = [b for b in blocks if b.states]
        if rng.random() < 0.5:
            for b in moving:
                nodes = (
                    number(b.path, *b.indices) if b.count > 1 else int(number(b.path, *b.indices).values[0])
                )
                yield m.Group(b.path, (nodes,), b.count, columns(b))
        else:
            numbers = [number(b.path, *b.indices).values for b in moving]
            yield m.Group("all", (Column(np.concatenate(numbers)),))

    return build_arrays("Lottery", blocks, groups)


def _drawn(rng, b, sizes, stateless, rank):
    """Inputs and equations of a block."""
    own = [rank[b.path, int(k)] for k in b.indices[0]]
    x = [] if b.path in stateless else [b.state("x", 0.5 * b.index(b.indices[0]))]
    if rng.random() < 0.5:
        b.let("unused", 2 * e_time())
    total = e_time() + b.parameter("k", 1.0 + rng.random()) * sum(x, 1.0)
    for _ in range(rng.integers(0, 4)):
        path, kind = rng.choice(list(sizes)), rng.choice(["state", "local", "rate"])
        kind = "local" if path in stateless else kind
        free = kind == "state"  # of any element
        choices = [[j for j in range(1, sizes[path] + 1) if free or rank[path, j] < r] for r in own]
        if all(choices):
            at = np.array([rng.choice(some) for some in choices])
            read = b.read(str(path), {"local": "y", "state": "x", "rate": "x"}[kind], str(kind), (at,))
            total = total + rng.random() * read
            if x and free and all(rank[path, int(j)] < r for j, r in zip(at, own, strict=True)):
                b.states["x"][0] = read + 1
    y = b.alge("y", total)
    if x:
        b.diff("x", sin_of(y) - x[0])
