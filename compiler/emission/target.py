"""The target tree: the Python that is generated, and its printer.

In: statements. Out: text. Guaranteed: parentheses keep the tree's order of operations; numbers, strings and names come out as literals that
read back equal; the text is ASCII; comments are one line of printable characters.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, assert_never

WIDTH = 110

# ---- expressions ------------------------------------------------------------------------


Operator = Literal["+", "-", "*", "/", "<", "<=", ">", ">=", "==", "!=", "and", "or"]


@dataclass(frozen=True, slots=True)
class Name:
    id: str


@dataclass(frozen=True, slots=True)
class Constant:
    value: float | int | str | bool | None


@dataclass(frozen=True, slots=True)
class Item:
    """Entry `index` of an array."""

    array: str
    index: int


@dataclass(frozen=True, slots=True)
class Slice:
    """Entries of an array, from `first` to before `stop`."""

    array: str
    first: int
    stop: int


@dataclass(frozen=True, slots=True)
class Unary:
    op: Literal["-", "not "]
    operand: Target


@dataclass(frozen=True, slots=True)
class Binary:
    op: Operator
    left: Target
    right: Target


@dataclass(frozen=True, slots=True)
class Conditional:
    test: Target
    then: Target
    other: Target


@dataclass(frozen=True, slots=True)
class Call:
    function: str
    args: tuple[Target, ...] = ()
    keywords: tuple[tuple[str, Target], ...] = ()
    rest: str = ""  # a mapping of further keywords


@dataclass(frozen=True, slots=True)
class Tuple:
    items: tuple[Target, ...]


@dataclass(frozen=True, slots=True)
class Dict:
    items: tuple[tuple[str, Target], ...]


Target = Name | Constant | Item | Slice | Unary | Binary | Conditional | Call | Tuple | Dict

# ---- statements -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Assign:
    target: Name | Item | Slice | Tuple
    value: Target
    comment: str = ""


@dataclass(frozen=True, slots=True)
class If:
    test: Target
    then: tuple[Statement, ...]
    other: tuple[Statement, ...] = ()


@dataclass(frozen=True, slots=True)
class Function:
    name: str
    parameters: tuple[str, ...]
    doc: str
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Return:
    value: Target


@dataclass(frozen=True, slots=True)
class Import:
    module: str
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Text:
    """A docstring."""

    text: str


@dataclass(frozen=True, slots=True)
class Comment:
    text: str


@dataclass(frozen=True, slots=True)
class Blank:
    lines: int = 1


Statement = Assign | If | Function | Return | Import | Text | Comment | Blank

# ---- printing ----------------------------------------------------------------------------------

_STRENGTH = {
    "or": 2, "and": 3, "not ": 4,
    "<": 5, "<=": 5, ">": 5, ">=": 5, "==": 5, "!=": 5,
    "+": 6, "-": 6, "*": 7, "/": 7,
}  # fmt: skip
_CONDITIONAL, _NEGATIVE, _ATOM = 1, 8, 9


def show(statements: Iterable[Statement]) -> str:
    """The text of a module."""
    return "\n".join(line for s in statements for line in _statement(s, "")) + "\n"


def _statement(statement: Statement, indent: str) -> Iterator[str]:
    match statement:
        case Assign(target=target, value=value, comment=comment):
            yield from _assign(target, value, comment, indent)
        case If(test=test, then=then, other=other):
            yield f"{indent}if {_show(test)}:"
            yield from _body(then, indent)
            if other:
                yield f"{indent}else:"
                yield from _body(other, indent)
        case Function(name=name, parameters=parameters, doc=doc, body=body):
            yield f"{indent}def {name}({', '.join(parameters)}):"
            yield from _body((*([Text(doc)] if doc else []), *body), indent)
        case Return(value=value):
            yield f"{indent}return {_show(value)}"
        case Import(module=module, names=()):
            yield f"{indent}import {module}"
        case Import(module=module, names=names):
            yield f"{indent}from {module} import {', '.join(names)}"
        case Text(text=text):
            yield from _docstring(text, indent)
        case Comment(text=text):
            yield f"{indent}# {plain(text)}"
        case Blank(lines=lines):
            yield from [""] * lines
        case _:
            assert_never(statement)


def _body(statements: tuple[Statement, ...], indent: str) -> Iterator[str]:
    inner = indent + "    "
    if not statements:
        yield f"{inner}pass"
    for s in statements:
        yield from _statement(s, inner)


def _assign(target: Name | Item | Slice | Tuple, value: Target, comment: str, indent: str) -> Iterator[str]:
    names = ", ".join(map(_show, target.items)) if isinstance(target, Tuple) else _show(target)
    lines = list(_wrapped(value, f"{indent}{names} = ", "", indent))
    if comment:
        lines[-1] = f"{lines[-1]}  # {plain(comment)}"
    yield from lines


def _wrapped(value: Target, before: str, after: str, indent: str) -> Iterator[str]:
    """One line if it fits; otherwise tables with one entry a line."""
    line = f"{before}{_show(value)}{after}"
    inner = indent + "    "
    match value:
        case Tuple(items=items) if len(line) > WIDTH and all(map(_is_short, items)):
            yield f"{before}("
            yield from _filled([f"{_show(item)}," for item in items], inner)
            yield f"{indent}){after}"
        case Tuple(items=items) if len(line) > WIDTH:
            yield f"{before}("
            for item in items:
                yield from _wrapped(item, inner, ",", inner)
            yield f"{indent}){after}"
        case Dict(items=entries) if len(line) > WIDTH:
            yield f"{before}{{"
            for key, item in entries:
                yield from _wrapped(item, f"{inner}{key!a}: ", ",", inner)
            yield f"{indent}}}{after}"
        case Call(function=function, args=args, keywords=()) if len(line) > WIDTH and all(
            map(_is_operand, args)
        ):
            yield f"{before}{function}("
            yield from _filled([f"{_show(arg)}," for arg in args], inner)
            yield f"{indent}){after}"
        case Call(function=function, args=args, keywords=keywords) if len(line) > WIDTH and (
            args or keywords
        ):
            yield f"{before}{function}("
            for item in args:
                yield from _wrapped(item, inner, ",", inner)
            for key, item in keywords:
                yield from _wrapped(item, f"{inner}{key}=", ",", inner)
            yield f"{indent}){after}"
        case _:
            yield line


def _is_short(value: Target) -> bool:
    """Whether several of these may share a line of a table."""
    if isinstance(value, Tuple):
        return all(isinstance(item, Constant) for item in value.items)
    return isinstance(value, Constant)


def _is_operand(value: Target) -> bool:
    """Whether it is arithmetic, of which several may share a line."""
    return not isinstance(value, Call | Tuple | Dict)


def _filled(words: Iterable[str], indent: str) -> Iterator[str]:
    """As many words a line as fit."""
    line = indent
    for word in words:
        if len(line) + len(word) + 1 > WIDTH and line.strip():
            yield line
            line = indent
        line += word if line == indent else f" {word}"
    yield line


def _show(value: Target, least: int = 0) -> str:
    """An expression, in parentheses if it binds less than `least`."""
    match value:
        case Name(id=text):
            return text
        case Constant(value=constant):
            return _parenthesised(_constant(constant), _NEGATIVE if _is_negative(constant) else _ATOM, least)
        case Item(array=array, index=index):
            return f"{array}[{index}]"
        case Slice(array=array, first=first, stop=stop):
            return f"{array}[{first}:{stop}]"
        case Unary(op=op, operand=operand):
            strength = _NEGATIVE if op == "-" else _STRENGTH[op]
            return _parenthesised(op + _show(operand, strength), strength, least)
        case Binary(op=op, left=left, right=right):
            strength = _STRENGTH[op]
            # Comparisons do not chain, and the left of a product may be negative as it stands.
            a = _show(left, strength + (strength == _STRENGTH["<"]))
            b = _show(right, strength + 1)
            text = f"{a}{op}{b}" if op in "*/" else f"{a} {op} {b}"
            return _parenthesised(text, strength, least)
        case Conditional(test=test, then=then, other=other):
            text = f"{_show(then, 2)} if {_show(test, 2)} else {_show(other, _CONDITIONAL)}"
            return _parenthesised(text, _CONDITIONAL, least)
        case Call(function=function, args=args, keywords=keywords, rest=rest):
            inside = [*(_show(a) for a in args), *(f"{key}={_show(a)}" for key, a in keywords)]
            inside += [f"**{rest}"] if rest else []
            return f"{function}({', '.join(inside)})"
        case Tuple(items=items):
            return f"({', '.join(_show(i) for i in items)}{',' if len(items) == 1 else ''})"
        case Dict(items=entries):
            return f"{{{', '.join(f'{key!a}: {_show(item)}' for key, item in entries)}}}"
        case _:
            assert_never(value)


def _parenthesised(text: str, strength: int, least: int) -> str:
    return f"({text})" if strength < least else text


def _is_negative(constant: object) -> bool:
    return isinstance(constant, int | float) and repr(constant).startswith("-")


def _constant(constant: float | int | str | bool | None) -> str:
    text = ascii(constant)
    if text.lstrip("-") in ("inf", "nan"):
        raise ValueError(f"{text} cannot be a literal")
    return text


def plain(text: str) -> str:
    """Text that may stand in a comment: one line of printable ASCII."""
    return "".join(c if " " <= c <= "~" else "?" for c in text)


def _docstring(text: str, indent: str) -> Iterator[str]:
    lines = [_escaped(line) for line in text.split("\n")]
    if len(lines) == 1:
        yield f'{indent}"""{lines[0]}"""'
        return
    yield f'{indent}"""{lines[0]}'
    yield from (f"{indent}{line}" if line else "" for line in lines[1:])
    yield f'{indent}"""'


def _escaped(line: str) -> str:
    """Text that reads back as itself between triple quotes."""
    return "".join(f"\\{c}" if c in '"\\' else c if " " <= c <= "~" else ascii(c)[1:-1] for c in line)
