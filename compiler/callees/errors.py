"""Problems with external functions and tables (E905, E906)."""

from __future__ import annotations

from dataclasses import dataclass

from hierc.grammar.problems import Problem

#: Wrong lines of a file that one message lists.
LISTED = 8


@dataclass(frozen=True)
class WrongExtern(Problem):
    code = "E905"
    explanation = (
        '`extern real f(real v) [N] = "module:function";` is a function of a Python module, which is looked for where Python looks for modules and beside '
        "the model's file. It is imported when the model is run or loaded, and never when it is only checked, formatted or drawn. Its arguments are `real` "
        "or `int`, numbers, vectors or matrices; its value is one number. What is wrong with the function itself is found when the model is run."
    )
    name: str
    target: str
    reason: str
    advice: str | None = None

    def title(self) -> str:
        return f"extern `{self.name}`: {self.reason}"

    def help(self) -> tuple[str, ...]:
        return (self.advice,) if self.advice else ()


@dataclass(frozen=True)
class WrongTable(Problem):
    code = "E906"
    explanation = (
        "A table's file has a line for each point of a rectangular grid, in any order: first the arguments, in their declared units, then the value, "
        "separated by commas. The first line may name the columns; what follows `#` is a comment. There are two or more points along each argument, and "
        "every combination has one value. The file lies beside the file that declares the table, or below its folder or project; it is a regular file of "
        "moderate size."
    )
    file: str
    reason: str
    others: tuple[str, ...] = ()  # further wrong lines: `line 8: …`
    advice: str | None = None

    def title(self) -> str:
        return f"table `{self.file}`{' ' if self.reason.startswith('line ') else ': '}{self.reason}"

    def notes(self) -> tuple[str, ...]:
        more = len(self.others) - LISTED
        return (*self.others[:LISTED], *([f"and {more} lines more"] if more > 0 else []))

    def help(self) -> tuple[str, ...]:
        return (self.advice,) if self.advice else ()
