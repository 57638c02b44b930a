"""Roll, pitch and heading on the estimator's ticks: the Canine AHRS over raw samples, or as recorded.

Everything is causal: a value at a tick depends only on samples and fixes at or before it, as on a wearable
computer. Body axes are forward, right, down; roll, pitch (nose up positive) and heading (clockwise from
north) are the aerospace Euler angles, in rad.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, sosfilt, sosfilt_zi

from codegen.batch.series import Series
from models.canine_ahrs import CanineAhrs

Array = npt.NDArray[np.float64]

TICK_S = CanineAhrs.sample_time
OVERSAMPLING = 40  # the filter runs at 1 kHz, the resolution of the sample times
CUTOFF_HZ = 8.0  # -3 dB; the ticks' Nyquist frequency is 12.5 Hz, and 25 Hz (-40 dB) aliases to 0
SAMPLES = [f"{sensor}_{axis}" for sensor in ("accel", "gyro") for axis in "xyz"]
AHRS = CanineAhrs.title()
ANGLES = ("roll_meas", "pitch_meas", "heading_meas", "heading_meas_sd")
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


def own_attitude(samples: Array, fix: Array, speed: Array, course: Array, s_acc: Array) -> Array:
    """Roll, pitch, heading and its standard deviation [rad] by the block `canine_ahrs`, (ticks, 4).

    The heading counts from an arbitrary zero until the first moving fix.

    Args:
        samples: (ticks, 6) specific force [m/s2] and turn rate [rad/s], this one the mean since the last
            tick; a tick with NaN has no sample.
        fix: 1 on ticks with a new fix, else 0 (ticks,).
        speed, course, s_acc: m/s, rad, m/s of the fix at each tick, or of the one before it (ticks,).
    """
    inputs = dict(zip(SAMPLES, samples.T, strict=True))
    inputs |= {"gps_fix": fix, "gps_speed": speed, "gps_course": course, "gps_s_acc": s_acc}
    rows = _ahrs().run({f"{AHRS}.{name}": row for name, row in inputs.items()})
    return np.column_stack([rows[f"{AHRS}.{name}"] for name in ANGLES])


@cache
def _ahrs() -> Series:
    return Series(CanineAhrs, [f"{AHRS}.{name}" for name in ANGLES])


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
