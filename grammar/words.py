"""Terminals of the grammar in words, for messages: what was expected and what was found, never a token's id."""

from __future__ import annotations

from collections.abc import Set

from hierc.grammar.errors import quoted

END = "$END"  # lark's name for the end of the text
JUNK = "JUNK"  # our name for characters that belong to no terminal

#: Where one of these sets can go on, the phrase stands for all of it. The first that fits is taken.
_PLACES = (
    ({"LEVEL", "RBRACE"}, "a statement of an agent or `}`"),
    ({"RECORD", "RBRACE"}, "a setting, `record`, `save`, `init`, `group` or `}`"),
    ({"MODE", "TRANS", "RBRACE"}, "`let`, `diff`, `alge`, `inv`, `mode`, `trans` or `}`"),
    ({"EXPERIMENT", END}, "`agent`, `experiment` or another definition"),
    ({"NAME", "FOR", "RBRACE"}, "an equation or `}`"),
)

#: Phrases in the order in which they are listed. What begins an expression is one phrase, see `expected`.
PHRASES = {
    "AGENT": "`agent`",
    "SCALAR": "a type (`real`, `int`, `bool`)",
    "NAME": "a name",
    "STRING": "a string",
    "_EQUAL": "`=`",
    "_ASSIGN": "`:=`",
    "_DOTS": "`..`",
    "IMPORT": "`import`",
    "FROM": "`from`",
    "WHEN": "`when`",
    "TO": "`to`",
    "OF": "`of`",
    "IN": "`in`",
    "THEN": "`then`",
    "ELSE": "`else`",
    "DO": "`do`",
    "MODE": "`mode`",
    "RATE": "`every` or `at`",
    "COLON": "`:`",
    "COMMA": "`,`",
    "LPAR": "`(`",
    "RPAR": "`)`",
    "LSQB": "`[`",
    "RSQB": "`]`",
    "SEMICOLON": "`;`",
    "LBRACE": "`{`",
    "RBRACE": "`}`",
}

#: What may go on where the text could as well end: named only when nothing else fits.
_OPTIONAL = {
    "ADD": "an operator",
    "PRIME": "`'`",
    "DOT": "`.`",
    "UNIT": "a unit",
    "AS": "`as`",
    "FOR": "`for`",
}


def expected(accepts: Set[str], name: str = "a name") -> str:
    """What may stand in a place, in words: the few things that bring the sentence to its end come first. `name`: what a name would be."""
    for place, phrase in _PLACES:
        if place <= accepts:
            return phrase
    phrases = [name if t == "NAME" else phrase for t, phrase in PHRASES.items() if t in accepts]
    if "NUMBER" in accepts:
        beginnings = {name, PHRASES["LPAR"], PHRASES["LSQB"]}
        phrases = ["an expression", *(p for p in phrases if p not in beginnings)]
    elif len(phrases) > 1:  # brackets that may follow a name say little beside what must follow
        phrases = [p for p in phrases if p not in ("`[`", "`(`")] or phrases
    if "PRIME" in accepts and phrases == [PHRASES["LSQB"]]:
        phrases = [_OPTIONAL["PRIME"]]  # the left side of a differential equation
    if not phrases:
        phrases = [_OPTIONAL[t] for t in _OPTIONAL if t in accepts]
    return _listed(phrases) or "something else"


def begins_statement(accepts: Set[str]) -> bool:
    """Whether a statement may begin in a place."""
    return any(place <= accepts for place, _ in _PLACES)


def found(terminal: str, text: str) -> str:
    """A token in words."""
    return "the end of the file" if terminal == END else quoted(text)


def _listed(phrases: list[str]) -> str:
    *most, last = phrases or [""]
    return f"{', '.join(most)} or {last}" if most else last
