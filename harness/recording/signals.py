"""Turns a recording into the estimator's sensor signals at 25 Hz."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.log.geodesy import TangentPlane
from harness.recording.attitude import TICK_S, Array, align_heading
from harness.recording.holes import holes_of_imu
from harness.recording.order import Mask
from harness.recording.recording import Recording, RecordingError

MOVING_M_S = 0.5  # m/s, speed above which the course over ground is used
ALIGNING_S = 10.0  # s, time constant with which the heading's offset forgets older courses


@dataclass(frozen=True)
class SensorSignals:
    """The inputs of an estimator at each tick, and the reference to compare its outputs with.

    Arrays are (ticks,), in SI units and rad; body axes are forward, right, down. The inertial signals are
    delayed by the filter. The gps signals hold their last value between fixes and during outages. The
    reference has the withheld fixes too; an estimator never gets it.
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


def sensor_signals(recording: Recording, outages: Sequence[tuple[float, float]] = ()) -> SensorSignals:
    """Resample a recording to ticks, and withhold the fixes at start <= t <= end [s] of each outage.

    A fix falls on the first tick at or after it. Fixes faster than MOVING_M_S align the heading, with the
    time constant ALIGNING_S.

    Raises:
        RecordingError: an outage hides the fix at 0, which is the origin, or ends before it starts.
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

    accel_x, accel_y, accel_z, gyro_x, gyro_y, gyro_z, roll, pitch, heading = recording.on_ticks.T
    aligning = used & (speed > MOVING_M_S)
    lost = [int(np.ceil(end / TICK_S)) for _, end in holes_of_imu(recording.imu_t)]
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
        heading_meas=align_heading(heading, tick[aligning], course[aligning], ALIGNING_S, lost),
        gps_fix=np.isin(clock, tick[used]),
        gps_north=held(used, north),
        gps_east=held(used, east),
        gps_speed=held(used, speed),
        gps_course=held(used, course),
        gps_h_acc=held(used, fixes.h_acc),
        gps_s_acc=held(used, fixes.s_acc),
        reference_fix=np.isin(clock, tick[covered]),
        reference_north=held(covered, north),
        reference_east=held(covered, east),
        reference_speed=held(covered, speed),
        reference_course=held(covered, course),
        origin_latitude=float(fixes.latitude[origin]),
        origin_longitude=float(fixes.longitude[origin]),
    )
