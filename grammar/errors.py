"""Problems of the text and its syntax (E1xx), and of reading files. Wording only; `recovery.py` decides which applies."""

# ruff: noqa: D102  (the methods are those of `Problem`)

from __future__ import annotations

import math
from dataclasses import dataclass

from hierc.grammar.problems import Problem


@dataclass(frozen=True)
class NumberOutOfRange(Problem):
    code = "E117"
    explanation = (
        "Numbers are IEEE doubles: a literal must not overflow, vanish or, as an integer, lose digits."
    )

    text: str
    value: float

    def title(self) -> str:
        if math.isinf(self.value):
            return f"the number `{clipped(self.text)}` is too large"
        if self.value == 0:
            return f"the number `{clipped(self.text)}` is too small to tell from zero"
        return f"the integer `{clipped(self.text)}` is too large to be kept exactly"

    def help(self) -> tuple[str, ...]:
        if 0 < self.value < math.inf:
            return (f"write `{self.value!r}` for a real number",)
        return ()


@dataclass(frozen=True)
class UnreadableFile(Problem):
    code = "E907"
    explanation = "A model is a regular file of UTF-8 text of at most 8 MB."

    name: str
    reason: str
    advice: tuple[str, ...] = ()

    def title(self) -> str:
        return f"cannot read `{self.name}`: {self.reason}"

    def help(self) -> tuple[str, ...]:
        return self.advice


def clipped(text: str, limit: int = 40) -> str:
    """`text`, its middle left out where it is too long for a message."""
    return text if len(text) <= limit else f"{text[: limit // 2]}…{text[-limit // 4 :]}"
