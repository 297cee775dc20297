"""The grammar itself: no conflicts, words and names, precedence, literals, long and deep texts."""

from __future__ import annotations

import math
import re
from importlib.resources import files

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lark import Lark
from lark.exceptions import GrammarError, LexError

from hierc.grammar import tree
from hierc.grammar.parser import parse, whole_words
from hierc.grammar.problems import ModelError
from hierc.grammar.recovery import words_of
from hierc.grammar.source import SourceFile

GRAMMAR = files("hierc.grammar").joinpath("hier.lark").read_text(encoding="utf-8")
CONTEXT_WORDS = ["each", "history", "level", "offset", "record", "save", "table"]


def parsed(text: str) -> tuple[tree.Item, ...]:
    return parse(SourceFile("test.hier", text)).items


def expression(text: str) -> tree.Expr:
    (const,) = parsed(f"const real x = {text};")
    assert isinstance(const, tree.Const)
    return const.value


def codes(text: str) -> list[str]:
    with pytest.raises(ModelError) as caught:
        parsed(text)
    return [problem.code for problem in caught.value.problems]


def shape(expr: tree.Expr) -> str:
    """An expression with every grouping in parentheses."""
    match expr:
        case tree.Binary():
            return f"({shape(expr.left)} {expr.op} {shape(expr.right)})"
        case tree.Unary():
            return f"({expr.op} {shape(expr.operand)})"
        case tree.Cond():
            return f"(if {shape(expr.condition)} then {shape(expr.then)} else {shape(expr.other)})"
        case _:
            return expr.span.text


# ---- the table ----------------------------------------------------------------------------------


def strict(grammar: str) -> Lark:
    pytest.importorskip("interegular")
    return Lark(grammar, parser="lalr", strict=True, edit_terminals=whole_words)


def test_the_grammar_has_no_conflicts() -> None:
    assert strict(GRAMMAR).rules


@pytest.mark.parametrize(
    "addition",
    [
        '\nsetting2 : NAME _EQUAL expr ";"\n%extend exp_item : setting2',
        "\nONE : /1+/\n%extend type_ : ONE ONE | NUMBER ONE",
    ],
    ids=["rules", "terminals"],
)
def test_conflicts_would_be_seen(addition: str) -> None:
    with pytest.raises((GrammarError, LexError)):
        strict(GRAMMAR.replace("?exp_item", "exp_item") + addition)


# ---- words and names ----------------------------------------------------------------------------


def words_of_the_grammar() -> set[str]:
    terminals = Lark(GRAMMAR, parser="lalr", edit_terminals=whole_words).terminals
    return {word for terminal in terminals for word in words_of(terminal)}


def test_names_exclude_the_words_of_the_grammar() -> None:
    excluded = re.search(r"NAME *: /\(\?!\(\?:([a-z|]+)\)", GRAMMAR)
    assert excluded is not None
    assert sorted(excluded[1].split("|")) == sorted(words_of_the_grammar() - set(CONTEXT_WORDS))


@pytest.mark.parametrize("word", sorted(words_of_the_grammar() - set(CONTEXT_WORDS)))
def test_reserved_words_are_no_names(word: str) -> None:
    assert codes(f"agent A() {{ read real {word}; }}") == ["E102"]
    assert codes(f"agent {word}() {{ }}") == ["E102"]
    parsed(f"agent A() {{ read real {word}_, x{word}, {word.upper()}; }}")


@pytest.mark.parametrize("word", CONTEXT_WORDS)
def test_words_of_one_place_are_names_elsewhere(word: str) -> None:
    parsed(
        f"agent {word}(real {word}) {{ write real {word} = {word}; let a = {word} + {word}(1) .* {word}.{word};"
        f" diff {{ {word}' = -{word}; }} level {word} {{ agent {word} = {word}({word} = 1) [{word} := {word}]; }}"
        f" sample every {word} offset {word} {{ {word} := {word}; }} group g = {word}; }}"
        f" experiment {word} of {word}() {{ record {word}.*; init {{ {word} = 1; }} }}"
    )


def test_each_after_group_is_no_name() -> None:
    assert codes("agent A() { group each = a; }") == ["E110"]


@pytest.mark.parametrize("text", ["agentA() { }", "agent A() { levelx { } }", "agent A() { readreal x; }"])
def test_a_word_ends_where_it_ends(text: str) -> None:
    codes(text)


def test_a_word_may_begin_a_name() -> None:
    parsed(
        "agent A() { write real realx, integer, boolean, writex, timer, notx, order, android; let a = notx + timer; }"
    )


# ---- expressions --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "grouping"),
    [
        ("a - b - c", "((a - b) - c)"),
        ("a/b*c ./ d .* e", "((((a / b) * c) ./ d) .* e)"),
        ("a + b*c^d", "(a + (b * (c ^ d)))"),
        ("a^b^c", "(a ^ (b ^ c))"),
        ("-a^2", "(- (a ^ 2))"),
        ("2^-a", "(2 ^ (- a))"),
        ("-a*b", "((- a) * b)"),
        ("a*-b", "(a * (- b))"),
        ("- -a", "(- (- a))"),
        ("a or b and not c == d + 1", "(a or (b and (not (c == (d + 1)))))"),
        ("a or b or c", "((a or b) or c)"),
        ("not not a", "(not (not a))"),
        ("if a then b else if c then d else e + 1", "(if a then b else (if c then d else (e + 1)))"),
        ("(a + b)*c", "((a + b) * c)"),
        ("2.*a", "(2 .* a)"),
        ("a//comment\n/b", "(a / b)"),
    ],
)
def test_precedence(text: str, grouping: str) -> None:
    assert shape(expression(text)) == grouping


def test_the_span_of_a_product_includes_the_parentheses_of_its_factors() -> None:
    expr = expression("(a + b) * (c)")
    assert isinstance(expr, tree.Binary)
    assert expr.span.text == "(a + b) * (c)"
    assert (expr.left.span.text, expr.right.span.text) == ("a + b", "c")


@given(st.floats(min_value=0, allow_nan=False, allow_infinity=False))
def test_every_float_keeps_its_value(value: float) -> None:
    number = expression(repr(value))
    assert isinstance(number, tree.Number)
    assert number.value == value
    assert not number.is_int


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("1e400", "E117"),
        ("1e-400", "E117"),
        ("9007199254740993", "E117"),
        ("9" * 5000, "E117"),
        (".5", "E104"),
        ("1.", "E104"),
    ],
)
def test_literals_out_of_range_or_form(text: str, code: str) -> None:
    assert codes(f"const real x = {text};") == [code]


def test_zero_may_have_any_exponent() -> None:
    assert expression("0e-999") == tree.Number(expression("0").span, "0e-999", 0.0, False, None)
    assert math.copysign(1, parsed_number("0.0")) == 1


def parsed_number(text: str) -> float:
    number = expression(text)
    assert isinstance(number, tree.Number)
    return number.value


def test_strings_know_escapes() -> None:
    (item,) = parsed('extern real f() = "a\\"b\\\\c";')
    assert isinstance(item, tree.Extern)
    assert item.target == 'a"b\\c'


# ---- size ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("operator", ["+", "*", "or", "and", ".*"])
def test_a_chain_of_five_thousand_terms(operator: str) -> None:
    expr = expression(f" {operator} ".join(["x"] * 5000))
    terms = 1
    while isinstance(expr, tree.Binary):
        terms += 1
        expr = expr.left
    assert terms == 5000


NESTS = {
    "parentheses": ("(", "1", ")"),
    "lists": ("[", "1", "]"),
    "calls": ("f(", "1", ")"),
    "indices": ("x[", "1", "]"),
    "signs": ("-", "1", ""),
    "nots": ("not ", "a", ""),
    "powers": ("a^", "1", ""),
    "conditions": ("if a then b else ", "1", ""),
    "guards": ("if ", "a", " then b else c"),
}


@pytest.mark.parametrize("nest", NESTS.values(), ids=NESTS.keys())
def test_nesting_has_a_limit(nest: tuple[str, str, str]) -> None:
    before, inner, after = nest
    expression(before * 60 + inner + after * 60)
    assert codes(f"const real x = {before * 300 + inner + after * 300};") == ["E118"]
    assert codes(f"const real x = {before * 50_000}") == ["E118"]


def test_nested_blocks_have_the_same_limit() -> None:
    parsed("agent A() {" + "level l {" * 100 + "}" * 101)
    assert codes("agent A() {" + "level l {" * 200 + "}" * 201) == ["E118"]


def test_brackets_side_by_side_are_not_nested() -> None:
    expression("+".join(["-f(x[1])*(-a)^-b"] * 1000))
