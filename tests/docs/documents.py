"""Documents with examples: their fenced blocks, and how a block that is out of date is replaced."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from hierc.grammar.source import SourceFile

DOCS = Path(__file__).parents[2] / "docs"


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block of a document, by its kind and the heading it stands under."""

    kind: str
    text: str
    heading: str
    line: int

    @property
    def source(self) -> SourceFile:
        return SourceFile("model.hier", self.text)

    @property
    def file_name(self) -> str | None:
        """The name of the file that the block is, where its first line gives one."""
        named = re.match(r"(?:#|//) ([\w.]+\.\w+)\b", self.text)
        return named[1] if named else None


def blocks(document: Path) -> list[Block]:
    """All fenced blocks, in order."""
    text = document.read_text(encoding="utf-8")
    found: list[Block] = []
    for match in re.finditer(r"^```([a-z-]+)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        before = text[: match.start()]
        heading = (re.findall(r"^## (.*)$", before, re.MULTILINE) or ["beginning"])[-1]
        found.append(Block(match[1], match[2], heading, before.count("\n") + 1))
    return found


def where(block: Block) -> str:
    """What a test of the block is called."""
    return f"{block.heading.replace(' ', '_')}-{block.line}"


def accept(document: Path, old: Block, new: str, after: str = "") -> None:
    """Put `new` in the place of the text of `old`; `after`: of the first such block behind this text."""
    text = document.read_text(encoding="utf-8")
    written = f"```{old.kind}\n{old.text}```"
    place = text.index(written, text.index(after))
    document.write_text(
        text[:place] + f"```{old.kind}\n{new}```" + text[place + len(written) :], encoding="utf-8"
    )
