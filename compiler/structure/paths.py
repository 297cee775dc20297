"""Paths: what an experiment names, at any depth: agents, their parameters and states, variables for results, and elements of them.

In: a path as written, and what the model has. Out: what it means. Everything that the paths of an experiment may be is decided here. What cannot be
meant raises Rejected.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hierc.compiler.collector import Rejected
from hierc.compiler.model import Group, Node, Variable
from hierc.compiler.shapes.evaluate import Environment, selected
from hierc.compiler.shapes.values import Shape, element_names, type_text
from hierc.compiler.structure.errors import MatchesNothing, UnknownPath
from hierc.compiler.structure.instances import Instance
from hierc.compiler.suggest import without_level
from hierc.grammar import tree


@dataclass(frozen=True, slots=True)
class Named:
    """What a path names: `name` of an agent, and the subscripts written after it."""

    owner: Instance
    name: str
    subs: tuple[tree.Expr | tree.Range, ...]


def find(path: tree.Path, instances: Sequence[Instance]) -> Named:
    """The agent that the last name of a path belongs to. Raises Rejected (E910)."""
    at = instances[0]
    for place, step in enumerate(path.steps[:-1]):
        name = step.name.text
        if name not in at.children or step.subs:
            rest = ".".join(s.name.text for s in path.steps[:place] + path.steps[place + 1 :])
            level = rest if name in at.agent.levels else None
            known = tuple(at.children)
            raise Rejected(
                UnknownPath(step.span, what="agent", path=step.span.text, candidates=known, shorter=level)
            )
        at = instances[at.children[name]]
    last = path.steps[-1]
    return Named(at, last.name.text, last.subs)


def group_named(path: tree.Path, groups: Sequence[Group], nodes: Sequence[Node]) -> str:
    """The group of this name, or the one that all of an agent or level belongs to. Raises Rejected (E910)."""
    text = path.span.text
    known = tuple(group.name for group in groups)
    if text in known:
        return text
    found = tuple(group.name for group in groups if any(_is_in(nodes[n], text) for n in group.nodes))
    if len(found) != 1:
        shorter = without_level(text, known)
        raise Rejected(
            UnknownPath(path.span, what="group", path=text, candidates=known, shorter=shorter, several=found)
        )
    return found[0]


def _is_in(node: Node, path: str) -> bool:
    """Whether a node is the agent or level of this name, or in it."""
    return node.path == path or node.path.startswith(f"{path}.") or path in node.levels


def elements(
    subs: tuple[tree.Expr | tree.Range, ...], name: str, shape: Shape, node: tree.Node, env: Environment
) -> tuple[Shape, Sequence[int]]:
    """The shape and the places of the scalars that subscripts choose from a variable; all of them where there are none."""
    if not subs:
        return shape, range(len(element_names(name, shape)))
    return selected(name, type_text("real", shape), shape, subs, node, env)


def recorded(pattern: tree.Pattern, variables: Mapping[str, Variable], env: Environment) -> list[str]:
    """The names for results that a pattern of `record` matches, elements by their subscripts. Raises Rejected (E904, E303)."""
    last = pattern.path.steps[-1]
    plain = all(not step.subs for step in pattern.path.steps[:-1])
    path = ".".join(step.name.text for step in pattern.path.steps)
    if pattern.star:
        return _inside(pattern, path, variables) if plain and not last.subs else _nothing(pattern, variables)
    variable = variables.get(path)
    if variable is None or not plain:
        return _nothing(pattern, variables)
    if not last.subs:
        return [path]
    _, places = elements(last.subs, path, variable.shape, pattern.path, env)
    names = element_names(path, variable.shape)
    return [names[place] for place in places]


def _inside(pattern: tree.Pattern, path: str, variables: Mapping[str, Variable]) -> list[str]:
    """All `write` variables in an agent, at any depth."""
    written = [v.path for v in variables.values() if v.access == "write"]
    found = [name for name in written if name.startswith(f"{path}.")]
    if not found:
        owners = dict.fromkeys(name.rpartition(".")[0] for name in written)
        raise Rejected(_no_match(pattern, [f"{owner}.*" for owner in owners if owner]))
    return found


def _nothing(pattern: tree.Pattern, variables: Mapping[str, Variable]) -> list[str]:
    raise Rejected(_no_match(pattern, list(variables)))


def _no_match(pattern: tree.Pattern, candidates: Sequence[str]) -> MatchesNothing:
    text = f"{pattern.path.span.text}.*" if pattern.star else pattern.path.span.text
    shorter = without_level(text, candidates)
    return MatchesNothing(pattern.span, pattern=text, candidates=tuple(candidates), shorter=shorter)
