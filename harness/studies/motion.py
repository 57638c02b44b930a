"""How the pack moves: sets of sensors and pack beside the text's figures (B.4, D.5) and a real dog's unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from rich.console import Console
from scipy import signal

from codegen.batch.series import Series
from harness.drawing import ESTIMATES, GRID, TRUTH, Style, house_style, new_figure, set_title
from harness.recording.described import UNITS, Column, FileDescription, read_columns
from harness.recording.recording import RecordingError
from harness.studies.study import Options, Progress, Result
from harness.terminal import new_table, print_table
from models.errors import UsageError, nearest
from models.kit.timing import TICK
from models.profile import SEGMENTS, Profile
from models.sensors import Sensors
from models.sets import SETS
from models.system import System, by_name

Array = npt.NDArray[np.float64]

TAKES = frozenset({"seeds", "set", "recording"})
SEEDS = 10
LENGTH = 60.0  # s of a trial
SETTLED = 2.0  # s at its begin that are left out
GAITS = {"walking": 1.0, "running": 4.86}  # m/s: at a walk as in detection mode (D.3); Table 5.1
STRIDES = (1.0, 8.0)  # Hz between which the main frequency is looked for
HALF_SECOND = 0.5  # within which the pitch's swing is taken
LINES = 256  # readings that a spectrum is taken over: 10 s at 25 Hz
JUMP = np.radians(8.0)  # from a reading to the next: a joint between pieces
# B.4 and D.5 say these of a walking, and of a running or sprinting dog
PUBLISHED: dict[str, dict[str, str]] = {
    "walking": {
        "swing": "10 to 20", "pitch": "-8.5", "pitch_swing": "5 to 10 (15 to 18)",
        "yaw_rate": "-70 to 70", "mean": "above 1", "largest": "above 20",
    },
    "running": {"swing": "40 to 50", "pitch_swing": "40 to 60", "yaw_rate": "-70 to 70"},
}  # fmt: skip
# the dog's unit: forward is -x, right -y, down z, as gravity shows while the dog sits and walks
DOG = "real dog"
DOG_RATE = 105.0  # readings a second, found by fit: the table has no time
DOG_COLUMNS = {
    "forward": Column("ax", np.nan, -UNITS["m/s2"]["g"]),
    "pitch": Column("AngleY", np.nan, UNITS["rad"]["deg"]),
    "yaw_rate": Column("wz", np.nan, UNITS["rad/s"]["deg/s"]),
}
COLORS = dict(zip(SETS, ESTIMATES, strict=False)) | {DOG: TRUTH}
SPECTRA = {
    "forward": ("longitudinal reading", "(m/s$^2$)$^2$/Hz"),
    "pitch": ("pitch", "deg$^2$/Hz"),
    "yaw_rate": ("yaw rate", "(deg/s)$^2$/Hz"),
}


@dataclass(frozen=True, eq=False)
class Motion:
    """What an inertial unit reads, (n,) each: forward [m/s2], pitch [rad], yaw rate [rad/s].

    Attributes:
        rate: readings a second.
    """

    rate: float
    forward: Array
    pitch: Array
    yaw_rate: Array


def run(options: Options, progress: Progress) -> Result:
    """The figures and spectra of each set, and of a real dog where its recording is given.

    Raises:
        UsageError: there is no such set.
        RecordingError: the folder lacks walking.csv or running.csv, or a column of them.
    """
    if options.set is not None and options.set not in SETS:
        raise UsageError(f'there is no set "{options.set}"{nearest(options.set, SETS)}')
    for gait in GAITS:
        if options.recording and not (options.recording / f"{gait}.csv").is_file():
            raise RecordingError(
                f"{options.recording}: has no {gait}.csv; expected the folder of a unit that a dog wore, "
                f"with {' and '.join(f'{name}.csv' for name in GAITS)}"
            )
    seeds = options.seeds or SEEDS
    chosen = [options.set] if options.set else list(SETS)
    series = _series()
    gaits: dict[str, dict[str, Any]] = {gait: {} for gait in GAITS}
    for done, (gait, speed) in enumerate(GAITS.items()):
        for number, name in enumerate(chosen):
            trials = [_trial(series, name, speed, seed) for seed in range(1, seeds + 1)]
            gaits[gait][name] = _described(trials)
            progress(100 * (done + (number + 1) / len(chosen)) / len(GAITS))
        if options.recording:
            gaits[gait][DOG] = _described(_dog(options.recording / f"{gait}.csv"))
    return {"seeds": seeds, "length_s": LENGTH, "speeds_m_s": GAITS, "published": PUBLISHED, "gaits": gaits}


def _series() -> Series:
    components = {"plant": Profile, "sensors": Sensors}
    system = System("study_motion", components, by_name(components, {"sensors": "plant"}))
    return Series(system, ["sensors.accel_x", "sensors.pitch_meas", "sensors.gyro_z"])


def _trial(series: Series, name: str, speed: float, seed: int) -> Motion:
    """Straight on at a steady speed, on level ground."""
    steady = {
        f"{profile}[{i + 1}]": 0.0
        for profile in ("acceleration_profile", "yaw_rate_profile", "pitch_profile")
        for i in range(SEGMENTS)
    }
    plant = {**steady, "start_speed": speed, "seed": float(seed), **SETS[name]["plant"]}
    sensors = {"seed": float(seed), **SETS[name]["sensors"]}
    rows = series.run({}, {"plant": plant, "sensors": sensors}, round((LENGTH + SETTLED) / TICK))
    settled = [row[round(SETTLED / TICK) :] for row in rows.values()]
    return Motion(1 / TICK, *settled)


def _dog(file: Path) -> list[Motion]:
    """The pieces of a dog's recording, which are concatenated: cut where its attitude jumps."""
    values, _, _ = read_columns(FileDescription(file, DOG_COLUMNS))
    joints = np.flatnonzero(np.abs(np.diff(values["pitch"])) > JUMP) + 1
    return [
        Motion(DOG_RATE, *(values[name][piece] for name in DOG_COLUMNS))
        for piece in np.split(np.arange(len(values["pitch"])), joints)
        if len(piece) >= _window(DOG_RATE)
    ]


def _window(rate: float) -> int:
    """Readings of a spectrum at this rate."""
    return round(LINES * TICK * rate)


def _described(motions: Sequence[Motion]) -> dict[str, Any]:
    """Figures and spectra of several pieces together."""
    spectra = {
        name: _spectrum([_in_degrees(motion, name) for motion in motions], motions[0].rate)
        for name in SPECTRA
    }
    frequency, density = spectra["forward"]
    band = (frequency >= STRIDES[0]) & (frequency <= STRIDES[1])
    main = float(frequency[band][density[band].argmax()])
    rate = motions[0].rate
    forward, pitch, yaw = (np.concatenate([_in_degrees(m, name) for m in motions]) for name in SPECTRA)
    swing = np.concatenate([_swings(m.forward, round(rate / main)) for m in motions])
    pitch_swing = np.degrees(np.concatenate([_swings(m.pitch, round(HALF_SECOND * rate)) for m in motions]))
    seen = frequency <= 0.5 / TICK
    return {
        "seconds": len(forward) / rate,
        "main_frequency_hz": main,
        "swing_m_s2": _median_and_p90(swing),
        "pitch_mean_deg": float(pitch.mean()),
        "pitch_sd_deg": float(pitch.std()),
        "pitch_swing_deg": _median_and_p90(pitch_swing),
        "yaw_rate_deg_s": {f"p{p}": float(np.percentile(yaw, p)) for p in (5, 95)},
        "mean_m_s2": float(forward.mean()),
        "largest_m_s2": float(np.abs(forward).max()),
        "spectra": {
            "frequency_hz": [round(float(f), 3) for f in frequency[seen]],
            **{name: [float(f"{d:.4g}") for d in spectra[name][1][seen]] for name in SPECTRA},
        },
    }


def _in_degrees(motion: Motion, name: str) -> Array:
    """A reading in the unit of its spectrum."""
    values: Array = getattr(motion, name)
    return values if name == "forward" else np.degrees(values)


def _spectrum(pieces: Sequence[Array], rate: float) -> tuple[Array, Array]:
    """Welch's power density of pieces, weighted by their lengths: (frequencies [Hz], densities)."""
    window = _window(rate)
    spectra = [signal.welch(piece, rate, nperseg=window) for piece in pieces]
    density = np.average([d for _, d in spectra], axis=0, weights=[len(piece) for piece in pieces])
    return spectra[0][0], np.asarray(density)


def _swings(values: Array, window: int) -> Array:
    """Largest less least reading within each window."""
    whole = len(values) // window
    return np.asarray(np.ptp(values[: whole * window].reshape(whole, window), axis=1))


def _median_and_p90(values: Array) -> dict[str, float]:
    return {"median": float(np.median(values)), "p90": float(np.percentile(values, 90))}


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the figures of each gait, with the text's."""
    for gait, described in result["gaits"].items():
        table = new_table()
        table.add_column(f"{gait}, {result['speeds_m_s'][gait]:g} m/s")
        for heading in (
            "swing [m/s2]\nmedian", "\np90", "main frequency\n[Hz]", "pitch [deg]\nmean", "\nsd",
            "swing of pitch [deg]\nmedian", "\np90", "yaw rate [deg/s]\np5 to p95",
            "mean reading\n[m/s2]", "largest\n[m/s2]",
        ):  # fmt: skip
            table.add_column(heading, justify="right")
        for name, of in described.items():
            swing, pitch, yaw = of["swing_m_s2"], of["pitch_swing_deg"], of["yaw_rate_deg_s"]
            table.add_row(
                name, f"{swing['median']:.1f}", f"{swing['p90']:.1f}", f"{of['main_frequency_hz']:.1f}",
                f"{of['pitch_mean_deg']:.1f}", f"{of['pitch_sd_deg']:.1f}", f"{pitch['median']:.1f}",
                f"{pitch['p90']:.1f}", f"{yaw['p5']:z.0f} to {yaw['p95']:z.0f}", f"{of['mean_m_s2']:.2f}",
                f"{of['largest_m_s2']:.1f}",
            )  # fmt: skip
        text = result["published"][gait]
        table.add_row(
            "the text (B.4, D.5)", text["swing"], "", "", text.get("pitch", ""), "", text["pitch_swing"], "",
            text["yaw_rate"], text.get("mean", ""), text.get("largest", ""),
        )  # fmt: skip
        print_table(table, console)
        console.print()
    console.print(
        f"{result['seeds']} trials of {result['length_s']:g} s a set; swing: largest less least reading "
        f"within a stride; of the pitch, within {HALF_SECOND:g} s",
        soft_wrap=True, markup=False, highlight=False,
    )  # fmt: skip


@house_style()
def draw(result: Mapping[str, Any]) -> Mapping[str, Figure]:
    """The spectra: a row for each gait, a column for each reading."""
    figure = new_figure(13, 6.6)
    axes = figure.subplots(len(GAITS), len(SPECTRA), sharex=True, sharey="col")
    for row, (gait, described) in enumerate(result["gaits"].items()):
        for column, (reading, (title, unit)) in enumerate(SPECTRA.items()):
            chart = axes[row, column]
            for name, of in described.items():
                frequency, density = (np.array(of["spectra"][n]) for n in ("frequency_hz", reading))
                positive = (frequency > 0) & (density > 0)
                chart.semilogy(frequency[positive], density[positive], label=name, **_style(name))
            chart.set_title(f"{gait}: {title}", fontsize=10, loc="left")
            chart.set_ylabel(unit)
            chart.grid(**GRID)
            chart.set_xlim(0, 0.5 / TICK)
    for chart in axes[-1]:
        chart.set_xlabel("frequency [Hz]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=10, ncols=len(labels), loc="outside lower center", frameon=False)
    for column, least in enumerate((1e-2, 1e-3, 1e-4)):
        axes[0, column].set_ylim(bottom=least)
    set_title(figure, "Spectra of what the unit on the pack reads, by set")
    return {"motion": figure}


def _style(name: str) -> Style:
    """A line's; `built_up` moves as `measured` does, which shows between its dashes."""
    return {
        "color": COLORS[name],
        "linewidth": 1.8 if name == DOG else 1.2,
        "linestyle": (0, (2, 4)) if name == "built_up" else "-",
    }
