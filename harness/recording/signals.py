"""Turns a recording into the estimator's sensor signals at 25 Hz."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.log.geodesy import TangentPlane
from harness.recording.attitude import TICK_S, Array, align_heading, own_attitude
from harness.recording.holes import holes_of_imu
from harness.recording.order import Mask
from harness.recording.recording import Recording, RecordingError
from models.errors import UsageError

MOVING_M_S = 0.5  # m/s, speed above which the course over ground is used
ALIGNING_S = 10.0  # s, time constant with which a recorded heading's offset forgets older courses
OWN, RECORDED = ATTITUDES = "own", "recorded"


@dataclass(frozen=True)
class SensorSignals:
    """The inputs of an estimator at each tick, and the reference to compare its outputs with.

    Arrays are (ticks,), in SI units and rad; body axes are forward, right, down. The inertial signals are
    delayed by the filter, and turn rates are means since the last tick. The gps signals hold their last value
    between fixes and during outages. The reference has the withheld fixes too; an estimator never gets it.
    """

    t: Array
    accel_x: Array  # specific force
    accel_y: Array
    accel_z: Array
    gyro_x: Array
    gyro_y: Array
    gyro_z: Array
    mag_x: Array  # zeros: there is no magnetometer
    mag_y: Array
    mag_z: Array
    roll_meas: Array
    pitch_meas: Array  # nose up positive
    heading_meas: Array  # clockwise from north, but from an arbitrary zero until the first moving fix
    heading_meas_sd: Array  # its standard deviation; 0 where none is stated
    gps_fix: Mask  # a new fix at this tick
    gps_north: Array  # from the origin, the position of the fix at t = 0
    gps_east: Array
    gps_speed: Array
    gps_course: Array
    gps_h_acc: Array
    gps_s_acc: Array
    reference_fix: Mask
    reference_north: Array
    reference_east: Array
    reference_speed: Array
    reference_course: Array
    origin_latitude: float
    origin_longitude: float


def sensor_signals(
    recording: Recording, outages: Sequence[tuple[float, float]] = (), attitude: str = ""
) -> SensorSignals:
    """Resample a recording to ticks, and withhold the fixes at start <= t <= end [s] of each outage.

    A fix falls on the first tick at or after it. The attitude, too, is without the withheld fixes.

    Args:
        attitude: OWN or RECORDED; by default as recorded, if the recording has one.

    Raises:
        RecordingError: an outage hides the fix at 0, which is the origin, or ends before it starts; no
            attitude is recorded.
    """
    fixes = recording.fixes
    origin = int(np.searchsorted(fixes.t, 0.0))
    plane = TangentPlane(*(float(field[origin]) for field in (fixes.latitude, fixes.longitude, fixes.height)))
    north, east = plane.to_plane(fixes.latitude, fixes.longitude)
    speed = np.hypot(fixes.velocity_north, fixes.velocity_east)
    course = np.arctan2(fixes.velocity_east, fixes.velocity_north)

    clock = np.arange(recording.ticks, dtype=np.int64)
    tick = np.ceil(fixes.t / TICK_S - 1e-6).astype(np.int64)
    covered = (tick >= 0) & (tick < recording.ticks)
    used = covered.copy()
    for start, end in outages:
        if not 0 < start <= end:
            raise RecordingError(f"outage from {start} to {end} s: expected 0 < start <= end")
        used &= (fixes.t < start) | (fixes.t > end)

    def held(among: Mask, field: Array) -> Array:
        return field[among][np.searchsorted(tick[among], clock, side="right") - 1]

    fix = np.isin(clock, tick[used])
    fix_speed, fix_course, fix_s_acc = held(used, speed), held(used, course), held(used, fixes.s_acc)
    angles = {
        OWN: lambda: _own(recording, fix, fix_speed, fix_course, fix_s_acc),
        RECORDED: lambda: _recorded(recording, fix & (fix_speed > MOVING_M_S), fix_course),
    }
    roll, pitch, heading, heading_sd = angles[recording_attitude(recording, attitude)]().T
    accel_x, accel_y, accel_z, gyro_x, gyro_y, gyro_z = recording.on_ticks[recording.ticks_before :].T
    zeros = np.zeros(recording.ticks)
    return SensorSignals(
        t=np.asarray(clock * TICK_S),
        accel_x=accel_x,
        accel_y=accel_y,
        accel_z=accel_z,
        gyro_x=gyro_x,
        gyro_y=gyro_y,
        gyro_z=gyro_z,
        mag_x=zeros,
        mag_y=zeros,
        mag_z=zeros,
        roll_meas=roll,
        pitch_meas=pitch,
        heading_meas=heading,
        heading_meas_sd=heading_sd,
        gps_fix=fix,
        gps_north=held(used, north),
        gps_east=held(used, east),
        gps_speed=fix_speed,
        gps_course=fix_course,
        gps_h_acc=held(used, fixes.h_acc),
        gps_s_acc=fix_s_acc,
        reference_fix=np.isin(clock, tick[covered]),
        reference_north=held(covered, north),
        reference_east=held(covered, east),
        reference_speed=held(covered, speed),
        reference_course=held(covered, course),
        origin_latitude=float(fixes.latitude[origin]),
        origin_longitude=float(fixes.longitude[origin]),
    )


def require_attitude(asked: str) -> None:
    """Raise unless it is OWN, RECORDED, or "" for what the recording has.

    Raises:
        UsageError: it is not.
    """
    if asked and asked not in ATTITUDES:
        raise UsageError(f"the attitude is {asked!r}, expected {' or '.join(ATTITUDES)}")


def recording_attitude(recording: Recording, asked: str = "") -> str:
    """The attitude that is used of a recording: OWN or RECORDED.

    A recorded one is the default: it is what the estimator on board is given.

    Raises:
        RecordingError: RECORDED is asked for, and there is none.
    """
    if asked == RECORDED and recording.attitude is None:
        raise RecordingError(
            f"{recording.name}: no attitude is recorded; expected an *.mtb, or imu.columns for it in "
            f"recording.toml; take --attitude {OWN}"
        )
    return asked or (OWN if recording.attitude is None else RECORDED)


def _own(recording: Recording, fix: Mask, *of_fix: Array) -> Array:
    """Roll, pitch, heading and its deviation by the Canine AHRS, from the samples before the origin on.

    Returns (ticks, 4).

    Args:
        of_fix: speed, course and speed accuracy of the fixes (ticks,).
    """
    before = recording.ticks_before
    samples = recording.on_ticks.copy()
    t = (np.arange(len(samples)) - before) * TICK_S
    for start, end in holes_of_imu(recording.imu_t):
        samples[(t > start) & (t < end)] = np.nan
    rows = [np.pad(row, (before, 0)) for row in (fix.astype(np.float64), *of_fix)]
    return own_attitude(samples, *rows)[before:]


def _recorded(recording: Recording, aligning: Mask, course: Array) -> Array:
    """The recorded roll and pitch, and heading, whose zero may be any: courses align it.

    Its deviation is not stated, 0. Returns (ticks, 4).
    """
    assert recording.attitude_on_ticks is not None
    roll, pitch, heading = recording.attitude_on_ticks[recording.ticks_before :].T
    ticks = np.flatnonzero(aligning)
    lost = [int(np.ceil(end / TICK_S)) for _, end in holes_of_imu(recording.imu_t)]
    aligned = align_heading(heading, ticks, course[ticks], ALIGNING_S, lost)
    return np.column_stack([roll, pitch, aligned, np.zeros(recording.ticks)])
