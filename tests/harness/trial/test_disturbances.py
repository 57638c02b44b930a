"""What disturbed a trial is read from its rows."""

from pathlib import Path

import numpy as np
import pytest

from harness.log.channel import Channel
from harness.log.log import Log, read_log
from harness.trial import trial
from harness.trial.disturbances import GPS_OUTAGE, LOST_RADIO, ORDER, Span, disturbances
from harness.trial.prepare import prepared
from harness.trial.request import Request, build_missing
from harness.trial.scenario import Scenario, Setting
from models.commands import Command

STEP = 0.04  # s


def log_of(signals: dict[str, list[float] | np.ndarray], period: float | None = None) -> Log:
    """A log of rows at 25 Hz with these signals of some components."""
    names: dict[str, list[str]] = {}
    for signal in signals:
        component, name = signal.split(".")
        names.setdefault(component, []).append(name)
    channels, values = [], {}
    for component, own in names.items():
        blank = ("",) * len(own)
        channels.append(Channel(component, component, tuple(own), blank, ("Real",) * len(own), blank))
        values[component] = np.column_stack([signals[f"{component}.{name}"] for name in own]).astype(float)
    ticks = len(next(iter(signals.values())))
    parameters = {} if period is None else {"sensors.gps_period": str(period)}
    return Log(
        Path("trial.mcap"),
        tuple(channels),
        {"parameters": parameters},
        {},
        np.arange(ticks, dtype=np.float64) * STEP,
        values,
    )


def fixes(ticks: int, period: float, *outages: Span) -> np.ndarray:
    """When fixes came at a period, each on the first tick at or after it was due, and none in the outages."""
    due = {int(np.ceil(n * period / STEP - 1e-6)) for n in range(ticks)}
    time = STEP * np.arange(ticks)
    lost = np.any([(time >= start - 1e-9) & (time < end - 1e-9) for start, end in outages], axis=0)
    came: np.ndarray = np.array([tick in due for tick in range(ticks)]) & ~lost
    return came


@pytest.mark.parametrize("period", [0.04, 0.1, 0.2, 0.25, 1.0])
@pytest.mark.parametrize("known", [True, False])
def test_fixes_in_time_are_no_outage(period: float, known: bool) -> None:
    log = log_of({"sensors.gps_fix": fixes(250, period)}, period if known else None)
    assert disturbances(log) == {}


@pytest.mark.parametrize("period", [0.1, 0.2, 0.25, 1.0])
@pytest.mark.parametrize(
    "outages", [[(2.0, 4.0)], [(0.0, 3.0)], [(2.0, 3.0), (5.0, 7.0)], [(7.0, 10.0)]],
    ids=["one", "at the start", "two", "at the end"],
)  # fmt: skip
def test_an_outage_is_from_the_first_fix_that_failed_to_the_next_that_came(
    period: float, outages: list[Span]
) -> None:
    log = log_of({"sensors.gps_fix": fixes(251, period, *outages)}, period)
    spans = disturbances(log)[GPS_OUTAGE]
    assert len(spans) == len(outages)
    for span, outage in zip(spans, outages, strict=True):
        assert span == pytest.approx(outage, abs=STEP)


@pytest.mark.parametrize("period", [0.25, None])
def test_a_trial_without_a_fix_is_one_outage(period: float | None) -> None:
    log = log_of({"sensors.gps_fix": np.zeros(100)}, period)
    assert disturbances(log) == {GPS_OUTAGE: [pytest.approx((0.0, 99 * STEP))]}


def test_orders_are_overrides_and_the_start_withdrawn() -> None:
    time = STEP * np.arange(100)
    override = np.where((time >= 1) & (time < 2), Command.LEFT, Command.NONE)
    start = (time >= 0.4) & (time < 3)
    log = log_of({"controller.override": override, "controller.start": start})
    # nothing is ordered before the trial begins
    assert disturbances(log)[ORDER] == [pytest.approx((1, 2)), pytest.approx((3, time[-1]))]


def test_the_radio_is_lost_while_the_link_is_down() -> None:
    log = log_of({"controller.link_ok": [1, 1, 0, 0, 1, 0]})
    assert disturbances(log) == {LOST_RADIO: [pytest.approx((0.08, 0.16)), pytest.approx((0.2, 0.2))]}


def test_a_system_without_receiver_and_operator_has_no_disturbance() -> None:
    assert disturbances(log_of({"plant.north": np.zeros(10)})) == {}
    assert disturbances(log_of({"sensors.gps_fix": [1.0], "controller.override": [0.0]})) == {}


def test_a_trial_was_disturbed_when_its_scenario_says(tmp_path: Path) -> None:
    windows = {"sensors.outage_start": [0.5, 2.0], "sensors.outage_end": [1.0, 3.0]}
    sets = (Setting("controller.override", "STOP", 1.0, 1.5), Setting("controller.link_ok", False, 2.5))
    scenario = Scenario("disturbed", waypoints=((30.0, 0.0),), duration=4.0, parameters=windows, sets=sets)
    request = Request(scenario)
    build_missing(request)
    with prepared(request) as ready:
        trial.run(request, ready, tmp_path)
    assert disturbances(read_log(tmp_path / "trial.mcap")) == {
        GPS_OUTAGE: [pytest.approx((0.5, 1.0), abs=STEP), pytest.approx((2.0, 3.0), abs=STEP)],
        ORDER: [pytest.approx((1.0, 1.5), abs=STEP)],
        LOST_RADIO: [pytest.approx((2.5, 4.0), abs=STEP)],
    }
