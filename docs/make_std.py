"""Writes `docs/std.md` from the files of the library: `python docs/make_std.py`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from hierc.grammar import tree
from hierc.grammar.parser import parse
from hierc.grammar.reading import read_source

LIBRARY = Path(__file__).parents[1] / "models" / "std"

_HEADING = """# The library `std`

Blocks that come with hierc. A file imports what it uses:

```hier
from std.blocks import Lag, PI;

agent Loop() {
  agent plant      = Lag(T = 0.5 [s], K = 2) [u := controller.u];
  agent controller = PI(Kp = 2, Ki = 8 [1/s], low = -4, high = 4) [r := 1, y := plant.y];
}
```

Parameters without a default must be given. Where no unit is shown, a value is in whatever fits. The files are in `models/std`; each block is
tested against its transfer function or a known solution in `tests/models`. This page is made from them by `docs/make_std.py`.
"""


def page() -> str:
    """The text of `docs/std.md`."""
    return "\n".join([_HEADING, *(line for file in sorted(LIBRARY.glob("*.hier")) for line in _file(file))])


def _file(path: Path) -> Iterator[str]:
    """A section for a file: its first comment, then its agents and functions in the order of the text."""
    file = parse(read_source(path))
    comments = {comment.span.stop: comment.text[3:].strip() for comment in file.comments}
    first = re.match(r"(?:///[^\n]*\n)+", file.source.text)
    assert first is not None
    yield f"## `std.{path.stem}`\n"
    yield f"{' '.join(line[3:].strip() for line in first[0].splitlines())}\n"
    for item in file.items:
        if isinstance(item, tree.Agent):
            yield from _agent(item)
        elif isinstance(item, tree.Func):
            yield from _func(item, _before(item, comments))


def _agent(agent: tree.Agent) -> Iterator[str]:
    yield f"**`{agent.name.text}({_params(agent.params)})`**  "
    yield f"{_sentence(agent.doc)}  "
    for access in ("read", "write"):
        names = [
            f"`{_typed(item.type, declarator.name, declarator.unit)}`"
            for item in agent.items
            if isinstance(item, tree.Decl) and item.access == access
            for declarator in item.declarators
        ]
        if names:
            yield f"{access.capitalize()}s {', '.join(names)}.{'  ' if access == 'read' else ''}"
    yield ""


def _func(func: tree.Func, doc: str) -> Iterator[str]:
    """A function that has a comment; the others are its helpers."""
    if doc:
        yield f"**`{func.type.span.text} {func.name.text}({_params(func.params)})`**  "
        yield f"{_sentence(doc)}\n"


def _before(item: tree.Func, comments: dict[int, str]) -> str:
    """The comment on the lines right above."""
    lines: list[str] = []
    stop = item.span.start - 1
    while stop in comments:
        lines.insert(0, comments[stop])
        stop = item.span.file.text.rfind("\n", 0, stop)
    return " ".join(lines)


def _sentence(doc: str) -> str:
    """A comment for Markdown: stars are products."""
    return " ".join(doc.split()).replace("*", r"\*")


def _params(params: Iterable[tree.Param]) -> str:
    return ", ".join(
        _typed(p.type, p.name, p.unit) + (f" = {p.default.span.text}" if p.default else "") for p in params
    )


def _typed(type_: tree.Type, name: tree.Name, unit: tree.Unit | None) -> str:
    shown = "" if type_.span.text == "real" else f"{type_.span.text} "
    return f"{shown}{name.text}" + (f" [{unit.text}]" if unit else "")


if __name__ == "__main__":
    Path(__file__).with_name("std.md").write_text(page(), encoding="utf-8")
