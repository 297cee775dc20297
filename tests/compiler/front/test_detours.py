"""Levels that depend on later ones by way of other agents, against a search of all ways."""

from __future__ import annotations

import random

import pytest
from helpers import model_of

from hierc.grammar.problems import ModelError

TEXT = """
agent Lag() { read real u; write real y = 0; diff { y' = u - y; } }
agent Robot() {
  read real a, b;
  write real s, f;
  level slow { agent slow_lag = Lag() [u := a]; }
  level fast { agent fast_lag = Lag() [u := b + slow_lag.y]; }
  alge { s = slow_lag.y; f = fast_lag.y; }
}
agent World() {
"""


def world(couplings: dict[str, tuple[str, str]], lags: dict[str, str]) -> str:
    robots = (f"agent {name} = Robot() [a := {a}, b := {b}];" for name, (a, b) in couplings.items())
    return TEXT + "\n".join(
        [*robots, *(f"agent {name} = Lag() [u := {u}];" for name, u in lags.items()), "}"]
    )


def depends(couplings: dict[str, tuple[str, str]], lags: dict[str, str]) -> bool:
    """Whether the slow level of some robot is reached from its fast one, by following every way there is."""
    reads = {f"{name}.y": {u} for name, u in lags.items()}
    for name, (a, b) in couplings.items():
        reads |= {f"{name}.s": {a}, f"{name}.f": {b, f"{name}.s"}}
    for name in couplings:
        found, waiting = set(), [f"{name}.s"]
        while waiting:
            new = reads.get(waiting.pop(), set()) - found
            found |= new
            waiting += new
        if f"{name}.f" in found:
            return True
    return False


@pytest.mark.parametrize("seed", range(40))
def test_random_worlds(seed: int) -> None:
    pick = random.Random(seed)
    robots, lags = ["r1", "r2", "r3"], ["l1", "l2"]
    sources = [*(f"{r}.{v}" for r in robots for v in "sf"), *(f"{lag}.y" for lag in lags), "0", "0"]

    def source(name: str) -> str:
        return pick.choice([s for s in sources if not s.startswith(name)])

    couplings = {name: (source(name), source(name)) for name in robots}
    readers = {name: source(name) for name in lags}
    codes = []
    try:
        model_of(world(couplings, readers))
    except ModelError as error:
        codes = [problem.code for problem in error.problems]
    assert ("E601" in codes) == depends(couplings, readers)


def test_the_worlds_are_of_both_kinds() -> None:
    assert depends({"r1": ("l1.y", "0")}, {"l1": "r1.f"})
    assert not depends({"r1": ("l1.y", "0")}, {"l1": "r1.s"})
    with pytest.raises(ModelError) as caught:
        model_of(world({"r1": ("l1.y", "0")}, {"l1": "r1.f"}))
    assert "through `l1`" in caught.value.problems[0].title()
    model_of(world({"r1": ("0", "l1.y")}, {"l1": "r1.s"}))


def test_a_way_round_two_agents_with_levels() -> None:
    """`r1` reads the slow level of `r2`, which reads the fast one of `r1`: both ends stand in agents with levels."""
    with pytest.raises(ModelError) as caught:
        model_of(world({"r1": ("r2.s", "0"), "r2": ("r1.f", "0")}, {}))
    assert [problem.code for problem in caught.value.problems] == ["E601"]
    assert "through `r2.slow_lag`" in caught.value.problems[0].title()
