"""Sums and extremes over slices of arrays that differ from element to element: what their nodes join, how many there are, and who depends on whom."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hierc.compiler.arrays.columns import Integers, expanded
from hierc.compiler.arrays.elements import Elements
from hierc.compiler.cascade.detours import inputs_behind
from hierc.compiler.driver import compile_source, model_of
from hierc.compiler.model import Model
from hierc.compiler.structure.slices import WIDTH, Row, Slices
from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile

# ---- rows -----------------------------------------------------------------------------------------


class Nodes:
    """Keeps what is joined: the scalars of a row are 0, 1, …, joined ones follow."""

    def __init__(self, rows: int, width: int) -> None:
        self.terms: list[Counter[int]] = []
        self.joined: list[Counter[int]] = []
        self.depth: list[int] = []
        self.scalars = np.arange(rows * width).reshape(rows, width)
        self.row = Row(self.make, "state", self.scalars)

    def make(self, kind: str, scalars: Integers, sizes: Integers, places: Integers) -> Integers:
        first = len(self.joined)
        assert scalars.shape[1] == sizes.max() <= WIDTH
        for numbers, size in zip(scalars.tolist(), sizes.tolist(), strict=True):
            parts = numbers[:size]
            if kind == "state":
                self.joined.append(Counter(parts))
                self.depth.append(1)
            else:
                self.joined.append(sum((self.joined[p] for p in parts), Counter()))
                self.depth.append(1 + max(self.depth[p] for p in parts))
        return np.arange(first, len(self.joined))


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_a_slice_joins_its_own_scalars_once(data: st.DataObject) -> None:
    rows, width = data.draw(st.integers(1, 3)), data.draw(st.integers(1, 200))
    nodes = Nodes(rows, width)
    for _ in range(data.draw(st.integers(1, 3))):
        place = st.tuples(st.integers(0, rows - 1), st.integers(0, width - 1), st.integers(0, width - 1))
        wanted = [
            (r, min(a, b), max(a, b)) for r, a, b in data.draw(st.lists(place, min_size=1, max_size=30))
        ]
        numbers = nodes.row.joined(Slices(*(np.array(column) for column in zip(*wanted, strict=True))))
        for (row, first, last), number in zip(wanted, numbers.tolist(), strict=True):
            assert nodes.joined[number] == Counter(nodes.scalars[row, first : last + 1].tolist())


@pytest.mark.parametrize("width", [50, 500, 5000])
@pytest.mark.parametrize("forward", [True, False])
def test_all_beginnings_or_ends_take_few_nodes_and_short_ways(width: int, forward: bool) -> None:
    nodes = Nodes(1, width)
    here, ends = np.arange(width), np.full(width, width - 1)
    slices = Slices(0 * here, 0 * here, here) if forward else Slices(0 * here, here, ends)
    numbers = nodes.row.joined(slices)
    assert len(nodes.joined) < 2.5 * width
    assert max(nodes.depth[n] for n in numbers.tolist()) <= 2 * np.ceil(np.log(width) / np.log(WIDTH))


def test_what_was_joined_is_joined_once() -> None:
    nodes = Nodes(1, 300)
    here = np.arange(0, 300, 2)
    first = nodes.row.joined(Slices(0 * here, 0 * here, here))
    count = len(nodes.joined)
    again = nodes.row.joined(Slices(0 * here, 0 * here, here))
    assert (first == again).all()
    assert len(nodes.joined) == count


# ---- models ---------------------------------------------------------------------------------------

CAR = """
agent Car() {
  read real u;
  write real x = 1, y;
  alge { y = 2*x; }
  diff { x' = u - x; }
}
"""


def model(coupling: str, **params: object) -> Model:
    text = f"{CAR} agent Road(int N = 50) {{ agent car[i in 1..N] = Car() [u := {coupling}]; }}"
    return model_of(SourceFile("test.hier", text), "Road", params)


def cars_read(made: Model) -> dict[int, set[int]]:
    """For each car the cars whose states its equations use, whatever is between."""
    elements = Elements(node.first for node in made.nodes)
    found = {}
    for node in made.nodes:
        for k in range(node.count if node.states else 0):
            seen: set[int] = set()
            waiting = [source_of(made, node.id, i, k) for i in range(len(node.inputs))]
            while waiting:
                element, index = waiting.pop()
                block = made.nodes[elements.block(element)]
                if block.states:
                    seen.add(index_of(made, elements, element))
                else:
                    at = element - block.first
                    waiting += [source_of(made, block.id, i, at) for i in inputs_behind(block, index)]
            found[index_of(made, elements, node.first + k)] = seen
    return found


def source_of(made: Model, block: int, k: int, place: int) -> tuple[int, int]:
    node = made.nodes[block]
    source = node.inputs[k]
    return int(expanded(source.node, node.count)[place]), int(expanded(source.index, node.count)[place])


def index_of(made: Model, elements: Elements, element: int) -> int:
    node = made.nodes[elements.block(element)]
    return int(expanded(node.indices[0], node.count)[element - node.first])


@pytest.mark.parametrize(
    ("coupling", "wanted"),
    [
        ("sum(car[1..i-1].x)", lambda i, n: range(1, i)),
        ("sum(car[i+1..N].y)", lambda i, n: range(i + 1, n + 1)),
        ("max(car[1..i].x)", lambda i, n: range(1, i + 1)),
        ("sum(car[max(1, i-11)..i-1].y)", lambda i, n: range(max(1, i - 11), i)),
        ("sum([car[k].x^2 for k in 1..i-1])", lambda i, n: range(1, i)),
        ("if mod(i, 2) == 0 then sum(car[1..i-1].x) else 0", lambda i, n: range(1, i) if i % 2 == 0 else ()),
    ],
)
def test_elements_depend_on_their_slices_alone(coupling: str, wanted: object) -> None:
    made = model(coupling, N=150)
    assert cars_read(made) == {i: set(wanted(i, 150)) for i in range(1, 151)}  # type: ignore[operator]


@pytest.mark.parametrize(
    "coupling", ["sum(car[1..i-1].x)", "sum(car[i+1..N].y)", "sum([car[k].x^2 for k in 1..i-1])"]
)
def test_each_of_a_cascade_is_a_group(coupling: str) -> None:
    """Nothing that is joined makes an element need a later one."""
    made = model(coupling, N=600)
    assert sum(group.count for group in made.groups if group.name == "car[]") == 600
    assert not any(group.name == "car" for group in made.groups)


def test_elements_that_need_each_other_are_one_group() -> None:
    made = model("sum(car[1..i-1].x) + sum(car[i+1..N].x)", N=100)
    assert [(group.name, group.count) for group in made.groups] == [("car", 1)]


@pytest.mark.parametrize("coupling", ["sum(car[1..i-1].x)", "if i == 1 then 0 else min(car[1..i-1].x)"])
def test_kinds_do_not_grow_with_the_array(coupling: str) -> None:
    counts = []
    for count in (100, 800, 6400):
        made = model(coupling, N=count)
        counts.append((sum(node.path == "car[]" for node in made.nodes), len(made.nodes)))
    assert [kinds for kinds, _ in counts] == [1, 1, 1] if "if" not in coupling else [2, 2, 2]
    assert np.diff([nodes for _, nodes in counts]).max() <= 2 * (np.log(8) / np.log(WIDTH))


def test_the_text_of_one_group_hardly_grows() -> None:
    text = (
        CAR
        + """agent Road(int N = 100) {
      level drive { agent car[i in 1..N] = Car() [u := sum(car[1..i-1].x)]; }
    }"""
    )
    source = SourceFile("test.hier", text)
    sizes = [len(compile_source(source, None, {"N": count}).text) for count in (100, 6400)]
    assert sizes[1] < 2 * sizes[0]


def test_few_lengths_are_written_out() -> None:
    made = model("sum(car[max(1, i-2)..min(N, i+2)].x)")
    assert sorted(node.count for node in made.nodes) == [2, 2, 46]
    assert not any(node.template == "sum" for node in made.nodes)


# ---- mistakes -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("coupling", "code", "words"),
    [
        ("sum(car[1..i+1].x)", "E801", "for `i = 50`"),
        ("sum(car[i-1..N].x)", "E801", "for `i = 1`"),
        ("max(car[1..i-1].x)", "E306", "got `real[0]`"),
        ("max([car[k].x for k in 1..i-1])", "E306", "got `real[0]`"),
        ("sum([car[k+1].x for k in 1..i])", "E801", "for `k = 50`"),
    ],
)
def test_mistakes(coupling: str, code: str, words: str) -> None:
    with pytest.raises(ModelError) as caught:
        model(coupling)
    (problem,) = caught.value.problems
    assert problem.code == code
    assert words in problem.title()


@pytest.mark.parametrize(
    "coupling", ["norm(car[1..i].x)", "sum([car[k].x*i for k in 1..i])", "sum(2*car[1..i].x)"]
)
def test_other_slices_divide_the_array(coupling: str) -> None:
    made = model(coupling, N=20)
    assert sum(node.path == "car[]" for node in made.nodes) == 20
    with pytest.raises(ModelError, match="E804"):
        model(coupling, N=1000)
