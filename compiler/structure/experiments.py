"""Experiments: which agent runs, what it is given, and how it is run and recorded.

`choose` is a phase before the instances are made: it picks the agent. `resolve_gifts` finds the parameters and states that the experiment's arguments and
`init` name; `resolve_experiment`, at the end, settles settings, group settings and records against the finished model.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from math import isfinite
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any, assert_never

from hierc.compiler import unsupported
from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.model import Experiment, Group, Node, Settings, Variable
from hierc.compiler.resolve.declarations import Agent, Library
from hierc.compiler.resolve.errors import GivenTwice, UnknownParameter
from hierc.compiler.resolve.names import check_arguments, check_bindings
from hierc.compiler.shapes.environment import Environment
from hierc.compiler.shapes.evaluate import evaluate
from hierc.compiler.shapes.folding import constant
from hierc.compiler.structure.errors import (
    CannotSave,
    NoChoice,
    UnknownExperiment,
    UnknownPath,
    UnknownSetting,
    WrongValue,
)
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.paths import Gift, Sub, check_gift, find, group_named, recorded
from hierc.grammar import tree
from hierc.grammar.problems import ModelError
from hierc.grammar.source import Span

#: Settings that a group may have of its own.
GROUP_SETTINGS = ("rtol", "atol", "max_step", "min_step", "method")
#: Files that results can be saved to.
ENDINGS = (".csv", ".npz")
#: Settings of the language that have no effect yet.
LATER_SETTINGS = ("order", "on_violation")


@dataclass(frozen=True, slots=True)
class Choice:
    """The agent that runs, and the experiment that says how."""

    agent: Agent
    experiment: tree.Experiment | None


def choose(library: Library, name: str | None, problems: Collector) -> Choice:
    """The experiment or agent named; else the only experiment; else, without experiments, the only agent that no other contains.

    Raises ModelError.
    """
    tops = _top_agents(library)
    experiment: tree.Experiment | None = None
    agent: Agent | None = None
    if name is not None and name in library.experiments:
        experiment = library.experiments[name]
    elif name is not None and name in library.own_agents():
        agent = library.agents[name]
    elif name is not None:
        raise ModelError(
            [UnknownExperiment(None, name=name, candidates=(*library.experiments, *library.own_agents()))]
        )
    elif len(library.experiments) == 1:
        (experiment,) = library.experiments.values()
    elif len(tops) == 1 and not library.experiments:
        agent = library.agents[tops[0]]
    else:
        raise ModelError([NoChoice(None, experiments=tuple(library.experiments), agents=tuple(tops))])
    if experiment is not None:
        agent = library.agents[experiment.agent.text]
    assert agent is not None
    _check_given(agent, experiment, problems)
    return Choice(agent, experiment)


def runnable_agents(library: Library) -> list[str]:
    """The only agent that no other contains: it is what runs. Of several, those that need neither arguments nor couplings."""
    tops = _top_agents(library)
    if len(tops) == 1:
        return tops
    agents = [library.agents[name] for name in tops]
    return [
        agent.name
        for agent in agents
        if not agent.reads() and all(p.default is not None for p in agent.params.values())
    ]


def _top_agents(library: Library) -> list[str]:
    """Agents of the main file that no other contains."""
    contained = {sub.instance.agent.text for agent in library.agents.values() for sub in agent.subs.values()}
    return [name for name in library.own_agents() if name not in contained]


def _check_given(agent: Agent, experiment: tree.Experiment | None, problems: Collector) -> None:
    """The top agent's parameters and reads all have values."""
    if experiment is None:
        check_arguments(agent, (), agent.definition.name.span, problems, alone=True)
        check_bindings(agent, (), agent.definition.name, problems, top=True)
        return
    own = tuple(
        tree.Arg(a.span, a.path.steps[0].name, a.value) for a in experiment.args if len(a.path.steps) == 1
    )
    check_arguments(agent, own, experiment.agent.span, problems)
    check_bindings(agent, experiment.bindings, experiment.name, problems, top=True)


# ---- arguments and initial values -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Gifts:
    """What an experiment gives, by agent of the outline and name; of elements of one state or array there may be several."""

    arguments: Mapping[tuple[int, str], tuple[Gift, ...]]
    initials: Mapping[tuple[int, str], tuple[Gift, ...]]


def resolve_gifts(
    library: Library, experiment: tree.Experiment | None, outline: Sequence[Instance], problems: Collector
) -> Gifts:
    """Find what the arguments and `init` values of an experiment name."""
    if experiment is None:
        return Gifts({}, {})
    arguments: dict[tuple[int, str], list[Gift]] = {}
    initials: dict[tuple[int, str], list[Gift]] = {}
    for arg in experiment.args:
        try:
            key, elements = _parameter(arg.path, outline)
        except Rejected as rejection:
            problems.rejected(rejection)
            continue
        first = next(
            (gift for gift in arguments.get(key, ()) if gift.whole and all(e is None for e in elements)), None
        )
        if first is not None:
            problems.add(GivenTwice(arg.path.span, name=arg.path.text, first=first.path.span))
        arguments.setdefault(key, []).append(Gift(arg.path, arg.value, elements))
    for initial in _initials(experiment):
        try:
            key, elements = _state(initial.path, outline)
        except Rejected as rejection:
            problems.rejected(rejection)
            continue
        initials.setdefault(key, []).append(Gift(initial.path, initial.value, elements))
    return Gifts(
        {key: tuple(given) for key, given in arguments.items()},
        {key: tuple(given) for key, given in initials.items()},
    )


def check_gifts(gifts: Gifts, agents: Sequence[Instance], env: Environment, problems: Collector) -> None:
    """Whether there are all elements of arrays that gifts are for. `agents`: the blocks of all arrays; `env` is the scope of the experiment."""
    blocks: dict[int, list[Instance]] = {}
    for agent in agents:
        blocks.setdefault(agent.outline, []).append(agent)
    for (outline, _), given in (*gifts.arguments.items(), *gifts.initials.items()):
        for gift in given:
            try:
                check_gift(gift, blocks[outline], env)
            except Rejected as rejection:
                problems.rejected(rejection)


Target = tuple[tuple[int, str], tuple[Sub | None, ...]]


def _parameter(path: tree.Path, outline: Sequence[Instance]) -> Target:
    """The parameter that a path names, by agent and name, and the elements of arrays. Raises Rejected."""
    named = find(path, outline)
    agent = named.owner.agent
    if named.name not in agent.params:
        known = tuple(agent.params)
        raise Rejected(UnknownParameter(path.span, agent=agent.name, name=named.name, candidates=known))
    if named.subs:
        advice = f"give all of it: `{path.text} = …`"
        raise Rejected(
            UnknownParameter(path.span, agent=agent.name, name=path.span.text, candidates=(), advice=advice)
        )
    return (named.owner.id, named.name), named.elements


def _state(path: tree.Path, outline: Sequence[Instance]) -> Target:
    """The state that a path names, or of which it names elements, by agent and name, and the elements of arrays. Raises Rejected."""
    named = find(path, outline)
    states = [v.name for v in named.owner.agent.variables.values() if v.declarator.initial is not None]
    if named.name not in states:
        owner = path.span.text[: path.steps[-1].span.start - path.span.start]
        candidates = tuple(f"{owner}{state}" for state in states)
        raise Rejected(UnknownPath(path.span, what="state", path=path.span.text, candidates=candidates))
    return (named.owner.id, named.name), named.elements


def _initials(experiment: tree.Experiment) -> Iterator[tree.Initial]:
    for item in experiment.items:
        if isinstance(item, tree.InitBlock):
            yield from item.values


# ---- settings and records -------------------------------------------------------------------------------------------------------------


def resolve_experiment(
    experiment: tree.Experiment | None,
    env: Environment,
    nodes: Sequence[Node],
    groups: Sequence[Group],
    variables: Sequence[Variable],
    problems: Collector,
) -> Experiment:
    """What the experiment says, against the finished model. `env` is the scope of the experiment."""
    if experiment is None:
        return Experiment(None, Settings(), (), (), ())
    resolver = _Resolver(env, nodes, groups, variables, problems)
    for item in experiment.items:
        resolver.item(item)
    resolver.finish()
    settings = Settings(**resolver.settings)
    group_settings = tuple((name, Settings(**values)) for name, values in resolver.groups.items())
    return Experiment(
        experiment.name.text,
        settings,
        group_settings,
        tuple(dict.fromkeys(resolver.record)),
        tuple(resolver.save),
    )


_STRING = re.compile(r'"(?:\\.|[^"\\\n])*"')


def _is_outside(file: str) -> bool:
    """Whether a file name leads out of the folder it is in, on any system."""
    depth = 0
    for part in PureWindowsPath(file).parts:
        depth += -1 if part == ".." else 1
        if depth < 0:
            return True
    return file.startswith("/") or bool(PureWindowsPath(file).anchor)


class _Resolver:
    """Reads the items of an experiment one by one."""

    def __init__(
        self,
        env: Environment,
        nodes: Sequence[Node],
        groups: Sequence[Group],
        variables: Sequence[Variable],
        problems: Collector,
    ) -> None:
        self._env = env
        self._nodes = nodes
        self._groups = groups
        self._variables = variables
        self._problems = problems
        self.settings: dict[str, Any] = {}
        self.groups: dict[str, dict[str, Any]] = {}
        self.record: list[str] = []
        self.save: list[str] = []
        self._stop: Span | None = None

    def item(self, item: tree.ExpItem) -> None:
        match item:
            case tree.Setting():
                self._setting(item, self.settings, tuple(f.name for f in fields(Settings)))
            case tree.GroupSettings():
                self._group(item)
            case tree.Record(patterns=patterns):
                for pattern in patterns:
                    try:
                        self.record += recorded(pattern, self._variables, self._env)
                    except Rejected as rejection:
                        self._problems.rejected(rejection)
            case tree.Save():
                self._save(item)
            case tree.InitBlock():
                pass  # in the initial values already
            case _ as never:
                assert_never(never)

    def _setting(self, setting: tree.Setting, into: dict[str, Any], known: tuple[str, ...]) -> None:
        name = setting.name.text
        if name in LATER_SETTINGS:
            self._problems.add(unsupported.Function(setting.name.span, use=f"the setting `{name}`"))
        elif name not in known:
            self._problems.add(UnknownSetting(setting.name.span, name=name, candidates=known))
        elif name in into:
            self._problems.add(GivenTwice(setting.name.span, name=name, first=setting.name.span))
        elif name == "method":
            into[name] = self._method(setting)
        else:
            into[name] = self._number(setting)
            self._stop = setting.value.span if name == "stop" else self._stop

    def _method(self, setting: tree.Setting) -> str | None:
        value = setting.value
        if isinstance(value, tree.Ref) and not value.prime and len(value.path.steps) == 1:
            return value.path.text
        self._problems.add(
            WrongValue(value.span, name="method", wanted="a name", given=f"`{value.span.text}`")
        )
        return None

    def _number(self, setting: tree.Setting) -> float | None:
        name, node = setting.name.text, setting.value
        try:
            value = evaluate(node, self._env)
        except Rejected as rejection:
            self._problems.rejected(rejection)
            return None
        known = constant(value.single) if value.shape == () and value.scalar != "bool" else None
        if known is None or not isfinite(known) or (name not in ("start", "stop") and known <= 0):
            wanted = "a finite number" if name in ("start", "stop") else "a positive finite number"
            self._problems.add(WrongValue(node.span, name=name, wanted=wanted, given=f"`{node.span.text}`"))
        return known

    def finish(self) -> None:
        """Check what several settings say together."""
        start, stop = self.settings.get("start", 0.0), self.settings.get("stop")
        if self._stop is not None and start is not None and stop is not None and stop <= start:
            wanted = f"a time after the start, {start:g} s"
            self._problems.add(
                WrongValue(self._stop, name="stop", wanted=wanted, given=f"`{self._stop.text}`")
            )

    def _save(self, item: tree.Save) -> None:
        places = _STRING.finditer(item.span.text)
        for file, place in zip(item.files, places, strict=True):
            outside = _is_outside(file)
            if outside or PurePosixPath(file).suffix not in ENDINGS:
                start = item.span.start
                span = Span(item.span.file, start + place.start(), start + place.end())
                self._problems.add(CannotSave(span, file=file, endings=ENDINGS, outside=outside))
        self.save.extend(item.files)

    def _group(self, item: tree.GroupSettings) -> None:
        try:
            name = group_named(item.path, self._groups, self._nodes, self._env)
        except Rejected as rejection:
            self._problems.rejected(rejection)
            return
        for setting in item.settings:
            self._setting(setting, self.groups.setdefault(name, {}), GROUP_SETTINGS)
