"""The text of a model as nested blocks, which may be put in another order."""

from __future__ import annotations

from dataclasses import dataclass, field
from random import Random


@dataclass
class Block:
    """`head { items }`; the order of items means nothing, but levels keep theirs. Without a head: a file."""

    head: str = ""
    items: list[str | Block] = field(default_factory=list)

    @property
    def is_level(self) -> bool:
        return self.head.startswith("level ")

    def text(self, indent: str = "") -> str:
        inner = indent + "  " * bool(self.head)
        lines = [i.text(inner) if isinstance(i, Block) else f"{inner}{i}\n" for i in self.items]
        return f"{indent}{self.head} {{\n{''.join(lines)}{indent}}}\n" if self.head else "".join(lines)

    def shuffled(self, rng: Random) -> Block:
        """The same model in another order of declarations, equations and blocks."""
        items = [i.shuffled(rng) if isinstance(i, Block) else i for i in self.items]
        rng.shuffle(items)
        levels = iter([i.shuffled(rng) for i in self.items if isinstance(i, Block) and i.is_level])
        return Block(self.head, [next(levels) if isinstance(i, Block) and i.is_level else i for i in items])
