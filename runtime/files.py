"""Files that are whole or not there: atomic writes, and the folder of caches.

Nothing here takes locks: a writer makes a file of its own beside the target and renames it, so that readers see the old or the new
content, and of two writers the later one wins.
"""

from __future__ import annotations

import os
import secrets
import stat
import sys
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

#: Folder of all caches; empty switches caching off.
VARIABLE = "HIERC_CACHE"


def write_whole(path: Path, content: bytes | Callable[[BinaryIO], None]) -> None:
    """Write `content` (or let it write itself) to `path`, whole or not at all.

    A device or pipe is written directly. Raises OSError; the file as it was before is then still there.
    """
    path = path.resolve()  # a link keeps pointing where it points
    if path.exists() and not path.is_file():
        with path.open("wb") as file:
            _put(file, content)
        return
    temporary = path.with_name(f".{path.name[:100]}.{secrets.token_hex(6)}")
    try:
        with temporary.open("xb") as file:
            _put(file, content)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            temporary.chmod(stat.S_IMODE(path.stat().st_mode))
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _put(file: BinaryIO, content: bytes | Callable[[BinaryIO], None]) -> None:
    if callable(content):
        content(file)
    else:
        file.write(content)


def cache_folder(kind: str) -> Path | None:
    """The folder for caches of this kind, made on first use; None where there is no safe place for one.

    What is cached is code, so the folder must belong to the user and be writable by nobody else.
    """
    root = _cache_root()
    if root is None:
        return None
    folder = root / kind
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)  # the mode holds for the last folder only
        folder.mkdir(mode=0o700, exist_ok=True)
        return folder if _is_private(root) and _is_private(folder) else None
    except OSError:
        return None


def _cache_root() -> Path | None:
    chosen = os.environ.get(VARIABLE)
    if chosen is not None:
        return Path(chosen).absolute() if chosen else None
    if sys.platform == "win32":
        base, name = os.environ.get("LOCALAPPDATA"), "hierc/cache"
    elif sys.platform == "darwin":
        base, name = os.path.expanduser("~/Library/Caches"), "hierc"  # noqa: PTH111 - Path.home() raises without a home
    else:
        base, name = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "hierc"  # noqa: PTH111
    return Path(base, name) if base and os.path.isabs(base) else None  # noqa: PTH117 - `~` stays where there is no home


def _is_private(folder: Path) -> bool:
    if not hasattr(os, "geteuid"):
        return True
    status = folder.stat()
    return status.st_uid == os.geteuid() and not status.st_mode & 0o022
