"""Garbage on board: bytes arrive as others, and faults of signals act before the instruments."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.log.log import Log, read_log
from harness.onboard.garbage import Garbage, Garbler
from harness.trial import trial
from harness.trial.prepare import prepared
from harness.trial.request import Request, build_missing
from harness.trial.scenario import Disturbance, ScenarioError, load
from models.commands import Command
from models.modes import Anomaly

SENT = bytes(range(256)) * 20


def garbage(share: float = 0.25, number: int = 1, seed: int = 7) -> Garbage:
    return Garbage("gps", share, 10, 20, seed, number)


def test_a_share_of_the_bytes_arrives_as_others_in_the_window_alone() -> None:
    garbled = Garbler([garbage()])
    assert garbled("gps", 9, SENT) == garbled("gps", 20, SENT) == garbled("imu", 15, SENT) == SENT
    arrived = garbled("gps", 10, SENT)
    assert len(arrived) == len(SENT)
    # a byte is replaced by itself once in 256 times
    changed = np.mean([a != b for a, b in zip(arrived, SENT, strict=True)])
    assert abs(changed - 0.25 * 255 / 256) < 4 * np.sqrt(0.25 * 0.75 / len(SENT))


def test_the_seed_and_the_fault_decide_the_bytes() -> None:
    def first(fault: Garbage) -> bytes:
        return Garbler([fault])("gps", 10, SENT)

    assert first(garbage()) == first(garbage())
    assert len({first(garbage()), first(garbage(number=2)), first(garbage(seed=8))}) == 3


def fly(folder: Path, *faults: Disturbance) -> Log:
    request = Request(replace(load("two_waypoint"), duration=4.0, faults=faults), onboard="host")
    build_missing(request)
    with prepared(request) as ready:
        trial.run(request, ready, folder)
    return read_log(folder / trial.LOG)


@pytest.mark.parametrize("stream", ["gps", "imu"])
def test_frames_with_garbage_are_dropped(stream: str, tmp_path: Path) -> None:
    # given a stream of which every fifth byte arrives as another
    log = fly(tmp_path, Disturbance(stream, "garbage", 1.0, 3.0, 0.2))
    # then hardly a frame of it is taken meanwhile
    frames = log[f"telemetry.{stream}_frames"]
    at = {t: float(frames[np.searchsorted(log.time, t + 1e-9) - 1]) for t in (1.2, 3.0, 4.0)}
    assert at[3.0] - at[1.2] < 0.4 * (at[4.0] - at[3.0])
    assert np.isfinite(log["estimator.north"]).all()


def test_a_radio_with_garbage_is_lost(tmp_path: Path) -> None:
    # given that no frame comes through from 1 s on, and that the vest waits for 2 s after the last one
    log = fly(tmp_path, Disturbance("radio", "garbage", 1.0, None, 0.5))
    lost = log["controller.anomaly"] == Anomaly.LOST_LINK
    assert lost[(log.time > 2.0) & (log.time < 3.1)].any()
    assert not lost[(log.time > 0.5) & (log.time < 2.0)].any()
    assert (log["controller.command"][log.time > 3.3] == Command.STOP).all()


def test_faults_of_the_sensors_reach_the_firmware(tmp_path: Path) -> None:
    # given a position that is 20 m off, and an inertial unit that gives NaN for a while
    offset = Disturbance("sensors.gps_north", "offset", 0.0, None, 20.0)
    log = fly(tmp_path, offset, Disturbance("sensors.accel_x", "nan", 2.0, 2.2))
    # then the program's origin is there, and it goes on
    off = log["estimator.north"][50] - log["plant.north"][50]
    assert off == pytest.approx(20.0, abs=4.0)
    assert np.isfinite(log["estimator.north"]).all()


def refused(stream: str, onboard: str) -> str:
    """Why garbage of a stream is refused."""
    scenario = replace(load("two_waypoint"), faults=(Disturbance(stream, "garbage", 1.0, 2.0, 0.1),))
    with pytest.raises(ScenarioError) as caught, prepared(Request(scenario, onboard=onboard)):
        pass
    return str(caught.value)


def test_garbage_is_refused_where_no_bytes_are_sent() -> None:
    assert "only firmware on board receives bytes; run with --onboard" in refused("gps", "")
    assert 'signal is "gsp"; expected one of gps, imu, radio' in refused("gsp", "host")
