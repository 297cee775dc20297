"""`hierc fmt`: model files in the one style, in place.

A file is written only if its text changes, whole or not at all, and after the formatter has made sure that it still says the same.
"""

from __future__ import annotations

import difflib
import re
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

from hierc.exits import MODEL_ERROR, OK, UsageError
from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile
from hierc.screen import say, show_problems

#: As a name, it reads stdin and writes stdout.
STDIN = "-"


def fmt(arguments: Namespace) -> int:
    """Format files, or tell what would change. A file with errors is left as it is, and the others are done all the same.

    `arguments` has `paths`, `width`, `check` and `diff`. Raises UsageError for paths that cannot be meant, OSError for a file that
    cannot be written, and `UnsafeFormat` where the formatter is at fault.
    """
    if arguments.width < 1:
        raise UsageError(f"--width wants at least one column, not {arguments.width}")
    changed, good, bad = 0, 0, 0
    names = model_files(arguments.paths)
    for name in names:
        try:
            changed += _format(name, arguments)
            good += 1
        except ModelError as error:
            show_problems(error.problems, as_json=False)
            bad += 1
    if good and names != [STDIN]:
        word = "would change" if arguments.check or arguments.diff else "changed"
        errors = f", {bad} with errors left alone" if bad else ""
        say(f"{good} {'file' if good == 1 else 'files'} read, {changed or 'none'} {word}{errors}")
    return MODEL_ERROR if bad or (arguments.check and changed) else OK


def model_files(paths: Sequence[str]) -> list[str]:
    """The files that are meant: files as named, of a folder all `.hier` files below it but hidden and linked ones. None twice."""
    if STDIN in paths:
        if len(paths) > 1:
            raise UsageError("`-` reads one model from stdin; it cannot stand beside files")
        return [STDIN]
    found: dict[Path, str] = {}
    for name in paths:
        path = Path(name)
        files = sorted(_below(path)) if path.is_dir() else [path]
        if not files:
            raise UsageError(f"there is no .hier file in `{name}`")
        for file in files:
            found.setdefault(file.resolve(), str(file))
    return list(found.values())


def _below(folder: Path) -> Iterator[Path]:
    for file in folder.rglob("*.hier"):
        hidden = any(part.startswith(".") for part in file.relative_to(folder).parts)
        if file.is_file() and not file.is_symlink() and not hidden:
            yield file


def _format(name: str, arguments: Namespace) -> bool:
    """Format one file as the arguments say. Returns whether that changes it."""
    from hierc.grammar.formatting import format_source
    from hierc.grammar.reading import LARGEST_FILE, read_source, source_of

    if name == STDIN:
        source = source_of("<stdin>", sys.stdin.buffer.read(LARGEST_FILE + 1))
    else:
        source = read_source(name)
    text = format_source(source, arguments.width)
    if arguments.diff:
        _put("".join(_diff(source, text)))
    elif name == STDIN and not arguments.check:
        _put(text)
    if text == source.text:
        return False
    if arguments.check:
        say(f"would change: {source.name}")
    elif not arguments.diff and name != STDIN:
        _write(name, text)
    return True


def _write(name: str, text: str) -> None:
    from hierc.runtime.files import write_whole

    try:
        write_whole(Path(name), text.encode())
    except OSError as error:
        raise OSError(error.errno, error.strerror, name) from error  # not the name of a file in between
    say(f"formatted: {name}")


def _put(text: str) -> None:
    """Write to stdout what models are made of: UTF-8 with line breaks as they are."""
    sys.stdout.flush()
    sys.stdout.buffer.write(text.encode())


def _diff(source: SourceFile, text: str) -> Iterator[str]:
    """What would change, in the form that `patch` takes."""
    before, after = (re.findall(r"[^\n]*\n|[^\n]+", version) for version in (source.text, text))
    for line in difflib.unified_diff(before, after, source.name, source.name):
        yield line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"
