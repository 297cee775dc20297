"""The runnable model: what it tells of itself, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

import hierc
from hierc.runtime.errors import SettingError
from hierc.runtime.model import Model

TEXT = """
/// Lags in a row.
agent Lags(int n = 2, real T [ms] = 20 [ms], real[2] w = [1, 2]) {
  write real[n] x = zeros(n);
  diff { for i in 1..n { x[i]' = (w[1]*w[2] - x[i])/T; } }
}
experiment e of Lags() { stop = 1; }
"""


@pytest.fixture(scope="module")
def model() -> Model:
    return hierc.load(TEXT, params={"n": 3, "T": 50.0})


def test_parameters(model: Model) -> None:
    found = model.parameters
    assert list(found) == ["n", "T", "w"]
    assert (found["n"].value, found["n"].structural) == (3.0, True)
    assert found["T"].value == pytest.approx(50.0, rel=1e-15)
    assert (found["T"].unit, found["T"].structural) == ("ms", False)
    assert np.asarray(found["w"].value).tolist() == [1.0, 2.0]


def test_repr(model: Model) -> None:
    assert repr(model) == "<Model Lags: 3 states in groups Lags; 3 parameters>"


def test_a_result_lists_what_was_set(model: Model) -> None:
    assert model.simulate(params={"w": [2, 2]}).params == {"n": 3, "T": 50.0, "w": [2, 2]}


@pytest.mark.parametrize("value", ["3", None, [1, 2], float("nan"), 1j])
def test_wrong_values(model: Model, value: object) -> None:
    with pytest.raises(SettingError, match="`T`"):
        model.simulate(params={"T": value})


def test_structural_parameters_are_compiled_in(model: Model) -> None:
    with pytest.raises(SettingError, match="built into the code"):
        model.simulate(params={"n": 4})


def test_state_vectors_of_another_length(model: Model) -> None:
    for function in (model.rhs, model.jacobian):
        with pytest.raises(ValueError, match="has 3 states"):
            function(0.0, [0.0, 0.0])


def test_an_interrupted_run(model: Model) -> None:
    """Ctrl-C is not an error of the simulation: a sweep that goes on after failures stops."""

    def interrupt(t: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(hierc.Interrupted) as caught:
        model.simulate(stop=1e9, max_step=1.0, progress=interrupt)
    assert not isinstance(caught.value, Exception)
    assert 0.0 < caught.value.result.t_reached < 1e9
