"""Orders and cycles of names: constants after those they use, functions and agents without end, `let`s of parameters alone.

Part of the phase `names.py`. All of it looks at the text only, never at values.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise

from hierc.compiler.collector import Collector
from hierc.compiler.equations.errors import AlgebraicLoop, LoopStep
from hierc.compiler.resolve.declarations import Agent, Library
from hierc.compiler.resolve.errors import RecursiveDefinition
from hierc.compiler.walk import visit
from hierc.grammar import tree


def references(expr: tree.Expr) -> list[tree.Ref]:
    """References in an expression, but to index names that it binds itself."""
    return [
        v.node
        for v in visit(expr)
        if isinstance(v.node, tree.Ref) and v.node.path.steps[0].name.text not in v.bound
    ]


def ordered(uses: Mapping[str, Iterable[str]]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names with each after those it uses, and a closed path if there is one (then the order is empty)."""
    graph = {name: [u for u in used if u in uses] for name, used in uses.items()}
    try:
        return tuple(TopologicalSorter(graph).static_order()), ()
    except CycleError as error:
        cycle: list[str] = error.args[1]
        return (), tuple(reversed(cycle))


def order_of_consts(consts: Mapping[str, tree.Const], problems: Collector) -> tuple[str, ...]:
    """Constants, each after those it uses; E208 for one that needs itself."""
    uses = {
        name: [ref.path.text for expr in (const.value, *const.type.sizes) for ref in references(expr)]
        for name, const in consts.items()
    }
    order, cycle = ordered(uses)
    if cycle:
        problems.add(RecursiveDefinition(consts[cycle[0]].name.span, kind="const", cycle=cycle))
    return order


def order_of_lets(agent: Agent, problems: Collector) -> tuple[str, ...]:
    """The `let`s of an agent, each after those it uses; E506 for one that needs itself."""
    found = {name: references(let.let.value) for name, let in agent.lets.items()}
    order, cycle = ordered({name: [ref.path.text for ref in refs] for name, refs in found.items()})
    if cycle:
        steps = []
        for name, used in pairwise(cycle):
            place = next(ref.span for ref in found[name] if ref.path.text == used)
            steps.append(LoopStep(name, used, place))
        problems.add(AlgebraicLoop(steps[0].span, steps=tuple(steps)))
    return order


def check_containment(library: Library, problems: Collector) -> None:
    """No agent contains itself."""
    uses = {
        name: [sub.instance.agent.text for sub in agent.subs.values()]
        for name, agent in library.agents.items()
    }
    _, cycle = ordered(uses)
    if cycle:
        inner = next(s for s in library.agents[cycle[0]].subs.values() if s.instance.agent.text == cycle[1])
        problems.add(RecursiveDefinition(inner.instance.agent.span, kind="agent", cycle=cycle))


def check_calls_end(library: Library, problems: Collector) -> None:
    """No function calls itself."""
    calls = {
        name: [v.node for v in visit(func.body) if isinstance(v.node, tree.Call)]
        for name, func in library.funcs.items()
    }
    _, cycle = ordered({name: [call.function.text for call in made] for name, made in calls.items()})
    if cycle:
        call = next(c for c in calls[cycle[0]] if c.function.text == cycle[1])
        problems.add(RecursiveDefinition(call.function.span, kind="func", cycle=cycle))


def parameter_lets(agent: Agent, consts: Iterable[str]) -> frozenset[str]:
    """`let`s made of parameters and constants only: they may stand in arguments and sizes."""
    fixed = (
        {*agent.params, *agent.consts, *consts, "pi"}
        - agent.variables.keys()
        - agent.subs.keys()
        - agent.lets.keys()
    )
    found: set[str] = set()
    order, _ = ordered(
        {name: [ref.path.text for ref in references(let.let.value)] for name, let in agent.lets.items()}
    )
    for name in order:
        value = agent.lets[name].let.value
        if any(isinstance(v.node, tree.Time) for v in visit(value)):
            continue
        if all(ref.path.text in fixed or ref.path.text in found for ref in references(value)):
            found.add(name)
    return frozenset(found)
