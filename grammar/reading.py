"""From a path to a source text: the only place where a model file is opened.

A model may come from a stranger: only regular files of moderate size are read, and what is not text is refused in one line.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile

LARGEST_FILE = 8 * 2**20  # bytes


def read_source(path: str | os.PathLike[str]) -> SourceFile:
    """The text of a `.hier` file, shown under the name it was asked for. Raises ModelError when it cannot be read as text.

    A byte order mark is dropped. Line breaks stay as they are.
    """
    name = os.fspath(path)
    try:
        data = _regular_bytes(Path(path))
    except OSError as error:
        raise _refused(name, _reason(error)) from None
    except ValueError:  # a NUL character in the path
        raise _refused(name, "this is not a possible file name") from None
    return source_of(name, data)


def source_of(name: str, data: bytes) -> SourceFile:
    """The text of a model that was read elsewhere. Raises ModelError when it is not text of moderate size."""
    if len(data) > LARGEST_FILE:
        raise _refused(name, f"it is larger than {LARGEST_FILE // 2**20} MB")
    try:
        return SourceFile(name, data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise _refused(name, f"line {line} is not UTF-8 text", "save the file with UTF-8 encoding") from None


def _regular_bytes(path: Path) -> bytes:
    """All bytes of a regular file. Opening does not wait for a FIFO; the open file is checked, so it cannot be swapped."""
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(descriptor, "rb") as file:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise OSError("it is a folder")
        if not stat.S_ISREG(mode):
            raise OSError("it is not a regular file")
        return file.read(LARGEST_FILE + 1)


def _reason(error: OSError) -> str:
    if isinstance(error, FileNotFoundError):
        return "there is no such file"
    if isinstance(error, PermissionError):
        return "permission denied"
    if isinstance(error, IsADirectoryError):
        return "it is a folder"
    return error.strerror or str(error)


def _refused(name: str, reason: str, *help: str) -> ModelError:
    # Not before it is needed: all kinds of problems together take longer to make than a file to read.
    from hierc.grammar.errors import UnreadableFile

    return ModelError([UnreadableFile(None, name, reason, help)])
