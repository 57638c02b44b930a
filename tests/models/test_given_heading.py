"""The heading of an AHRS, held by the estimators that take it: how far it is believed, and when it is not."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from models.given_heading import GivenHeading
from models.system import ESTIMATORS
from tests.models.motions import Columns, noisy, walk

Make = Callable[..., Any]
NAMES = [name for name, block in ESTIMATORS.items() if issubclass(block, GivenHeading)]
ANY = math.pi / math.sqrt(3)
EACH = pytest.mark.parametrize(
    ("name", "precision"), [(name, p) for name in NAMES for p in ESTIMATORS[name].precisions]
)


def signals() -> Columns:
    return noisy(walk(300), seed=3)


@EACH
def test_the_stated_deviation_is_the_ahrs_own_if_it_is_above_the_accuracy(
    native: Make, name: str, precision: str
) -> None:
    deviation = np.arange(300) / 128  # 0 to 2.3, with the limit itself
    accuracy = ESTIMATORS[name].variables()["heading_accuracy"].start[0]
    out = native(ESTIMATORS[name], precision, {"max_heading_sd": 1}).run(
        **signals() | {"heading_meas_sd": deviation}
    )
    assert out["heading_sd"] == pytest.approx(np.clip(deviation, accuracy, ANY), rel=1e-6)
    known = np.arange(300) > 10
    assert (out["valid"][known] == (deviation[known] <= 1)).all()


@EACH
def test_without_samples_the_heading_becomes_unknown(native: Make, name: str, precision: str) -> None:
    """By 0.5 rad in a second, from the accuracy on; 30 deg of it are reached in about 1 s."""
    inputs = signals()
    inputs["accel_x"][100:200] = math.nan
    out = native(ESTIMATORS[name], precision).run(**inputs)
    accuracy = ESTIMATORS[name].variables()["heading_accuracy"].start[0]
    assert out["heading_sd"][100:200] == pytest.approx(
        np.minimum(accuracy + 0.02 * np.arange(1, 101), ANY), rel=1e-5
    )
    assert (out["valid"][20:] == (out["heading_sd"][20:] <= math.radians(30))).all()
    assert out["valid"][[110, 150, 200]].tolist() == [1, 0, 1]


@EACH
def test_a_filter_that_had_no_sample_yet_knows_no_heading(native: Make, name: str, precision: str) -> None:
    inputs = signals()
    inputs["accel_x"][:100] = math.nan
    out = native(ESTIMATORS[name], precision).run(**inputs)
    assert out["started"][50]
    assert not out["valid"][:100].any()
    assert out["heading_sd"][:100] == pytest.approx(ANY)
