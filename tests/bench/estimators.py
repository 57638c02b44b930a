"""The estimators at native speed: each tick beside filterpy's, and a million ticks at once."""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from codegen.batch.series import Series
from models.estimator import Estimator
from models.kit.timing import TICK
from models.system import ESTIMATOR, ESTIMATORS

ROUNDS = 3
MILLION = 1_000_000
PEER_TICKS = 600
FIX_EVERY = 6  # ticks
WITHIN, LARGEST_WITHIN = 0.2, 0.5  # s of a core: a million ticks of four_state, and of the largest

Row = tuple[str, str, str, str]


def rows() -> tuple[list[Row], list[str]]:
    """The table's rows, and the results that fall short of what is expected."""
    table: list[Row] = []
    short: list[str] = []
    runs = {name: native(block) for name, block in ESTIMATORS.items()}
    million: dict[str, float] = {}
    for name, block in ESTIMATORS.items():
        peer = by_filterpy(block)
        pairs = [
            (core_seconds_of(runs[name]) / MILLION, core_seconds_of(peer) / PEER_TICKS) for _ in range(ROUNDS)
        ]
        ours, theirs = (median(pair[side] for pair in pairs) for side in (0, 1))
        ratio = median(theirs / ours for ours, theirs in pairs)
        million[name] = min(ours for ours, _ in pairs) * MILLION
        states, scalars = size_of(block)
        table.append(
            (
                f"{name} in C, against filterpy with {states} states, {scalars} scalars a fix",
                f"{1e9 * ours:.0f} ns/tick",
                f"{1e9 * theirs:,.0f} ns/tick",
                f"{ratio:.0f}",
            )
        )
    largest = max(million, key=lambda name: million[name])
    for name, demand in {ESTIMATOR: WITHIN, largest: LARGEST_WITHIN}.items():
        table.append((f"a million ticks of {name} (at most {demand:g} s)", f"{million[name]:.2f} s", "", ""))
        if million[name] > demand:
            short.append(
                f"a million ticks of {name} take {million[name]:.2f} s of a core; expected {demand:g} s"
            )
    return table, short


def size_of(block: type[Estimator]) -> tuple[int, int]:
    """Number of states, and of scalars that a fix gives."""
    return tuple(block.variables()[name].size or 1 for name in ("x", "innovation"))  # type: ignore[return-value]


def core_seconds_of(work: Callable[[], object]) -> float:
    """How long it takes of its core, however busy the core is."""
    start = time.thread_time()
    work()
    return time.thread_time() - start


def native(block: type[Estimator]) -> Callable[[], object]:
    """A million ticks of a walk to the northeast in C, a fix each sixth; compiled once, before the clock."""
    way = TICK * np.arange(MILLION)
    signals = {
        "accel_x": np.where(np.arange(MILLION) & 8, 0.5, -0.5),
        "heading_meas": np.full(MILLION, 0.3),
        "gps_fix": np.arange(MILLION) % FIX_EVERY == 0,
        "gps_north": (0.955 * way) % 1e4,
        "gps_east": (0.296 * way) % 1e4,
        "gps_speed": np.ones(MILLION),
        "gps_course": np.full(MILLION, 0.3),
        "gps_h_acc": np.full(MILLION, 3.5),
        "gps_s_acc": np.full(MILLION, 0.1),
        "accel_z": np.full(MILLION, -9.8),
        "mag_x": np.full(MILLION, 2e-5),
        "mag_z": np.full(MILLION, 4e-5),
    }
    rest = np.zeros(MILLION)
    inputs = {
        f"{block.title()}.{name}": np.asarray(signals.get(name, rest), np.float64)
        for name in block.flat_names("input")
    }
    series = Series(block)
    series.run({name: row[:FIX_EVERY] for name, row in inputs.items()})
    return lambda: series.run(inputs)


def by_filterpy(block: type[Estimator]) -> Callable[[], object]:
    """The ticks of a filter of that size in filterpy."""
    states, scalars = size_of(block)
    observe = np.eye(scalars, states)

    def work() -> None:
        ekf = ExtendedKalmanFilter(dim_x=states, dim_z=scalars)
        ekf.P, ekf.Q, ekf.R = np.eye(states), 1e-4 * np.eye(states), np.eye(scalars)
        ekf.F = np.eye(states) + 0.04 * np.eye(states, k=1)
        ekf.B = np.full((states, 1), 0.04)
        for tick in range(PEER_TICKS):
            ekf.predict(np.array([[0.5 if tick & 8 else -0.5]]))
            if tick % FIX_EVERY == 0:
                ekf.update(np.ones((scalars, 1)), lambda x: observe, lambda x: observe @ x)

    return work


if __name__ == "__main__":
    for row in rows()[0]:
        print(*row, sep="   ")
