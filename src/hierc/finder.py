"""Where imported files are: beside the file that imports them, in the project, in HIERC_PATH, in the library `std` that comes with hierc.

A model may come from a stranger. A file is read only if it is a regular `.hier` file that, with all links followed, lies in the folder where
it was looked for; nothing of any other file is ever shown. (The library may be installed as links.) Every place that was looked at is
remembered with what was there, so that a later process can tell whether it would find the same.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from hierc.grammar.problems import ModelError
from hierc.grammar.reading import read_source
from hierc.grammar.source import SourceFile

if TYPE_CHECKING:
    from hierc.compiler.imports.modules import Missing, Refused

#: A folder that holds a file of this name is a project: imports of all files below are looked for in it.
PROJECT = "hier.toml"
#: Folders with further files, separated as in PATH.
PATH_VARIABLE = "HIERC_PATH"
#: Most files of a folder that are looked through for advice.
_LISTED = 1000

#: What was at each place: None for nothing, the hash of a file's text, or `THERE` where only that something was there matters.
Seen = Mapping[str, str | None]
THERE = "there"


@dataclass(frozen=True, slots=True)
class _Place:
    """A folder to look in; `shown` is how files in it are named, `said` how it is called in a message."""

    folder: Path
    shown: Path
    said: str
    library: bool = False  # std


@dataclass(frozen=True, slots=True)
class _File:
    """A file that was found: where it is, and in what kind of place."""

    folder: Path
    library: bool


class Finder:
    """Finds the files that a model imports; the `Reader` of the compiler.

    `main` is the model's own text, and `path` where it stands, or would stand: what it imports is looked for beside it.
    """

    def __init__(self, main: SourceFile, path: Path, library: Path) -> None:
        real = Path(os.path.realpath(path))
        self.seen: dict[str, str | None] = {}
        self._library = library
        self._files: dict[str, _File] = {main.name: _File(real.parent, library=False)}
        self._by_path: dict[Path, SourceFile] = {real: main}

    @property
    def folder(self) -> Path:
        """The folder of the main file."""
        return next(iter(self._files.values())).folder

    @property
    def start(self) -> tuple[str, ...]:
        """Everything but files that decides what is found: the folder of the main file, HIERC_PATH, the place of std."""
        return str(self.folder), os.environ.get(PATH_VARIABLE, ""), str(Path.cwd()), str(self._library)

    def find(self, importer: str, module: str) -> SourceFile | Missing | Refused:
        """See `Reader.find`."""
        from hierc.compiler.imports.modules import Missing, file_of

        file = file_of(module)
        places = list(self._places(importer))
        for place in places:
            path = place.folder / file
            known = self._by_path.get(path)
            if known is not None:
                return known
            if os.path.lexists(path):
                return self._open(place, path, file)
            self.seen[str(path)] = None
        said = tuple(f"for `{file}` {place.said}" if i == 0 else place.said for i, place in enumerate(places))
        return Missing(file, said, tuple(self._modules_near(places, module)))

    def data(self, importer: str, file: str) -> SourceFile | Missing | Refused:
        """See `Reader.data`: a file beside the one that names it, or below; also elsewhere in its project, named from there by `../`."""
        from hierc.compiler.imports.modules import Missing, Refused

        home = self._files[importer]
        path = Path(os.path.normpath(home.folder / file)) if "\0" not in file else Path()
        root = self._library if home.library else self._project(home.folder) or home.folder
        real = Path(os.path.realpath(path))
        if not real.is_relative_to(root) or not path.is_relative_to(root):
            return Refused(file, "it lies outside the folder of the model or its project")
        if not os.path.lexists(path):
            return Missing(file)
        if real.suffix != ".csv":
            return Refused(file, "its name does not end in `.csv`")
        try:
            text = read_source(real).text
        except ModelError as error:
            return Refused(file, getattr(error.problems[0], "reason", "it cannot be read"))
        self.seen[str(path)] = digest(text)
        return SourceFile(str(Path(importer).parent / file), text)

    @cached_property
    def elsewhere(self) -> Mapping[str, str]:
        """Agents and functions of std, with their modules."""
        return _Definitions(self._library / "std")

    # ---- places ----------------------------------------------------------------------------------------------------------------------

    def _places(self, importer: str) -> Iterator[_Place]:
        """Where a file's imports are looked for. The library sees nothing but itself."""
        std = _Place(self._library, Path(), "in `std`", library=True)
        home = self._files[importer]
        if not home.library:
            shown = Path(importer).parent
            yield _Place(home.folder, shown, "beside this file")
            root = self._project(home.folder)
            if root is not None and root != home.folder:
                above = Path(os.path.normpath(shown / os.path.relpath(root, home.folder)))
                yield _Place(root, above, f"in the project's folder `{above}`")
            for entry in filter(None, os.environ.get(PATH_VARIABLE, "").split(os.pathsep)):
                yield _Place(Path(os.path.realpath(entry)), Path(entry), f"in `{entry}` ({PATH_VARIABLE})")
        yield std

    def _project(self, folder: Path) -> Path | None:
        """The nearest folder upwards that is a project's."""
        for candidate in (folder, *folder.parents):
            mark = candidate / PROJECT
            there = os.path.lexists(mark)
            self.seen[str(mark)] = THERE if there else None
            if there:
                return candidate
        return None

    def _modules_near(self, places: list[_Place], module: str) -> Iterator[str]:
        """Modules in the folders where a file was looked for, and all of std."""
        prefix, _, _ = module.rpartition(".")
        for place in places:
            folder = Path(os.path.realpath(place.folder / prefix.replace(".", "/")))
            if not folder.is_relative_to(place.folder):
                continue  # a link that leads out
            for file in islice(folder.glob("*.hier"), _LISTED):
                yield f"{prefix}.{file.stem}" if prefix else file.stem
        yield from (f"std.{file.stem}" for file in (self._library / "std").glob("*.hier"))

    # ---- files -----------------------------------------------------------------------------------------------------------------------

    def _open(self, place: _Place, path: Path, file: str) -> SourceFile | Refused:
        """The file at a path where there is one."""
        from hierc.compiler.imports.modules import Refused

        real = Path(os.path.realpath(path))
        known = self._by_path.get(real)
        if known is not None:
            self.seen[str(path)] = digest(known.text)
            return known
        if not (place.library or real.is_relative_to(os.path.realpath(place.folder))):
            return Refused(file, "it is a link that leads out of the folder")
        if real.suffix != ".hier":
            return Refused(file, "it is a link to a file of another kind")
        try:
            text = read_source(real).text
        except ModelError as error:
            return Refused(file, getattr(error.problems[0], "reason", "it cannot be read"))
        name = str(place.shown / file)
        source = SourceFile(str(real) if name in self._files else name, text)
        self.seen[str(path)] = digest(text)
        library = place.library or real.is_relative_to(os.path.realpath(self._library / "std"))
        self._files[source.name] = _File(real.parent, library)
        self._by_path[real] = source
        return source


@dataclass(frozen=True)
class _Definitions(Mapping[str, str]):
    """The names that the files of a folder define, with their modules. Nothing is read before it is asked for."""

    folder: Path
    _HEAD = re.compile(r"^(?:agent|func[^(\n]*?)\s+(\w+)\s*\(", re.MULTILINE)

    @cached_property
    def _found(self) -> dict[str, str]:
        found: dict[str, str] = {}
        for file in sorted(self.folder.glob("*.hier")):
            with suppress(OSError, ModelError):
                for name in self._HEAD.findall(read_source(file).text):
                    found.setdefault(name, f"{self.folder.name}.{file.stem}")
        return found

    def __getitem__(self, name: str) -> str:
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)


def unchanged(seen: Seen) -> bool:
    """Whether every place still holds what was seen there."""
    return all(_now(path, was) == was for path, was in seen.items())


def _now(path: str, was: str | None) -> str | None:
    if not os.path.lexists(path):
        return None
    if was == THERE:
        return THERE
    try:
        return digest(read_source(path).text)
    except ModelError:
        return ""


def digest(text: str) -> str:
    """The hash by which a file's text is known."""
    return hashlib.sha256(text.encode()).hexdigest()
