"""What an incline does to an estimator that does not know of it: the Canine Motion Simulator (D.6)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console

from harness.drawing import ABOVE, ESTIMATES, GPS, GRID, TRUTH, house_style, new_figure, set_title
from harness.studies.published import INCLINE_DEG, TRUE_BIAS
from harness.studies.statistics import summary
from harness.studies.study import Options, Progress, Result, in_threads
from harness.studies.tracking import Configuration, Tracking, Trial
from harness.terminal import new_table, print_table
from models.earth import GRAVITY
from models.four_state import FourState
from models.kit.timing import TICK
from models.profile import Profile
from models.six_state import SixState

TAKES = frozenset({"seeds"})
SEEDS = 100
ASYMPTOTE = TRUE_BIAS + GRAVITY * math.sin(
    math.radians(INCLINE_DEG)
)  # m/s2, where the bias goes (CHOICES.md 13)
UPHILL = 4.0  # s, when the incline begins (D.6.1)
END, LATER = 19.0, 60.0  # s: the end of D.6.1's profile; going on like that
QUICK = {"sigma_constant": 0.04, "sigma_bias": 0.03}  # per tick, CHOICES.md 13
NO_PITCH, NO_PITCH_QUICK, PITCH = (
    "six states, no pitch, Q of B.12",
    "six states, no pitch, quicker Q",
    "pitch",
)
CONFIGURATIONS = {
    NO_PITCH: Configuration(SixState),  # B.12 gives ranges: the largest are the block's own
    NO_PITCH_QUICK: Configuration(SixState, QUICK),
    # sigma_A is per tick there, and per square root of a second here (eq. 3.16)
    PITCH: Configuration(FourState, {"fuzzy": 0, **QUICK, "sigma_constant": 0.04 / math.sqrt(TICK)}),
}
NOISE = {  # D.12 to D.14; what the receiver states: B.11
    "gps_wander": 0.0, "gps_position_noise": 0.1, "gps_speed_noise": 0.05, "gps_reported_s_acc": 0.05,
    "gps_reported_h_acc": 3.5, "accel_noise": 1.0, "accel_bias[1]": TRUE_BIAS,
}  # fmt: skip
PUBLISHED = "D.6.4: without pitch the bias is not the true one; its asymptote is 0.1 + 9.81 sin 10 deg"
COLORS = dict(zip(CONFIGURATIONS, (ESTIMATES[1], ESTIMATES[3], ESTIMATES[0]), strict=True))


def run(options: Options, progress: Progress) -> Result:
    """Bias, position and speed at the end of the profile and later, over seeds; the first trial in full."""
    tracking = Tracking("study_pitch", Profile, CONFIGURATIONS)
    seeds = range(1, (options.seeds or SEEDS) + 1)
    ticks = round(LATER / TICK) + 1

    def trial(seed: int) -> Trial:
        # the last segment goes on until the end
        values = {"plant": {"duration[3]": LATER}, "sensors": NOISE}
        return tracking.run(ticks, seed, {}, values, outage=0)

    rows = []
    for done, row in enumerate(in_threads(lambda seed: _measured(trial(seed)), seeds), 1):
        rows.append(row)
        progress(100 * done / len(seeds))
    configurations = {
        title: {key: summary(np.array([row[title][key] for row in rows])) for key in rows[0][title]}
        for title in CONFIGURATIONS
    }
    return {
        "seeds": len(seeds), "asymptote_m_s2": ASYMPTOTE, "true_bias_m_s2": TRUE_BIAS, "published": PUBLISHED,
        "configurations": configurations, "sample": _sample(trial(seeds[0])),
    }  # fmt: skip


def _measured(trial: Trial) -> dict[str, dict[str, float]]:
    """Of each configuration the bias [m/s2] at the end and later, the errors at the end and before it."""
    end, later = round(END / TICK), round(LATER / TICK)
    return {
        title: {
            "bias_m_s2_at_end": float(estimate["accel_bias"][end]),
            "bias_m_s2_later": float(estimate["accel_bias"][later]),
            "position_error_m_at_end": float(trial.position_error(estimate)[end]),
            "speed_error_m_s_last_5_s": float(
                trial.speed_error(estimate)[end - round(5 / TICK) : end].mean()
            ),
        }
        for title, estimate in trial.estimates.items()
    }


def _sample(trial: Trial) -> dict[str, Any]:
    """The first trial up to the end of the profile, rounded."""
    ticks = round(END / TICK) + 1

    def rounded(values: np.ndarray[Any, Any]) -> list[float]:
        return [round(float(value), 3) for value in values]

    fixes = np.flatnonzero(trial.sensed["gps_fix"][:ticks])
    return {
        "time_s": rounded(trial.time[:ticks]),
        "truth": {n: rounded(trial.truth[n][:ticks]) for n in ("north", "east", "speed")},
        "gps": {
            "time_s": rounded(trial.time[fixes]),
            **{n: rounded(trial.sensed[f"gps_{n}"][fixes]) for n in ("north", "east", "speed")},
        },
        "estimates": {
            title: {n: rounded(estimate[n][:ticks]) for n in ("north", "east", "speed", "accel_bias")}
            for title, estimate in trial.estimates.items()
        },
    }


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print where the bias goes, and what it costs."""
    table = new_table()
    table.add_column("configuration")
    for heading in (
        f"bias, m/s2\nat {END:g} s", "\nsd", f"\nat {LATER:g} s", "\nsd",
        f"position error, m\nat {END:g} s", "speed error, m/s\nlast 5 s",
    ):  # fmt: skip
        table.add_column(heading, justify="right")
    for title, values in result["configurations"].items():
        at_end, later = values["bias_m_s2_at_end"], values["bias_m_s2_later"]
        table.add_row(
            title,
            *(f"{bias[key]:.3f}" for bias in (at_end, later) for key in ("mean", "sd")),
            f"{values['position_error_m_at_end']['mean']:.2f}",
            f"{values['speed_error_m_s_last_5_s']['mean']:.3f}",
        )  # fmt: skip
    print_table(table, console)
    quick = ", ".join(f"{name} {value:g}" for name, value in QUICK.items())
    console.print(
        f"{result['seeds']} seeds; true bias {result['true_bias_m_s2']:g} m/s2, the asymptote without pitch "
        f"{result['asymptote_m_s2']:.3f} m/s2; quicker Q: {quick} a tick",
        soft_wrap=True, markup=False, highlight=False,
    )  # fmt: skip


@house_style()
def draw(result: Mapping[str, Any]) -> Mapping[str, Figure]:
    """The first trial as in Figures D.3 and D.4: position, speed, bias."""
    figure = new_figure(13, 5.4)
    axes = figure.subplot_mosaic([["map", "speed"], ["map", "bias"]], width_ratios=[1, 1.35])
    sample = result["sample"]
    time = np.array(sample["time_s"])
    begin = int(np.searchsorted(time, UPHILL))
    gps, truth = sample["gps"], sample["truth"]
    chart: Axes = axes["map"]
    chart.plot(gps["east"], gps["north"], ".", color=GPS, markersize=4, label="GPS")
    axes["speed"].plot(gps["time_s"], gps["speed"], ".", color=GPS, markersize=4)
    for title, estimate in sample["estimates"].items():
        style: dict[str, Any] = {"color": COLORS[title], "linewidth": 1.2}
        chart.plot(estimate["east"], estimate["north"], label=title, **style)
        axes["speed"].plot(time, estimate["speed"], **style)
        axes["bias"].plot(time, estimate["accel_bias"], **style)
    chart.plot(truth["east"], truth["north"], color=TRUTH, linewidth=0.8, label="truth")
    axes["speed"].plot(time, truth["speed"], color=TRUTH, linewidth=0.8)
    chart.plot(truth["east"][begin], truth["north"][begin], "D", color=ESTIMATES[2], label="incline begins")
    for level, text in (
        (result["true_bias_m_s2"], "true"),
        (result["asymptote_m_s2"], "asymptote without pitch"),
    ):
        axes["bias"].axhline(level, color=TRUTH, linewidth=0.8, linestyle=":")
        axes["bias"].text(0.15, level + 0.03, text, fontsize=9, va="bottom")
    for name, label in (("speed", "speed [m/s]"), ("bias", "accelerometer bias [m/s2]")):
        axes[name].axvline(UPHILL, color=ESTIMATES[2], linewidth=1.2)
        axes[name].set_ylabel(label)
        axes[name].set_xlim(0, time[-1])
    axes["bias"].set_ylim(-0.6, 2.2)
    axes["bias"].set_xlabel("time [s]")
    chart.set_xlabel("east [m]")
    chart.set_ylabel("north [m]")
    chart.margins(0.05)
    for each in axes.values():
        each.grid(**GRID)
    chart.legend(fontsize=9, ncols=2, **ABOVE)
    set_title(figure, f"The Canine Motion Simulator up an incline of {INCLINE_DEG:g} deg (D.6), seed 1")
    return {"pitch": figure}
