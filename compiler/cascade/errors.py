"""Problems with levels, groups and their order (E6xx)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from hierc.compiler.suggest import abbreviated
from hierc.grammar.problems import Label, Problem
from hierc.grammar.source import Span

LEVELS_NOTE = "levels run slowest first; a level may read itself and the levels above it"


@dataclass(frozen=True)
class BrokenCascade(Problem):
    """A level reads a later one in a continuous equation."""

    code = "E601"
    explanation = (
        "Levels are written slowest first, and the order is a promise: none depends continuously on a later one. That is what lets every "
        "level run at its own step size. Two subsystems that need each other continuously, as a controller and its plant do, belong into one "
        "level, above what only carries out what they ask for. A planner above them hands down a reference and its rate, `goal := plan.p, "
        "goal_rate := plan.p'`, and need not know what becomes of it."
    )
    reader: str | None  # the agent that reads; None for a level with equations of its own
    reader_level: str
    source: str
    source_level: str
    read: str | None  # the read variable of the coupling
    agents: bool  # whether both sides are agents
    through: tuple[str, ...] = ()  # agents outside by way of which the later level is read
    back: Span | None = None  # where the last of them reads it
    observer: bool = False  # whether the reader is an observer of the level

    def title(self) -> str:
        reader = (
            f"`{self.reader}` (level `{self.reader_level}`)"
            if self.reader
            else f"level `{self.reader_level}`"
        )
        if self.through:
            way = " and ".join(f"`{name}`" for name in self.through)
            return f"{reader} reads `{self.source}`, which depends on the later level `{self.source_level}` through {way}"
        return f"{reader} reads `{self.source}`, which belongs to the later level `{self.source_level}`"

    def remark(self) -> str:
        if self.read is None:
            return "used in a continuous equation"
        return f"`{self.read}` is used in a continuous equation of `{self.reader or self.reader_level}`"

    def labels(self) -> tuple[Label, ...]:
        if self.back is None:
            return ()
        return (Label(self.back, f"`{self.through[-1]}` reads level `{self.source_level}` here"),)

    def notes(self) -> tuple[str, ...]:
        return (LEVELS_NOTE,)

    def help(self) -> tuple[str, ...]:
        if self.observer:
            return (f"move the observer out of level `{self.reader_level}`",)
        one_level = f"move both {'agents' if self.agents else 'parts'} into one level"
        if self.read is None:
            return (one_level,)
        return (f"{one_level}, or read `{self.read}` only inside a `sample` block (not supported yet)",)


@dataclass(frozen=True)
class LaterDerivative(Problem):
    code = "E606"
    explanation = "`x'` in a coupling is the right-hand side of `x`, known only where `x` is computed: in an earlier level, or in the same one."
    read: str  # the read variable of the coupling
    text: str  # `plan.p'`
    level: str
    owner: str

    def title(self) -> str:
        return f"`{self.read} := {self.text}`: in level `{self.level}`, but `{self.owner}` comes later"

    def notes(self) -> tuple[str, ...]:
        return (LEVELS_NOTE,)


@dataclass(frozen=True)
class CyclicGroups(Problem):
    code = "E603"
    explanation = (
        "Groups are integrated one after the other, each at its own step size, so they cannot depend on each other. Put what does into one "
        "group."
    )
    groups: tuple[str, ...]
    reads: tuple[tuple[str, Span], ...]  # what each group reads of the next, and where
    several: str | None  # one of the groups that has several agents

    def title(self) -> str:
        names = [f"`{name}`" for name in self.groups]
        reads = [f"{name} reads `{text}`" for name, (text, _) in zip(names, self.reads, strict=True)]
        shown = abbreviated(names)
        return f"groups {', '.join(shown[:-1])} and {shown[-1]} depend on each other ({', '.join(abbreviated(reads))})"

    def labels(self) -> tuple[Label, ...]:
        by_place = {
            span: f"`{name}` reads `{text}`"
            for name, (text, span) in reversed(list(zip(self.groups, self.reads, strict=True)))
        }
        return tuple(Label(span, text) for span, text in reversed(by_place.items()) if span != self.span)

    def help(self) -> tuple[str, ...]:
        one_group = (
            "put them into one group, or read one direction only inside a `sample` block (not supported yet)"
        )
        if self.several is None:
            return (one_group,)
        return (
            one_group,
            f"or take agents out of `{self.several}` into a group of their own: `group g = …;`",
        )


@dataclass(frozen=True)
class InTwoGroups(Problem):
    code = "E604"
    explanation = "Every agent of a level belongs to exactly one group."
    name: str
    first: str
    second: str
    first_span: Span

    def title(self) -> str:
        return f"`{self.name}` is in two groups, `{self.first}` and `{self.second}`"

    def labels(self) -> tuple[Label, ...]:
        return (Label(self.first_span, f"in group `{self.first}` here"),)


@dataclass(frozen=True)
class OutsideLevels(Problem):
    code = "E605"
    explanation = (
        "An agent with levels keeps its sub-agents, states and `diff` blocks in them, so that it is clear where each stands; so does a level "
        "with levels inside. Only algebraic variables may stand beside levels, as observers."
    )
    agent: str
    level: str | None  # the level that has levels; None for the agent itself
    what: str  # `a `diff` of its own`, `a state of its own`, `an agent`

    def title(self) -> str:
        subject = f"agent `{self.agent}`" if self.level is None else f"level `{self.level}`"
        return f"{subject} has levels, so it cannot have {self.what} outside them"

    def help(self) -> tuple[str, ...]:
        inner = "" if self.level is None else f" of `{self.level}`"
        return (f"move it into a level{inner}, or into an agent in a level",)


@dataclass(frozen=True)
class TwoLevels(Problem):
    code = "E607"
    explanation = "A variable is declared and defined in one level."
    name: str
    declared: str
    defined: str
    declared_span: Span

    def title(self) -> str:
        return f"`{self.name}` is declared in {self.declared} and defined in {self.defined}"

    def labels(self) -> tuple[Label, ...]:
        return (Label(self.declared_span, "declared here"),)


@dataclass(frozen=True)
class NoSuchMember(Problem):
    code = "E609"
    explanation = (
        "`group g = a, b.*;` names agents of one level of the agent it stands in: `a` itself, or all agents inside `b`. An agent that has "
        "levels is not split or joined by `group`: its levels are its groups."
    )
    pattern: str
    reason: str

    def title(self) -> str:
        return f"`{self.pattern}` cannot be a member of this group: {self.reason}"


@dataclass(frozen=True)
class NameTaken(Problem):
    """A group that `group` makes, and one that is there without it, have one name."""

    code = "E602"
    explanation = (
        "Settings, results and `hierc graph` tell groups by name. What `group` leaves of a level keeps the level's name, and an agent that makes a "
        "group on its own has its path for a name."
    )
    name: str
    kind: Literal["level", "agent"]
    rest: str  # an agent of the other group

    def title(self) -> str:
        return f"`{self.name}` is the name of another group too"

    def notes(self) -> tuple[str, ...]:
        if self.kind == "agent":
            return (f"agent `{self.rest}` makes a group of that name",)
        return (f"level `{self.name}` is a group with what no `group` names: `{self.rest}`",)

    def help(self) -> tuple[str, ...]:
        return ("rename one of them",)


@dataclass(frozen=True)
class LevelWithoutStates(Problem):
    code = "W611"
    severity: ClassVar[Literal["error", "warning"]] = "warning"
    explanation = (
        "What has no state is no group: it is computed by the groups that read it, at their step sizes, so it may as well be written in the first "
        "level that reads it."
    )
    level: str
    reader: str | None

    def title(self) -> str:
        end = f"it will be merged with `{self.reader}`" if self.reader else "it is computed for results only"
        return f"level `{self.level}` has no states; {end}"


@dataclass(frozen=True)
class LargeGroup(Problem):
    code = "W613"
    severity: ClassVar[Literal["error", "warning"]] = "warning"
    explanation = (
        "A level is one group, integrated at the pace of its fastest agent. Where the agents of an array do not need each other in a circle, each can be a "
        "group with its own step size."
    )
    level: str
    count: int
    array: str

    def title(self) -> str:
        return f"level `{self.level}` holds {self.count} agents without a loop in one group"

    def help(self) -> tuple[str, ...]:
        return (f"give each its own step size: `group each {self.array};`",)
