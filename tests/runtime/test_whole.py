"""The right-hand side of a whole system in one call has the bits of plain Python."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from array_models import a_model, chain, platoon

import hierc
from hierc.runtime import partitions
from hierc.runtime.machine.whole import Derivatives
from hierc.runtime.model import Model
from hierc.runtime.system import System

TEXT = """
agent Head(real k = 3) {
  write real[2] x = [1, 2];
  write real y;
  alge { y = sqrt(x[1]^2 + 4) + atan2(x[1], x[2]); }
  diff { x[1]' = -k*x[2] + cos(2 [rad/s]*time); x[2]' = sin(x[1])^2*y; }
}
agent Tail() {
  read real a, y;
  write real z = 0;
  diff { z' = tanh(a)*y - log(1 + z^2); }
}
agent Both() {
  level h { agent h = Head(k = 4); }
  level t { agent t[i in 1..3] = Tail() [a := i*h.x[2], y := h.y]; }
}
"""


def whole(model: Model, params: dict[str, float] | None = None) -> System:
    engine = model.engine.with_groups(partitions.one(model.engine.elements))
    system = model.system(params)
    return replace(system, plan=engine.plan, expansion=engine.elements)


@pytest.mark.parametrize("which", ["text", "platoon", "chain"])
def test_the_bits_of_plain_python(which: str) -> None:
    models = {
        "text": lambda: hierc.load(TEXT),
        "platoon": lambda: a_model(platoon(7)),
        "chain": lambda: a_model(chain(9, one_group=True)),
    }
    system = whole(models[which]())
    derivatives = Derivatives(system)
    rng = np.random.default_rng(5)
    for count in range(1, 50):
        t, x = rng.normal(), rng.normal(size=system.size)
        assert derivatives(t, x).tobytes() == system.rhs(t, x).tobytes()
        assert derivatives.evaluations == count


def test_parameters_are_those_of_the_system() -> None:
    model = hierc.load(TEXT)
    x = np.arange(1.0, 6.0)
    default, other = (Derivatives(whole(model, params)) for params in (None, {"h.k": 9.0}))
    assert other(0.5, x)[0] - default(0.5, x)[0] == pytest.approx(-(9.0 - 4.0) * x[1])
    first = default(0.5, x)
    default(0.6, 2 * x)
    assert first.tobytes() == default(0.5, x).tobytes()  # what was returned is the caller's


def test_several_groups_are_refused() -> None:
    with pytest.raises(ValueError, match="several groups"):
        Derivatives(a_model(platoon(2)).system())
