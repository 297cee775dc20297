"""Random hierarchies of any depth: the cascade, the groups and their order against a search of all ways."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from helpers import groups, model_of

from hierc.compiler.model import Model
from hierc.grammar.problems import ModelError

LAG = """
agent Lag(real T = 1) {
  read real u;
  write real y = 0;
  diff { y' = (u - y)/T; }
}
"""


@dataclass(frozen=True)
class Member:
    """A sub-agent in a level of its agent, given as the path of levels from the outside; it reads the sum of `sources`."""

    name: str
    kind: str
    level: tuple[str, ...]
    sources: tuple[str, ...]


@dataclass(frozen=True)
class Plan:
    """An agent: its members, and what its observer `out` is the sum of. `levels`: every level, each after the one around it."""

    levels: tuple[tuple[str, ...], ...]
    members: tuple[Member, ...]
    out: tuple[str, ...]

    def divided(self, level: tuple[str, ...]) -> bool:
        return any(inner[:-1] == level for inner in self.levels)

    def text(self, name: str) -> str:
        return f"agent {name}() {{ read real u; write real out; alge {{ out = {sum_of(self.out)}; }} {self.inside(())} }}"

    def inside(self, level: tuple[str, ...]) -> str:
        members = (
            f"agent {m.name} = {m.kind}() [u := {sum_of(m.sources)}];"
            for m in self.members
            if m.level == level
        )
        inner = (
            f"level {path[-1]} {{ {self.inside(path)} }}"
            for path in self.levels
            if path and path[:-1] == level
        )
        return " ".join([*members, *inner])


def sum_of(names: tuple[str, ...]) -> str:
    return " + ".join(names) or "0"


@dataclass(frozen=True)
class State:
    """A lag of the model: by its path, with the levels around it from the outside, as (agent or level with levels, which of its levels)."""

    path: str
    levels: tuple[tuple[tuple[str, ...], int], ...]
    reads: frozenset[str]


def random_plan(pick: random.Random, kinds: list[str], *, flat: bool = False) -> Plan:
    """Two or three levels, some of which have levels, and one or two members in each innermost one."""
    levels: list[tuple[str, ...]] = []

    def divide(around: tuple[str, ...], depth: int) -> Iterator[tuple[str, ...]]:
        for index in range(pick.choice((2, 2, 3)) if depth == 0 else 2):
            here = (*around, f"{around[-1] if around else 'l'}{index}")
            levels.append(here)
            yield from divide(here, depth + 1) if depth < 2 and pick.random() < 0.4 else (here,)

    places = [()] if flat else list(divide((), 0))
    named = [
        (f"m{i}", place) for i, place in enumerate(p for p in places for _ in range(pick.choice((1, 2, 3))))
    ]
    chosen = [(name, place, pick.choice(kinds)) for name, place in named]
    outputs = {name: f"{name}.{'y' if kind == 'Lag' else 'out'}" for name, _, kind in chosen}

    def sources(reader: int) -> tuple[str, ...]:
        """Mostly of earlier members, so that many worlds are in order."""
        before = [outputs[name] for name, _, _ in chosen[:reader]] + ["u"]
        anywhere = [source for name, source in outputs.items() if name != chosen[reader][0]]
        return tuple(
            pick.choice(anywhere if anywhere and pick.random() < 0.04 else before)
            for _ in range(pick.choice((1, 2)))
        )

    members = tuple(Member(name, kind, place, sources(i)) for i, (name, place, kind) in enumerate(chosen))
    return Plan(tuple(levels), members, tuple(pick.choices(list(outputs.values()), k=pick.choice((1, 2)))))


def random_world(seed: int) -> dict[str, Plan]:
    pick = random.Random(seed)
    arm = random_plan(pick, ["Lag"])
    pair = random_plan(pick, ["Lag"], flat=True)
    robot = random_plan(pick, ["Lag", "Lag", "Arm", "Pair"])
    return {
        "Arm": arm,
        "Pair": pair,
        "Robot": robot,
        "World": random_plan(pick, ["Lag", "Robot", "Arm", "Pair"]),
    }


def states_of(plans: dict[str, Plan]) -> dict[str, State]:
    """Every lag of the world."""
    found: dict[str, State] = {}

    def behind(source: str, plan: Plan, path: str, given: frozenset[str]) -> frozenset[str]:
        """The lags that a name in an agent stands for."""
        if source == "u":
            return given
        name, variable = source.split(".")
        if variable == "y":
            return frozenset({path + name})
        (member,) = (m for m in plan.members if m.name == name)
        inner = plans[member.kind]
        return frozenset().union(*(behind(s, inner, f"{path}{name}.", frozenset()) for s in inner.out))

    def enter(
        plan: Plan, path: str, given: frozenset[str], around: tuple[tuple[tuple[str, ...], int], ...]
    ) -> None:
        for member in plan.members:
            levels = list(around)
            for depth in range(1, len(member.level) + 1):
                outer, here = member.level[: depth - 1], member.level[:depth]
                beside = [level for level in plan.levels if level[:-1] == outer]
                levels.append(((path, *outer), beside.index(here)))
            read = frozenset().union(*(behind(s, plan, path, given) for s in member.sources))
            name = path + member.name
            if member.kind == "Lag":
                found[name] = State(name, tuple(levels), read)
            else:
                enter(plans[member.kind], f"{name}.", read, tuple(levels))

    enter(plans["World"], "", frozenset(), ())
    return found


def reached(states: dict[str, State]) -> dict[str, set[str]]:
    """For each lag all that it depends on."""
    found = {}
    for name in states:
        seen: set[str] = set()
        waiting = [name]
        while waiting:
            new = states[waiting.pop()].reads - seen
            seen |= new
            waiting += new
        found[name] = seen
    return found


def breaks_order(states: dict[str, State]) -> bool:
    """Whether a level depends on a later one beside it, by any way."""
    for name, others in reached(states).items():
        here = dict(states[name].levels)
        for other in others:
            if any(block in here and here[block] < index for block, index in states[other].levels):
                return True
    return False


def groups_of(states: dict[str, State]) -> dict[tuple[object, ...], set[str]]:
    """The lags of each innermost level."""
    found: dict[tuple[object, ...], set[str]] = {}
    for state in states.values():
        found.setdefault(state.levels, set()).add(state.path)
    return found


def closes_circle(states: dict[str, State]) -> bool:
    """Whether groups depend on each other."""
    edges = {
        (states[r].levels, s.levels) for s in states.values() for r in s.reads if states[r].levels != s.levels
    }
    left = {s.levels for s in states.values()}
    while True:
        ready = {g for g in left if not any(b == g and a in left for a, b in edges)}
        if not ready:
            return bool(left)
        left -= ready


def outcome(text: str) -> tuple[list[str], Model | None]:
    try:
        model = model_of(text, experiment="World")
    except ModelError as error:
        return [problem.code for problem in error.problems], None
    return [], model


def text_of(plans: dict[str, Plan]) -> str:
    unbound = "experiment World of Top() {} agent Top() { agent w = World() [u := 0]; }"
    return LAG + " ".join(plan.text(name) for name, plan in plans.items()) + unbound


def expected_codes(states: dict[str, State]) -> set[str]:
    if breaks_order(states):
        return {"E601"}
    return {"E603"} if closes_circle(states) else set()


@pytest.mark.parametrize("seed", range(150))
def test_random_worlds(seed: int) -> None:
    plans = random_world(seed)
    states = states_of(plans)
    codes, model = outcome(text_of(plans))
    assert set(codes) == expected_codes(states)
    if model is None:
        return
    made = {frozenset(path.removeprefix("w.") for path in paths) for paths in groups(model).values()}
    assert made == {frozenset(names) for names in groups_of(states).values()}
    place = {path.removeprefix("w."): i for i, paths in enumerate(groups(model).values()) for path in paths}
    assert all(place[read] <= place[name] for name, state in states.items() for read in state.reads)


def test_the_worlds_are_of_all_kinds() -> None:
    kinds = [frozenset(expected_codes(states_of(random_world(seed)))) for seed in range(150)]
    assert kinds.count(frozenset()) >= 20
    assert kinds.count(frozenset({"E601"})) >= 20
    assert kinds.count(frozenset({"E603"})) >= 5
