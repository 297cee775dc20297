"""Views: what each file of a model sees.

In: the files of a model. Out: for each its own definitions, and a scope that also holds what it imports, under the names that it uses for it:
`Lag` after `from std.blocks import Lag;`, `blocks.Lag` after `import std.blocks as blocks;`. Guaranteed: no name is defined twice in a file, by
an import neither; what is imported by name is there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from hierc.compiler.collector import Collector
from hierc.compiler.imports.errors import NotInFile, UnusedImport
from hierc.compiler.imports.modules import Module, file_of, statements
from hierc.compiler.resolve.declarations import Library, declare
from hierc.grammar import tree

#: The parts of a library that can be imported.
KINDS = ("consts", "funcs", "agents", "tables", "externs")


@dataclass(frozen=True, slots=True)
class Imported:
    """A definition of another file; `spelled` is what this file calls it."""

    spelled: str
    module: str
    name: str


@dataclass(frozen=True, slots=True)
class View:
    """A file of the model: its own definitions, all that it sees, and where what it imports comes from."""

    module: Module
    own: Library
    scope: Library
    imported: tuple[Imported, ...]


def views(modules: tuple[Module, ...], elsewhere: Mapping[str, str], problems: Collector) -> tuple[View, ...]:
    """A view for each file. `elsewhere`: what could be imported, with its module, for advice."""
    libraries = {module.name: declare(module.file, problems) for module in modules}
    return tuple(_view(module, libraries, elsewhere, problems) for module in modules)


def warn_of_unused(view: View, problems: Collector) -> None:
    """A warning for each name that is imported and never used."""
    if not view.module.imports:
        return
    used = set(_used(view.module.file.items))
    for statement in statements(view.module.file):
        for name in statement.names if isinstance(statement, tree.FromImport) else ():
            if name.text not in used:
                problems.add(UnusedImport(name.span, name.text))
        if isinstance(statement, tree.Import):
            name = spelled_name(statement)
            if not any(text.startswith(f"{name.text}.") for text in used):
                problems.add(UnusedImport(name.span, name.text))


def spelled_name(statement: tree.Import) -> tree.Name:
    """What a file calls a module that it imports: `m` after `import a.b as m;`, else `a.b`."""
    return statement.alias or tree.Name(statement.module.span, statement.module.text)


def _view(
    module: Module, libraries: Mapping[str, Library], elsewhere: Mapping[str, str], problems: Collector
) -> View:
    own = libraries[module.name]
    imported: list[Imported] = []
    spelled_modules: set[str] = set()
    for statement in statements(module.file):
        target = module.imports[statement.module.text]
        names = definitions(libraries[target])
        match statement:
            case tree.Import():
                spelled = spelled_name(statement).text
                spelled_modules.add(spelled)
                imported += [Imported(f"{spelled}.{name}", target, name) for name in names]
            case tree.FromImport():
                chosen = [name for name in statement.names if _is_there(name, statement, names, problems)]
                imported += [Imported(name.text, target, name.text) for name in chosen]
    parts: dict[str, Any] = {kind: dict(getattr(own, kind)) for kind in KINDS}
    for one in imported:
        for kind in KINDS:
            found = getattr(libraries[one.module], kind).get(one.name)
            if found is not None:
                parts[kind].setdefault(one.spelled, found)
    scope = replace(own, **parts, modules=frozenset(spelled_modules), elsewhere=elsewhere)
    return View(module, own, scope, tuple(imported))


def definitions(library: Library) -> tuple[str, ...]:
    """The names of all that a library defines for others."""
    return tuple(name for kind in KINDS for name in getattr(library, kind))


def _is_there(
    name: tree.Name, statement: tree.FromImport, names: tuple[str, ...], problems: Collector
) -> bool:
    if name.text not in names:
        problems.add(NotInFile(name.span, name.text, file_of(statement.module.text), names))
    return name.text in names


def _used(items: tuple[tree.Item, ...]) -> Iterator[str]:
    """The texts of all paths in expressions, and of all names of agents."""
    stack: list[object] = list(items)
    while stack:
        node = stack.pop()
        match node:
            case tree.Import() | tree.FromImport():
                continue
            case tree.Path() | tree.Dotted():
                yield node.text
            case tuple():
                stack.extend(node)
                continue
        if isinstance(node, tree.Node):
            stack.extend(getattr(node, part.name) for part in fields(node) if part.name != "span")
