"""Commands in documents: what they print, and whether that is what is shown."""

from __future__ import annotations

import re
import shlex
from contextlib import redirect_stderr, redirect_stdout
from io import BytesIO, TextIOWrapper

import pytest
from documents import Block

from hierc.cli import main

#: A row of statistics: its counters and step sizes may differ a little between machines.
STATISTICS = re.compile(r"^  \S+ +(?:radau|dop|tsit)\d+ .*$")
NUMBER = re.compile(r"(?<![\w.\[])\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.\]])")
DURATION = re.compile(r"simulated in \S+ \S+ after \S+ \S+ of preparation")
#: What only the first run on a machine says.
FIRST = re.compile(r"^compiling .*\n", re.MULTILINE)


def printed_by(block: Block) -> str:
    """The commands of a block, each with what it prints."""
    commands = [line.removeprefix("$ ") for line in block.text.splitlines() if line.startswith("$ ")]
    return "".join(f"$ {command}\n{output_of(command)}" for command in commands)


def output_of(command: str) -> str:
    """What a command prints on the screen, but for what only the first run says."""
    program, *arguments = shlex.split(command)
    assert program == "hierc"
    screen = TextIOWrapper(BytesIO(), encoding="utf-8", newline="\n", write_through=True)
    with redirect_stdout(screen), redirect_stderr(screen):
        main(arguments)
    screen.seek(0)
    return FIRST.sub("", screen.read())


def is_shown(shown: str, printed: str) -> bool:
    """Whether lines are alike; a line `…` stands for any number of lines."""
    shown, printed = (DURATION.sub("simulated", text) for text in (shown, printed))
    lines = printed.splitlines()
    for number, part in enumerate(re.split(r"^…\n", shown, flags=re.MULTILINE)):
        wanted = part.splitlines()
        starts = range(len(lines) - len(wanted) + 1) if number else range(1)
        start = next((s for s in starts if all(map(alike, wanted, lines[s:]))), None)
        if start is None or len(lines) < len(wanted):
            return False
        lines = lines[start + len(wanted) :]
    return not lines or shown.endswith("…\n")


def alike(shown: str, printed: str) -> bool:
    """Whether two lines are equal; in rows of statistics, numbers may differ by a third."""
    if not STATISTICS.match(shown):
        return shown == printed
    words = [NUMBER.sub("#", " ".join(line.split())) for line in (shown, printed)]
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=False)
    return words[0] == words[1] and all(float(a) == pytest.approx(float(b), rel=0.33) for a, b in pairs)
