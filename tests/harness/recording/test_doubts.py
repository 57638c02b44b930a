"""What looks wrong in a recording: told where it is, and not told of what is right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.recording.attitude import Array
from harness.recording.doubts import doubts
from harness.recording.mounting import rotation
from harness.recording.recording import EARTH_RADIUS, Fixes, Recording
from tests.harness.command import canine
from tests.harness.recording import made_up

SECONDS, RATE, FIX_RATE = 90.0, 50, 4
LATITUDE = 0.8  # rad


def walk(seed: int = 1, stands_s: float = 10.0, noisy: float = 1.0) -> Recording:
    """A body that stands and then goes at a speed that changes, in turns; noisy sensors, level axes."""
    noise = np.random.default_rng(seed)
    t = np.arange(0, SECONDS, 1 / RATE)
    moving = np.clip((t - stands_s) / 2, 0, 1)
    speed = moving * (1.5 + 0.6 * np.sin(0.8 * t))
    yaw_rate = moving * (0.1 + 0.5 * np.sin(0.5 * t) * np.sin(0.13 * t))
    heading = np.cumsum(yaw_rate) / RATE
    north, east = (np.cumsum(speed * part) / RATE for part in (np.cos(heading), np.sin(heading)))
    force = np.column_stack([np.gradient(speed, t), speed * yaw_rate, np.full(len(t), -9.81)])
    rate = np.column_stack([np.zeros((len(t), 2)), yaw_rate])
    every = slice(0, None, RATE // FIX_RATE)
    n = len(t[every])
    drift = np.cumsum(noise.normal(0, 0.05, (2, n)), axis=1)
    course = heading[every]
    velocity = [
        speed[every] * part + noise.normal(0, 0.05 * noisy, n) for part in (np.cos(course), np.sin(course))
    ]
    fixes = Fixes(
        t=t[every],
        latitude=LATITUDE + (north[every] + drift[0]) / EARTH_RADIUS,
        longitude=0.1 + (east[every] + drift[1]) / EARTH_RADIUS / np.cos(LATITUDE),
        height=np.zeros(n),
        velocity_north=velocity[0],
        velocity_east=velocity[1],
        h_acc=np.full(n, 1.5),
        s_acc=np.full(n, 0.1),
    )
    force += noise.normal(0, 0.5 * noisy, force.shape)
    rate += noise.normal(0, 0.05 * noisy, rate.shape)
    return Recording("walk", fixes, t, force, rate, {})


def imu(of: Recording, turn: Array) -> Recording:
    """The same with both sensors' axes multiplied by (3, 3)."""
    return replace(of, specific_force=of.specific_force @ turn.T, rate=of.rate @ turn.T)


def held(values: Array, t: Array, start: float, end: float) -> Array:
    """Values (n, ...) of which those from start to end [s] are those at the start."""
    first, last = np.searchsorted(t, [start, end])
    stands = values.copy()
    stands[first:last] = stands[first]
    return stands


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_sound_recording_is_not_doubted(seed: int) -> None:
    assert doubts(walk(seed)) == ()


def test_a_recording_that_stands_still_is_not_doubted() -> None:
    still = walk(stands_s=2 * SECONDS)
    coarse = replace(still, specific_force=np.round(still.specific_force), rate=np.round(still.rate))
    assert doubts(coarse) == ()


@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
def test_a_sensor_that_repeats_its_sample_in_motion_is_told_with_its_time(sensor: str) -> None:
    sound = walk()

    def hung(start: float, end: float) -> tuple[str, ...]:
        force, rate = (held(values, sound.imu_t, start, end) for values in (sound.specific_force, sound.rate))
        if sensor == "gyroscope":
            return doubts(replace(sound, rate=rate))
        return doubts(replace(sound, specific_force=force))

    # given one that hangs for 0.6 s in motion, for 0.4 s, and for 5 s at rest
    assert hung(40, 40.6) == (
        f"the {sensor} repeats one sample from 40.0 to 40.6 s, in motion; did it hang?",
    )
    assert hung(40, 40.4) == ()
    assert hung(2, 7) == ()


def test_a_receiver_that_repeats_its_place_is_told_if_it_says_that_it_moves() -> None:
    sound = walk()
    t = sound.fixes.t

    def hung(start: float, end: float) -> tuple[str, ...]:
        latitude, longitude = (held(x, t, start, end) for x in (sound.fixes.latitude, sound.fixes.longitude))
        return doubts(replace(sound, fixes=replace(sound.fixes, latitude=latitude, longitude=longitude)))

    # given a place that stands for 6 s of motion, about 9 m, for 2 s, about 3 m, and for 8 s at rest
    (doubt,) = hung(40, 46)
    assert doubt.startswith(
        "the position stands still from 40.1 to 45.8 s, while the speeds of the fixes say "
    )
    assert hung(40, 42) == ()
    assert hung(1, 9) == ()


def test_a_gyroscope_with_the_wrong_sign_is_told_by_the_turns() -> None:
    (doubt,) = doubts(replace(walk(), rate=walk().rate * [1, 1, -1]))
    assert doubt.startswith("the yaw rate is the reverse of the rate of the course (correlation -0.9")


@pytest.mark.parametrize(
    ("turn", "words"),
    [
        (np.diag([-1.0, 1, 1]), "the force follows the mirror image of the change of velocity"),
        (np.diag([1.0, -1, 1]), "the force follows the mirror image of the change of velocity"),
        (np.eye(3)[[1, 0, 2]], "the force follows the mirror image of the change of velocity"),
        (rotation(0, 0, 90), "the force is turned by 9"),  # and some: it is an estimate
        (rotation(0, 0, -90), "the force is turned by "),
        (rotation(0, 0, 180), "the force is turned by "),
        (rotation(0, 0, 30), ""),  # what a loose harness, or a body that slips, may do
    ],
    ids=["forward", "right", "exchanged", "yaw 90", "yaw -90", "yaw 180", "yaw 30"],
)
def test_axes_that_the_motion_contradicts_are_told(turn: Array, words: str) -> None:
    lines = doubts(imu(walk(), turn))
    assert len(lines) == bool(words)
    assert all(doubt.startswith(words) for doubt in lines)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda v: np.abs(v) * np.exp(1j * np.radians(np.angle(v))),  # radians taken for degrees
        lambda v: v.conj(),  # counter-clockwise
        lambda v: v / 3.6,  # km/h in the file, m/s in the description
        lambda v: v * 3.6,
        lambda v: v * 1j,  # from east
    ],
    ids=["rad", "sense", "slow", "fast", "east"],
)
def test_courses_and_speeds_that_the_positions_contradict_are_told(wrong: Callable[[Array], Array]) -> None:
    sound = walk()
    velocity = wrong(sound.fixes.velocity_north + 1j * sound.fixes.velocity_east)
    fixes = replace(sound.fixes, velocity_north=velocity.real, velocity_east=velocity.imag)
    lines = doubts(replace(sound, fixes=fixes))
    assert lines[0].startswith("along the courses of the fixes the positions move ")


def test_a_wrong_clock_is_told_before_axes_that_it_makes_look_wrong() -> None:
    # given an IMU whose time is 1 s late and whose forward axis is reversed
    sound = imu(walk(noisy=0.1), np.diag([-1.0, 1, 1]))
    lines = doubts(replace(sound, imu_t=sound.imu_t + 1.0))
    assert [doubt for doubt in lines if "clock" in doubt]
    assert not [doubt for doubt in lines if "mirror" in doubt]


def test_doubts_are_warnings_of_a_check_and_notes_of_a_replay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.replay.replay.replay_picture", lambda *_, **__: b"")  # seconds to draw
    # given a stream whose axes forward and right are exchanged
    turned = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]]) @ rotation(180, 0, 0)
    (tmp_path / "f9r.ubx").write_bytes(made_up.stream(turned))
    words = "the force follows the mirror image of the change of velocity"
    # then both say it, and neither refuses
    status, text, _ = canine(capsys, "check", tmp_path / "f9r.ubx")
    assert status == 0
    assert f"warning   {words}" in text
    status, _, notes = canine(capsys, "replay", tmp_path / "f9r.ubx", "--out", tmp_path / "out")
    assert status == 0
    assert words in notes
