"""Silence is detected to the tick, telemetry keeps its period, and float32 counts as double does."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.kit.geometry import SHORT_COUNT_MAX
from models.kit.model import Model
from models.kit.timing import TICK
from models.watchdog import Watchdog

PRECISIONS = ["double", "float"]


def once(tick: int, ticks: int) -> np.ndarray[Any, Any]:
    """An input that is on at one tick alone."""
    return np.asarray(np.arange(ticks) == tick, dtype=float)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_imu_and_operator_count_as_silent_before_their_first_message(native: Any, precision: str) -> None:
    # given a receiver whose fixes are good, and neither inertial unit nor operator
    outputs = native(Watchdog, precision).run(valid=np.ones(3))
    # then
    assert (
        outputs["imu_ok"].tolist()
        == outputs["link_ok"].tolist()
        == outputs["override_ok"].tolist()
        == outputs["estimate_ok"].tolist()
        == [0] * 3
    )


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(
    ("heard", "ok", "parameter", "timeout", "ticks"),
    [
        ("sampled", "imu_ok", "imu_timeout", 0.2, 5),  # 0.2 s / 40 ms
        ("sampled", "imu_ok", "imu_timeout", 0.04, 1),
        ("heard", "link_ok", "link_timeout", 2.0, 50),
        ("heard", "link_ok", "link_timeout", 0.6, 15),  # 14.999999... in float32
        ("heard", "link_ok", "link_timeout", 0.07, 1),  # less than two ticks
        ("overridden", "override_ok", "override_timeout", 1.0, 25),
        ("overridden", "override_ok", "override_timeout", 0.04, 1),
    ],
)
def test_silence_is_detected_on_the_first_tick_beyond_the_timeout(  # noqa: PLR0917
    native: Any, precision: str, heard: str, ok: str, parameter: str, timeout: float, ticks: int
) -> None:
    # given one message, on tick 3
    watchdog = native(Watchdog, precision, {parameter: timeout})
    # when
    outputs = watchdog.run(**{heard: once(3, ticks + 10)})
    # then the sender counts as alive from there for the timeout, and not a tick longer
    expected = [3 <= k <= 3 + ticks for k in range(ticks + 10)]
    assert outputs[ok].tolist() == expected
    # and the others as silent throughout
    assert not any(outputs[other].any() for other in {"imu_ok", "link_ok", "override_ok"} - {ok})


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_single_message_ends_a_long_silence_at_once(native: Any, precision: str) -> None:
    # given silence from tick 1 to 99, long beyond both timeouts
    heard = once(0, 101) + once(100, 101)
    # when
    outputs = native(Watchdog, precision).run(
        heard=heard, sampled=heard, overridden=heard, valid=np.ones(101)
    )
    # then
    for name, last in (("imu_ok", 5), ("link_ok", 50), ("override_ok", 25), ("estimate_ok", 5)):
        assert np.flatnonzero(outputs[name]).tolist() == [*range(last + 1), 100], name


@pytest.mark.parametrize(("valid", "sampled", "ok"), [(1, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 0)])
def test_the_estimate_is_trusted_with_recent_fixes_and_a_live_imu(
    native: Any, valid: int, sampled: int, ok: int
) -> None:
    outputs = native(Watchdog, "float").run(valid=valid, sampled=sampled)
    assert outputs["estimate_ok"].tolist() == [ok]


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("period", "ticks"), [(0.2, 5), (0.04, 1), (1.0, 25), (0.6, 15)])
def test_telemetry_is_due_at_once_and_then_every_period(
    native: Any, precision: str, period: float, ticks: int
) -> None:
    outputs = native(Watchdog, precision, {"report_period": period}).run(valid=np.zeros(4 * ticks))
    assert np.flatnonzero(outputs["report"]).tolist() == [0, ticks, 2 * ticks, 3 * ticks]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_initialize_resets_the_watchdog(native: Any, precision: str) -> None:
    # given a watchdog that has heard both
    watchdog = native(Watchdog, precision)
    watchdog.run(heard=np.ones(7), sampled=1, overridden=1, valid=1)
    assert watchdog["link_ok"]
    assert watchdog["override_ok"]
    # when
    watchdog._call("initialize")
    # then both count as silent, and telemetry is due at once
    outputs = watchdog.run(heard=0, sampled=0, overridden=0)
    assert [outputs[name][0] for name in ("link_ok", "imu_ok", "override_ok", "report")] == [0, 0, 0, 1]


def test_ages_stop_at_their_maximum() -> None:
    # given ages at their end, as after 20 minutes without a message
    model = Model(Watchdog)
    model.initialize()
    # when
    for _ in range(3):
        model.step()
    # then
    assert (model["imu_age"], model["link_age"], model["override_age"]) == (SHORT_COUNT_MAX,) * 3
    assert not model["link_ok"]


@pytest.mark.parametrize("name", ["imu_timeout", "link_timeout", "override_timeout", "report_period"])
def test_a_time_of_whole_ticks_counts_as_many_in_float32(native: Any, name: str) -> None:
    # given times of 1 to 250 ticks (the greatest report period), as decimals
    limit = "report_ticks" if name == "report_period" else name.replace("timeout", "limit")
    for ticks in range(1, 251):
        time = round(ticks * TICK, 2)
        # then both precisions count that many
        assert [native(Watchdog, p, {name: time})[limit] for p in PRECISIONS] == [ticks, ticks], time


@given(st.integers(4, 100_000))
def test_a_time_in_hundredths_of_a_second_counts_the_ticks_that_fit_in(hundredths: int) -> None:
    model = Model(Watchdog, {"link_timeout": hundredths / 100})
    model.initialize()
    assert model["link_limit"] == hundredths // 4
