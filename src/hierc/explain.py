"""The pages of the error index: what a code means, with a model that has the problem and the message that it gets.

A page is made from the problem's class: its name and `explanation`. The failing model is `pages/CODE.hier`; its message is what the
compiler says today, so that a page cannot go out of date. `hierc explain` prints pages, and `docs/errors.md` is all of them.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

from hierc.exits import UsageError
from hierc.grammar.problems import ModelError, Problem
from hierc.grammar.source import SourceFile

_WIDTH = 88
_FOLDER = Path(__file__).parent / "pages"

_HEADING = """# Problems and their codes

What hierc says when something is wrong, by code, each with a model that has the problem. `hierc explain E601` prints one of these pages.
Codes that begin with `E` are errors; with `W`, warnings: the model runs. This file is made by `docs/make_errors.py`.
"""

#: The families of codes, by their first digit.
FAMILIES = {
    "0": "Not supported yet",
    "1": "Text and syntax",
    "2": "Names and instances",
    "3": "Types and shapes",
    "4": "Units",
    "5": "Equations",
    "6": "Levels and groups",
    "7": "Modes, events and sampling",
    "8": "Arrays of agents",
    "9": "Files and experiments",
}


@dataclass(frozen=True, slots=True)
class Page:
    """One code. `example` is a model with the problem and `message` what the compiler says of it; None where no short model shows it."""

    code: str
    name: str
    explanation: str
    example: str | None
    message: str | None


def explain(code: str) -> str:
    """The page of a code as text for a terminal; `E601`, `e601` and `601` are the same. Raises UsageError for an unknown code."""
    kinds = problem_kinds()
    wanted = code.strip().upper()
    found = [known for known in kinds if wanted in (known, known[1:])]
    if not found:
        close = get_close_matches(wanted if wanted[:1].isalpha() else f"E{wanted}", kinds, n=1)
        meant = f"did you mean {close[0]}? " if close else ""
        raise UsageError(f"there is no code `{code}`; {meant}`hierc explain` lists them all")
    return "\n\n".join(_terminal(page(kinds[known])) for known in found)


def index() -> str:
    """All codes with their names, a line each, by family."""
    lines: list[str] = []
    for family, kinds in _families():
        lines += ["", family, *(f"  {kind.code}  {name_of(kind)}" for kind in kinds)]
    return "\n".join(lines[1:]) + "\n"


def reference() -> str:
    """The whole error index in Markdown: the text of `docs/errors.md`."""
    parts = [_HEADING]
    for family, kinds in _families():
        parts.append(f"## {family}\n")
        parts += [_markdown(page(kind)) for kind in kinds]
    return "\n".join(parts)


def problem_kinds() -> dict[str, type[Problem]]:
    """Every class of problems by its code, in the order of the numbers."""
    for package in ("hierc.grammar", "hierc.compiler"):
        for module in walk_packages(import_module(package).__path__, f"{package}."):
            if module.name.endswith(("errors", ".unsupported")):
                import_module(module.name)
    ours = (kind for kind in _below(Problem) if kind.__module__.startswith("hierc."))
    kinds = (kind for kind in ours if isinstance(vars(kind).get("code"), str))
    return {kind.code: kind for kind in sorted(kinds, key=lambda kind: (kind.code[1:], kind.code))}


def _below(kind: type[Problem]) -> Iterator[type[Problem]]:
    for child in kind.__subclasses__():
        yield child
        yield from _below(child)


def _families() -> Iterator[tuple[str, list[type[Problem]]]]:
    kinds = problem_kinds().values()
    for digit, family in FAMILIES.items():
        if members := [kind for kind in kinds if kind.code[1] == digit]:
            yield family, members


def name_of(kind: type[Problem]) -> str:
    """The class's name in words: `broken cascade`."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=A)(?=[A-Z][a-z])", " ", kind.__name__).lower()
    return words.replace("charon", "CHARON").replace("modelica", "Modelica")


def page(kind: type[Problem]) -> Page:
    """The page of a class of problems; compiles its example."""
    file = _FOLDER / f"{kind.code}.hier"
    example = file.read_text(encoding="utf-8") if file.exists() else None
    message = None if example is None else message_of(SourceFile("model.hier", example))
    return Page(kind.code, name_of(kind), kind.explanation, example, message)


def message_of(source: SourceFile, folder: Path = _FOLDER) -> str:
    """What the compiler says of a model that stands in `folder`: all its problems as text."""
    from hierc.grammar.render import render

    return "\n\n".join(render(problem) for problem in problems_of(source, folder))


def problems_of(source: SourceFile, folder: Path = _FOLDER) -> tuple[Problem, ...]:
    """All problems of a model that stands in `folder`: its errors, or its warnings if it has none."""
    from hierc.compiler.driver import check_source, compile_source
    from hierc.loader import placed

    finder = placed(source, folder / source.name).finder
    try:
        warnings = check_source(source, reader=finder)
        if not warnings:
            compile_source(source, reader=finder)  # a few problems show only when derivatives are taken
    except ModelError as error:
        return error.problems
    return warnings


def _terminal(page: Page) -> str:
    paragraphs = [f"{page.code}: {page.name}", textwrap.fill(page.explanation, _WIDTH)]
    if page.example is not None and page.message is not None:
        paragraphs += [_indented(page.example), "gives", _indented(page.message)]
    return "\n\n".join(paragraphs)


def _indented(text: str) -> str:
    return textwrap.indent(text.rstrip(), "    ")


def _markdown(page: Page) -> str:
    lines = [f"### {page.code}: {page.name}\n", textwrap.fill(page.explanation, 140) + "\n"]
    if page.example is not None and page.message is not None:
        lines += ["```hier", page.example.rstrip(), "```\n", "```text", page.message, "```\n"]
    return "\n".join(lines)
