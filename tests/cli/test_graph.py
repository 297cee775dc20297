"""`hierc graph`: the structure found is that of the model, and every form of it says the same."""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path

import pytest

from hierc.cli import main
from hierc.compiler.diagram import Diagram, diagram
from hierc.compiler.driver import model_of
from hierc.compiler.model import Model
from hierc.grammar.source import SourceFile
from hierc.graph import ASCII, UNICODE, marks_for, to_dot, to_json, to_text
from hierc.loader import packaged_models, read


def model_named(name: str) -> Model:
    """The model of a text, or of a packaged file."""
    text = read(name)
    return model_of(text.source, reader=text.finder)


#: A gain inside a feedback loop (`s`), one before it (`g`), groups by name, an observer, and a start that reads a later level.
MODEL = """
agent Lag(real T = 1) { read real u; write real y = 0; diff { y' = (u - y)/T; } }
agent Gain(real k = 1) { read real u; write real y; alge { y = k*u; } }
agent Source() { write real y = 0; diff { y' = 1 - y; } }
agent Late() { read real start; write real y = start; diff { y' = -y; } }
agent Loop() {
  level plan { agent a = Source(); agent b = Lag() [u := a.y]; agent g = Gain() [u := b.y]; }
  level body { agent p = Lag() [u := s.y]; agent s = Gain() [u := g.y - q.y]; agent q = Lag() [u := p.y]; }
  level tip {
    agent t1 = Lag() [u := p.y]; agent t2 = Lag() [u := q.y + t1.y]; agent late = Late() [start := a.y];
    group fast = t2; group mid = t1;
  }
  write real out;
  alge { out = t2.y - a.y; }
}
"""


@pytest.fixture(scope="module")
def loop() -> Diagram:
    return diagram(model_named(MODEL))


def test_members_stand_in_blocks_slow_ones_first(loop: Diagram) -> None:
    blocks: dict[int, set[str]] = {}
    for member in loop.members:
        blocks.setdefault(member.block, set()).add(member.path)
    assert [{"a", "b"}, {"g"}, {"p", "q", "s"}] == list(blocks.values())[:3]
    assert {frozenset(block) for block in list(blocks.values())[3:]} == {
        frozenset(block) for block in ({"t1"}, {"t2"}, {"late"}, {"Loop"})
    }
    assert {m.path: m.group for m in loop.members} == {
        "a": "plan", "b": "plan", "g": None, "p": "body", "q": "body", "s": None,
        "t1": "mid", "t2": "fast", "late": "tip", "Loop": None,
    }  # fmt: skip


def test_reads_are_those_of_continuous_equations(loop: Diagram) -> None:
    reads = {m.path: [name for reading in m.reads for name in reading.names] for m in loop.members}
    assert reads == {
        "a": [], "b": ["a.y"], "g": ["b.y"], "s": ["g.y", "q.y"], "p": ["s.y"], "q": ["p.y"],
        "t1": ["p.y"], "t2": ["q.y", "t1.y"], "late": [], "Loop": ["a.y", "t2.y"],
    }  # fmt: skip


@pytest.mark.parametrize("name", [*packaged_models(), "loop"])
def test_every_diagram_is_block_triangular(name: str) -> None:
    made = diagram(model_named(MODEL if name == "loop" else name))
    assert all(a.block <= b.block for a, b in pairwise(made.members))
    for member in made.members:
        assert all(made.members[reading.owner].block <= member.block for reading in member.reads)


def test_vectors_have_one_name_where_they_are_read_whole() -> None:
    parts = """
    agent P() { write real[3] p = [0, 0, 0]; diff { p' = [1, 1, 1]; } }
    agent Q() { read real[3] w; read real one; write real x = 0; diff { x' = w[1] + w[2] + w[3] + one; } }
    agent Top() { agent a = P(); agent b = Q() [w := a.p', one := a.p[2]]; }
    """
    (a, b) = diagram(model_named(parts)).members
    assert (a.path, b.path) == ("a", "b")
    assert [reading.names for reading in b.reads] == [("a.p'", "a.p[2]")]


def test_the_table_shows_the_matrix(loop: Diagram) -> None:
    lines = to_text(loop, ASCII, 100).splitlines()
    assert lines[0] == "Loop (<text>): 5 groups, 7 states"
    assert " 4  -       s: Gain          0   .  .  x  #  o  x              g.y, q.y" in lines
    assert " 5  body    p: Lag           1   .  .  .  x  #  o              s.y" in lines
    assert "10    tip   late: Late       1   .  .  .  .  .  .  .  .  .  #" in lines
    assert sum(line.startswith("---") for line in lines) == len({member.block for member in loop.members})


NESTED = """
agent Lag(real T = 1) { read real u; write real y = 0; diff { y' = (u - y)/T; } }
agent Robot() {
  read real u;
  level body { agent b = Lag() [u := u]; }
  level motors {
    level slow { write real[2] p = [0, 0]; diff { p' = [b.y, b.y'] - p; } }
    level fast { agent m = Lag() [u := p[2]]; }
  }
  write real y;
  alge { y = m.y; }
}
agent Cell() {
  level plan { agent plan = Lag() [u := 1]; }
  level robots { agent robot = Robot() [u := plan.y]; agent other = Lag() [u := robot.y]; }
}
"""


@pytest.fixture(scope="module")
def cell() -> Diagram:
    return diagram(model_named(NESTED))


def test_levels_that_hold_several_groups_are_headings(cell: Diagram) -> None:
    assert cell.divided() == {"robots", "robot.motors"}
    assert to_text(cell, ASCII, 100).splitlines()[2:12] == [
        "   group           agent                   states  1 2 3 4 5 6  reads",
        "-" * 85,
        "1  plan            plan: Lag                    1  #",
        "   robots",
        "2    robot.body    robot.b: Lag                 1  x #          plan.y",
        "     robot.motors",
        "3      robot.slow  robot.slow: Robot.slow       2  . x #        robot.b.y, robot.b.y'",
        "4      robot.fast  robot.m: Lag                 1  . . x #      robot.p[2]",
        "5    -             robot: Robot                 0  . . . x #    robot.m.y",
        "6    robots        other: Lag                   1  . . . x . #  robot.m.y",
    ]


def test_other_forms_nest_as_the_table_does(cell: Diagram) -> None:
    levels = {agent["path"]: agent["levels"] for agent in json.loads(to_json(cell))["agents"]}
    assert levels["robot.m"] == ["robots", "robot.motors", "robot.fast"]
    assert levels["robot"] == levels["other"] == ["robots"]
    dot = to_dot(cell)
    (motors,) = re.findall(r'subgraph "cluster level robot.motors" \{\n(.*?)\n    \}\n', dot, re.DOTALL)
    assert re.findall(r'subgraph "(.*)"', motors) == ["cluster group robot.slow", "cluster group robot.fast"]
    assert dot.count("{") == dot.count("}") == 8


def test_a_picture_frames_levels_that_hold_several_groups(cell: Diagram) -> None:
    from hierc.picture import draw

    (axes,) = draw(cell, None).axes
    frames = {(p.get_x(), p.get_y(), p.get_width(), p.get_height()) for p in axes.patches if not p.get_fill()}
    assert frames == {(1, 1, 5, 5), (2, 2, 2, 2)}


def test_a_narrow_table_leaves_the_matrix_out(loop: Diagram) -> None:
    text = to_text(loop, UNICODE, 45)
    assert "■" not in text
    assert "-o graph.svg" in text
    assert "q.y, t1.y" in text


@pytest.mark.parametrize(
    ("encoding", "marks"), [("utf-8", UNICODE), ("ascii", ASCII), (None, ASCII), ("?", ASCII)]
)
def test_marks_are_those_that_the_terminal_has(encoding: str | None, marks: object) -> None:
    assert marks_for(encoding) is marks


def test_json_says_the_same(loop: Diagram) -> None:
    data = json.loads(to_json(loop))
    assert [agent["path"] for agent in data["agents"]] == [member.path for member in loop.members]
    assert {group["name"]: set(group["agents"]) for group in data["groups"]} == {
        "plan": {"a", "b"}, "body": {"p", "q"}, "mid": {"t1"}, "fast": {"t2"}, "tip": {"late"},
    }  # fmt: skip
    (t2,) = (agent for agent in data["agents"] if agent["path"] == "t2")
    assert t2["reads"] == [{"of": "q", "variables": ["q.y"]}, {"of": "t1", "variables": ["t1.y"]}]


def test_dot_has_every_arrow(loop: Diagram) -> None:
    text = to_dot(loop)
    arrows = sum(len(member.reads) for member in loop.members)
    assert text.count(" -> ") == arrows == 11
    assert text.count("{") == text.count("}")


@pytest.mark.parametrize(
    ("suffix", "magic"),
    [("svg", b"<?xml"), ("png", b"\x89PNG"), ("pdf", b"%PDF"), ("dot", b"digraph"), ("json", b"{")],
)
def test_files_are_of_their_kind(suffix: str, magic: bytes, tmp_path: Path) -> None:
    file = tmp_path / f"servo.{suffix}"
    assert main(["graph", "servo", "-o", str(file)]) == 0
    assert file.read_bytes().startswith(magic)


def test_a_picture_has_a_mark_for_each_pair(loop: Diagram) -> None:
    from hierc.picture import draw

    (axes,) = draw(loop, None).axes
    own, reads = axes.collections
    assert len(own.get_offsets()) == sum(bool(member.states) for member in loop.members)
    expected = {(r.owner + 0.5, i + 0.5) for i, member in enumerate(loop.members) for r in member.reads}
    assert {tuple(point) for point in reads.get_offsets().tolist()} == expected


@pytest.mark.parametrize("length", [1, 30, 60, 120])
def test_nothing_is_cut_however_long_names_are(length: int) -> None:
    from hierc.picture import draw

    name, agent = "M" * length, "w" * length
    text = f"agent A() {{ write real x = 0; diff {{ x' = 1; }} }} agent {name}() {{ level m{agent} {{ agent {agent} = A(); }} }}"
    figure = draw(diagram(model_of(SourceFile("m.hier", text))), None)
    figure.canvas.draw()
    (axes,) = figure.axes
    whole = figure.bbox
    texts = [figure._suptitle, *axes.texts, *axes.get_xticklabels(), *axes.get_yticklabels()]
    assert len(texts) == 4
    for shown in texts:
        box = shown.get_window_extent()
        assert whole.x0 <= box.x0 < box.x1 <= whole.x1, shown.get_text()
        assert whole.y0 <= box.y0 < box.y1 <= whole.y1, shown.get_text()


def test_a_small_picture_names_what_is_read() -> None:
    from hierc.picture import draw

    (axes,) = draw(diagram(model_named("servo")), None).axes
    assert {text.get_text() for text in axes.texts} == {"1 state", "2 states", "r, r'", "tau"}


def test_other_files_are_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["graph", "servo", "-o", str(tmp_path / "servo.txt")]) == 2
    assert "must end in .svg or .png or .pdf or .dot or .json" in capsys.readouterr().err


PLATOON = """
agent Lead() { write real v = 20; diff { v' = 1 - v; } }
agent Car(real tau = 0.5) { read real ahead; write real v = 20; diff { v' = (ahead - v)/tau; } }
agent Platoon() {
  agent lead = Lead();
  agent car[i in 1..10] = Car() [ahead := if i == 1 then lead.v else car[i - 1].v];
  group each car;
}
"""


def test_arrays_are_shown_once() -> None:
    shown = diagram(model_named(PLATOON))
    lines = to_text(shown, ASCII).splitlines()
    assert lines[0].endswith(": 11 groups, 11 states")
    assert [line.rstrip() for line in lines[2:]] == [
        "   group       agent            states  1 2 3  reads",
        "-" * 68,
        "1  lead        lead: Lead            1  #",
        "2  car[1]      car[1]: Car           1  x #    lead.v",
        "3  car[2..10]  car[2..10]: Car     9x1  . x @  car[1].v, car[2..9].v",
        "",
        "Rows read columns: # own equations   @ the same, reading others of the array   x reads",
    ]
    assert '  n2 -> n2 [label="car[2..9].v"];' in to_dot(shown).splitlines()
    counts = {agent["path"]: agent.get("count") for agent in json.loads(to_json(shown))["agents"]}
    assert counts == {"lead": None, "car[1]": None, "car[2..10]": 9}


def test_a_picture_tells_what_an_array_reads_of_itself() -> None:
    from hierc.picture import draw

    texts = [text.get_text() for text in draw(diagram(model_named(PLATOON)), None).axes[0].texts]
    assert texts == ["1 state", "1 state", "v", "1 state each", "v", "v"]


def test_a_sum_over_many_agents_is_one_row() -> None:
    text = """
    agent Lag() { write real y = 0; diff { y' = 1 - y; } }
    agent Top() {
      agent lag[i in 1..2000] = Lag();
      write real total;
      alge { total = sum(lag.y); }
    }
    """
    members = diagram(model_of(SourceFile("sum.hier", text))).members
    (total,) = (m for m in members if m.path == "sum of lag.y")
    assert [name for reading in total.reads for name in reading.names] == ["lag[1..2000].y"]
    assert len(members) == 3
