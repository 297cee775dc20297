"""The pieces under arrays of agents, each against the plain way of doing it."""

import base64
import zlib
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import integers

from hierc.compiler.arrays.columns import Column
from hierc.compiler.arrays.elements import Elements, distinct, ranges, spelled
from hierc.compiler.emission import packing
from hierc.compiler.emission.runs import Run, members
from hierc.compiler.emission.sequence import Circular, Link, sequence
from hierc.compiler.emission.target import Assign, Name, show
from hierc.compiler.model import Source
from hierc.runtime import contract

LIMITS = settings(max_examples=300, deadline=None, derandomize=True)
numbers = st.integers(-(2**30), 2**30 - 1)


def printed(target):
    names = {"Steps": contract.Steps, "Packed": contract.Packed, "Run": contract.Run}
    exec(show([Assign(Name("found"), target)]), names)
    return names["found"]


# ---- columns as text -----------------------------------------------------------------------------


@LIMITS
@given(st.lists(numbers, min_size=1, max_size=60) | st.lists(st.integers(0, 3), min_size=2, max_size=300))
def test_columns_read_back(values):
    assert integers(printed(packing.column(Column(values))), len(values)) == values


@pytest.mark.parametrize(
    ("values", "form"),
    [
        (range(5, 2000), contract.Steps(5)),
        (range(90, 30, -3), contract.Steps(90, -3)),
        ([4, 4, 4], contract.Steps(4, 0)),
        ([3, 1], contract.Steps(3, -2)),
        ([3, 1, 2], (3, 1, 2)),
        ([7], (7,)),
    ],
)
def test_the_shortest_form_is_taken(values, form):
    assert printed(packing.column(Column(list(values)))) == form


def test_what_is_packed_is_as_the_contract_says():
    values = [3 * k * k % 1000 for k in range(500)]
    text = printed(packing.column(Column(values))).text
    differences = np.frombuffer(zlib.decompress(base64.b64decode(text)), "<i4")
    assert np.cumsum(differences).tolist() == values


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="32 bits"):
        packing.packed(np.array([0, 2**31]))


# ---- runs ----------------------------------------------------------------------------------------


def unrolled(entries, groups):
    """Rows of elements, by the contract's words."""
    rows = []
    for entry in entries:
        if isinstance(entry, Run):
            rows += [
                [entry.first + k * entry.step + g * entry.shift for g in range(groups)]
                for k in range(entry.count)
            ]
        else:
            rows.append([entry] * groups if isinstance(entry, int) else entry.values.tolist())
    return rows


@LIMITS
@given(
    st.integers(1, 4),
    st.lists(
        st.tuples(st.integers(0, 9), st.integers(-2, 2), st.integers(0, 3), st.integers(1, 5)),
        min_size=1,
        max_size=5,
    ),
)
def test_runs_are_the_rows_they_stand_for(groups, pieces):
    """Rows with stretches that can be told by a rule, and places where it changes."""
    rows = [
        [first + k * step + g * shift for g in range(groups)]
        for first, step, shift, count in pieces
        for k in range(count)
    ]
    assert unrolled(members(np.array(rows)), groups) == rows


def test_regular_rows_are_one_entry():
    rows = np.arange(3000).reshape(50, 60).T
    assert members(rows) == [Run(0, 60, 1, 60)]
    assert members(np.arange(100, 0, -1)[:, None]) == [Run(100, 100, -1, 0)]
    assert members(np.arange(7)[None, :]) == [Column(range(7))]


# ---- order ----------------------------------------------------------------------------------------


@st.composite
def links(draw):
    """Items of a few vertices, of which each may need some that come before it in a secret order."""
    sizes = draw(st.lists(st.integers(1, 6), min_size=1, max_size=4))
    items = [(v, k) for v, size in enumerate(sizes) for k in range(size)]
    secret = draw(st.permutations(items))
    found = []
    for place, (v, k) in enumerate(secret[1:], start=1):
        for at in draw(st.lists(st.integers(0, place - 1), max_size=2)):
            w, j = secret[at]
            found.append(Link(v, w, np.array([k]), np.array([j])))
    return sizes, found


@LIMITS
@given(links())
def test_items_come_after_those_they_need(case):
    sizes, found = case
    order = [(v, k) for v, items in sequence(sizes, found, range(len(sizes))) for k in items.tolist()]
    assert sorted(order) == [(v, k) for v, size in enumerate(sizes) for k in range(size)]
    place = {item: n for n, item in enumerate(order)}
    for link in found:
        assert place[link.source, int(link.sources[0])] < place[link.reader, int(link.readers[0])]


def test_only_what_is_wanted_comes():
    everything = [Link(1, 0, np.arange(3), np.arange(3))]
    assert [v for v, _ in sequence([3, 3, 3], everything, [1])] == [0, 1]


def test_items_that_need_each_other_have_no_order():
    ring = Link(0, 0, np.arange(4), np.array([1, 2, 3, 0]))
    with pytest.raises(Circular):
        sequence([4], [ring], [0])


# ---- elements --------------------------------------------------------------------------------------


def test_elements_know_their_blocks():
    elements = Elements([0, 1, 5])
    assert (
        elements.blocks(np.arange(8)).tolist()
        == [elements.block(n) for n in range(8)]
        == [0, 1, 1, 1, 1, 2, 2, 2]
    )
    assert elements.touched(Source(Column([0, 1, 2]), "state", 4), 3) == [(0, 4), (1, 4)]
    assert elements.touched(Source(Column([0, 1, 2]), "state", Column([4, 3, 3])), 3) == [(0, 4), (1, 3)]
    assert elements.touched(Source(6, "state", Column([4, 3, 4])), 3) == [(2, 3), (2, 4)]


@LIMITS
@given(st.lists(st.integers(-3, 3), min_size=1) | st.lists(numbers, min_size=1).map(sorted))
def test_distinct_integers(values):
    assert distinct(np.array(values)).tolist() == sorted(set(values))


@LIMITS
@given(st.sets(st.integers(-5, 40), min_size=1))
def test_ranges_name_all_of_few_integers(values):
    text = ranges(np.array(sorted(values)))
    parts = [part.split("..") for part in text.split(", ")]
    if ["", "."] not in parts:
        assert [n for part in parts for n in range(int(part[0]), int(part[-1]) + 1)] == sorted(values)
        assert all(int(b[0]) > int(a[-1]) + 1 for a, b in pairwise(parts))
    else:
        assert len(parts) == 4
        assert (int(parts[0][0]), int(parts[-1][-1])) == (min(values), max(values))


@pytest.mark.parametrize(
    ("path", "indices", "text"),
    [
        ("lead", (), "lead"),
        ("car[].engine", (Column([2, 3, 4]),), "car[2..4].engine"),
        ("car[]", (7,), "car[7]"),
        ("robot[].joint[].q", (Column([1, 1, 2, 2]), Column([1, 2, 1, 2])), "robot[1..2].joint[1..2].q"),
        ("robot[].joint[]", (Column([1, 2, 3]), Column([1, 2, 3])), "robot[1..3].joint[1..3] (3 of 9)"),
        ("bee[]", (Column([9, 1, 5, 3, 7]),), "bee[1, 3, ..., 9]"),
    ],
)
def test_names_of_several_elements(path, indices, text):
    assert spelled(path, indices) == text
