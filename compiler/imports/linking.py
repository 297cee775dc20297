"""Linking: one library of all files, in which every name means one thing.

In: the files of a model, each with what it sees; all names in them are right. Out: a `Library` that the later phases take for that of one file.
What an imported file defines is called by its module and its own name, `std.blocks.Lag`, wherever it is used. What the main file defines keeps
its name; a constant or function for which an imported file has the same word, in a meaning of its own, becomes `main.k`. Spans stay those of the
user's text.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from itertools import count
from typing import Any, TypeVar

from hierc.compiler.collector import Collector
from hierc.compiler.imports.views import View, definitions
from hierc.compiler.resolve.declarations import Agent, Library, declare
from hierc.compiler.resolve.names import is_own
from hierc.grammar import tree

T = TypeVar("T")

NOTHING: frozenset[str] = frozenset()


def link(files: tuple[View, ...]) -> Library:
    """One library of all files, of which the main one is the last."""
    *others, main = files
    if not others:
        return main.own
    words: set[str] = set()
    items: list[tree.Item] = []
    for view in others:
        own = {name: f"{view.module.name}.{name}" for name in definitions(view.own)}
        items += _renamed(view, own, words)
    prefix = _unused({view.module.name for view in others})
    taken = words.intersection(definitions(main.own)) - main.own.agents.keys()
    items += _renamed(main, {name: f"{prefix}.{name}" for name in taken}, set())
    merged = declare(replace(main.own.file, items=tuple(items)), Collector())
    sources = tuple(view.own.file.source for view in reversed(files))
    return replace(merged, sources=sources)


def _unused(names: set[str]) -> str:
    """A name for the main file's module that no other has."""
    candidates = (f"main{k}" if k else "main" for k in count())
    return next(name for name in candidates if name not in names)


def _renamed(view: View, own: Mapping[str, str], words: set[str]) -> list[tree.Item]:
    """The definitions of a file, with names of its own as in `own`. All words that keep their meaning are added to `words`."""
    imported = {one.spelled: f"{one.module}.{one.name}" for one in view.imported}
    renaming = _Renaming({**imported, **own}, words)
    found: list[tree.Item] = []
    for item in view.module.file.items:
        match item:
            case tree.Import() | tree.FromImport():
                pass
            case tree.Experiment():
                if not view.module.name:
                    found.append(_experiment(item, renaming, view.scope.agents))
            case _:
                new = renaming.node(item, _hidden(item, view.own.agents))
                name = own.get(item.name.text, item.name.text)
                found.append(replace(new, name=tree.Name(item.name.span, name)))
    return found


def _experiment(item: tree.Experiment, renaming: _Renaming, agents: Mapping[str, Agent]) -> tree.Experiment:
    """An experiment: the names of its agent come first, but not in what it gives to that agent's own parameters."""
    inside = frozenset(agents[item.agent.text].names())
    args = tuple(renaming.node(arg, NOTHING if is_own(arg) else inside) for arg in item.args)
    return replace(renaming.node(item, inside), args=args)


def _hidden(item: tree.Item, agents: Mapping[str, Agent]) -> frozenset[str]:
    """The names that mean something else inside a definition."""
    match item:
        case tree.Agent(name=name):
            agent = agents[name.text]
            return frozenset(agent.names())
        case tree.Func(params=params) | tree.Extern(params=params) | tree.Table(params=params):
            return frozenset(param.name.text for param in params)
        case _:
            return NOTHING


@dataclass(frozen=True, slots=True)
class _Renaming:
    """Renames what `names` says in parts of a tree. Nesting is limited before, but for chains of operators, which are walked along."""

    names: Mapping[str, str]
    words: set[str]

    def node(self, node: T, hidden: frozenset[str]) -> T:
        """`node` with its names replaced, where they are not `hidden`."""
        return self._node(node, hidden)  # type: ignore[no-any-return]

    def _node(self, node: Any, hidden: frozenset[str]) -> Any:
        match node:
            case tuple():
                return tuple([self._node(part, hidden) for part in node])
            case tree.Ref(path=path) if path.steps[0].name.text not in hidden and path.text in self.names:
                return replace(node, path=self._path(path, hidden))
            case tree.Call(function=path, args=args) if path.text in self.names:
                return replace(node, function=self._path(path, hidden), args=self._node(args, hidden))
            case tree.Instance() | tree.Experiment():
                return self._parts(node, hidden, agent=self._agent(node.agent))
            case tree.Setting(name=tree.Name(text="method")):
                return node  # its value is a word of its own
            case tree.Binary():
                return self._chain(node, hidden)
            case tree.Name(text=text):
                self.words.add(text)
                return node
            case tree.Node():
                return self._parts(node, hidden)
            case _:
                return node

    def _parts(self, node: tree.Node, hidden: frozenset[str], **new: Any) -> Any:
        """`node` with all its parts renamed but `span` and those that are `new`. An index is hidden beside its range, not in it."""
        old = {
            part.name: getattr(node, part.name)
            for part in fields(node)
            if part.name != "span" and part.name not in new
        }
        indices = {value.index.text for value in old.values() if isinstance(value, tree.Over)}
        inner = hidden | indices if indices else hidden
        for name, value in old.items():
            new[name] = self._node(value, hidden if isinstance(value, tree.Over) else inner)
        return replace(node, **new)

    def _path(self, path: tree.Path, hidden: frozenset[str]) -> tree.Path:
        """A path that names a definition: one step, with the subscripts of the last."""
        name = tree.Name(path.span, self.names[path.text])
        return tree.Path(path.span, (tree.Step(path.span, name, self._node(path.steps[-1].subs, hidden)),))

    def _agent(self, dotted: tree.Dotted) -> tree.Dotted:
        name = self.names.get(dotted.text)
        return dotted if name is None else tree.Dotted(dotted.span, (tree.Name(dotted.span, name),))

    def _chain(self, node: tree.Binary, hidden: frozenset[str]) -> tree.Expr:
        chain: list[tree.Binary] = []
        first: tree.Expr = node
        while isinstance(first, tree.Binary):
            chain.append(first)
            first = first.left
        result: tree.Expr = self._node(first, hidden)
        for link_ in reversed(chain):
            result = replace(link_, left=result, right=self._node(link_.right, hidden))
        return result
