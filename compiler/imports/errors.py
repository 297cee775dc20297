"""Problems with imports (E901, E902, E913 to E915, W512)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from hierc.compiler.suggest import did_you_mean, listed
from hierc.grammar.problems import Label, Problem
from hierc.grammar.source import Span


@dataclass(frozen=True)
class MissingFile(Problem):
    code = "E901"
    explanation = (
        "`import a.b;` means the file `a/b.hier`. It is looked for beside the file that imports it, then in the project's folder (the nearest one "
        "upwards that holds a file `hier.toml`), then in each folder that the environment variable HIERC_PATH lists, then in the library `std` that "
        "comes with hierc."
    )
    file: str  # `a/b.hier`
    looked_in: tuple[str, ...]
    module: str
    modules: tuple[str, ...]  # names that could have been meant

    def title(self) -> str:
        return f"cannot find `{self.file}`"

    def notes(self) -> tuple[str, ...]:
        *places, last = self.looked_in or ("nowhere",)
        return (f"looked {', '.join(places)} and {last}" if places else f"looked {last}",)

    def help(self) -> tuple[str, ...]:
        return did_you_mean(self.module, self.modules)


@dataclass(frozen=True)
class ImportCycle(Problem):
    code = "E902"
    explanation = (
        "A file is read after those that it imports, so no file can import itself, directly or by way of others. Move what both need into a "
        "third file."
    )
    cycle: tuple[str, ...]  # names of files; first and last are the same
    others: tuple[Span, ...]  # the further imports of the circle

    def title(self) -> str:
        return f"import cycle: {' -> '.join(f'`{name}`' for name in self.cycle)}"

    def labels(self) -> tuple[Label, ...]:
        return tuple(Label(span, "which leads back by this import") for span in self.others[-1:])

    def help(self) -> tuple[str, ...]:
        return ("move what both need into a file of its own",) if self.others else ()


@dataclass(frozen=True)
class NotInFile(Problem):
    code = "E913"
    explanation = (
        "`from a.b import C;` makes an agent, a function or a constant that the file `a/b.hier` itself defines visible as `C`. Experiments, and "
        "what that file imports from others, cannot be imported from it."
    )
    name: str
    file: str
    candidates: tuple[str, ...]

    def title(self) -> str:
        return f"`{self.file}` defines no `{self.name}`"

    def help(self) -> tuple[str, ...]:
        if not self.candidates:
            return ("it defines nothing that can be imported",)
        return did_you_mean(self.name, self.candidates) or (f"it defines {listed(self.candidates)}",)


@dataclass(frozen=True)
class RefusedFile(Problem):
    """A file that is there and is not read, or cannot be."""

    code = "E914"
    explanation = (
        "A model may come from a stranger, so that imports read only regular `.hier` files of moderate size, of UTF-8 text, inside the folder that "
        "they are looked for in: links that lead out of it are not followed."
    )
    file: str
    reason: str

    def title(self) -> str:
        return f"cannot import `{self.file}`: {self.reason}"


@dataclass(frozen=True)
class TooManyFiles(Problem):
    code = "E915"
    explanation = (
        "Files and their text are counted while they are read, so that no import can fill the memory."
    )
    what: str

    def title(self) -> str:
        return f"a model is made of at most {self.what}"


@dataclass(frozen=True)
class UnusedImport(Problem):
    code = "W512"
    severity: ClassVar[Literal["error", "warning"]] = "warning"
    explanation = "What is imported and never used costs reading time, and is often left over from an earlier version of the file."
    name: str

    def title(self) -> str:
        return f"`{self.name}` is imported and never used"

    def help(self) -> tuple[str, ...]:
        return ("remove it",)
