"""What a magnetometer does for the heading through an outage (Appendix C, Figures C.1 to C.4)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from rich.console import Console

from harness.drawing import BELOW, ESTIMATES, GPS, GRID, OUTAGE, TRUTH, house_style, new_figure, shade
from harness.studies import published
from harness.studies.paths import PEDESTRIAN, SEARCHING, Gait, walk
from harness.studies.statistics import paired, summary
from harness.studies.study import Options, Progress, Result, in_threads
from harness.studies.tracking import Configuration, Tracking, Trial
from harness.terminal import new_table, print_table
from models.errors import UsageError, nearest
from models.kit.link import Values
from models.kit.timing import TICK
from models.kit.units import DEG
from models.recorded import Recorded
from models.sets import SETS
from models.seven_state import TUNINGS, SevenState
from models.six_state import SixState

Array = npt.NDArray[np.float64]
TAKES = frozenset({"seeds", "set"})
SEEDS = 100
WITHOUT, WITH, LEVELLED, SIX = (
    "without magnetometer", "with magnetometer", "with magnetometer, levelled", "six states, Appendix B",
)  # fmt: skip
COLORS = dict(zip((WITHOUT, WITH, LEVELLED, SIX), ESTIMATES, strict=False))
SHOWN = (WITHOUT, WITH)
FIXES = {  # eq. C.9: whatever the receiver states, 0.01 m and 0.1 m/s
    "position_sd_scale": 1e-6, "position_sd_floor": 0.01, "speed_sd_scale": 1e-6, "speed_sd_floor": 0.1,
}  # fmt: skip
# what a pack on a walker does: swings of B.4, the rest ours
WALKER = {
    "walk_acceleration_swing": 1.75, "yaw_rate_swing": 40 * DEG, "walk_pitch_swing": 2 * DEG,
    "roll_swing": 4 * DEG, "pitch_mean": 0.0, "jerk_rate": 0.0,
}  # fmt: skip


def run(options: Options, progress: Progress) -> Result:
    """Mean difference of the heading from the true one during the outage, for a walker and a dog.

    As in the text the tuning is that of Table C.1 with magnetometer and without.

    Raises:
        UsageError: there is no such set.
    """
    if options.set is not None and options.set not in SETS:
        raise UsageError(f'there is no set "{options.set}"{nearest(options.set, SETS)}')
    seeds = range(1, (options.seeds or SEEDS) + 1)
    carriers: dict[str, tuple[str, Gait, Values]] = {
        "pedestrian": ("pedestrian", PEDESTRIAN, {"plant": WALKER})
    }
    carriers |= {
        f"canine, set {name}": ("canine", SEARCHING, SETS[name])
        for name in ([options.set] if options.set else SETS)
    }
    results: dict[str, Any] = {}
    for number, (title, (carrier, gait, values)) in enumerate(carriers.items()):
        tracking = Tracking("study_heading", Recorded, _configurations(carrier))
        one = partial(trial, tracking, gait, values)
        errors = []
        for done, each in enumerate(in_threads(one, seeds), 1):
            errors.append(errors_of(each))
            progress(100 * (number + done / len(seeds)) / len(carriers))
        results[title] = {"carrier": carrier, **_judged(errors), "sample": _sample(one(seeds[0]))}
    return {
        "seeds": len(seeds),
        "carriers": results,
        "published": {
            carrier: {"place": place, "improvement_percent": percent}
            for carrier, (place, percent) in published.HEADING.items()
        },
    }


def _configurations(carrier: str) -> dict[str, Configuration]:
    tuning = {**TUNINGS[carrier], **FIXES}
    return {
        WITHOUT: Configuration(SevenState, {**tuning, "use_magnetometer": 0}),
        WITH: Configuration(SevenState, {**tuning, "level_magnetometer": 0}),  # C.3 knows no pitch
        LEVELLED: Configuration(SevenState, tuning),
        SIX: Configuration(SixState),
    }


def trial(tracking: Tracking, gait: Gait, values: Values, seed: int) -> Trial:
    """A trial whose second half is without GPS."""
    path = walk(gait, seed)
    ticks = len(path.north)
    signals = {"path_north": path.north, "path_east": path.east}
    return tracking.run(ticks, seed, signals, values, outage=ticks * TICK / 2)


def errors_of(one: Trial) -> dict[str, float]:
    """Each configuration's mean difference from the true heading during the outage [deg]."""
    during = slice(one.last_fix + 1, None)
    return {
        title: float(np.degrees(np.abs(_wrapped(estimate["heading"] - one.truth["heading"])[during]).mean()))
        for title, estimate in one.estimates.items()
    }


def _wrapped(angle: Array) -> Array:
    """In [-pi, pi)."""
    return np.asarray(np.mod(angle + np.pi, 2 * np.pi) - np.pi)


def _judged(errors: list[dict[str, float]]) -> dict[str, Any]:
    table = {title: np.array([one[title] for one in errors]) for title in errors[0]}
    improvements = 100 * (1 - table[WITH] / table[WITHOUT])
    return {
        "heading_error_deg": {title: summary(values) for title, values in table.items()},
        "improvement_percent": {
            "of_means": 100 * (1 - float(table[WITH].mean() / table[WITHOUT].mean())),
            "p10": float(np.percentile(improvements, 10)),
            "median": float(np.median(improvements)),
            "p90": float(np.percentile(improvements, 90)),
        },
        "paired_t_test": {"first": WITHOUT, "second": WITH, **paired(table[WITHOUT], table[WITH])},
    }


def _sample(one: Trial) -> dict[str, Any]:
    """A trial for the picture, in degrees, rounded."""

    def rounded(angles: Array) -> list[float]:
        return [round(float(angle), 1) for angle in np.degrees(angles)]

    fixes = np.flatnonzero(one.sensed["gps_fix"])
    return {
        "time_s": [round(float(time), 2) for time in one.time],
        "outage_begins_s": round(float(one.time[one.last_fix]), 2),
        "truth_deg": rounded(one.truth["heading"]),
        "gps": {
            "time_s": [round(float(time), 2) for time in one.time[fixes]],
            "course_deg": rounded(one.sensed["gps_course"][fixes]),
        },
        "estimates_deg": {title: rounded(one.estimates[title]["heading"]) for title in SHOWN},
    }


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the mean differences, and what the magnetometer improves."""
    table = new_table()
    table.add_column("heading error in the outage, deg")
    for title in (WITHOUT, WITH, LEVELLED, SIX):
        table.add_column(title, justify="right")
    for heading in ("improvement, %\nof the means", "\np10 to p90 of trials", "\np", "\nthe text"):
        table.add_column(heading, justify="right")
    for title, values in result["carriers"].items():
        text = result["published"][values["carrier"]]
        change = values["improvement_percent"]
        table.add_row(
            title,
            *(f"{values['heading_error_deg'][name]['mean']:.2f}" for name in (WITHOUT, WITH, LEVELLED, SIX)),
            f"{change['of_means']:.1f}", f"{change['p10']:.0f} to {change['p90']:.0f}",
            f"{values['paired_t_test']['p']:.2g}", f"{text['improvement_percent']:g}",
        )  # fmt: skip
    print_table(table, console)
    console.print(
        f"{result['seeds']} trials each; the text compares one trial each with the receiver's course "
        "(Figures C.2, C.4), ours with the true heading",
        highlight=False, markup=False, soft_wrap=True,
    )  # fmt: skip


@house_style()
def draw(result: Mapping[str, Any]) -> Mapping[str, Figure]:
    """The first trial of the walker and of the first dog, as in Figures C.1 to C.4."""
    carriers = list(result["carriers"].items())[:2]
    figure = new_figure(13, 6)
    grid = figure.subplots(len(carriers), len(SHOWN), squeeze=False, sharey=True)
    for row, (title, values) in zip(grid, carriers, strict=True):
        sample = values["sample"]
        time, truth = np.array(sample["time_s"]), np.array(sample["truth_deg"])
        for axes, name in zip(row, SHOWN, strict=True):
            shade(axes, [(sample["outage_begins_s"], time[-1])], OUTAGE)
            gps = sample["gps"]
            axes.plot(gps["time_s"], gps["course_deg"], ".", color=GPS, markersize=4, label="GPS course")
            axes.plot(time, _unlinked(truth), color=TRUTH, linewidth=1.4, label="truth")
            estimate = np.array(sample["estimates_deg"][name])
            axes.plot(time, _unlinked(estimate), color=COLORS[WITHOUT], linewidth=1.2, label="estimate")
            error = values["heading_error_deg"][name]["mean"]
            axes.set_title(f"{title}, {name}: {error:.1f} deg in {result['seeds']} trials", fontsize=10)
            axes.set_xlim(0, time[-1])
            axes.set_ylim(-190, 190)
            axes.set_yticks(range(-180, 181, 90))
            axes.grid(**GRID)
        row[0].set_ylabel("heading [deg]")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]; grey: without GPS")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), **BELOW)
    return {"heading": figure}


def _unlinked(angles: Array) -> Array:
    """Without the lines across the picture where an angle leaves it on one side and comes in on the other."""
    jumps = np.flatnonzero(np.abs(np.diff(angles)) > 180)
    unlinked = angles.astype(np.float64)
    unlinked[jumps] = np.nan
    return unlinked
