"""Modules: the files that a model is made of.

In: the tree of the main file, and a `Reader` that knows where files are. Out: a `Module` for each file, each after those that it imports, the
main one last. Guaranteed: names of modules differ; no file imports itself by any way; every import that was not reported leads to a module.
Files are read one after the other, however long the chain of imports.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import PurePath
from typing import Protocol, assert_never

from hierc.compiler.collector import Collector
from hierc.compiler.imports.errors import ImportCycle, MissingFile, RefusedFile, TooManyFiles
from hierc.compiler.resolve.ordering import ordered
from hierc.grammar import tree
from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile

#: Most files of a model, and most characters in all of them.
MAX_FILES = 200
MAX_CHARACTERS = 2**24

#: The name of the main file's module. The others are called as they are first imported: `std.blocks`.
MAIN = ""

#: An import statement.
Import = tree.Import | tree.FromImport


@dataclass(frozen=True, slots=True)
class Missing:
    """There is no such file. `looked_in` says where it was looked for; `modules` are names that would have led to a file."""

    file: str
    looked_in: tuple[str, ...] = ()
    modules: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Refused:
    """A file that is there and must not, or cannot, be read."""

    file: str
    reason: str


class Reader(Protocol):
    """Finds files. A file is known by the name it is shown under: two files never share one, and a file is never read under two."""

    def find(self, importer: str, module: str) -> SourceFile | Missing | Refused:
        """The file that the file named `importer` means by the module `a.b`."""

    def data(self, importer: str, file: str) -> SourceFile | Missing | Refused:
        """The text of a file of data that the file named `importer` names; it is never shown."""

    @property
    def elsewhere(self) -> Mapping[str, str]:
        """Agents and functions that could be imported, with the module of each: for advice only."""


class NoFiles:
    """A reader for models of one file: there are no others."""

    elsewhere: Mapping[str, str] = {}

    def find(self, importer: str, module: str) -> Missing:
        """See `Reader`."""
        return Missing(file_of(module))

    def data(self, importer: str, file: str) -> Missing:
        """See `Reader`."""
        return Missing(file)


NO_FILES = NoFiles()


@dataclass(frozen=True, slots=True)
class Module:
    """A file of the model; `imports` gives the module of each of its import statements that leads to one, by the text between its dots."""

    name: str
    file: tree.File
    imports: Mapping[str, str]


def file_of(module: str) -> str:
    """`a/b.hier` for `a.b`."""
    return f"{module.replace('.', '/')}.hier"


def statements(file: tree.File) -> Iterator[Import]:
    """The import statements of a file."""
    for item in file.items:
        if isinstance(item, Import):
            yield item


def read_modules(main: tree.File, reader: Reader, problems: Collector) -> tuple[Module, ...]:
    """All files of the model. Everything wrong with any of them goes to `problems`."""
    found = _Found(reader, problems)
    found.add(main, MAIN)
    while found.waiting:
        found.follow(found.waiting.popleft())
    order, cycle = ordered({name: uses.values() for name, uses in found.uses.items()})
    if cycle:
        problems.add(_cycle(cycle, found))
    return tuple(Module(found.names[n], found.files[n], found.imports(n)) for n in order)


@dataclass(slots=True)
class _Found:
    """The files found so far, by the names they are shown under. `uses`: for each the file of each module that it imports."""

    reader: Reader
    problems: Collector
    files: dict[str, tree.File] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    uses: dict[str, dict[str, str]] = field(default_factory=dict)
    waiting: deque[str] = field(default_factory=deque)
    characters: int = 0

    def add(self, file: tree.File, module: str) -> None:
        """Keep a file that is seen for the first time, under a name of its own."""
        name, k = module, 1
        while name in self.names.values():
            k += 1
            name = f"{module}_{k}"
        shown = file.source.name
        self.files[shown], self.names[shown], self.uses[shown] = file, name, {}
        self.characters += len(file.source.text)
        self.waiting.append(shown)

    def imports(self, shown: str) -> dict[str, str]:
        """The modules that a file imports."""
        return {module: self.names[target] for module, target in self.uses[shown].items()}

    def follow(self, shown: str) -> None:
        """Find the files that a file imports."""
        for statement in statements(self.files[shown]):
            module = statement.module.text
            if module not in self.uses[shown]:
                target = self._found(statement, shown, module)
                if target is not None:
                    self.uses[shown][module] = target

    def _found(self, statement: Import, importer: str, module: str) -> str | None:
        span = statement.module.span
        match self.reader.find(importer, module):
            case Missing(file, looked_in, modules):
                self.problems.add(MissingFile(span, file, looked_in, module, modules))
                return None
            case Refused(file, reason):
                self.problems.add(RefusedFile(span, file, reason))
                return None
            case SourceFile() as source:
                return source.name if source.name in self.files or self._read(statement, source) else None
            case _ as never:
                assert_never(never)

    def _read(self, statement: Import, source: SourceFile) -> bool:
        """Read a new file, if there is room for it."""
        if len(self.files) >= MAX_FILES:
            self.problems.add(TooManyFiles(statement.span, f"{MAX_FILES} files"))
            return False
        if self.characters + len(source.text) > MAX_CHARACTERS:
            self.problems.add(TooManyFiles(statement.span, f"{MAX_CHARACTERS // 2**20} million characters"))
            return False
        try:
            file = parse(source)
        except ModelError as error:
            for problem in error.problems:
                self.problems.add(problem)
            file = tree.File(statement.span, source, (), ())
        self.add(file, statement.module.text)
        return True


def _cycle(cycle: tuple[str, ...], found: _Found) -> ImportCycle:
    """The closed path, from the file on it that was read first."""
    first = min(cycle[:-1], key=list(found.files).index)
    start = cycle.index(first)
    path = (*cycle[start:-1], *cycle[:start], first)
    spans = []
    for importer, target in pairwise(path):
        uses = found.uses[importer]
        spans.append(
            next(
                s.module.span for s in statements(found.files[importer]) if uses.get(s.module.text) == target
            )
        )
    return ImportCycle(spans[0], tuple(PurePath(name).stem for name in path), tuple(spans[1:]))
