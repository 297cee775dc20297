"""Arrays of agents as people are shown them: dumps and diagrams name blocks, not elements."""

import hand_arrays as models
import pytest

from hierc.compiler.diagram import diagram
from hierc.compiler.dump import dump_cascade, dump_model, dump_tree
from hierc.compiler.emission.plan import plan
from hierc.compiler.symbolic.derive import derive

MODEL = """\
model Platoon (platoon.hier)

parameters
  lead.w = 0.5
  car[1].tau = 0.5
  car[1].k = 2/car[1].tau
  car[2..10].tau = 0.5
  car[2..10].k = 2/car[2..10].tau

node 0  lead: Lead
  v' = sin(lead.w*time)   from 20
  x' = v   from 0

node 1  car[1]: Car
  gap = lead.x - x - 5
  x' = v   from (-10)*1
  v' = car[1].k*(gap - car[1].tau*v + lead.v - v) + 0.5*lead.v'   from 20

node 2  car[2..10]: Car
  gap = car[1..9].x - x - 5
  x' = v   from (-10)*(2..10)
  v' = car[2..10].k*(gap - car[2..10].tau*v + car[1..9].v - v) + 0.5*car[1..9].v'   from 20

groups
  lead: lead
  car[1]: car[1]
  car[2..10] (9 groups): car[2..10]

experiment (none)
"""

CASCADE = """\
model Robots (robots.hier)

1. group robot[1..4] (4 groups): 1 state each
   robot[1..4] (Robot)

2. group robot[1..4].arm (4 groups): 4 states each
   robot[1..4].joint[1] (Joint)
      reads robot[1..4].q'
   robot[1..4].joint[2..3] (Joint)
      uses  robot[1..4].joint[1..2].tau
   robot[1..4].tool (Tool)
      reads robot[1..4].sum.all

without states, computed where they are read
   robot[1..4].sum (Sum)
      reads robot[1..4].joint[1].tau
      reads robot[1..4].joint[2].tau
      reads robot[1..4].joint[3].tau
"""


def test_a_model_is_dumped_block_by_block():
    assert dump_model(models.platoon(10)) == MODEL


def test_the_cascade_is_dumped_family_by_family():
    assert dump_cascade(models.robots(4)) == CASCADE


@pytest.mark.parametrize("make", [models.platoon, models.robots, models.train])
def test_dumps_do_not_grow_with_the_elements(make):
    def dumps(n):
        model = make(n)
        symbolic = derive(model)
        return dump_model(model), dump_cascade(model), dump_tree(symbolic), dump_tree(plan(model, symbolic))

    for few, many in zip(dumps(10), dumps(2000), strict=True):
        assert len(many) < 1.1 * len(few)


def test_a_block_is_one_member_of_the_diagram():
    shown = diagram(models.platoon(10))
    assert [(m.path, m.count, m.group, m.states) for m in shown.members] == [
        ("lead", 1, "lead", ("v", "x")),
        ("car[1]", 1, "car[1]", ("x", "v")),
        ("car[2..10]", 9, "car[2..10]", ("x", "v")),
    ]
    assert [(r.owner, r.names) for r in shown.members[2].reads] == [
        (1, ("car[1].x", "car[1].v", "car[1].v'")),
        (2, ("car[2..9].x", "car[2..9].v", "car[2..9].v'")),
    ]
    assert (shown.groups, shown.group_count) == (("lead", "car[1]", "car[2..10]"), 11)


def test_the_groups_of_a_family_stand_together():
    shown = diagram(models.robots(4))
    blocks = {}
    for m in shown.members:
        blocks.setdefault(m.block, []).append(m.path)
    arm = ["robot[1..4].joint[1]", "robot[1..4].joint[2..3]", "robot[1..4].sum", "robot[1..4].tool"]
    assert list(blocks.values()) == [["robot[1..4]"], arm]


@pytest.mark.parametrize("seed", range(40))
def test_diagrams_of_arrays_are_block_triangular(seed):
    model = models.lottery(seed)
    members = diagram(model).members
    assert sum(m.count for m in members) == sum(node.count for node in model.nodes)
    assert [m.block for m in members] == sorted(m.block for m in members)
    for m in members:
        assert all(members[reading.owner].block <= m.block for reading in m.reads)
