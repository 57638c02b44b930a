"""What looks wrong in a recording: sensors that hang, axes and units that the motion contradicts.

Each doubt is a line for `canine check` and a note of `canine replay`. None refuses a recording: a body may
move so that nothing can be told, and then nothing is said.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from harness.log.geodesy import TangentPlane
from harness.recording.agreement import Offset, gravity, swept, turning_offset
from harness.recording.attitude import Array
from harness.recording.recording import Fixes, Recording
from harness.recording.signals import MOVING_M_S

FAR_S = 0.3  # s of offset by the turns: more is a wrong clock, not a body that looks ahead
# noise changes some of three values with every sample; in motion even a coarse IMU repeats none for long
HUNG_S = 0.5  # s of motion in which a sensor repeats all three values
HUNG_M = 5.0  # m that the speeds say while the position stands: a place in 1e-5 deg stands for 1.1 m
COURSE_S = 5.0  # s of a stretch whose displacement is compared with the velocities: metres, above the noise
COURSE_OFF = 0.3  # part by which displacement and velocities may differ: 17 deg, or the factor 0.7
PUSH_S = 0.5  # s of a stretch whose force is compared with the change of velocity
LEAST_PUSH = (
    0.4  # of the force that a change of velocity explains: the pitch and the lean of a body take some
)
LARGEST_YAW_DEG = 60.0  # deg between the force and the change of velocity: more is a wrong mounting, not slip
TURN_S = 1.0  # s between the fixes of a turn: over less, gait and the noise of the courses hide it
LEAST_STRETCHES = 6
SURE = 2.5  # standard deviations of an estimate beyond which a doubt is told


def doubts(recording: Recording) -> tuple[str, ...]:
    """All that looks wrong in a recording, a line each; gravity is judged with the mounting."""
    clock, turning = clock_warning(turning_offset(recording)), turning_offset(recording, TURN_S)
    lines = [*hung_sensors(recording), hung_receiver(recording.fixes), wrong_course(recording.fixes), clock]
    if turning.reversed:
        lines.append(
            "the yaw rate is the reverse of the rate of the course (correlation "
            f"{turning.correlation:.2f}); has the gyroscope's vertical axis the wrong sign?"
        )
    if not clock and not gravity(recording.specific_force, np.eye(3)).warning:  # which must be mended first
        lines.append(wrong_axes(recording))
    return tuple(line for line in lines if line)


def clock_warning(turning: Offset) -> str:
    """What the turns say of the clocks; "" if nothing."""
    if turning.seconds is None or abs(turning.seconds) <= FAR_S:
        return ""
    early = "early" if turning.seconds > 0 else "late"
    return f"by its turns the clock of the IMU is {abs(turning.seconds):.2f} s {early}: see clock.imu_offset"


def hung_sensors(recording: Recording) -> list[str]:
    """A line on each sensor of the IMU that repeats its values while the receiver moves."""
    speed = np.hypot(recording.fixes.velocity_north, recording.fixes.velocity_east)
    moving = swept(recording.fixes.t, (speed > MOVING_M_S).astype(np.float64))
    lines = []
    for sensor, values in (("accelerometer", recording.specific_force), ("gyroscope", recording.rate)):
        first, last = _standing(values)
        start, end = recording.imu_t[first], recording.imu_t[last]
        moved = np.interp(end, recording.fixes.t, moving) - np.interp(start, recording.fixes.t, moving)
        if len(moved) and moved.max() >= HUNG_S:
            i = int(moved.argmax())
            span = f"from {start[i]:.1f} to {end[i]:.1f} s"
            lines.append(f"the {sensor} repeats one sample {span}, in motion; did it hang?")
    return lines


def hung_receiver(fixes: Fixes) -> str:
    """Does the position stand still while the speed of the fixes says that it moves?"""
    speed = np.hypot(fixes.velocity_north, fixes.velocity_east)
    way = swept(fixes.t, np.where(speed > MOVING_M_S, speed, 0.0))
    first, last = _standing(np.column_stack([fixes.latitude, fixes.longitude]))
    moved = way[last] - way[first]
    if not len(moved) or moved.max() < max(HUNG_M, float(np.median(fixes.h_acc))):
        return ""
    i = int(moved.argmax())
    return (
        f"the position stands still from {fixes.t[first[i]]:.1f} to {fixes.t[last[i]]:.1f} s, while the "
        f"speeds of the fixes say {moved[i]:.0f} m; did the receiver hang?"
    )


def wrong_course(fixes: Fixes) -> str:
    """Do the positions go where the velocities say, and as far?"""
    place = _places(fixes)
    way = swept(fixes.t, fixes.velocity_north + 1j * fixes.velocity_east)
    first, last = _stretches(fixes.t, COURSE_S)
    moving = np.abs(way[last] - way[first]) > MOVING_M_S * COURSE_S / 2
    first, last = first[moving], last[moving]
    moved, said = place[last] - place[first], way[last] - way[first]
    power = float((np.abs(said) ** 2).sum())
    if len(said) < LEAST_STRETCHES:
        return ""
    ratio = complex((moved * said.conj()).sum()) / power
    deviation = float(np.sqrt((np.abs(moved - ratio * said) ** 2).sum() / (len(said) - 1) / power))
    if abs(ratio - 1) - SURE * deviation <= COURSE_OFF:
        return ""
    return (
        f"along the courses of the fixes the positions move {ratio.real:.2f} times as far as their speeds "
        f"say, and {ratio.imag:.2f} times to the right; are units and sense of speed and course right?"
    )


def wrong_axes(recording: Recording) -> str:
    """Does the force in the body's horizontal plane follow the change of velocity, or its mirror image?

    As complex numbers, forward and right: force = turned * change + mirrored * conj(change) + constant.
    Axes that are right have turned = 1, and a yaw of the mounting turns it. Axes that are left-handed, or of
    which one is reversed, have `mirrored` instead.
    """
    fixes = recording.fixes
    velocity = fixes.velocity_north + 1j * fixes.velocity_east
    mean = (velocity[1:] + velocity[:-1]) / 2
    moving = np.abs(mean) > MOVING_M_S
    along = np.where(moving, mean.conj() / np.where(moving, np.abs(mean), 1), 0)
    change = np.r_[0, np.cumsum(np.diff(velocity) * along)]
    rests = np.r_[0, np.cumsum(~moving)]
    force = swept(recording.imu_t, recording.specific_force[:, 0] + 1j * recording.specific_force[:, 1])
    first, last = _stretches(fixes.t, PUSH_S)
    inside = (rests[first] == rests[last]) & (fixes.t[first] >= recording.imu_t[0])
    inside &= fixes.t[last] <= recording.imu_t[-1]
    first, last = first[inside], last[inside]
    lasts = fixes.t[last] - fixes.t[first]
    if len(lasts) < LEAST_STRETCHES:
        return ""
    pushed = np.interp(fixes.t[last], recording.imu_t, force) - np.interp(
        fixes.t[first], recording.imu_t, force
    )
    gained = (change[last] - change[first]) / lasts
    terms = np.column_stack([gained, gained.conj(), np.ones(len(gained))])
    if np.linalg.matrix_rank(terms) < terms.shape[1]:
        return ""
    solution, *_ = np.linalg.lstsq(terms, pushed / lasts, rcond=None)
    rest = pushed / lasts - terms @ solution
    noise = float((np.abs(rest) ** 2).sum()) / (len(rest) - terms.shape[1])
    deviation = float(np.sqrt(noise * np.linalg.inv(terms.conj().T @ terms)[0, 0].real))
    turned, mirrored = complex(solution[0]), complex(solution[1])
    lead = abs(mirrored) - abs(turned)
    if abs(mirrored) > LEAST_PUSH and lead > SURE * deviation:
        return (
            f"the force follows the mirror image of the change of velocity ({abs(mirrored):.2f} of it, "
            f"{abs(turned):.2f} of the change itself); are the IMU's axes left-handed, or is one reversed?"
        )
    yaw = float(np.degrees(np.angle(turned)))
    if abs(turned) > LEAST_PUSH and -lead > SURE * deviation and abs(yaw) > LARGEST_YAW_DEG:
        return (
            f"the force is turned by {abs(yaw):.0f} deg to the {'right' if yaw > 0 else 'left'} against the "
            "change of velocity; has imu.mounting the right yaw, and the accelerometer the right signs?"
        )
    return ""


def _places(fixes: Fixes) -> npt.NDArray[np.complex128]:
    """North + i east [m] of the fixes (f,)."""
    plane = TangentPlane(*(float(part[0]) for part in (fixes.latitude, fixes.longitude, fixes.height)))
    north, east = plane.to_plane(fixes.latitude, fixes.longitude)
    return np.asarray(north + 1j * east)


def _standing(values: Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """The first and the last of each run of equal rows (n, m)."""
    same = np.r_[False, (values[1:] == values[:-1]).all(axis=1), False].astype(np.int8)
    return np.flatnonzero(np.diff(same) > 0), np.flatnonzero(np.diff(same) < 0)


def _stretches(times: Array, seconds: float) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """First and last of stretches of this length one behind the other, without those that a hole is in."""
    interval = float(np.median(np.diff(times))) if len(times) > 1 else seconds
    steps = max(1, round(seconds / interval))
    ends = np.arange(0, len(times), steps)
    whole = times[ends[1:]] - times[ends[:-1]] <= 1.2 * steps * interval
    return ends[:-1][whole], ends[1:][whole]
