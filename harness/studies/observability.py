"""Study `observability`: what fixes can tell an estimator along a motion, and what they cannot (App. B-D).

The information of all fixes of a motion about the state at its start is the observability Gramian weighted
by the fixes' accuracy, sum of Phi_k^T H^T R^-1 H Phi_k, without process noise. Each state is counted in a
deviation of its own, which is what is known of it at the start, so that an eigenvalue lambda says: in this
direction the fixes know sqrt(lambda) times as much as was known. Directions below 1 are not observed.
Beside it stands the Riccati recursion with process noise: what a filter can know at the end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from rich.console import Console
from rich.markup import escape

from harness.drawing import BELOW, ESTIMATES, GRID, house_style, new_figure, set_title
from harness.studies.study import Options, Progress, Result
from harness.terminal import new_table, print_table
from models.earth import GRAVITY
from models.kit.timing import TICK
from models.kit.units import DEG

Array = npt.NDArray[np.float64]

TAKES: frozenset[str] = frozenset()

FIX_S = 0.25  # s between fixes (2.3)
POSITION_SD, SPEED_SD = 1.75, 0.1  # m, m/s of a fix (3.15, B.11)
COURSE_SD = 0.05  # m/s over the speed: rad of the course (D.12)
COURSE_SD_MOST = np.pi  # rad: a course at rest says nothing
MAGNETIC_SD = 0.1  # rad (C.9, pedestrian)
ACCELERATION_NOISE, GYRO_NOISE = 1.0 * TICK, 0.1 * DEG * TICK  # m/s, rad in a tick: of D.14 and D.13
ZERO = 1e-10  # of the largest eigenvalue, relative: what rounding leaves of an eigenvalue that is 0


@dataclass(frozen=True)
class Motion:
    """A motion on the ticks, (ticks,) each: speed [m/s], heading and pitch [rad]."""

    speed: Array
    heading: Array
    pitch: Array


@dataclass(frozen=True)
class StateOfFilter:
    """A state of an extended estimator: its name, its unit, what is known of it at the start."""

    name: str
    unit: str
    deviation: float  # in SI
    scale: float = 1.0  # SI to the unit shown
    noise: float = 0.0  # in SI, standard deviation that a tick adds


SPEED = StateOfFilter("speed", "m/s", np.sqrt(0.1), noise=ACCELERATION_NOISE)  # P0 of eq. 3.17
BIAS = StateOfFilter("accelerometer bias", "m/s2", 1.0, noise=1e-3)  # eq. 3.16, 3.17
NORTH, EAST = (StateOfFilter(name, "m", 3.5) for name in ("north", "east"))  # a receiver's stated 3.5 m
OFFSET = StateOfFilter("pitch offset", "deg", 10 * DEG, 1 / DEG)  # a pack that sits askew (D.5)
HEADING = StateOfFilter("heading", "deg", np.pi, 1 / DEG, GYRO_NOISE)  # unknown at the start (B.13)
GYRO_BIAS = StateOfFilter("gyro bias", "deg/s", 1 * DEG, 1 / DEG)
MAGNETIC_BIAS = StateOfFilter("magnetometer bias", "deg", 10 * DEG, 1 / DEG)

SYSTEMS: dict[str, tuple[StateOfFilter, ...]] = {
    "four_state": (SPEED, BIAS, NORTH, EAST),
    "four_state with a pitch offset": (SPEED, BIAS, NORTH, EAST, OFFSET),
    "six_state": (SPEED, BIAS, HEADING, GYRO_BIAS, NORTH, EAST),
    "seven_state": (SPEED, BIAS, HEADING, GYRO_BIAS, NORTH, EAST, MAGNETIC_BIAS),
}


def motions() -> dict[str, Motion]:
    """The motions that are compared, 40 s each but for that of D.6.1."""
    time = np.arange(0, 40, TICK)
    zero, walking = np.zeros_like(time), np.full_like(time, 1.5)
    stop_and_go = np.clip(1.5 * np.sin(2 * np.pi * time / 10) + 0.5, 0, 1.5)
    sitting = (time % 10) > 7  # 3 s of every 10 s it sits, pack nose up
    pitch_sitting = np.where(sitting, 40 * DEG, -8.5 * DEG)
    return {
        "stands": Motion(zero, zero, zero - 8.5 * DEG),
        "walks straight": Motion(walking, zero + 0.5, zero - 8.5 * DEG),
        "walks in turns": Motion(walking, 0.6 * time, zero - 8.5 * DEG),
        "stops and goes": Motion(stop_and_go, zero + 0.5, zero - 8.5 * DEG),
        "D.6.1, 10 deg uphill": _profile(),
        "pitch wanders, 4 deg in 3 s": Motion(
            walking, zero + 0.5, (-8.5 + 4 * np.sin(2 * np.pi * time / 3)) * DEG
        ),
        "walks and sits": Motion(np.where(sitting, 0.0, 1.5), zero + 0.5, pitch_sitting),
    }


def _profile() -> Motion:
    """The motion of D.6.1: 1 m/s2 for 3 s, a turn of 90 deg in 1 s that slows it, then 15 s uphill."""
    time = np.arange(0, 19, TICK)
    speed = np.interp(time, [0, 3, 4], [0.0, 3.0, 2.0])
    heading = np.interp(time, [3, 4], [0.0, np.pi / 2])
    return Motion(speed, heading, np.where(time >= 4, 10 * DEG, 0.0))


def dynamics(system: str, speed: float, heading: float, pitch: float) -> Array:
    """The continuous Jacobian (n, n) of a system's states (eq. 3.12, B.6, C.6).

    The pitch offset is what the attitude reference reads too much: the true pitch is the reading less it.
    """
    states = SYSTEMS[system]
    at = {state.name: i for i, state in enumerate(states)}
    F = np.zeros((len(states), len(states)))
    F[0, 1] = -1.0  # eq. 3.10
    F[at["north"], 0], F[at["east"], 0] = np.cos(heading), np.sin(heading)  # eq. 3.11
    if OFFSET in states:
        F[0, at[OFFSET.name]] = GRAVITY * np.cos(pitch)  # d/d(offset) of -g sin(measured - offset)
    if HEADING in states:
        F[at["heading"], at["gyro bias"]] = -1.0  # eq. B.3
        F[at["north"], at["heading"]] = -speed * np.sin(heading)  # eq. B.5
        F[at["east"], at["heading"]] = speed * np.cos(heading)
    return F


def over_a_tick(F: Array) -> Array:
    """The transition matrix of a tick, exact: no state of ours acts through more than one other, F^3 = 0."""
    return np.asarray(np.eye(len(F)) + F * TICK + F @ F * (TICK**2 / 2))


def measurement(system: str, speed: float) -> tuple[Array, Array]:
    """H (m, n) of a fix and the deviations (m,) of its values (eq. 3.14, B.8, C.4)."""
    states = SYSTEMS[system]
    at = {state.name: i for i, state in enumerate(states)}
    rows, deviations = [{"speed": 1.0}, {"north": 1.0}, {"east": 1.0}], [SPEED_SD, POSITION_SD, POSITION_SD]
    if HEADING in states:
        rows.append({"heading": 1.0})
        deviations.append(min(COURSE_SD / max(speed, 1e-9), COURSE_SD_MOST))
    if MAGNETIC_BIAS in states:
        rows.append({"heading": 1.0, "magnetometer bias": 1.0})
        deviations.append(MAGNETIC_SD)
    H = np.zeros((len(rows), len(states)))
    for i, row in enumerate(rows):
        for name, value in row.items():
            H[i, at[name]] = value
    return H, np.array(deviations)


def gramian(system: str, motion: Motion) -> Array:
    """The information (n, n) of all fixes about the state at the start, in the states' own deviations."""
    n = len(SYSTEMS[system])
    scale = np.diag([state.deviation for state in SYSTEMS[system]])
    transition, information, fixes = np.eye(n), np.zeros((n, n)), 0
    for tick, values in enumerate(zip(motion.speed, motion.heading, motion.pitch, strict=True)):
        if tick * TICK >= fixes * FIX_S - 1e-9:
            H, deviations = measurement(system, values[0])
            row = H @ transition @ scale / deviations[:, None]
            information += row.T @ row
            fixes += 1
        transition = over_a_tick(dynamics(system, *values)) @ transition
    return information


def covariance(system: str, motion: Motion) -> Array:
    """What a filter with process noise knows: the standard deviations (ticks, n) along the motion, in SI."""
    states = SYSTEMS[system]
    P = np.diag([state.deviation**2 for state in states])
    Q = np.diag([state.noise**2 for state in states])
    deviations, fixes = np.empty((len(motion.speed), len(states))), 0
    for tick, values in enumerate(zip(motion.speed, motion.heading, motion.pitch, strict=True)):
        if tick * TICK >= fixes * FIX_S - 1e-9:
            H, sd = measurement(system, values[0])
            gain = np.linalg.solve(H @ P @ H.T + np.diag(sd**2), H @ P).T  # eq. 3.1
            left = np.eye(len(states)) - gain @ H
            P = left @ P @ left.T + gain @ np.diag(sd**2) @ gain.T  # eq. 3.3, Joseph's form: stays positive
            fixes += 1
        deviations[tick] = np.sqrt(np.diag(P))
        transition = over_a_tick(dynamics(system, *values))
        P = transition @ P @ transition.T + Q  # eq. 3.5
    return deviations


def judge(system: str, motion: Motion) -> dict[str, Any]:
    """Rank, condition and least observable direction of the Gramian, and what is known at the end."""
    states, information = SYSTEMS[system], gramian(system, motion)
    values, vectors = np.linalg.eigh(information)
    smoothed = np.sqrt(np.diag(np.linalg.inv(np.eye(len(states)) + information)))  # with P0 = I
    filtered = covariance(system, motion)[-1]
    shown = [(state, state.deviation * state.scale) for state in states]
    return {
        "states": len(states),
        "rank": int((values > ZERO * values[-1]).sum()),
        "better_known": int((values > 1).sum()),
        "condition": float(values[-1] / values[0]) if values[0] > ZERO * values[-1] else None,
        "eigenvalues": [max(0.0, float(value)) for value in values],
        "weakest": direction(states, vectors[:, 0]),
        "sd_without_noise": {
            state.name: float(sd * unit) for (state, unit), sd in zip(shown, smoothed, strict=True)
        },
        "sd": {state.name: float(sd * state.scale) for state, sd in zip(states, filtered, strict=True)},
    }


def direction(states: Sequence[StateOfFilter], vector: Array) -> str:
    """A direction in the scaled state, in words: 1 unit of its largest part, with all above a tenth of it."""
    largest = np.argmax(np.abs(vector))
    shown = np.array([state.deviation * state.scale for state in states])
    physical = vector / vector[largest] * shown / shown[largest]
    named = [
        i for i in np.argsort(-np.abs(vector), kind="stable") if abs(vector[i]) > 0.1 * abs(vector[largest])
    ]
    return " with ".join(f"{states[i].name} {physical[i]:+.2g} {states[i].unit}" for i in named)


def run(options: Options, progress: Progress) -> Result:
    """Every system along every motion."""
    return {
        "at_the_start": {
            state.name: {"sd": state.deviation * state.scale, "unit": state.unit}
            for states in SYSTEMS.values()
            for state in states
        },
        "systems": {
            system: {name: judge(system, motion) for name, motion in motions().items()} for system in SYSTEMS
        },
    }


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print a table for each system: rank, condition, the biases' deviations, the weakest direction."""
    for system, rows in result["systems"].items():
        biases = [state for state in SYSTEMS[system] if "bias" in state.name or "offset" in state.name]
        table = new_table()
        table.add_column(system)
        for heading in ("rank", "better\nknown", "condition"):
            table.add_column(heading, justify="right")
        for state in biases:
            heading = f"{state.name}, sd\n[{state.unit}]".replace(" ", "\n", 1)
            table.add_column(escape(heading), justify="right")
        table.add_column("least observable direction")
        for name, row in rows.items():
            condition = "-" if row["condition"] is None else f"{row['condition']:.0e}"
            table.add_row(
                name,
                f"{row['rank']} of {row['states']}",
                str(row["better_known"]),
                condition,
                *(f"{row['sd'][state.name]:.3g}" for state in biases),
                row["weakest"],
            )
        print_table(table, console)
    console.print(
        "sd: standard deviation at the end of the motion, in a filter with process noise", style="dim"
    )


def draw(result: Mapping[str, Any]) -> Mapping[str, Figure]:
    """The study's picture."""
    return {"observability": _picture(result)}


@house_style()
def _picture(result: Mapping[str, Any]) -> Figure:
    """How the deviation of each bias falls along each motion, in a filter with process noise."""
    picture = new_figure(14, 5.2)
    panels = (
        ("four_state with a pitch offset", BIAS),
        ("six_state", GYRO_BIAS),
        ("seven_state", MAGNETIC_BIAS),
    )
    for axes, (system, state) in zip(picture.subplots(1, len(panels)), panels, strict=True):
        place = SYSTEMS[system].index(state)
        for i, (name, motion) in enumerate(motions().items()):
            deviations = covariance(system, motion)[:, place] * state.scale
            style = {"color": ESTIMATES[i % 5], "linestyle": "-" if i < 5 else "--"}
            axes.semilogy(np.arange(len(deviations)) * TICK, deviations, label=name, **style)
        axes.set_title(f"{system}: {state.name}", fontsize=10)
        axes.set_xlabel("time [s]")
        axes.set_ylabel(f"standard deviation [{state.unit}]")
        axes.grid(**GRID)
    handles, labels = picture.axes[0].get_legend_handles_labels()
    picture.legend(handles, labels, loc="outside lower center", ncols=4, **BELOW)
    set_title(picture, "What fixes tell an estimator about its biases, by motion")
    return picture
