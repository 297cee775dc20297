"""A model means the same however deep its parts stand: the cart and the arm, flat, with levels in levels, and with agents in agents."""

from __future__ import annotations

from importlib.resources import files

import numpy as np
import pytest

from hierc.compiler.driver import compile_source
from hierc.grammar.source import SourceFile
from hierc.loader import run_module
from hierc.runtime.model import Model

#: For each model where its top agent begins and ends in the text.
TOPS = {"cart": ("agent Cart4() {", "experiment figure8"), "arm": ("agent Robot() {", "experiment reach")}

CART_LEVELS = """agent Cart4() {
  level gross {
    level plan { agent plan = Planner(); }
    level follow {
      level kin { agent kin = Unicycle() [goal := plan.p, goal_rate := plan.p']; }
      level dyn {
        agent cart = DynamicCart(x0 = -0.6 [m], y0 = -0.4 [m], th0 = 0.3)
          [xr := kin.x, yr := kin.y, thr := kin.th, vr := kin.v, omr := kin.om];
      }
    }
  }
  level fine {
    level chase {
      agent tail = DynamicCart(
        d = 1 [m], k1 = 8 [1/s], k2 = 20 [1/m^2], k3 = 10 [1/m], kv = 80 [1/s], kt = 400 [1/s],
        x0 = -1.8 [m], y0 = -0.9 [m], th0 = 0.2
      ) [xr := cart.x, yr := cart.y, thr := cart.th, vr := cart.v, omr := cart.om];
    }
  }
}
"""

CART_AGENTS = """
/// A cart behind another; what others may know of the first is passed on.
agent Pair(real start [m], real behind [m], real stiff [1/s] = 80) {
  read real gx [m], gy [m], gth [rad], gv [m/s], gom [rad/s];
  level dyn {
    agent cart = DynamicCart(x0 = start, y0 = -0.4 [m], th0 = 0.3)
      [xr := gx, yr := gy, thr := gth, vr := gv, omr := gom];
  }
  level chase {
    agent tail = DynamicCart(
      d = 1 [m], k1 = 8 [1/s], k2 = 20 [1/m^2], k3 = 10 [1/m], kv = stiff, kt = 5*stiff,
      x0 = behind, y0 = -0.9 [m], th0 = 0.2
    ) [xr := cart.x, yr := cart.y, thr := cart.th, vr := cart.v, omr := cart.om];
  }
}
agent Lower(real x0 [m], real x1 [m]) {
  read real[2] p [m], v [m/s];
  level kin { agent kin = Unicycle() [goal := p, goal_rate := v]; }
  level carts {
    agent pair = Pair(start = x0, behind = x1) [gx := kin.x, gy := kin.y, gth := kin.th, gv := kin.v, gom := kin.om];
  }
}
agent Cart4() {
  level plan { agent plan = Planner(); }
  level rest { level lower { agent lower = Lower(x0 = -0.6 [m], x1 = -1.8 [m]) [p := plan.p, v := plan.p']; } }
}
"""

ARM_LEVELS = """agent Robot() {
  const real[2] l [m] = [0.7, 0.6];
  level gross {
    level plan { agent plan = Ellipse(); }
    level ik { agent ik = InverseKinematics(l = l) [p := plan.p, pdot := plan.p']; }
  }
  level fine {
    level body { agent arm = Arm(l = l, m = [4, 3]) [qr := ik.q, qrd := ik.q']; }
    level motor { agent mot = Motors() [tau := arm.tau]; }
  }
}
"""

ARM_AGENTS = """
agent Actuated(real[2] lengths [m], real[2] masses [kg]) {
  read real[2] wish [rad], wish_rate [rad/s];
  level body { agent arm = Arm(l = lengths, m = masses) [qr := wish, qrd := wish_rate]; }
  level motor { agent mot = Motors() [tau := arm.tau]; }
}
agent Planned(real[2] lengths [m]) {
  level plan { agent plan = Ellipse(); }
  level ik { agent ik = InverseKinematics(l = lengths) [p := plan.p, pdot := plan.p']; }
  write real[2] q [rad], rate [rad/s];
  alge { q = ik.q; rate = ik.q'; }
}
agent Robot() {
  const real[2] l [m] = [0.7, 0.6];
  level all {
    level gross { agent planned = Planned(lengths = l); }
    level fine { agent actuated = Actuated(lengths = l, masses = [4, 3]) [wish := planned.q, wish_rate := planned.rate]; }
  }
}
"""

VARIANTS = {
    "cart-levels": ("cart", CART_LEVELS),
    "cart-agents": ("cart", CART_AGENTS),
    "arm-levels": ("arm", ARM_LEVELS),
    "arm-agents": ("arm", ARM_AGENTS),
}


def built(text: str) -> Model:
    model: Model = run_module(compile_source(SourceFile("model.hier", text)).text, "model.hier").MODEL
    return model


@pytest.fixture(scope="module", params=VARIANTS)
def pair(request: pytest.FixtureRequest) -> tuple[Model, Model]:
    """A model from the gallery and the same with its top agent written otherwise."""
    name, top = VARIANTS[request.param]
    text = files("hierc.models").joinpath(f"{name}.hier").read_text(encoding="utf-8")
    begin, end = (text.index(mark) for mark in TOPS[name])
    return built(text[:end]), built(text[:begin] + top)


def short(path: str) -> str:
    """A path from its last agent on, which is enough to tell the variables of these models apart."""
    return ".".join(path.split(".")[-2:])


def test_states_are_the_same_in_the_same_order(pair: tuple[Model, Model]) -> None:
    flat, nested = pair
    assert [short(name) for name in nested.states] == list(flat.states)
    assert np.array_equal(nested.initial(), flat.initial())
    assert [group.name.split(".")[-1] for group in nested.plan.groups] == [
        group.name for group in flat.plan.groups
    ]


def test_right_hand_sides_agree(pair: tuple[Model, Model]) -> None:
    """Bit by bit: the parts are the same, and so are the values that they are given."""
    flat, nested = pair
    generator = np.random.default_rng(5)
    for _ in range(50):
        t, x = generator.uniform(0, 10), flat.initial() + generator.normal(0, 0.3, len(flat.states))
        assert np.array_equal(nested.rhs(t, x), flat.rhs(t, x))


def test_elements_start_and_are_recorded_by_name() -> None:
    model = built(
        """
        agent Arm() { private real[2,2] M = [[1, 2], [3, 4]]; write real[3] q = [5, 6, 7]; diff { M' = -M; q' = q; } }
        agent Robot() { level body { level arm { agent arm = Arm(); } } }
        experiment e of Robot() {
          stop = 1 [s];
          init { arm.M[2, 1..2] = [8, 9]; arm.q[2] = 10; }
          record arm.q[2..3], arm.M[2,2];
        }
        """
    )
    result = model.simulate()
    assert {name: column[0] for name, column in result.columns().items()} == {
        "arm.q[2]": 10.0, "arm.q[3]": 7.0, "arm.M[2,2]": 9.0,
    }  # fmt: skip
    assert result["arm.q[2]"][-1] == pytest.approx(10 * np.e, rel=1e-5)
    assert result["arm.M"][0].tolist() == [[1, 2], [8, 9]]


def test_runs_agree(pair: tuple[Model, Model]) -> None:
    one, other = (model.simulate(stop=0.5, rtol=1e-8, interval=0.05) for model in pair)
    paths = {short(name): name for name in other.names}
    for name in one.names:
        if name in paths:
            assert np.array_equal(other[paths[name]], one[name]), name
    assert set(one.recorded) <= paths.keys()
    assert [s.steps for s in one.stats.values()] == [s.steps for s in other.stats.values()]
