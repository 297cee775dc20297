"""Random files: constants, functions, agents of agents, an experiment. Every model is valid: it compiles without problems."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from random import Random

from making.experiments import ExperimentMaker
from making.expressions import Func, Leaf, Maker, Scope, Shape, Text, known
from making.fans import MANY, fans, partial_sums
from making.text import Block
from making.units import COMMON, ONE, SECOND, Style, Unit, Writer, over

CONSTS = ["grav", "joints", "L", "gain", "base"]
FUNCS = ["blend", "mix", "curve", "spread", "shape"]
EXTERNS = [("soft", 1), ("swing", 2), ("hill", 3), ("noticed", 1)]
AGENTS = ["Lag", "Joint", "Plan", "Arm", "Robot", "Cell", "Line"]
SUBS = ["a", "b", "left", "right", "arm", "tip"]
NAMES = [
    "x", "y", "z", "q", "qd", "th", "om", "v", "w", "u", "p", "r", "e", "f", "h", "M", "P", "tau", "level", "offset", "table", "record",
    "save", "history", "each", "i", "k", "c", "d", "goal", "rate", "sum", "norm", "n", "x1", "x2", "T",
]  # fmt: skip
SIZES: list[Shape] = [(), (), (), ("2",), ("3",), ("2", "2"), ("2", "3")]


@dataclass(frozen=True)
class Wishes:
    """What models may have.

    `arrays`: arrays of agents; `nested`: levels in levels; `large`: how many agents; `style`: how units are written; `outside`: tables and external
    functions; `groups`: `group` statements, some of which may need each other in a circle; `seeing`: experiments that use the parameters of the agent
    that runs.
    """

    nested: bool = True
    arrays: bool = False
    large: float = 1.0
    style: Style | None = None
    outside: bool = False
    groups: bool = False
    seeing: bool = True


@dataclass
class Variable:
    """A variable of an agent. `safe`: a `read` that an initial value uses, or a state."""

    name: str
    shape: Shape
    unit: Unit
    safe: bool = False


@dataclass(frozen=True)
class Param:
    """A parameter. `kind`: `real`; `bool`; `size`, an int of 2 or more; `pick`, 1 or 2."""

    name: str
    kind: str
    shape: Shape
    unit: Unit
    default: str | None

    @property
    def type(self) -> str:
        return self.kind if self.kind in ("real", "bool") else "int"


@dataclass
class Agent:
    """What others see of an agent, and where things are in it."""

    name: str
    params: list[Param] = field(default_factory=list)
    reads: list[Variable] = field(default_factory=list)
    writes: list[Variable] = field(default_factory=list)
    states: list[Variable] = field(default_factory=list)
    subs: list[Sub] = field(default_factory=list)
    levels: list[str] = field(default_factory=list)
    fixed: Scope = field(default_factory=Scope)

    @property
    def layered(self) -> bool:
        """Whether there are levels in it, at any depth."""
        return bool(self.levels) or any(sub.agent.layered for sub in self.subs)


@dataclass
class Sub:
    """An agent in an agent; `sizes` are what its size parameters are there, `count` how many there are of it, if it is an array."""

    name: str
    agent: Agent
    sizes: dict[str, str]
    count: str | None = None

    def leaf(self, write: Variable, *, rate: bool = False, safe: bool = False) -> Leaf:
        """What an expression may use of it."""
        shape = self.shape(write) if self.count is None else (self.count, *self.shape(write))
        unit = over(write.unit, SECOND) if rate else write.unit
        return Leaf(f"{self.name}.{write.name}{chr(39) * rate}", shape, unit, safe, self.count is not None)

    @property
    def many(self) -> bool:
        """Whether it is looked at only as a whole."""
        return self.count in MANY

    def shape(self, variable: Variable | Param) -> Shape:
        return tuple(self.sizes.get(size, size) for size in variable.shape)


class FileMaker:
    """Makes one file."""

    def __init__(self, rng: Random, wishes: Wishes) -> None:
        self.rng, self.wishes = rng, wishes
        style = wishes.style or rng.choice(["none", "coherent", "mixed", "mixed"])
        self.writer = Writer(rng, style)
        self.rash = rng.choice([0.0, 0.0, 0.1])
        self.heavy = rng.choice([0.0, 0.0, 0.0, 0.02])
        self.file = Block()
        self.consts: list[Leaf] = []
        self.size_consts: list[str] = []
        self.funcs: list[Func] = []
        self.agents: list[Agent] = []

    def some(self, least: int, most: int) -> int:
        return self.rng.randint(least, most)

    def chance(self, probability: float) -> bool:
        return self.rng.random() < probability

    def unit(self) -> Unit:
        return self.rng.choice(COMMON)

    def maker(self, scope: Scope) -> Maker:
        return Maker(self.rng, self.writer, scope, self.rash, self.heavy)

    def make(self) -> Block:
        self._constants()
        if self.wishes.outside:
            self._outside()
        self._functions()
        count = self.some(1, 1 + round(3 * self.wishes.large))
        for number in range(count):
            AgentMaker(self, AGENTS[number]).make()
        top = AgentMaker(self, "Top", top=True).make()
        self.file.items.append(ExperimentMaker(self, top).make())
        return self.file

    def _constants(self) -> None:
        for name in self.rng.sample(CONSTS, self.some(0, 3)):
            if self.chance(0.25):
                self.file.items.append(f"const int {name} = {self.some(2, 3)};")
                self.size_consts.append(name)
                continue
            shape: Shape = self.rng.choice([(), (), ("2",), ("3",)])
            unit = self.unit()
            value = self.maker(Scope(tuple(self.consts))).make(shape, unit, 1, loose=True)
            self.file.items.append(f"const {typed(shape)} {name}{self.writer.declared(unit)} = {value};")
            self.consts.append(Leaf(name, shape, unit, safe=True))

    def _outside(self) -> None:
        """Tables and external functions; see `oracle_outside.py` and the files in `data`."""
        for file, count in self.rng.sample(
            [("curve", 1), ("curve", 1), ("map", 2), ("cube", 3)], self.some(0, 2)
        ):
            methods = ["hold", "linear", "cubic"] if count == 1 else ["hold", "linear"]
            head, func = self._signature(self.rng.choice(["thrust", "drag", "lift"]), count)
            if func is not None:
                self.file.items.append(f'table {head} = "{file}.csv", {self.rng.choice(methods)};')
                self.funcs.append(func)
        for name, count in self.rng.sample(EXTERNS, self.some(0, 1)):
            head, func = self._signature(name, count)
            if func is not None:
                self.file.items.append(f'extern real {head} = "oracle_outside:{name}";')
                self.funcs.append(func)

    def _signature(self, name: str, count: int) -> tuple[str, Func | None]:
        """What stands between `table` and its file, unless the name is taken."""
        names, units = self.rng.sample(["a", "b", "x", "q", "l"], count), [self.unit() for _ in range(count)]
        unit = self.unit()
        params = ", ".join(f"real {n}{self.writer.declared(u)}" for n, u in zip(names, units, strict=True))
        taken = name in (f.name for f in self.funcs)
        func = None if taken else Func(name, tuple(((), u) for u in units), (), unit)
        return f"{name}({params}){self.writer.declared(unit)}", func

    def _functions(self) -> None:
        for name in self.rng.sample(FUNCS, self.some(0, 3)):
            names = self.rng.sample(["a", "b", "x", "q", "l"], self.some(1, 3))
            shapes: list[Shape] = [
                self.rng.choice([(), ("n",), ("2",), ("n", "n"), ("n", "m")]) for _ in names
            ]
            units = [self.unit() for _ in names]
            generic = {size for shape in shapes for size in shape if known(size) is None}
            shape = tuple(
                self.rng.choice(["2", *sorted(generic)]) for _ in range(self.rng.choice([0, 0, 1, 2]))
            )
            unit = self.unit()
            leaves = [Leaf(n, s, u) for n, s, u in zip(names, shapes, units, strict=True)]
            outer = [leaf for leaf in self.consts if leaf.text not in names]
            params = [
                f"{typed(s)} {n}{self.writer.declared(u)}"
                for n, s, u in zip(names, shapes, units, strict=True)
            ]
            given: list[tuple[Shape, Unit | None]] = list(zip(shapes, units, strict=True))
            picks: tuple[str, ...] = ()
            if self.chance(0.2):
                params.append("int which")
                given.append(((), None))
                picks = ("which",)
            scope = Scope(
                (*leaves, *outer), whole=tuple(sorted(generic)), picks=picks, funcs=tuple(self.funcs)
            )
            body = self.maker(scope).make(shape, unit, 2)
            self.file.items.append(f"func {typed(shape)} {name}({', '.join(params)}) = {body};")
            self.funcs.append(Func(name, tuple(given), shape, unit))

    def parameter(self, param: Param, scope: Scope) -> str:
        """A value for a parameter."""
        match param.kind:
            case "bool":
                return self.rng.choice(["true", "false", *scope.bools])
            case "size":
                return self.rng.choice(["2", "3", "4"])
            case "pick":
                return self.rng.choice(["1", "2", *scope.picks])
        return str(self.maker(scope).make(param.shape, param.unit, self.some(0, 1), loose=True))


def typed(shape: Shape) -> str:
    return f"real[{','.join(shape)}]" if shape else "real"


class AgentMaker:
    """Makes one agent, level by level: each thing may use what stands before it, and, where that is no circle, states that stand after it."""

    def __init__(self, file: FileMaker, name: str, *, top: bool = False) -> None:
        self.file, self.rng, self.top = file, file.rng, top
        self.agent = Agent(name)
        names = [n for n in NAMES if n not in (c.text for c in file.consts)]
        if file.consts and self.rng.random() < 0.2:
            names.append(self.rng.choice(file.consts).text)  # hides the constant
        self.names = names
        self.rng.shuffle(self.names)
        self.sub_names = [n for n in SUBS if n not in CONSTS]
        self.rng.shuffle(self.sub_names)
        self.body: list[str | Block] = []
        self.sizes: list[str] = []
        self.placed: list[Sub] = []
        outer = [c for c in file.consts if c.text not in names]
        #: What arguments may use; what initial values may; what equations may.
        self.fixed = Scope(tuple(outer), whole=tuple(file.size_consts), funcs=tuple(file.funcs))
        self.safe = self.fixed
        self.scope = replace(self.fixed, timed=True)

    def name(self) -> str:
        return self.names.pop()

    def maker(self, scope: Scope) -> Maker:
        return self.file.maker(scope)

    def add(self, leaf: Leaf, *scopes: str) -> None:
        for scope in scopes:
            setattr(self, scope, getattr(self, scope).with_leaves(leaf))

    def shape(self) -> Shape:
        if self.sizes and self.rng.random() < 0.5:
            size = self.rng.choice(self.sizes)
            return self.rng.choice([(size,), (size,), (size, size)])
        return self.rng.choice(SIZES)

    def make(self) -> Agent:
        file, agent = self.file, self.agent
        self._parameters()
        for _ in range(file.some(0, 1 if self.top else 2)):
            read = Variable(
                self.name(),
                self.rng.choice([(), (), *SIZES, *((s,) for s in self.sizes)]) if not self.top else (),
                file.unit(),
            )
            agent.reads.append(read)
            self.body.append(f"read {typed(read.shape)} {read.name}{file.writer.declared(read.unit)};")
            self.add(Leaf(read.name, read.shape, read.unit), "scope")
            self.add(Leaf(read.name, read.shape, read.unit), "safe")
        layered = file.chance(0.8 if self.top else 0.35)
        if layered:
            self._levels(self.body, file.some(2, 3), 0)
        else:
            self._section(self.body, most=3)
        self._observers(1 if agent.writes else 2)
        agent.fixed = self.fixed
        params = ", ".join(declared(p, file.writer) for p in agent.params)
        file.file.items.append(Block(f"agent {agent.name}({params})", self.body))
        file.agents.append(agent)
        return agent

    def _levels(self, into: list[str | Block], count: int, depth: int) -> None:
        for number in range(count):
            name = f"{'stage' if depth == 0 else 'part'}{len(self.agent.levels) + 1}"
            self.agent.levels.append(name)
            block = Block(f"level {name}")
            into.append(block)
            if self.file.wishes.nested and depth < 2 and self.file.chance(0.25):
                self._levels(block.items, 2, depth + 1)
            else:
                self._section(block.items, most=2, least=int(number == 0))

    # ---- parameters and constants ---------------------------------------------------------------------------------------------------

    def _parameters(self) -> None:
        file = self.file
        for _ in range(file.some(0, 3)):
            kind = self.rng.choice(["real", "real", "real", "bool", "size", "pick"])
            name = self.name()
            shape: Shape = self.shape() if kind == "real" and file.chance(0.4) else ()
            param = Param(name, kind, shape, file.unit() if kind == "real" else ONE, None)
            if file.chance(0.7) or kind == "size":
                value = (
                    self.rng.choice(["2", "3", *file.size_consts])
                    if kind == "size"
                    else file.parameter(param, self.fixed)
                )
                param = replace(param, default=value)
            self._parameter(param)
        if file.chance(0.3):
            name, unit = self.name(), file.unit()
            value = file.maker(Scope(tuple(c for c in self.fixed.leaves if c in file.consts))).make(
                (), unit, 1, loose=True
            )
            self.body.append(f"const real {name}{file.writer.declared(unit)} = {value};")
            self.add(Leaf(name, (), unit, safe=True), "fixed", "safe", "scope")
        if file.chance(0.3):
            self._let(self.body, self.fixed, "fixed", "safe", "scope")

    def _parameter(self, param: Param) -> None:
        self.agent.params.append(param)
        grown = {"bool": "bools", "size": "whole", "pick": "picks"}.get(param.kind)
        for scope in ("fixed", "safe", "scope"):
            if grown is None:
                self.add(Leaf(param.name, param.shape, param.unit, safe=True), scope)
            else:
                setattr(
                    self,
                    scope,
                    replace(
                        getattr(self, scope), **{grown: (*getattr(getattr(self, scope), grown), param.name)}
                    ),
                )
        if param.kind == "size":
            self.sizes.append(param.name)

    def _let(self, into: list[str | Block], scope: Scope, *scopes: str) -> None:
        name, shape, unit = self.name(), self.shape(), self.file.unit()
        value = self.maker(scope).make(shape, unit, 2)
        note = self.file.writer.declared(unit) if self.file.chance(0.3) else ""
        into.append(f"let {name}{note} = {value};")
        self.add(Leaf(name, shape, unit), *scopes)

    # ---- one level ------------------------------------------------------------------------------------------------------------------

    def _section(self, into: list[str | Block], most: int, least: int = 1) -> None:
        """Sub-agents, variables and equations."""
        file = self.file
        # What has no level around it must not stand between levels of sub-agents once a level is put around all of it.
        agents = [a for a in file.agents if self.agent.levels or not a.layered][-3:]
        subs = [self._sub(agents) for _ in range(file.some(0, most) if agents else 0)]
        layered = [sub for sub in subs if sub.agent.layered]
        level = [sub for sub in subs if not sub.agent.layered]
        # Levels of sub-agents must not need each other by way of what is around them, which is one group.
        first = file.chance(0.5)
        for sub in layered if first else []:
            self._instance(into, sub)
        self._own(into, level, states=file.some(0 if subs else least, 2))
        for sub in [] if first else layered:
            self._instance(into, sub)
        if file.wishes.groups:
            self._groups(into, level)

    def _groups(self, into: list[str | Block], subs: list[Sub]) -> None:
        """Statements that split and join agents of one level, or agents that stand in none."""
        alone = [sub for sub in subs if sub.agent.states and not sub.agent.subs]
        each = [sub.name for sub in alone if sub.count is not None and self.file.chance(0.4)]
        into += [f"group each {name};" for name in each]
        singles = [sub.name for sub in alone if sub.name not in each]
        if singles and self.file.chance(0.5):
            members = self.rng.sample(singles, self.file.some(1, len(singles)))
            name = next(n for n in reversed(self.names) if n != "each")  # which would begin `group each`
            self.names.remove(name)
            into.append(f"group {name} = {', '.join(members)};")

    def _own(self, into: list[str | Block], subs: list[Sub], *, states: int) -> None:
        """Variables and equations, and sub-agents that all may read each other's states."""
        file = self.file
        own: list[Sub | tuple[str, Variable | None]] = [("diff", self._state(into)) for _ in range(states)]
        for sub in subs:
            for write in sub.agent.writes:
                if write.safe:
                    self._seen(sub, write, "scope")
        own += [("alge", Variable(self.name(), self.shape(), file.unit())) for _ in range(file.some(0, 1))]
        own += [("let", None)] * file.some(0, 1)
        own += subs
        self.rng.shuffle(own)
        for thing in own:
            match thing:
                case Sub():
                    self._instance(into, thing, seen=True)
                case ("let", _):
                    self._let(into if file.chance(0.7) else self.body, self.scope, "scope")
                case (kind, Variable() as variable):
                    self._equations(into, kind, variable)

    def _state(self, into: list[str | Block]) -> Variable:
        file = self.file
        variable = Variable(self.name(), self.shape(), file.unit(), safe=True)
        access = "write" if file.chance(0.85) else "private"
        initial = self._initial(self.safe, variable.shape, variable.unit)
        nominal = f" nominal {file.maker(self.fixed).safe(variable.unit, 1)}" if file.chance(0.1) else ""
        # The rate of a time is a number, which would not fit beside ms/s.
        unit = (
            " [s]"[: 4 * (file.writer.style != "none")]
            if variable.unit == SECOND
            else file.writer.declared(variable.unit)
        )
        into.append(f"{access} {typed(variable.shape)} {variable.name}{unit} = {initial}{nominal};")
        self.agent.states.append(variable)
        if access == "write":
            self.agent.writes.append(variable)
        leaf = Leaf(variable.name, variable.shape, variable.unit, safe=True)
        self.add(leaf, "scope", "safe")
        return variable

    def _initial(self, scope: Scope, shape: Shape, unit: Unit) -> Text:
        """An initial value; a `read` in it must be bound to something whose initial value is known."""
        maker = replace(self.maker(scope), used=[])
        value = maker.make(shape, unit, self.file.some(0, 2), loose=True)
        used = {leaf.text for leaf in maker.used}
        for read in self.agent.reads:
            read.safe = read.safe or read.name in used
        return value

    def _sub(self, agents: list[Agent]) -> Sub:
        agent = self.rng.choice(agents)
        sub = Sub(self.sub_names.pop() if self.sub_names else self.name(), agent, {})
        for param in agent.params:
            if param.kind == "size":
                default = param.default or "2"
                sub.sizes[param.name] = self.rng.choice([default, "2", "3", *self.sizes])
        if self.file.wishes.arrays and self.file.chance(0.4):
            sub.count = self.rng.choice(["2", "3", "4", *self.sizes, *self.file.size_consts])
            if not agent.subs and self.file.chance(0.1):
                sub.count = self.rng.choice(MANY)
        self.agent.subs.append(sub)
        return sub

    def _instance(self, into: list[str | Block], sub: Sub, *, seen: bool = False) -> None:
        file, agent = self.file, sub.agent
        index = (
            ""
            if sub.count is None
            else self.rng.choice([n for n in ("i", "j", "k") if n not in self.scope.whole])
        )
        fixed, safe, scope = (self._counted(s, sub, index) for s in (self.fixed, self.safe, self.scope))
        args = []
        for param in agent.params:
            if param.kind == "size":
                if sub.sizes[param.name] != param.default:
                    args.append(f"{param.name} = {sub.sizes[param.name]}")
            elif param.default is None or file.chance(0.4):
                args.append(f"{param.name} = {file.parameter(replace(param, shape=sub.shape(param)), fixed)}")
        binds = []
        for read in agent.reads:
            value = self._coupling(sub, read, index, safe if read.safe else scope)
            binds.append(f"{read.name} := {value}")
        self.rng.shuffle(args)
        self.rng.shuffle(binds)
        coupling = f" [{', '.join(binds)}]" if binds else ""
        array = f"[{index} in 1..{sub.count}]" if index else ""
        into.append(f"agent {sub.name}{array} = {agent.name}({', '.join(args)}){coupling};")
        self.placed.append(sub)
        for write in agent.writes:
            if not (write.safe and seen):
                self._seen(sub, write, "scope")
            if write.safe:
                self._seen(sub, write, "scope", rate=True)
                self._seen(sub, write, "safe", safe=True)

    def _seen(self, sub: Sub, write: Variable, scope: str, *, rate: bool = False, safe: bool = False) -> None:
        """What others may use of a variable of a sub-agent."""
        if not sub.many:
            self.add(sub.leaf(write, rate=rate, safe=safe), scope)
        elif not rate:
            for leaf in fans(self.rng, sub, write, safe=safe):
                self.add(leaf, scope)

    @staticmethod
    def _counted(scope: Scope, sub: Sub, index: str) -> Scope:
        return scope if sub.count is None else scope.bind(index, "1", sub.count)

    def _coupling(self, sub: Sub, read: Variable, index: str, scope: Scope) -> Text:
        """What a `read` of a sub-agent is bound to; elements of an array may use the one before."""
        shape, unit = sub.shape(read), read.unit
        if read.safe:
            return self._initial(scope, shape, unit)
        value = self.maker(scope).make(shape, unit, 2, loose=True)
        if not index or self.file.chance(0.4):
            return value
        before = f"{sub.name}[{index} - 1]"
        chained = [Leaf(f"{before}.{w.name}", sub.shape(w), w.unit) for w in sub.agent.writes]
        chained += [
            Leaf(f"{before}.{w.name}'", sub.shape(w), over(w.unit, SECOND))
            for w in sub.agent.writes
            if w.safe
        ]
        chained += partial_sums(sub, index, [other for other in self.placed if other.count == sub.count])
        other = self.maker(scope.with_leaves(*chained, *chained)).make(shape, unit, 2, loose=True)
        return Text(f"if {index} == 1 then {value} else {other}", 0)

    # ---- equations ------------------------------------------------------------------------------------------------------------------

    def _equations(self, into: list[str | Block], kind: str, variable: Variable) -> None:
        file = self.file
        unit = variable.unit if kind == "alge" else over(variable.unit, SECOND)
        prime = "" if kind == "alge" else "'"
        if kind == "alge":
            access = "write" if file.chance(0.8) else "private"
            into.append(
                f"{access} {typed(variable.shape)} {variable.name}{file.writer.declared(variable.unit)};"
            )
            if access == "write":
                self.agent.writes.append(variable)
        items = self._pieces(variable, unit, prime)
        blocks = [i for i in into if isinstance(i, Block) and i.head == kind]
        if blocks and file.chance(0.6):
            blocks[0].items += items
        else:
            into.append(Block(kind, list(items)))
        self.add(Leaf(f"{variable.name}{prime}", variable.shape, unit), "scope")

    def _pieces(self, variable: Variable, unit: Unit, prime: str) -> list[str | Block]:
        """Equations for a variable: for the whole, its elements, slices of it, or in a `for`."""
        name, shape = variable.name, variable.shape
        maker, depth = self.maker(self.scope), 2
        ways = [
            "whole",
            "whole",
            *(["for", "rest"] if shape else []),
            *(["each"] if shape and known(shape[0]) else []),
        ]
        way = self.rng.choice(ways)
        if way == "whole":
            return [f"{name}{prime} = {maker.make(shape, unit, depth + 1, loose=True)};"]
        tail = "".join(f", 1..{size}" for size in shape[1:])
        if way == "each":
            return [
                f"{name}[{k}{tail}]{prime} = {maker.make(shape[1:], unit, depth, loose=True)};"
                for k in range(1, int(shape[0]) + 1)
            ]
        index = self.rng.choice([n for n in ("i", "j", "k") if n not in self.scope.whole])
        first = "1" if way == "for" else "2"
        inner = maker.within(maker.scope.bind(index, first, shape[0]))
        if name == index:
            return [f"{name}{prime} = {maker.make(shape, unit, depth, loose=True)};"]
        item = f"{name}[{index}{tail}]{prime} = {inner.make(shape[1:], unit, depth, loose=True)};"
        found: list[str | Block] = [Block(f"for {index} in {first}..{shape[0]}", [item])]
        if way == "rest":
            found.append(f"{name}[1{tail}]{prime} = {maker.make(shape[1:], unit, depth, loose=True)};")
        return found

    def _observers(self, least: int) -> None:
        for _ in range(self.file.some(least - 1, 2)):
            self._equations(self.body, "alge", Variable(self.name(), self.shape(), self.file.unit()))
        if not self.agent.writes:
            variable = Variable(self.name(), (), self.file.unit())
            self.body.append(f"write real {variable.name}{self.file.writer.declared(variable.unit)};")
            self.body.append(
                Block(
                    "alge",
                    [f"{variable.name} = {self.maker(self.scope).make((), variable.unit, 1, loose=True)};"],
                )
            )
            self.agent.writes.append(variable)


def declared(param: Param, writer: Writer) -> str:
    """A parameter as it is declared."""
    unit = writer.declared(param.unit) if param.kind == "real" else ""
    type_ = typed(param.shape) if param.kind == "real" else param.type
    return f"{type_} {param.name}{unit}" + (f" = {param.default}" if param.default is not None else "")


def random_model(rng: Random, wishes: Wishes = Wishes()) -> Block:
    """A file with agent `Top` and experiment `run`."""
    return FileMaker(rng, wishes).make()
