"""Roll, pitch and heading on the estimator's ticks, from raw inertial samples and courses over ground.

Everything is causal: a value at a tick depends only on samples and fixes at or before it, as on a wearable
computer. Body axes are forward, right, down; roll, pitch (nose up positive) and heading (clockwise from
north) are the aerospace Euler angles, in rad.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from ahrs.common.orientation import acc2q
from ahrs.filters import Madgwick
from scipy.signal import butter, sosfilt, sosfilt_zi

from harness.recording.holes import holes_of_imu
from models.kit.block import Block

Array = npt.NDArray[np.float64]

TICK_S = Block.sample_time
OVERSAMPLING = 40  # the filter runs at 1 kHz, the resolution of the sample times
CUTOFF_HZ = 8.0  # -3 dB; the ticks' Nyquist frequency is 12.5 Hz, and 25 Hz (-40 dB) aliases to 0
FILTER_ORDER = 4  # below 2 Hz its group delay is 2.613 / (2 pi CUTOFF_HZ) = 52 ms


def anti_alias(t: Array, samples: Array, ticks: int, *, mean: bool = False) -> Array:
    """Low-pass `samples` (n, m) taken at uneven times `t` (n,) s, and sample them at the ticks k * TICK_S.

    A uniform grid of 1 kHz holds the last sample at each instant (before the first sample, the first). It
    passes a Butterworth filter that starts settled on its first input. With `mean`, each value is the mean
    of the filtered signal since the last tick, as the integral of a turn rate needs. Returns (ticks, m).
    """
    grid = np.arange((ticks - 1) * OVERSAMPLING + 1) * (TICK_S / OVERSAMPLING)
    held = samples[np.maximum(np.searchsorted(t, grid + 1e-9, side="right") - 1, 0)]
    sos = butter(FILTER_ORDER, CUTOFF_HZ, fs=OVERSAMPLING / TICK_S, output="sos")
    settled = sosfilt_zi(sos)[:, :, None] * held[0]
    filtered, _ = sosfilt(sos, held, axis=0, zi=settled)
    if mean:
        filtered[1:] = np.repeat(
            filtered[1:].reshape(ticks - 1, OVERSAMPLING, -1).mean(axis=1), OVERSAMPLING, axis=0
        )
    return np.asarray(filtered[::OVERSAMPLING], dtype=np.float64)


def euler_angles(t: Array, specific_force: Array, rate: Array) -> Array:
    """Roll, pitch and heading, unwrapped, (n, 3) rad; the heading counts from an arbitrary zero.

    `t` (n,) s, `specific_force` (n, 3) m/s2 and `rate` (n, 3) rad/s in body axes. The filter is Madgwick's
    gradient filter (Madgwick, Harrison, Vaidyanathan, ICORR 2011) at the library's gain of 0.033 rad/s. Its
    step has a fixed length, so the centripetal acceleration of a long turn tilts it slowly; unlike Mahony's
    filter it has no bias state that winds up in a turn. Its vertical is gravity (minus the specific force),
    so its earth frame is north, east, down, turned by the unknown heading. Over a hole of the samples the
    angles stay: what the body did meanwhile is unknown, and one step of seconds would turn and tilt them far.
    """
    elapsed = np.diff(t)
    for start, _ in holes_of_imu(t):
        elapsed[np.searchsorted(t, start)] = 0.0
    madgwick = Madgwick()
    q = np.empty((len(t), 4))
    q[0] = acc2q(-specific_force[0])
    for i in range(1, len(t)):
        q[i] = madgwick.updateIMU(q[i - 1], rate[i], -specific_force[i], dt=elapsed[i - 1])
    w, x, y, z = q.T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.column_stack([np.unwrap(roll), pitch, np.unwrap(heading)])


def align_heading(
    heading: Array,
    fix_tick: npt.NDArray[np.int64],
    course: Array,
    time_constant_s: float,
    lost: Sequence[int] = (),
) -> Array:
    """Turn a heading from an arbitrary zero (ticks,) into one clockwise from north, by courses over ground.

    `course` (f,) rad became known at the ascending ticks `fix_tick` (f,). The offset is the mean of
    course - heading over the fixes so far, which later forgets older ones with `time_constant_s`; before the
    first fix it is zero. From the ticks `lost` on the zero is another one, and the mean begins anew. Returns
    (ticks,) rad in (-pi, pi].
    """
    offset = np.zeros_like(heading)
    mean, last, n = 0j, 0, 0
    for k, course_at_fix in zip(fix_tick, course, strict=True):
        n = 1 if any(last < lost_at <= k for lost_at in lost) else n + 1
        forgetting = 1 - np.exp(-(k - last) * TICK_S / time_constant_s)
        mean += max(1 / n, forgetting) * (np.exp(1j * (course_at_fix - heading[k])) - mean)
        offset[k:] = np.angle(mean)
        last = k
    return np.asarray(np.angle(np.exp(1j * (heading + offset))), dtype=np.float64)
