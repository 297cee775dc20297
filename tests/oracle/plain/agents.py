"""The agents of a running model, for the interpreter: what each declares, what is in it, and what defines each element of its variables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

from hierc.grammar import tree
from plain.functions import Value

if TYPE_CHECKING:
    from plain.interpreter import Interpreter

Index = tuple[int, ...]
Shape = tuple[int, ...]


def items_of(agent: tree.Agent | tree.Level) -> Iterator[tree.AgentItem]:
    """All items of an agent; levels open no scope."""
    for item in agent.items:
        if isinstance(item, tree.Level):
            yield from items_of(item)
        else:
            yield item


@dataclass(frozen=True)
class Scope:
    """Where an expression stands: in an agent or in none, with names bound by indices and function calls."""

    agent: Agent | None = None
    bound: Mapping[str, Value] = field(default_factory=dict)

    def bind(self, name: str, value: Value) -> Scope:
        return replace(self, bound={**self.bound, name: value})


@dataclass(frozen=True)
class Equation:
    """What defines one element of a variable: element `at` of an expression."""

    value: tree.Expr
    scope: Scope
    at: Index


class Agent:
    """An agent of the running model. `place` is its name, with its number if it is one of an array."""

    def __init__(
        self,
        model: Interpreter,
        definition: tree.Agent,
        parent: Agent | None,
        instance: tree.Instance | None,
        index: int | None,
    ) -> None:
        self.model, self.definition, self.parent, self.instance, self.index = (
            model,
            definition,
            parent,
            instance,
            index,
        )
        #: The scope of the instance's arguments and couplings; the experiment's sees the parameters of the agent that runs.
        self.around = Scope(self if parent is None else parent)
        if instance is not None and instance.index is not None and index is not None:
            self.around = self.around.bind(instance.index.index.text, index)
        items = list(items_of(definition))
        self.consts = {c.name.text: c for c in items if isinstance(c, tree.Const)}
        self.lets = {i.name.text: i for i in items if isinstance(i, tree.Let)}
        self.params = {p.name.text: p for p in definition.params}
        self.variables = {
            d.name.text: (i, d) for i in items if isinstance(i, tree.Decl) for d in i.declarators
        }
        self.blocks = [i for i in items if isinstance(i, tree.Diff | tree.Alge)]
        self._instances = [i for i in items if isinstance(i, tree.Instance)]

    @property
    def steps(self) -> tuple[tuple[str, int | None], ...]:
        """The way to this agent from the top."""
        if self.parent is None or self.instance is None:
            return ()
        return (*self.parent.steps, (self.instance.name.text, self.index))

    def named(self, name: str) -> str:
        """The path of something in this agent."""
        places = [n if k is None else f"{n}[{k}]" for n, k in self.steps]
        return ".".join([*places, name])

    @cached_property
    def children(self) -> Mapping[str, Agent | list[Agent]]:
        """Sub-agents; those of an array in a list."""
        made: dict[str, Agent | list[Agent]] = {}
        for instance in self._instances:
            definition = self.model.agents[instance.agent.text]
            if instance.index is None:
                made[instance.name.text] = Agent(self.model, definition, self, instance, None)
            else:
                numbers = self.model.numbers(instance.index.range, Scope(self))
                made[instance.name.text] = [Agent(self.model, definition, self, instance, k) for k in numbers]
        return made

    def inside(self) -> Iterator[Agent]:
        """This agent and all in it."""
        yield self
        for child in self.children.values():
            for one in child if isinstance(child, list) else [child]:
                yield from one.inside()

    def shape(self, name: str) -> Shape:
        """The shape of a variable."""
        return self.model.sizes(self.variables[name][0].type, Scope(self))

    def is_state(self, name: str) -> bool:
        return self.variables[name][1].initial is not None

    @cached_property
    def equations(self) -> Mapping[tuple[str, str, Index], Equation]:
        """The equation of each element, by kind (`diff` or `alge`), name and element."""
        found: dict[tuple[str, str, Index], Equation] = {}
        for block in self.blocks:
            kind = "diff" if isinstance(block, tree.Diff) else "alge"
            for equation, scope in self._spelled_out(block):
                target = equation.target
                for at, place in self.model.selected(self.shape(target.name.text), target.subs, scope):
                    assert (
                        found.setdefault(
                            (kind, target.name.text, place), Equation(equation.value, scope, at)
                        ).at
                        == at
                    )
        return found

    def _spelled_out(self, block: tree.Diff | tree.Alge) -> Iterator[tuple[tree.Equation, Scope]]:
        for item in block.equations:
            if isinstance(item, tree.Equation):
                yield item, Scope(self)
            else:
                for k in self.model.numbers(item.over.range, Scope(self)):
                    for equation in item.equations:
                        yield equation, Scope(self).bind(item.over.index.text, k)
