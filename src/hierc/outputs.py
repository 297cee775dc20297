"""Where results go: what cannot be written is refused before a long run; what fails after it loses nothing else.

`asked_for` and `saved_by` name the files, `check_writable` refuses; `write` writes them all and tells which it could not.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from hierc.exits import UsageError

if TYPE_CHECKING:
    from hierc.runtime.model import Model
    from hierc.runtime.result import Result

TABLES = (".csv", ".npz")
STDOUT = "-"


@dataclass(frozen=True, slots=True)
class Outputs:
    """Files that a run is to write, and whether its table goes to stdout."""

    tables: tuple[Path, ...]
    plots: tuple[Path, ...]
    stdout: bool


@dataclass(frozen=True, slots=True)
class Written:
    """The files that were written, and a sentence for each that could not be."""

    files: tuple[str, ...]
    failures: tuple[str, ...]


def asked_for(tables: Iterable[str], plots: Iterable[str]) -> Outputs:
    """The outputs that the command line names, `-` for stdout. Raises UsageError for what could not be written."""
    files = tuple(Path(name) for name in tables if name != STDOUT)
    drawings = tuple(map(Path, plots))
    for file in files:
        check_writable(file, TABLES)
    if drawings:
        from hierc.runtime.plotting import SUFFIXES, require_matplotlib

        for file in drawings:
            check_writable(file, SUFFIXES)
        try:
            require_matplotlib()
        except ImportError as error:
            raise UsageError(str(error)) from None
    return Outputs(files, drawings, STDOUT in tables)


def saved_by(model: Model) -> tuple[Path, ...]:
    """Files the experiment saves to: a model may be a stranger's, so only names inside the current folder. Raises UsageError."""
    here = Path.cwd()
    paths = tuple(map(Path, model.plan.experiment.save))
    for path in paths:
        target = _target(here / path)
        if target is None or not target.is_relative_to(here):
            raise UsageError(
                f"the experiment saves to `{path}`, outside the current folder; write there with -o if you mean it"
            )
        try:
            check_writable(path, TABLES)
        except UsageError as error:
            raise UsageError(f"{error} (the experiment saves there; -o FILE writes elsewhere)") from None
    return paths


def check_writable(path: Path, suffixes: tuple[str, ...] | None) -> None:
    """Raise UsageError if a file of this name and kind cannot be written."""
    hindrance = _hindrance(path, suffixes)
    if hindrance is not None:
        raise UsageError(f"cannot write `{path}`: {hindrance}")


def _hindrance(path: Path, suffixes: tuple[str, ...] | None) -> str | None:
    target = _target(path)
    if suffixes and path.suffix not in suffixes:
        return f"the name must end in {' or '.join(suffixes)}"
    if target is None:
        return "there can be no such file"
    if target.is_dir():
        return "it is a folder"
    if not target.parent.is_dir():
        leads = f"it is a link to `{target}`, and " if path.is_symlink() else ""
        return f"{leads}there is no folder `{target.parent if leads else path.parent}`"
    beside = target.is_file() or not target.exists()  # such a file is made beside its place, then renamed
    if beside and not os.access(target.parent, os.W_OK):
        return f"you may not write into the folder `{target.parent}`"
    return None


def _target(path: Path) -> Path | None:
    """The file that a name leads to; None where links go round in a circle."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):
        return None


@contextmanager
def writing(path: str | Path) -> Iterator[None]:
    """Turn a failure to write a file into a UsageError that names the file as the user did."""
    try:
        yield
    except OSError as error:
        raise UsageError(f"cannot write `{path}`: {error.strerror or error}") from None


def write(result: Result, outputs: Outputs) -> Written:
    """Write all files of a run (the table on stdout is not one of them)."""
    jobs: list[tuple[Path, Callable[[], object]]] = [
        (path, partial(result.to_csv if path.suffix == ".csv" else result.to_npz, path))
        for path in outputs.tables
    ]
    jobs += [(path, partial(result.plot, path)) for path in outputs.plots]
    files, failures = [], []
    for path, job in jobs:
        try:
            with writing(path):
                job()
            files.append(str(path))
        except UsageError as failure:
            failures.append(str(failure))
    return Written(tuple(files), tuple(failures))
