"""Arrays of agents: blocks of elements that are coupled alike, what they read by columns, their groups, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hierc.compiler.arrays.columns import expanded
from hierc.compiler.driver import compile_source, model_of
from hierc.compiler.expression import Choose, Number
from hierc.compiler.model import Model, Node
from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile
from hierc.loader import run_module
from hierc.runtime.errors import SettingError

LAG = """
agent Lag(real k [1/s] = 1, real x0 = 0) {
  read real u;
  write real x = x0, y;
  alge { y = 2*x; }
  diff { x' = k*(u - x); }
}
"""


def model(text: str, **params: object) -> Model:
    top = None if "experiment" in text else "Road" if "agent Road" in text else "Top"
    return model_of(SourceFile("test.hier", LAG + text), top, params)


def codes(text: str) -> list[str]:
    with pytest.raises(ModelError) as caught:
        model(text)
    return [problem.code for problem in caught.value.problems if problem.severity == "error"]


def titles(text: str) -> list[str]:
    with pytest.raises(ModelError) as caught:
        model(text)
    return [problem.title() for problem in caught.value.problems if problem.severity == "error"]


def blocks(made: Model, path: str) -> list[Node]:
    return [node for node in made.nodes if node.path == path]


def owners(made: Model, path: str, index: int) -> list[int]:
    """The numbers of the elements of an array, by their last index."""
    found = {}
    for node in blocks(made, path):
        for k, i in enumerate(expanded(node.indices[-1], node.count).tolist()):
            found[i] = node.first + k
    return [found[i] for i in sorted(found)]


def reads(made: Model, node: Node, element: int) -> list[tuple[int, str, int]]:
    """What one element of a block reads."""
    return [
        (
            int(expanded(s.node, node.count)[element]),
            s.kind,
            int(expanded(s.index, node.count)[element]),
        )
        for s in node.inputs
    ]


# ---- blocks -------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 3, 50])
def test_a_chain_has_two_blocks(count: int) -> None:
    made = model(
        """agent Top(int N = 3) {
             agent car[i in 1..N] = Lag(k = 1 [1/s]*i) [u := if i == 1 then 1 else car[i - 1].x];
           }""",
        N=count,
    )
    assert [node.count for node in blocks(made, "car[]")] == ([1] if count == 1 else [1, count - 1])
    order = owners(made, "car[]", 0)
    for node in blocks(made, "car[]")[1:]:
        for k, i in enumerate(expanded(node.indices[0], node.count).tolist()):
            assert reads(made, node, k) == [(order[i - 2], "state", 0)]


def test_patterns_are_the_choices_of_all_conditions_on_indices() -> None:
    made = model(
        """agent Top() {
             agent car[i in 1..12] = Lag(k = if mod(i, 2) == 0 then 1 [1/s] else 2 [1/s])
               [u := if i <= 4 then 0 else if i <= 8 then car[1].x else car[2].y];
           }"""
    )
    found = {tuple(expanded(node.indices[0], node.count).tolist()) for node in blocks(made, "car[]")}
    assert found == {(1, 3), (2, 4), (5, 7), (6, 8), (9, 11), (10, 12)}


def test_structural_arguments_divide_an_array() -> None:
    made = model(
        """agent Vector(int n) { write real[n] q = zeros(n); diff { q' = -1 [1/s]*q; } }
           agent Top() { agent v[i in 1..6] = Vector(n = 1 + mod(i, 3)); }"""
    )
    assert sorted((node.count, len(node.states)) for node in blocks(made, "v[]")) == [(2, 1), (2, 2), (2, 3)]
    assert {v.shape for v in made.variables if v.path == "v[].q"} == {(1,), (2,), (3,)}


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(0, 1_000_000), min_size=1, max_size=12))
def test_indices_computed_by_constants(numbers: list[int]) -> None:
    count = len(numbers)
    parents = [0] + [1 + n % k for k, n in enumerate(numbers[1:], start=1)]
    made = model(
        f"""const int[{count}] parent = [{", ".join(map(str, parents))}];
            agent Top() {{
              agent a[i in 1..{count}] = Lag() [u := if parent[i] == 0 then 1 else a[parent[i]].x];
            }}"""
    )
    order = owners(made, "a[]", 0)
    for node in blocks(made, "a[]"):
        for k, i in enumerate(expanded(node.indices[0], node.count).tolist()):
            expected = [(order[parents[i - 1] - 1], "state", 0)] if parents[i - 1] else []
            assert reads(made, node, k) == expected


def test_elements_of_vectors_are_gathered() -> None:
    made = model(
        """agent Source(int n = 4) { write real[n] s = zeros(n); diff { s' = -1 [1/s]*s; } }
           agent Top(real[4] gain = [1, 2, 3, 4]) {
             const real[4] half = [0.5, 1.5, 2.5, 3.5];
             agent source = Source();
             agent a[i in 1..4] = Lag(x0 = gain[5 - i]) [u := source.s[i] + half[i] + gain[i]*time/(1 [s])];
           }"""
    )
    (node,) = blocks(made, "a[]")
    assert [reads(made, node, k) for k in range(4)] == [[(0, "state", k)] for k in range(4)]
    gain = next(p for p in made.parameters if p.path == "gain")
    columns = [expanded(entry, 4).tolist() for entry in node.parameters]
    assert [gain.first + k for k in range(4)] in columns
    assert any(constants.values == (0.5, 1.5, 2.5, 3.5) for constants in made.constants)


def test_an_array_in_an_array() -> None:
    made = model(
        """agent Robot(real w [1/s] = 1) {
             read real u;
             let half = 0.5*u;
             agent joint[j in 1..3] = Lag(k = w*j) [u := half + (if j == 1 then u else joint[j - 1].x)];
             write real tip;
             alge { tip = joint[3].y; }
           }
           agent Top() { agent robot[i in 1..4] = Robot(w = 1 [1/s]*i) [u := if i == 1 then 1 else robot[i - 1].tip]; }"""
    )
    joints = blocks(made, "robot[].joint[]")
    assert sorted(node.count for node in joints) == [1, 2, 3, 6]
    place = {}
    for node in joints:
        pairs = zip(*(expanded(c, node.count).tolist() for c in node.indices), strict=True)
        place.update({pair: (node, node.first + k, k) for k, pair in enumerate(pairs)})
    for (i, j), (node, _, k) in place.items():
        found = {number for number, kind, _ in reads(made, node, k) if kind == "state"}
        assert found == ({place[i, j - 1][1]} if j > 1 else set())
    entries = {
        i: [expanded(e, node.count)[k] for e in node.parameters]
        for (i, j), (node, _, k) in place.items()
        if j == 1
    }
    assert len({tuple(e) for e in entries.values()}) == 4


# ---- columns only -----------------------------------------------------------------------------------------------------------------


def test_neither_the_text_nor_the_model_grows_with_the_array() -> None:
    text = (
        LAG
        + """agent Top(int N = 100) {
               agent head = Lag() [u := 1];
               agent car[i in 1..N] = Lag(k = 1 [1/s]*i, x0 = -2*i) [u := if i == 1 then head.x else car[i - 1].x];
               agent mean = Lag() [u := sum(car.x)/N + max(car[2..N].y)];
               group each car;
             }"""
    )
    sizes = {}
    for count in (100, 10_000):
        source = SourceFile("test.hier", text)
        made = model_of(source, None, {"N": count})
        joins = sum(node.template in ("sum", "max") for node in made.nodes)
        sizes[count] = (
            len(made.nodes) - joins,
            len(made.groups),
            len(compile_source(source, None, {"N": count}).text),
        )
    assert sizes[100][:2] == sizes[10_000][:2]
    assert sizes[10_000][2] < 2 * sizes[100][2]


def test_a_billion_agents_are_refused_before_any_is_made() -> None:
    assert codes("agent Top() { agent car[i in 1..1000000000] = Lag() [u := 1]; }") == ["E215"]


def test_too_many_agents_in_arrays_of_arrays() -> None:
    assert codes(
        """agent Row() { agent car[i in 1..50000] = Lag() [u := 1]; }
           agent Top() { agent row[i in 1..500] = Row(); }"""
    ) == ["E215"]


# ---- groups and order ---------------------------------------------------------------------------------------------------------------


def names(made: Model) -> list[tuple[str, int]]:
    return [(group.name, group.count) for group in made.groups]


def test_each_agent_of_an_array_may_be_a_group() -> None:
    chain = "agent car[i in 1..9] = Lag() [u := if i == 1 then 1 else car[i - 1].x];"
    grouped = model(f"agent Top() {{ level all {{ {chain} }} group each car; }}")
    assert names(grouped) == [("car[]", 1), ("car[]", 8)]
    assert names(model(f"agent Top() {{ level all {{ {chain} }} }}")) == [("all", 1)]
    assert names(model(f"agent Top() {{ {chain} }}")) == [("car[]", 1), ("car[]", 8)]


def test_agents_of_an_array_that_need_each_other_are_one_group() -> None:
    ring = "agent car[i in 1..9] = Lag() [u := car[mod(i, 9) + 1].x];"
    assert names(model(f"agent Top() {{ {ring} }}")) == [("car", 1)]
    assert codes(f"agent Top() {{ level all {{ {ring} }} group each car; }}") == ["E603"]
    (title,) = titles(f"agent Top() {{ level all {{ {ring} }} group each car; }}")
    assert "`car[1]`, `car[2]`" in title


def test_groups_follow_what_they_read_element_by_element() -> None:
    made = model(
        """agent Top() {
             agent a[i in 1..5] = Lag() [u := if i == 5 then 1 else b[i + 1].x];
             agent b[i in 1..5] = Lag() [u := a[i].x];
           }"""
    )
    numbered = [
        (group.name, i) for group in made.groups for i in expanded(group.indices[0], group.count).tolist()
    ]
    order = numbered if made.order is None else [numbered[k] for k in made.order.values]
    place = {key: k for k, key in enumerate(order)}
    for i in range(1, 6):
        assert place["a[]", i] < place["b[]", i]
        assert i == 5 or place["b[]", i + 1] < place["a[]", i]


def test_levels_of_one_element_may_read_later_levels_of_another() -> None:
    robot = """agent Robot() {
                 read real u;
                 level plan { agent plan = Lag() [u := u]; }
                 level body { agent body = Lag() [u := plan.x]; }
                 write real out;
                 alge { out = body.x; }
               }"""
    fine = robot + "agent Top() { agent r[i in 1..3] = Robot() [u := if i == 1 then 1 else r[i - 1].out]; }"
    assert names(model(fine)) == [("r[].plan", 1), ("r[].body", 1), ("r[].plan", 2), ("r[].body", 2)]
    broken = robot.replace("[u := u]", "[u := u + body.x]")
    assert codes(broken + "agent Top() { agent r[i in 1..3] = Robot() [u := 1]; }") == ["E601"]


def test_a_large_level_without_a_loop_is_worth_a_warning() -> None:
    chain = "agent car[i in 1..{}] = Lag() [u := if i == 1 then 1 else car[i - 1].x];"
    ring = "agent car[i in 1..30] = Lag() [u := car[mod(i, 30) + 1].x];"
    for inside, warned in ((chain.format(30), True), (chain.format(5), False), (ring, False)):
        warnings = model(f"agent Top() {{ level all {{ {inside} }} }}").warnings
        assert ("W613" in [w.code for w in warnings]) == warned


# ---- loops --------------------------------------------------------------------------------------------------------------------------


def test_outs_along_an_array_are_no_loop() -> None:
    chain = "agent car[i in 1..9] = Through() [u := if i == 1 then 1 else car[i - 1].y];"
    through = "agent Through() { read real u; write real x = 0, y; alge { y = x + 0.5*u; } diff { x' = -1 [1/s]*x; } }"
    assert len(model(f"{through} agent Top() {{ {chain} }}").nodes) == 2
    ring = "agent car[i in 1..9] = Through() [u := car[mod(i, 9) + 1].y];"
    assert codes(f"{through} agent Top() {{ {ring} }}") == ["E506"]
    itself = "agent car[i in 1..9] = Through() [u := car[clamp(i, 3, 7)].y];"
    (title,) = titles(f"{through} agent Top() {{ {itself} }}")[:1]
    assert "`car[3].y` uses `car[3].y`" in title


def test_initial_values_along_an_array() -> None:
    ready = "agent Follow() { read real u; write real x = u; diff { x' = u - x; } }"
    chain = "agent car[i in 1..9] = Follow() [u := if i == 9 then 1 else car[i + 1].x];"
    assert len(model(f"{ready} agent Top() {{ {chain} }}").nodes) == 2
    ring = "agent car[i in 1..9] = Follow() [u := car[mod(i, 9) + 1].x];"
    assert codes(f"{ready} agent Top() {{ {ring} }}") == ["E507"]


# ---- from outside ---------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", ["row[2].one[1].k", "row.one[1].k"])
def test_a_subscript_after_a_single_agent(path: str) -> None:
    text = LAG + "agent Row() { agent one = Lag() [u := 1]; } agent Top() { agent row[i in 1..3] = Row(); }"
    assert model_of(SourceFile("test.hier", text), "Top", {"row[2].one.k": 2.0}).nodes
    with pytest.raises(ModelError) as caught:
        model_of(SourceFile("test.hier", text), "Top", {path: 2.0})
    assert [problem.code for problem in caught.value.problems] == ["E806"]


def test_a_misspelt_parameter_of_one_element() -> None:
    with pytest.raises(ModelError) as caught:
        model_of(SourceFile("test.hier", LAG + ROAD), "Road", {"car[2].kk": 1.0})
    assert caught.value.problems[0].help() == ("did you mean `car[2].k`?",)


ROAD = """agent Road(int N = 4) { agent car[i in 1..N] = Lag(k = 1 [1/s]*i) [u := 1]; }"""


@pytest.mark.parametrize(
    ("path", "value", "code"),
    [
        ("car.k", 2.0, None),
        ("car.k", [1.0, 2.0, 3.0, 4.0], None),
        ("car[2].k", 2.0, None),
        ("car[2..3].k", 2.0, None),
        ("car[2..3].k", [1.0, 2.0], None),
        ("car.k", [1.0, 2.0], "E802"),
        ("car[2..3].k", [1.0, 2.0, 3.0], "E802"),
        ("car[5].k", 2.0, "E801"),
        ("car[0..2].k", 2.0, "E801"),
        ("car[2].kk", 2.0, "E206"),
        ("cart[2].k", 2.0, "E206"),
        ("car[2].k", "two", "E911"),
        ("car[3..2].k", 2.0, "E805"),
        ("car[2].k[1].x", 2.0, "E206"),
    ],
)
def test_values_by_path(path: str, value: object, code: str | None) -> None:
    def made() -> Model:
        return model_of(SourceFile("test.hier", LAG + ROAD), None, {path: value})

    if code is None:
        assert made().nodes
        return
    with pytest.raises(ModelError) as caught:
        made()
    assert [problem.code for problem in caught.value.problems] == [code]


@pytest.mark.parametrize(
    ("items", "expected"),
    [
        ("record car[2..3].x;", ("car[2..3].x",)),
        ("record car.y, car[4].x;", ("car.y", "car[4].x")),
        ("record car[1].*;", ("car[1].x", "car[1].y")),
        ("record car.*;", ("car.x", "car.y")),
    ],
)
def test_records_of_elements(items: str, expected: tuple[str, ...]) -> None:
    made = model(f"{ROAD} experiment e of Road() {{ stop = 1 [s]; {items} }}")
    assert made.experiment.record == expected


@pytest.mark.parametrize(
    ("items", "code"),
    [
        ("record car[5].x;", "E801"),
        ("record car[2].z;", "E904"),
        ("record car[3..2].x;", "E805"),
        ("init { car[4].x = 1; car[1..4].x = 2; }", None),
        ("init { car[5].x = 1; }", "E801"),
        ("init { car[0..3].x = 1; }", "E801"),
        ("init { car[3..2].x = 1; }", "E805"),
        ("group cars { rtol = 1e-3; }", "E910"),
        ("group car { rtol = 1e-3; }", None),
        ("group car[1] { rtol = 1e-3; } group car[4] { rtol = 1e-3; }", None),
        ("group car[5] { rtol = 1e-3; }", "E801"),
        ("group car[3..5] { rtol = 1e-3; }", "E801"),
        ("group car[4].x { rtol = 1e-3; }", "E910"),
    ],
)
def test_paths_of_experiments(items: str, code: str | None) -> None:
    text = f"{ROAD} experiment e of Road() {{ stop = 1 [s]; {items} }}"
    if code is None:
        assert model(text).nodes
    else:
        assert codes(text) == [code]


@pytest.mark.parametrize("element", ["car[5]", "car[0]", "car[2..5]"])
def test_arguments_of_elements_that_are_not_there(element: str) -> None:
    assert codes(f"{ROAD} experiment e of Road({element}.k = 2) {{ stop = 1 [s]; }}") == ["E801"]


def test_elements_of_arrays_that_differ_in_size() -> None:
    """A subscript counts among the elements that those before it chose."""
    rows = """agent Row(int n) { agent car[i in 1..n] = Lag() [u := 1]; }
        agent Grid() { agent row[i in 1..3] = Row(n = i); }"""
    text = f"{rows} experiment e of Grid(row[%s].car[2].k = 2) {{ stop = 1 [s]; }}"
    assert model(text % "2..3").nodes
    assert codes(text % "1") == ["E801"]


def test_groups_of_agents_that_are_coupled_differently() -> None:
    chain = """agent Road() { agent car[i in 1..4] = Lag() [u := if i == 1 then 1 else car[i - 1].x]; }
        experiment e of Road() { stop = 1 [s]; group car[%s] { rtol = 1e-3; } }"""
    for index in ("1", "2", "1..4"):
        assert len(model(chain % index).groups) == 2
    assert codes(chain % "0..2") == ["E801"]


@pytest.mark.parametrize(
    ("items", "record", "code"),
    [
        ("record tip[1].q, tip[3].q[3];", ("tip[1].q", "tip[3].q[3]"), None),
        ("record tip[2..3].q[1..2];", ("tip[2..3].q[1]", "tip[2..3].q[2]"), None),
        ("record tip.q[1], tip[1..2].*;", ("tip.q[1]", "tip[1..2].q"), None),
        ("record tip.q[2];", (), "E303"),
        ("init { tip[3].q = [4, 5, 6]; tip[2..3].q[2] = 1; }", (), None),
        ("init { tip[2].q = [4, 5, 6]; }", (), "E302"),
    ],
)
def test_elements_that_differ_in_shape(items: str, record: tuple[str, ...], code: str | None) -> None:
    text = f"""agent Tip(int n) {{ write real[n] q = zeros(n); diff {{ q' = -q; }} }}
        agent Road() {{ agent tip[i in 1..3] = Tip(n = i); }}
        experiment e of Road() {{ stop = 1 [s]; {items} }}"""
    if code is None:
        assert model(text).experiment.record == record
    else:
        assert codes(text) == [code]


def test_subscripts_of_an_experiment_are_computed() -> None:
    items = "stop = 1 [s]; group car[last] { rtol = 1e-3; } group car[2..last] { atol = 1e-3; } record car[last - 1].x;"
    made = model(f"const int last = 4; {ROAD} experiment e of Road() {{ {items} }}")
    assert [name for name, _ in made.experiment.groups] == ["car[4]", "car[2..4]"]
    assert made.experiment.record == ("car[3].x",)


def test_gifts_of_an_experiment_to_elements() -> None:
    made = model(
        f"{ROAD} experiment e of Road(car[2].k = 9, car[3..4].k = 8) {{ stop = 1 [s]; init {{ car[1].x = 5; }} }}"
    )
    (k,) = (p for p in made.parameters if p.path == "car[].k")
    assert "Choose" in type(k.values[0]).__name__
    assert np.prod(k.count) == 4


def test_what_means_fewer_elements_holds_and_nothing_is_given_twice() -> None:
    for args in ("car[2].k = 9, car.k = 8", "car.k = 8, car[2].k = 9"):
        made = model(f"{ROAD} experiment e of Road({args}) {{ stop = 1 [s]; }}")
        (k,) = (p for p in made.parameters if p.path == "car[].k")
        given = k.values[0]
        assert isinstance(given, Choose)
        assert [e.value for e in (given.then, given.other) if isinstance(e, Number)] == [9.0, 8.0]
    for items in ("init { car[2].x = 1; car[2].x = 2; }", "init { car[1..2].x = 1; car[2..3].x = 2; }"):
        assert codes(f"{ROAD} experiment e of Road() {{ stop = 1 [s]; {items} }}") == ["E214"]


def test_conditions_on_indices_in_lists_and_functions() -> None:
    made = model(
        """func real pick(int i, real a, real b) = if i == 1 then a else b;
           agent Top() {
             agent b[i in 1..6] = Lag() [u := 1];
             agent a[i in 1..6] = Lag() [u := sum([if i + j <= 6 then b[i + j].x else 0 for j in 0..2])
                                           + pick(i, 1, if i > 1 then a[i - 1].x else 0)];
           }"""
    )
    order, others = owners(made, "a[]", 0), owners(made, "b[]", 0)
    for node in blocks(made, "a[]"):
        for k, i in enumerate(expanded(node.indices[0], node.count).tolist()):
            expected = {others[i + j - 1] for j in range(3) if i + j <= 6}
            expected |= {order[i - 2]} if i > 1 else set()
            assert {number for number, _, _ in reads(made, node, k)} == expected


def test_sums_keep_their_type_however_many_they_join() -> None:
    count = "div(sum([if a[j].x > 0 then 1 else 0 for j in 1..N]), 2)"
    for size in (30, 40):
        made = model(
            f"""agent Top(int N = 3) {{
                  agent a[i in 1..N] = Lag() [u := 1];
                  agent half = Lag() [u := {count}];
                }}""",
            N=size,
        )
        assert made.nodes


def test_one_element_has_one_shape() -> None:
    made = model(
        """agent Vector(int n) { write real[n] q = zeros(n); diff { q' = -1 [1/s]*q; } }
           agent Top() { agent v[i in 2..3] = Vector(n = i); write real s; alge { s = v[2].q[1] + sum(v[3].q); } }"""
    )
    (top,) = blocks(made, "")
    assert len(top.inputs) == 4


def test_agents_that_need_each_other_in_every_element_are_one_family() -> None:
    pair = """agent Pair(real c = 1) {
             read real g;
             agent p = Lag(k = c*1 [1/s]) [u := q.x + g];
             agent q = Lag() [u := -p.x];
             write real o;
             alge { o = p.x; }
           }"""
    for chain in (
        "if i == 1 then 0 else r[i - 1].o",
        "if i == 50 then 0 else r[i + 1].o",
        "if i == 1 then 0 else i",
    ):
        made = model(f"{pair} agent Top() {{ agent r[i in 1..50] = Pair(c = i) [g := {chain}]; }}")
        assert sorted(names(made)) == [("r[].p+r[].q", 1), ("r[].p+r[].q", 49)]


def test_an_index_may_hide_a_parameter() -> None:
    """Then the parameter is not structural: what the index chooses is known without it."""
    made = model(
        """agent Row(real i = 1) {
             write real[3] q = zeros(3);
             diff { for i in 1..3 { q[i]' = -q[i]*1 [1/s]; } }
           }
           agent Top(real k = 2) {
             agent row[j in 1..4] = Row(i = 1/j);
             agent lag[k in 1..4] = Lag() [u := row[k].q[1]];
           }"""
    )
    assert {p.path for p in made.parameters if p.structural} == set()


@pytest.mark.parametrize(
    ("path", "value", "code"),
    [
        ("row.one.k", [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], None),
        ("row[2..3].one.k", [[1.0, 2.0], [3.0, 4.0]], None),
        ("row[2].one.k", [1.0, 2.0], None),
        ("row.one[2].k", [1.0, 2.0, 3.0], None),
        ("row.one.k", [[1.0, 2.0], [3.0, 4.0]], "E802"),
        ("row.one.k", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "E911"),
        ("row[2].one.k", [1.0, 2.0, 3.0], "E802"),
    ],
)
def test_values_for_arrays_in_arrays(path: str, value: object, code: str | None) -> None:
    """As when a run is given them: a list of lists."""
    text = (
        LAG
        + "agent Row() { agent one[j in 1..2] = Lag() [u := 1]; } agent Top() { agent row[i in 1..3] = Row(); }"
    )
    source = SourceFile("test.hier", text)
    model = run_module(compile_source(source, "Top").text, "test.hier").MODEL
    if code is None:
        assert model_of(source, "Top", {path: value}).nodes
        given = model.with_parameters({path: value}).parameters["row.one.k"].value
        assert set(np.ravel(value)) <= set(np.ravel(given))
        return
    with pytest.raises(ModelError) as caught:
        model_of(source, "Top", {path: value})
    assert [problem.code for problem in caught.value.problems] == [code]
    with pytest.raises(SettingError):
        model.with_parameters({path: value})
