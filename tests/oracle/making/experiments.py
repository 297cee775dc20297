"""Random experiments: what is given to agents, one by one or all of an array, how groups are run, what is recorded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from random import Random
from typing import TYPE_CHECKING

from making.expressions import Scope, Shape, known
from making.text import Block
from making.units import SECOND

if TYPE_CHECKING:
    from making.models import Agent, FileMaker, Param, Variable


@dataclass(frozen=True)
class Place:
    """An agent of the running model, or all of an array. `steps`: names on the way to it, with the sizes of arrays; `sizes`: what its sizes are."""

    agent: Agent
    steps: tuple[tuple[str, str | None], ...]
    sizes: dict[str, str]

    @property
    def arrays(self) -> list[str]:
        """The sizes of the arrays around it."""
        return [count for _, count in self.steps if count is not None]

    def shape(self, of: Variable | Param) -> Shape:
        return tuple(self.sizes.get(size, size) for size in of.shape)

    def path(self, subs: tuple[str, ...] = ()) -> str:
        """The way to it; `subs` stand after the arrays, those that are empty for all of one."""
        rest = iter(subs)
        names = [n if count is None else n + next(rest, "") for n, count in self.steps]
        return "".join(f"{name}." for name in names)


def everywhere(
    agent: Agent, steps: tuple[tuple[str, str | None], ...], sizes: dict[str, str]
) -> Iterator[Place]:
    """All agents in an agent."""
    yield Place(agent, steps, sizes)
    for sub in agent.subs:
        inner = {name: sizes.get(size, size) for name, size in sub.sizes.items()}
        count = None if sub.count is None else sizes.get(sub.count, sub.count)
        yield from everywhere(sub.agent, (*steps, (sub.name, count)), inner)


@dataclass(frozen=True)
class ExperimentMaker:
    """Makes the experiment that runs an agent."""

    file: FileMaker
    top: Agent

    @property
    def rng(self) -> Random:
        return self.file.rng

    def make(self) -> Block:
        """The experiment `run`."""
        file, top = self.file, self.top
        args, sizes = self._own()
        init: list[str | Block] = []
        items: list[str | Block] = [f"stop = {file.writer.number(2, SECOND, loose=True)};"]
        named = {name: name for name in sizes} if file.wishes.seeing else sizes
        for place in everywhere(top, (), named):
            if place.steps:
                args += self._arguments(place)
            for state in place.agent.states:
                if file.chance(0.15):
                    shape = place.shape(state)
                    init += [
                        f"{path}{state.name} = {value};" for path, value in self._gifts(place, shape, state)
                    ]
            items += self._settings(place, first=len(items) == 1)
        if init:
            items.append(Block("init", init))
        timed = replace(self._inside(), timed=True)
        binds = [f"{r.name} := {file.maker(timed).make(r.shape, r.unit, 2, loose=True)}" for r in top.reads]
        coupling = f" [{', '.join(binds)}]" if binds else ""
        return Block(f"experiment run of {top.name}({', '.join(args)}){coupling}", items)

    def _inside(self) -> Scope:
        """What expressions of the experiment may use: the parameters of the agent that runs."""
        return self.top.fixed if self.file.wishes.seeing else self._outside()

    def _outside(self) -> Scope:
        """What the file has."""
        file = self.file
        return Scope(tuple(file.consts), whole=tuple(file.size_consts), funcs=tuple(file.funcs))

    def _own(self) -> tuple[list[str], dict[str, str]]:
        """What the agent itself is given, and what its sizes are."""
        file, top = self.file, self.top
        sizes = {p.name: p.default or "2" for p in top.params if p.kind == "size"}
        args: list[str] = []
        for param in top.params:
            if param.kind == "size" and file.chance(0.3):
                sizes[param.name] = self.rng.choice(["2", "3", "4"])
                args.append(f"{param.name} = {sizes[param.name]}")
        for param in top.params:
            if param.kind != "size" and (param.default is None or file.chance(0.15)):
                shape = tuple(sizes.get(size, size) for size in param.shape)
                args.append(f"{param.name} = {file.parameter(replace(param, shape=shape), self._outside())}")
        return args, sizes

    def _arguments(self, place: Place) -> list[str]:
        """What an agent inside, or some or all of an array, are given."""
        found: list[str] = []
        for param in place.agent.params:
            # What is structural is the same in all of an array.
            if not self.file.chance(0.2) or (param.kind != "real" and (place.arrays or param.kind == "size")):
                continue
            if not place.arrays or param.kind != "real":
                given = replace(param, shape=place.shape(param))
                found.append(f"{place.path()}{param.name} = {self.file.parameter(given, self._inside())}")
                continue
            gifts = self._gifts(place, place.shape(param), param)
            found += [f"{path}{param.name} = {value}" for path, value in gifts]
        return found

    def _gifts(self, place: Place, shape: Shape, of: Variable | Param) -> list[tuple[str, str]]:
        """Paths and values: to all; perhaps to one, or to each of some, besides."""

        def value(scope: Scope) -> str:
            return str(self.file.maker(scope).make(shape, of.unit, self.rng.randint(0, 1), loose=True))

        found = [(place.path(), value(self._inside()))] if not place.arrays or self.file.chance(0.5) else []
        if not place.arrays:
            return found
        *outer, count = place.arrays
        if self.file.chance(0.6):
            whole = bool(found) or bool(outer)  # else it may be all of them that get one each
            first, last = ("2", count) if whole else ("1", count)
            where = (*(self.rng.choice(["[1]", "[2]"]) for _ in outer), f"[{first}..{last}]" if whole else "")
            found.append((place.path(where), self._each(shape, of, first, last)))
        elif self.file.chance(0.8):
            where = tuple(self.rng.choice(["[1]", "[2]"]) for _ in place.arrays)
            found.append((place.path(where), value(self._inside())))
        return found

    def _each(self, shape: Shape, of: Variable | Param, first: str, last: str) -> str:
        """A value for each agent from one to another, in a list or by an expression of the index."""
        scope = self._inside()
        short = known(last) is not None and int(last) <= 4 and len(shape) < 2
        if short and self.file.chance(0.5):
            values = [
                str(self.file.maker(scope).make(shape, of.unit, 1)) for _ in range(int(first), int(last) + 1)
            ]
            return f"[{', '.join(values)}]"
        taken = {*scope.whole, *scope.picks}
        index = self.rng.choice([n for n in ("i", "j", "k", "e") if n not in taken])
        inner = scope.bind(index, "1", "2")  # nobody knows how large it gets: no subscript
        item = self.file.maker(replace(inner, indices=())).make(shape, of.unit, 1)
        scaled = f"{item.at(6)}/(1 + {index})" if self.file.chance(0.7) else item
        return f"[{scaled} for {index} in {first}..{last}]"

    def _settings(self, place: Place, *, first: bool) -> list[str | Block]:
        agent, found = place.agent, list[str | Block]()
        alone = agent.states and not agent.subs and not agent.levels and place.steps and not place.arrays
        if alone and first:
            found.append(Block(f"group {place.path()[:-1]}", ["rtol = 1e-5;"]))
        if agent.writes and place.steps and self.file.chance(0.2):
            where = tuple(self.rng.choice(["", "[2]", f"[1..{count}]"]) for count in place.arrays)
            found.append(f"record {place.path(where)}{self.rng.choice(['*', agent.writes[0].name])};")
        return found
