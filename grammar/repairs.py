"""What is wrong at a syntax error, and how the text could go on.

In: a `Situation`, the parser's state around the token it cannot take. Out: a `Repair`, a problem in the user's terms with
the tokens to put in, or none where the statement is to be given up. The rules are tried from the particular to the
general; each looks at the text, not at parser internals, and asks the parser only "could you read this now?".
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from lark import Token, Tree

from hierc.grammar import declarations, errors, habits, headers, misplaced, signs, words
from hierc.grammar.forms import block, general, on_to_the_brace
from hierc.grammar.problems import Problem, closest
from hierc.grammar.situation import CLOSERS, Repair, Rule, Situation, span_of
from hierc.grammar.source import SourceFile, Span
from hierc.grammar.words import END, JUNK

LARGEST_INT = 2**53  # from it on a float no longer tells neighbouring integers apart


def choose(at: Situation) -> Repair:
    """The first rule that applies; the last one always does."""
    for rule in RULES:
        if repair := rule(at):
            return repair
    return Repair(general(at), None, at.start)


def literal_problems(source: SourceFile, token: Token) -> Iterator[Problem]:
    """Whether a number can be held as written."""
    value = float(token)
    vanishes = value == 0 and re.search("[1-9]", re.split("[eE]", token)[0]) is not None
    if math.isinf(value) or vanishes or (token.isdigit() and value >= LARGEST_INT):
        yield errors.NumberOutOfRange(span_of(source, token), str(token), value)


# ---- characters and literals --------------------------------------------------------------------


def _unclosed_string(at: Situation) -> Repair | None:
    if at.found.type != JUNK or at.found != '"':
        return None
    line = at.source.text[at.start :].partition("\n")[0]
    # What closes the statement at the end of the line is most likely not meant to be in the string.
    stop = at.start + max(1, len(line.rstrip(";,)}] \t\r")))
    insert = ("STRING",) if at.fits("STRING") else None
    return Repair(errors.UnclosedString(Span(at.source, at.start, stop)), insert, stop, sure=True)


def _strange_characters(at: Situation) -> Repair | None:
    if at.found.type != JUNK:
        return None
    if at.found.isalpha():
        return _strange_name(at)
    match = at.matched(r"[^\x21-\x7e\s\w]+|.")
    stop = match.end() if match else at.stop
    text = at.source.text[at.start : stop]
    return Repair(errors.UnexpectedCharacter(Span(at.source, at.start, stop), text), (), stop)


def _strange_name(at: Situation) -> Repair:
    """A word with letters beyond ASCII, of which the beginning may have been read as a name."""
    previous = at.previous
    start = at.start
    if previous and previous.type == "NAME" and previous.end_pos == start:
        start = previous.start_pos or 0
    match = at.matched(r"\w+", start)
    stop = match.end() if match else at.stop
    problem = errors.StrangeName(Span(at.source, start, stop), signs.ascii_name(at.source.text[start:stop]))
    return Repair(problem, ("NAME",) if at.fits("NAME") else (), stop)


def _number_without_digit(at: Situation) -> Repair | None:
    if at.found.type != "DOT":
        return None
    if (match := at.matched(r"\.[0-9]+([eE][+-]?[0-9]+)?")) and at.fits("NUMBER"):
        place = Span(at.source, *match.span())
        return Repair(
            errors.NumberWithoutDigit(place, match.group(), True), ("NUMBER",), match.end(), sure=True
        )
    previous = at.previous
    if previous and previous.type == "NUMBER" and previous.end_pos == at.start:
        match = at.matched(r"\.([eE][+-]?[0-9]+)?(?!\w)")
        if match is None:
            return None
        place = Span(at.source, previous.start_pos or 0, match.end())
        return Repair(errors.NumberWithoutDigit(place, place.text, False), (), place.stop, sure=True)
    return None


# ---- signs --------------------------------------------------------------------------------------


def _equals_signs(at: Situation) -> Repair | None:
    sign = at.matched(r":=|==|=|<-|:(?![:=])")
    if sign is None:
        return None
    place = Span(at.source, *sign.span())
    if sign.group() != "=" and at.fits("_EQUAL"):
        problem = errors.AssignmentSign(place, _subject(at), sign.group())
        return Repair(problem, ("_EQUAL",), sign.end(), sure=True)
    if at.fits("_ASSIGN"):
        return Repair(errors.EquationSign(place), ("_ASSIGN",), sign.end(), sure=True)
    return None


def _subject(at: Situation) -> str:
    """What the statement around is called, in the plural."""
    if at.innermost("LPAR"):
        return "parameters and arguments"
    kinds = [token.type for token in at.pending]
    statement = kinds[max((i for i, kind in enumerate(kinds) if kind == "LBRACE"), default=-1) + 1 :]
    if "LET" in statement or "CONST" in statement or "FUNC" in statement:
        return "definitions"
    if "ACCESS" in statement:
        return "initial values"
    if "EXPERIMENT" in kinds:
        return "initial values" if block(at) == "INIT" else "settings"
    return "agents" if "AGENT" in statement else "equations"


def _primes(at: Situation) -> Repair | None:
    previous = at.previous
    if previous is None:
        return None
    if at.found.type == "_EQUAL" and at.fits("PRIME", "_EQUAL"):
        advice = (f"write `{previous}' = …;`", "an equation without a derivative belongs under `alge`")
        edits = (
            at.insertion("'")
            if at.previous and at.previous.end_pos == at.start
            else at.edit("' =", previous.end_pos)
        )
        return Repair(general(at, advice, wanted="`'`", edits=edits), ("PRIME",), at.start)
    if at.found.type == "PRIME" and at.fits("_EQUAL") and at.matched(r"'\s*="):
        return Repair(general(at, ("derivatives belong under `diff`",)), (), at.stop)
    return None


def _misplaced_brackets(at: Situation) -> Repair | None:
    """An index or a unit after an expression in parentheses, a call or a list."""
    if at.previous is None or at.previous.type not in ("RPAR", "RSQB", "PRIME", "TIME", "BOOL"):
        return None
    match = at.matched(r"\[([^\[\]\n;=]*)\]")
    if match is None or at.fits(at.found.type):
        return None
    place = Span(at.source, *match.span())
    if _is_index(at, match[1].strip()):
        return Repair(errors.OnlyNamesIndexed(place, match[1].strip()), (), match.end(), sure=True)
    if at.found.type != "UNIT" or "," in match[1]:
        return None
    return Repair(errors.MisplacedUnit(place, _operand(at)), (), match.end(), sure=True)


def _operand(at: Situation) -> Span | None:
    """What ends before the error: brackets with the name before them, or a name with its dash."""
    depth, last = 0, None
    for token in reversed(at.before):
        if (
            depth == 0
            and last is not None
            and not (last.type in ("LPAR", "LSQB", "PRIME") and token.type == "NAME")
        ):
            break
        depth += (token.type in CLOSERS) - (token.type in CLOSERS.values())
        last = token
        if token.type in ("NAME", "TIME", "BOOL") and depth == 0:
            break
    if last is None or at.previous is None or depth:
        return None
    return Span(at.source, last.start_pos or 0, at.previous.end_pos or 0)


def _is_index(at: Situation, inside: str) -> bool:
    """Whether brackets are meant to hold an index: a number, a range, or a name that counts somewhere in the text."""
    if re.fullmatch(r"\d+([,:.+*-].*)?|\w+\s*(,|\+|-|:|\.\.).*", inside):
        return True
    if not re.fullmatch(r"[A-Za-z_]\w*", inside):
        return False
    counts = re.search(rf"\b(for|int)\s+{inside}\b", at.source.text) is not None
    return counts or (
        inside in ("i", "j", "k") and at.previous is not None and at.previous.end_pos == at.start
    )


_FACTOR = r"(?:1|%|[A-Za-zµΩ°]+)(?:\^-?[0-9.]+)?"
_HALF_A_UNIT = rf"(\[\s*)?{_FACTOR}(?:[*/]{_FACTOR})*(?(1)|\s*\])"


def _half_a_unit(at: Situation) -> Repair | None:
    """`[m/s = 0` or `m/s] = 0` where a unit may stand."""
    match = at.matched(_HALF_A_UNIT)
    if match is None or not at.fits("UNIT") or (not match[1] and at.innermost("LSQB")):
        return None
    problem = errors.HalfAUnit(Span(at.source, *match.span()), match.group().strip("[] \t"))
    return Repair(problem, ("UNIT",), match.end(), sure=True)


def _chained_comparison(at: Situation) -> Repair | None:
    if at.found.type != "CMP" or len(at.operands) < 3:
        return None
    left, sign, _ = at.operands
    if not (isinstance(left, Tree) and isinstance(sign, Token) and sign.type == "CMP"):
        return None
    begin, split = getattr(left.meta, "container_start_pos", left.meta.start_pos), sign.start_pos or 0
    text = at.source.text
    middle = text[split + len(sign) : at.start].strip()
    follows = at.matched(r"\s*([\w.']+)", at.stop)
    right = follows[1] if follows else "…"
    instead = f"{text[begin:split].strip()} {sign} {middle} and {middle} {at.found} {right}"
    chain = (
        Span(at.source, begin + len(text[begin:split]) - len(text[begin:split].lstrip()), follows.end())
        if follows
        else None
    )
    problem = errors.ChainedComparison(at.place, " ".join(instead.split()), chain)
    return Repair(problem, ("ADD",) if at.fits("ADD") else None, at.stop)


# ---- blocks -------------------------------------------------------------------------------------


def _unclosed_at_end(at: Situation) -> Repair | None:
    braces = [token for token in at.open_brackets if token.type == "LBRACE"]
    if at.found.type != END or not braces:
        return None
    last = len(at.source.text.rstrip())
    brace = _outdented(at) or braces[-1]
    seen = Span(at.source, last, last)
    return Repair(errors.UnclosedBrace(span_of(at.source, brace), seen, "the file ends here"), None, at.start)


def _outdented(at: Situation) -> Token | None:
    """The first `{` that was closed by a `}` standing further left: most likely its own is missing."""
    stack: list[Token] = []
    for token in at.before:
        if token.type == "LBRACE":
            stack.append(token)
        elif token.type == "RBRACE" and stack:
            brace = stack.pop()
            if _begins_line(at.source, token) and _indent(at.source, token) < _indent(at.source, brace):
                return brace
    return None


def _unclosed_at_definition(at: Situation) -> Repair | None:
    """A definition inside an agent: the agent was not closed."""
    braces = [token for token in at.open_brackets if token.type == "LBRACE"]
    if not braces:
        return None
    start: int | None = None
    if at.is_balanced:
        return None  # it is in the wrong place
    if at.found.type in ("EXPERIMENT", "IMPORT", "FUNC", "EXTERN") and at.is_first_on_line:
        start = at.start
    elif at.found.type == "LPAR" and len(at.before) > 1 and at.before[-2].type == "AGENT":
        start = at.before[-2].start_pos
        if not at.matched(r"agent\s+\w+\s*\([^{};]*\)\s*\{", start):
            return None
    if start is None:
        return None
    match = at.matched(r"\w+", start)
    seen = Span(at.source, start, match.end() if match else start)
    problem = errors.UnclosedBrace(
        span_of(at.source, _outdented(at) or braces[-1]), seen, "this cannot stand inside it"
    )
    return Repair(problem, None, start, closes_blocks=True)


def _unclosed_at_outdent(at: Situation) -> Repair | None:
    """A statement of the block outside, no further right than the line that opened the block inside."""
    brace = at.innermost("LBRACE")
    if brace is None or not at.is_word or not at.is_first_on_line or not at.reach(("RBRACE",), at.start):
        return None
    if _indent(at.source, at.found) > _indent(at.source, brace):
        return None
    problem = errors.UnclosedBrace(span_of(at.source, brace), at.place, "this cannot stand inside it")
    return Repair(problem, ("RBRACE",), at.start)


def _indent(source: SourceFile, token: Token) -> int:
    text = source.line(source.position(token.start_pos or 0)[0])
    return len(text) - len(text.lstrip())


def _begins_line(source: SourceFile, token: Token) -> bool:
    return _indent(source, token) == source.position(token.start_pos or 0)[1] - 1


# ---- words --------------------------------------------------------------------------------------


def _reserved_word(at: Situation) -> Repair | None:
    """A word of the language where a name would fit, followed by something that may follow a name."""
    if at.found.type == "NAME" or not at.is_word:
        return None
    if not at.reach(("NAME",), at.stop):
        return None
    return Repair(errors.ReservedWord(at.place, str(at.found)), ("NAME",), at.stop, sure=True)


def _missing_semicolon(at: Situation) -> Repair | None:
    previous = at.previous
    if previous is None or previous.type in ("LBRACE", "SEMICOLON") or not at.fits("SEMICOLON"):
        return None
    last = previous.end_pos or 0
    begins_equation = at.found.type == "NAME" and at.matched(r"\w+(\[[^\]\n]*\])?\s*('|=(?!=)|:=)")
    on_a_new_line = "\n" in at.source.text[last : at.start]
    ends = at.found.type in ("RBRACE", END) or at.is_word or on_a_new_line or begins_equation
    if not ends or not at.reach(("SEMICOLON",), at.start):
        return None
    return Repair(errors.MissingSemicolon(Span(at.source, last, last)), ("SEMICOLON",), at.start)


def _misspelt_word(at: Situation) -> Repair | None:
    if at.found.type != "NAME" or len(at.found) < 3 or at.is_word:
        return None
    accepted = {word: terminal for word, terminal in at.vocabulary.items() if terminal in at.accepts}
    if (word := closest(str(at.found), accepted)) is None:
        return None
    problem = general(at, (f"did you mean `{word}`?",), edits=at.edit(word))
    return Repair(problem, (accepted[word],), at.stop)


# ---- the general form ---------------------------------------------------------------------------

_PAIRS = (("LPAR", "RPAR"), ("RPAR", "SEMICOLON"), ("RSQB", "SEMICOLON"))


def _in_the_way(at: Situation) -> Repair | None:
    """A sign that nothing asks for: a second `;`, a bracket that closes nothing."""
    kind = at.found.type
    closes_nothing = kind in CLOSERS and all(b.type != CLOSERS[kind] for b in at.open_brackets)
    ends_nothing = kind == "SEMICOLON" and words.begins_statement(at.accepts)
    return _in_excess(at, sure=ends_nothing) if closes_nothing or ends_nothing else None


def _in_excess(at: Situation, *, sure: bool) -> Repair:
    after = "" if at.previous is None else str(at.previous)
    found = words.found(at.found.type, at.found)
    problem = errors.UnexpectedText(at.place, "", after, found, ("remove it",), replacement=at.removal())
    return Repair(problem, (), at.stop, sure)


def _left_out(at: Situation) -> Repair | None:
    """One or two tokens to put in, or a sign to leave out; the choice with which most of the text can be read."""
    if words.begins_statement(at.accepts):
        return None
    insertions: list[tuple[str, ...]] = [(terminal,) for terminal in words.PHRASES if terminal in at.accepts]
    changes = [(insert, at.start) for insert in [*insertions, *_PAIRS]]
    if at.found.type in (*CLOSERS, "COMMA", "SEMICOLON"):
        changes.append(((), at.stop))
    insert, resume = max(changes, key=lambda change: at.reach(*change))
    if not at.reach(insert, resume):
        return on_to_the_brace(at, general(at))
    if resume == at.stop:
        return _in_excess(at, sure=False)
    bracket = at.innermost(CLOSERS[insert[0]]) if insert[0] in CLOSERS else None
    last = at.start if at.previous is None else at.previous.end_pos
    if insert == ("LPAR", "RPAR"):
        advice = ("write `()` where there is nothing to give",)
        return Repair(general(at, advice, edits=at.edit("()", last, last)), insert, resume)
    text = _spelt(insert) if at.reach(insert, resume) > len(insert) else ""
    blank = at.source.text[last : at.start][:1].isspace()
    edits = at.edit(text.rstrip() if blank else text, last, last) if text else ()
    return Repair(general(at, (), bracket, edits=edits), insert, resume)


def _spelt(terminals: tuple[str, ...]) -> str:
    """Signs and words as they are put in behind the token before; empty where one of them is the user's to choose."""
    phrases = [words.PHRASES[terminal] for terminal in terminals]
    if not all(re.fullmatch("`[^`]+`", phrase) for phrase in phrases):
        return ""
    texts = [phrase.strip("`") for phrase in phrases]
    return "".join(f" {text} " if text.isalpha() or text in ("=", ":=", "{") else text for text in texts)


RULES: tuple[Rule, ...] = (
    *signs.RULES,
    _unclosed_string,
    *habits.RULES,
    *headers.HEADS,
    _strange_characters,
    _number_without_digit,
    _equals_signs,
    _primes,
    _misplaced_brackets,
    _half_a_unit,
    _chained_comparison,
    _unclosed_at_end,
    _unclosed_at_definition,
    _unclosed_at_outdent,
    *declarations.RULES,
    *headers.RULES[:1],
    *misplaced.RULES,
    *headers.RULES[1:],
    _reserved_word,
    _missing_semicolon,
    signs.missing_operator,
    _misspelt_word,
    _in_the_way,
    _left_out,
)
