"""Initial values that follow from each other along an array, in one pass, whichever way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from array_models import a_model, one_by_one, plan_of
from running import run
from small_models import a_class

from hierc.runtime.contract import Group, Node, Plan, Steps

HEAD = a_class("Head", {"x": "-x[0]"}, {(0, 0): "-1.0"}, start=["3.0 + t"])
LINK = a_class(
    "Link",
    {"x": "u[0] - x[0]"},
    {(0, 0): "-1.0", (0, 1): "1.0"},
    start=["p[0] + 0.5*u[0]"],
    inputs=1,
    values=["q[0]"],
)
COUNT = 7


def hanging(*, backwards: bool) -> Plan:
    """Links that start at half of what their neighbour starts at, and their own number; the head is the first element or the last."""
    head = Node("head", 0, (), ())
    neighbours = Steps(1) if backwards else Steps(0)
    links = Node("link[]", 1, (Steps(0),), ((neighbours, "state", 0),), COUNT, (Steps(1),))
    first, last = (COUNT, Steps(0)) if backwards else (0, Steps(1))
    lead = Group("head", (first,), ((first, -1),))
    others = Group("link[]", (last,), ((last, -1),), COUNT, (Steps(1),))
    against = Steps(COUNT, -1) if backwards else None
    return plan_of(
        (HEAD, LINK),
        (links, head) if backwards else (head, links),
        (others, lead) if backwards else (lead, others),
        parameter_count=COUNT,
        constants=((0, COUNT, Steps(1)),),
        order=against,
        start_order=against,
    )


def expected(start: float, *, backwards: bool) -> list[float]:
    """In the order of the cascade: the head's, then one link's from the other's."""
    values = [3.0 + start]
    for number in range(COUNT, 0, -1) if backwards else range(1, COUNT + 1):
        values.append(number + 0.5 * values[-1])
    return values


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("start", [0.0, 2.0])
def test_one_pass_is_enough(backwards: bool, start: float) -> None:
    plan = hanging(backwards=backwards)
    for model in (a_model(plan), a_model(one_by_one(plan))):
        assert model.initial(start).tolist() == expected(start, backwards=backwards)
    finished = run(a_model(plan), start + 1.0, start=start)
    assert finished.status.ok
    assert [float(g.initial[0]) for g in finished.groups] == expected(start, backwards=backwards)


def test_by_number_it_takes_a_pass_a_link() -> None:
    plan = replace(hanging(backwards=True), start_order=None)
    assert np.isnan(a_model(replace(plan, start_passes=COUNT)).initial()).any()
    settled = a_model(replace(plan, start_passes=COUNT + 1)).initial()
    assert settled.tolist() == expected(0.0, backwards=True)
    assert run(a_model(plan), 1.0).status.name == "BAD_START"


def test_any_order_is_followed() -> None:
    """One in which the last link comes before what it follows from: just that one is not known."""
    order = (COUNT, *range(COUNT - 1, 1, -1), 0, 1)
    found = a_model(replace(hanging(backwards=True), start_order=order)).initial()
    assert found[:-1].tolist() == expected(0.0, backwards=True)[:-1]
    assert np.isnan(found[-1])
