"""The estimator's ties and axes, one by one: each has a mutant that only its test notices."""

from __future__ import annotations

import math

import pytest

from models.four_state import FourState
from models.kit.model import Model


def started(**parameters: float) -> Model:
    """An estimator at the origin, at rest, that has had a fix on the tick before."""
    model = Model(FourState, parameters)
    model.initialize()
    model["started"] = 1
    for i in range(1, 5):
        model[f"covariance[{i}]"] = 1.0
    model["gps_h_acc"], model["gps_s_acc"] = 2.0, 0.5
    return model


@pytest.mark.parametrize(("speed", "sigma"), [(3.0, 16 / 15), (-3.0, 16 / 15), (5.0, 151.70), (-5.0, 151.70)])
def test_sigma_is_tuned_by_the_size_of_the_speed_at_exactly_3_m_s_too(speed: float, sigma: float) -> None:
    """Choice 6: 0.5 to 3.0 m/s -> 1.0667, 4 and above -> 151.70; not tuned it would be `sigma_constant`."""
    model = Model(FourState, {"sigma_constant": 0.1})
    model.initialize()
    model["x[1]"] = speed
    model.step()
    assert model["sigma"] == pytest.approx(sigma, abs=0.005)


@pytest.mark.parametrize("name", ["gps_north", "gps_east", "gps_speed"])
@pytest.mark.parametrize("side", [1, -1])
def test_the_gate_holds_north_east_and_speed_each(name: str, side: int) -> None:
    # given a nominal variance of 2 (h_acc / 2)^2 + (1.5 m/s age)^2, or 2 s_acc^2 + (4 m/s2 age)^2, a tick old
    if name == "gps_speed":
        width = 5 * math.sqrt(2 * 0.5**2 + (4 * 0.04) ** 2)
    else:
        width = 5 * math.sqrt(2 * 1.0**2 + (1.5 * 0.04) ** 2)
    for offset, accepted in ((0.999 * width, 1), (1.001 * width, 0)):
        model = started()
        model["x[1]"] = 0.0 if side > 0 or name != "gps_speed" else 20.0
        model["gps_fix"] = 1
        model["gps_speed"] = model["x[1]"]
        model[name] = model[name] + side * offset
        # the animal would move on in the tick: a fast one is where it was
        model["x[3]"] = -0.04 * model["x[1]"]
        # then a fix that is farther off along any of the three is not taken
        model.step()
        assert (name, model["accepted"]) == (name, accepted)
