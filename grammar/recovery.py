"""Parsing that goes on after an error, so that one run reports every syntax problem.

In: lark's parser and a text. Out: lark's parse tree and tokens, or problems. At an error, `repairs.py` says what is
wrong and how the text could go on: tokens to put in, text to leave out. Where it cannot say, the statement is given up: the
parser's stack is cut back to the block around it and the text skipped to its end. An error right after a
repair is taken for its echo and not reported.

Each recovery either takes in text or makes the next token acceptable, so the loop ends.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from copy import copy
from itertools import pairwise

from lark import Lark, Token, Tree, UnexpectedCharacters, UnexpectedToken
from lark.lexer import LexerState, TerminalDef
from lark.parsers.lalr_parser_state import ParserState

from hierc.grammar import repairs
from hierc.grammar.errors import NestedTooDeeply, UnclosedComment
from hierc.grammar.problems import Problem
from hierc.grammar.situation import Situation, span_of
from hierc.grammar.source import SourceFile, Span
from hierc.grammar.words import END, JUNK

DEEPEST = 128  # nesting of brackets, blocks and prefix operators
MOST_PROBLEMS = 100  # after so many, the file is something else than a model
ECHO = 2  # tokens
FAR = 8  # tokens that show a guess at what is missing to be right

#: Tokens that wait on the parser's stack for what they open. Chains such as `x + x + …` do not grow the stack.
_OPENERS = frozenset({"LPAR", "LSQB", "LBRACE", "NOT", "POW", "IF"})

_STOPS = re.compile(
    r"""//[^\n]* | /\*[\s\S]*?(?:\*/|\Z) | "(?:\\.|[^"\\\n])*" | [{};] | [A-Za-z_]\w* | .""",
    re.VERBOSE | re.DOTALL,
)


class RecoveringParser:
    """One run over one text. `tokens` are those of the text, `problems` in the order found."""

    def __init__(self, lark: Lark, source: SourceFile) -> None:
        self.source = source
        self.tokens: list[Token] = []
        self.problems: list[Problem] = []
        interactive = lark.parse_interactive(source.text)
        self._state: ParserState[int] = interactive.parser_state
        self._lexer = interactive.lexer_thread.lexer
        assert interactive.lexer_thread.state is not None
        self._lexing: LexerState = interactive.lexer_thread.state
        self._comment = re.compile(lark.get_terminal("COMMENT").pattern.to_regexp())
        self._vocabulary = {word: terminal.name for terminal in lark.terminals for word in words_of(terminal)}
        self._operands: tuple[Token | Tree[Token], ...] = ()
        self._done = False
        self._since_repair = ECHO

    def run(self) -> Tree[Token] | None:
        """Read the whole text. The parse tree, or None where there are problems."""
        result: Tree[Token] | None = None
        while not self._done and len(self.problems) < MOST_PROBLEMS:
            try:
                for token in self._lexer.lex(self._lexing, self._state):
                    self._shift(token)
                result = self._finish()
            except UnexpectedToken as error:
                self._recover(error.token)
            except UnexpectedCharacters:
                start = self._lexing.line_ctr.char_pos
                self._recover(Token(JUNK, self.source.text[start], start))
            except _TooDeep:
                break
        return None if self.problems else result

    # ---- reading --------------------------------------------------------------------------------

    def _shift(self, token: Token) -> None:
        self._feed(token)
        self.tokens.append(token)
        self._since_repair += 1
        if token.type == "NUMBER":
            self.problems.extend(repairs.literal_problems(self.source, token))
        if len(self._state.value_stack) > DEEPEST and self._nesting() > DEEPEST:
            self.problems.append(NestedTooDeeply(span_of(self.source, token), DEEPEST))
            raise _TooDeep

    def _feed(self, token: Token) -> Tree[Token] | None:
        """Feed a token. One that does not fit leaves the stack as it was, though the parser finds out only after reducing.

        The entries themselves may have changed by then, but no tree is made of them any more.
        """
        states, values = list(self._state.state_stack), list(self._state.value_stack)
        try:
            result: Tree[Token] | None = self._state.feed_token(token, is_end=token.type == END)
        except UnexpectedToken:
            self._operands = tuple(self._state.value_stack[-3:])
            self._state.state_stack[:], self._state.value_stack[:] = states, values
            raise
        return result

    def _finish(self) -> Tree[Token] | None:
        self._done = True
        if comment := self._unclosed_comment():
            self.problems.append(UnclosedComment(comment))
            return None
        return self._feed(Token(END, "", len(self.source.text)))

    def _nesting(self) -> int:
        """How many brackets, blocks and prefix operators are open."""
        values = self._state.value_stack
        kinds = [value.type if isinstance(value, Token) else "" for value in values]
        signs = sum(kind == "ADD" and below != "" for below, kind in pairwise(kinds))
        return signs + sum(kind in _OPENERS for kind in kinds)

    def _go_on_at(self, offset: int) -> None:
        self._lexing.line_ctr.char_pos = offset

    # ---- recovering -----------------------------------------------------------------------------

    def _recover(self, found: Token) -> None:
        """Report what is wrong at `found`, unless it echoes the last error, and get the parser going again."""
        repair = repairs.choose(self._situation(found))
        echo = self._since_repair < ECHO
        if not echo or repair.sure:
            self.problems.append(repair.problem)
        if self._done:
            return
        if repair.insert is None or not self._fits(*repair.insert):
            self._give_up_statement(repair.resume, whole_file=repair.closes_blocks)
        elif echo and not repair.sure:
            self._give_up_statement(found.start_pos or 0)
        else:
            for terminal in repair.insert:
                self._state.feed_token(Token.new_borrow_pos(terminal, "", found))
            self._go_on_at(repair.resume)
            self._since_repair = ECHO if repair.sure else 0

    def _situation(self, found: Token) -> Situation:
        possible = self._state.parse_conf.states[
            self._state.position
        ]  # rules in lower case, terminals in upper
        accepts = frozenset(t for t in possible if t.isupper() and self._fits(t))
        pending = tuple(v for v in self._state.value_stack if isinstance(v, Token))
        operands, self._operands = self._operands, ()
        return Situation(
            self.source,
            self.tokens,
            found,
            accepts,
            pending,
            operands,
            self._vocabulary,
            self._fits,
            self._reach,
        )

    def _fits(self, *terminals: str) -> bool:
        """Whether the parser could read these terminals now."""
        return self._probe(terminals) is not None

    def _reach(self, insert: tuple[str, ...], offset: int) -> int:
        """How many tokens of the text from `offset` on could be read after `insert`; no more than `FAR` are tried."""
        probe = self._probe(insert)
        if probe is None:
            return 0
        lexing = copy(self._lexing)
        lexing.line_ctr.char_pos = offset
        count = 0
        try:
            for token in self._lexer.lex(lexing, probe):
                probe.feed_token(token)
                count += 1
                if count == FAR:
                    return count
            probe.feed_token(Token(END, ""), is_end=True)
        except (UnexpectedToken, UnexpectedCharacters):
            return count
        return FAR

    def _probe(self, terminals: Iterable[str]) -> ParserState[int] | None:
        """A copy of the parser's state that has read these terminals and builds no tree; None where it cannot read them."""
        probe = self._state.copy(deepcopy_values=False)
        probe.parse_conf = copy(self._state.parse_conf)
        probe.parse_conf.callbacks = {}
        try:
            for terminal in terminals:
                probe.feed_token(Token(terminal, ""), is_end=terminal == END)
        except UnexpectedToken:
            return None
        return probe

    def _unclosed_comment(self) -> Span | None:
        start = self.tokens[-1].end_pos if self.tokens else 0
        for match in self._comment.finditer(self.source.text, start or 0):
            if match.group().startswith("/*") and not match.group()[2:].endswith("*/"):
                return Span(self.source, match.start(), match.start() + 2)
        return None

    # ---- giving up a statement ------------------------------------------------------------------

    def _give_up_statement(self, start: int, *, whole_file: bool = False) -> None:
        """Cut the stack back to a place where a statement may begin, and skip to where one may."""
        state = self._state
        ends = (END,) if whole_file else (END, "RBRACE")
        while len(state.state_stack) > 1 and not any(map(self._fits, ends)):
            del state.state_stack[-1], state.value_stack[-1]
        resume = self._skip(start)
        if resume and self.source.text[resume - 1] in ";}":
            # So that the next message says after what it stands. A `}` counts as `;`, for its `{` is not among the tokens.
            last = Token("SEMICOLON", self.source.text[resume - 1], resume - 1, end_pos=resume)
            self.tokens.append(last)
        self._go_on_at(resume)
        self._since_repair = ECHO

    def _skip(self, start: int) -> int:
        """The offset behind the statement around `start`: behind its `;` or `}`, or where the next one begins."""
        depth = 0
        for match in _STOPS.finditer(self.source.text, start):
            text = match.group()
            if text == "{":
                depth += 1
            elif text == "}" and depth == 0 and self._fits("RBRACE"):
                return match.start()
            elif text == "}":
                depth -= 1
                if depth <= 0:
                    return match.end()
            elif text == ";" and depth == 0:
                return match.end()
            elif text.isalpha() and depth == 0 and self._begins_statement(match.start()):
                return match.start()
        return len(self.source.text)

    def _begins_statement(self, offset: int) -> bool:
        """Whether a word at `offset` is the first of its line and one that begins a statement here."""
        line = self.source.text.rfind("\n", 0, offset) + 1
        if not self.source.text[line:offset].isspace() and line != offset:
            return False
        lexing = copy(self._lexing)
        lexing.line_ctr.char_pos = offset
        try:
            token = next(self._lexer.lex(lexing, self._state))
        except (UnexpectedToken, UnexpectedCharacters):
            return False
        return token.type != "NAME" and self._fits(token.type)


def words_of(terminal: TerminalDef) -> list[str]:
    """The words that a terminal stands for; none for signs, names and literals."""
    pattern = terminal.pattern.to_regexp().removesuffix(r"\b")
    return re.findall(r"[a-z]+", pattern) if re.fullmatch(r"[a-z]+|\(\?:[a-z|]+\)", pattern) else []


class _TooDeep(Exception):
    """The nesting limit was reached; what follows is not read."""
