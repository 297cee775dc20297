"""The layout engine: what a line may hold and where it ends."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hierc.grammar.formatting.layout import (
    Aside,
    Break,
    Concat,
    Doc,
    Group,
    Indent,
    Line,
    Wrap,
    concat,
    is_forced,
    layout,
    spaced,
    width_of,
)


def row(*words: str, kept: int = -1) -> Doc:
    first, *others = words
    return Group(concat(first, *(Wrap(" ", word, kept == i) for i, word in enumerate(others, 1))))


def test_a_group_is_on_one_line_or_on_as_many_as_it_has() -> None:
    call = Group(concat("f(", Indent(concat(Line(""), "aaa,", Line(), "bbb")), Line(""), ")"))
    assert layout(call, 11) == "f(aaa, bbb)\n"
    assert layout(call, 10) == "f(\n  aaa,\n  bbb\n)\n"


def test_what_follows_a_group_counts_up_to_where_a_line_may_end() -> None:
    inner = Group(concat("(", Indent(concat(Line(""), "aaaa")), Line(""), ")"))
    assert layout(concat(inner, ";"), 7) == "(aaaa);\n"
    assert layout(concat(inner, ";;"), 7) == "(\n  aaaa\n);;\n"
    assert layout(concat(inner, Group(concat(Line(), "bbbb"))), 7) == "(aaaa)\nbbbb\n"
    assert layout(concat(inner, Aside("  // a remark"), Break()), 7) == "(aaaa)  // a remark\n"


def test_a_row_ends_lines_where_they_are_full_or_the_writer_did() -> None:
    assert layout(row("aa", "bb", "cc", "dd"), 8) == "aa bb cc\ndd\n"
    assert layout(row("aa", "bb", "cc", "dd", kept=1), 8) == "aa\nbb cc dd\n"
    assert layout(row("aa", "bb", "cc", "dd", kept=1), 11) == "aa bb cc dd\n"
    assert layout(row("aa", "a_word_that_is_too_long", "cc"), 8) == "aa\na_word_that_is_too_long\ncc\n"


def test_due_lines_are_one_and_leave_no_blanks() -> None:
    block = concat(
        "{",
        " ",
        Indent(concat(Line(), Break(), Break(blank=True), " ", "a", " ")),
        Line(blank=True),
        "}",
        " ",
    )
    assert layout(block, 80) == "{\n\n  a\n\n}\n"
    assert layout(concat(Break(blank=True), "a"), 80) == "a\n"
    assert layout("", 80) == ""


def test_a_break_breaks_the_groups_around_it_and_no_others() -> None:
    inner = Group(concat("x", Line(), "y"))
    outer = Group(concat(inner, Line(), Group(concat("a", Break(), "b", Line(), "c"))))
    assert layout(outer, 80) == "x y\na\nb\nc\n"


def test_text_of_several_lines_ends_in_the_column_of_its_last() -> None:
    assert layout(concat("/* a\n   b */", row(" x", "y")), 10) == "/* a\n   b */ x\ny\n"


def test_spaces_stand_between_what_is_there() -> None:
    assert layout(spaced("a", None, "b"), 80) == "a b\n"


def test_depth_is_no_danger() -> None:
    doc: Doc = "x"
    for _ in range(10_000):
        doc = Group(Indent(concat("(", doc, ")")))
    assert layout(doc, 80).lstrip() == "(" * 10_000 + "x" + ")" * 10_000 + "\n"


def docs() -> st.SearchStrategy[Doc]:
    leaves: st.SearchStrategy[Doc] = st.one_of(
        st.text("ab", min_size=1, max_size=12), st.just(Line()), st.just(Line("")), st.just(Break())
    )
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.lists(inner, max_size=5).map(lambda parts: Concat(tuple(parts))),
            inner.map(Indent),
            st.builds(Group, inner, st.booleans()),
            st.builds(Wrap, st.sampled_from(["", " "]), inner, st.booleans()),
        ),
        max_leaves=30,
    )


def words(doc: Doc) -> str:
    match doc:
        case str():
            return doc.strip()
        case Concat():
            return "".join(map(words, doc.parts))
        case Indent() | Group():
            return words(doc.inner)
        case Wrap():
            return words(doc.item)
        case _:
            return ""


@given(docs(), st.integers(1, 60))
def test_no_text_is_lost_and_what_fits_is_on_one_line(doc: Doc, width: int) -> None:
    text = layout(doc, width)
    assert "".join(text.split()) == words(doc)
    assert all(line == line.rstrip() for line in text.split("\n"))
    whole = layout(Group(doc), width)
    assert whole.count("\n") <= 1 or is_forced(doc) or width_of(doc) > width
