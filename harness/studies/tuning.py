"""Over random set-ups of filter, sensors, pack: where fuzzy beats a constant Q, where pitch helps (3.3)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from rich.console import Console
from scipy import stats

from harness.drawing import BELOW, ESTIMATES, GRID, TRUTH, house_style, new_figure
from harness.studies import published
from harness.studies.paths import SEARCHING, walk
from harness.studies.published import FUZZY, INERTIAL, NO_PITCH, OUTAGE_S, PITCH
from harness.studies.statistics import paired, share
from harness.studies.study import Options, Progress, Result, in_threads
from harness.studies.tracking import Configuration, Tracking
from harness.terminal import new_table, print_table
from models.four_state import FourState
from models.kit.units import DEG
from models.recorded import Recorded

Array = npt.NDArray[np.float64]
TAKES = frozenset({"seeds"})
SETUPS, TRIALS = 500, 40
SIGNIFICANT = 0.05
SLOW = 2.0  # m/s: the stride, which swings the estimate by 1 m/s, does not take it to the step of sigma at 3
NEAREST = 5  # of the set-ups, to Table D.1
CONFIGURATIONS = {
    NO_PITCH: Configuration(FourState, {"use_pitch": 0, "fuzzy": 0}),
    PITCH: Configuration(FourState, {"use_pitch": 1, "fuzzy": 0}),
    FUZZY: Configuration(FourState, {"use_pitch": 1, "fuzzy": 1}),
}
QUESTIONS = ((PITCH, FUZZY), (NO_PITCH, PITCH))


class Factor(NamedTuple):
    """What is drawn for a set-up: uniformly, or uniformly in the logarithm."""

    low: float
    high: float
    unit: str
    logarithmic: bool = False

    def draw(self, rng: np.random.Generator) -> float:
        """A value; angles in rad."""
        if self.logarithmic:
            value = math.exp(rng.uniform(math.log(self.low), math.log(self.high)))
        else:
            value = rng.uniform(self.low, self.high)
        return float(f"{value * self.si:.5g}")

    @property
    def si(self) -> float:
        """The unit in SI."""
        return DEG if self.unit == "deg" else 1.0


FACTORS = {  # plausible ranges, ours, about the values of the text
    "walk.speed": Factor(0.7, 4.0, "m/s"),
    "estimator.sigma_constant": Factor(0.03, 0.3, "m/s2", True),  # D.7: 0.1
    "estimator.sigma_bias": Factor(3e-4, 3e-3, "m/s2", True),  # eq. 3.16: 0.001
    "estimator.initial_bias_variance": Factor(0.1, 10, "(m/s2)^2", True),  # eq. 3.17: 1
    "sensors.gps_reported_s_acc": Factor(0.05, 0.5, "m/s", True),
    "sensors.gps_reported_h_acc": Factor(1, 5, "m"),  # B.11: 3.5
    "sensors.gps_speed_noise": Factor(0.03, 0.15, "m/s", True),  # D.12: 0.05
    "sensors.accel_noise": Factor(0.3, 2, "m/s2", True),  # D.14: 1
    "sensors.accel_bias[1]": Factor(-0.5, 0.5, "m/s2"),  # D.14: 0.1
    "sensors.attitude_noise": Factor(0.2, 2, "deg", True),
    "sensors.attitude_lean": Factor(0, 0.3, "1"),
    "plant.walk_acceleration_swing": Factor(5, 20, "m/s2"),  # B.4: 10 to 20
    "plant.pitch_mean": Factor(-12, -5, "deg"),  # D.5: -8.5
    "plant.pitch_wander": Factor(0, 6, "deg"),
    "plant.pitch_wander_time": Factor(1, 5, "s"),
    "plant.jolt_peak": Factor(-10, 10, "m/s2"),
    "plant.jolt_rate": Factor(0, 0.5, "Hz"),
    "plant.jolt_time": Factor(0, 0.5, "s"),
}


def run(options: Options, progress: Progress) -> Result:
    """Mean errors of each set-up over trials of its own; the option `seeds` counts set-ups."""
    numbers = range(1, (options.seeds or SETUPS) + 1)
    setups = [draw_setup(number) for number in numbers]
    tracking = Tracking("study_tuning", Recorded, CONFIGURATIONS)
    rows = []
    for done, row in enumerate(in_threads(partial(judge, tracking), numbers), 1):
        rows.append(row)
        progress(100 * done / len(setups))
    return {
        "setups": len(setups),
        "trials": TRIALS,
        "questions": [_answer(first, second, setups, rows) for first, second in QUESTIONS],
        "nearest": _nearest(setups, rows),
        "rows": [{"factors": setup, **row} for setup, row in zip(setups, rows, strict=True)],
    }


def draw_setup(seed: int) -> dict[str, float]:
    """The factors of a set-up, SI."""
    rng = np.random.default_rng(seed)
    return {name: factor.draw(rng) for name, factor in FACTORS.items()}


def trial_seeds(number: int) -> range:
    """Those of a set-up. No two share a trial: Wilson's interval takes set-ups for independent."""
    return range((number - 1) * TRIALS + 1, number * TRIALS + 1)


def judge(tracking: Tracking, number: int) -> dict[str, Any]:
    """Mean errors of position [m] and speed [m/s] at the ends of a set-up's trials, and the tests' p."""
    setup = draw_setup(number)
    speed = setup["walk.speed"]
    gait = replace(SEARCHING, speed=speed, speed_deviation=SEARCHING.speed_deviation * speed)
    values: dict[str, dict[str, float]] = {"plant": {}, "sensors": {}, "estimator": {}}
    for name, value in setup.items():
        component, _, parameter = name.partition(".")
        if component in values:
            values[component][parameter] = value
    errors: dict[str, list[tuple[float, float]]] = {title: [] for title in (INERTIAL, *CONFIGURATIONS)}
    for seed in trial_seeds(number):
        path = walk(gait, seed)
        signals = {"path_north": path.north, "path_east": path.east}
        trial = tracking.run(len(path.north), seed, signals, values, OUTAGE_S)
        for title, estimate in {INERTIAL: trial.inertial(), **trial.estimates}.items():
            errors[title].append(
                (float(trial.position_error(estimate)[-1]), float(trial.speed_error(estimate)[-1]))
            )
    table = {title: np.array(pairs) for title, pairs in errors.items()}
    return {
        "mean_error": {title: pairs.mean(axis=0).round(4).tolist() for title, pairs in table.items()},
        "p": {
            f"{first}, {second}": paired(table[first][:, 0], table[second][:, 0])["p"]
            for first, second in QUESTIONS
        },
    }


def _answer(
    first: str, second: str, setups: list[dict[str, float]], rows: list[dict[str, Any]]
) -> dict[str, Any]:
    """In what share of the set-ups the second is better than the first, and what goes with it."""
    ratio = _ratios(rows, first, second)
    significant = _significant(rows, first, second)
    correlations = {
        name: float(stats.spearmanr([setup[name] for setup in setups], np.log(ratio)).statistic)
        for name in FACTORS
    }
    better, worse = (ratio < 1) & significant, (ratio > 1) & significant
    slow = np.array([setup["walk.speed"] < SLOW for setup in setups])

    def when_slow(which: npt.NDArray[np.bool_]) -> dict[str, Any] | None:
        return share(int(which[slow].sum()), int(slow.sum())) if slow.any() else None

    return {
        "first": first,
        "second": second,
        "better": share(int((ratio < 1).sum()), len(ratio)),
        "significantly_better": share(int(better.sum()), len(ratio)),
        "significantly_worse": share(int(worse.sum()), len(ratio)),
        "better_when_slow": when_slow(ratio < 1),
        "significantly_better_when_slow": when_slow(better),
        "significantly_worse_when_slow": when_slow(worse),
        "median_ratio": float(np.median(ratio)),
        "rank_correlation": dict(sorted(correlations.items(), key=lambda item: -abs(item[1]))),
    }


def _ratios(rows: list[dict[str, Any]], first: str, second: str) -> Array:
    """The second's mean position error by the first's, (set-ups,)."""
    return np.array([row["mean_error"][second][0] / row["mean_error"][first][0] for row in rows])


def _significant(rows: list[dict[str, Any]], first: str, second: str) -> npt.NDArray[np.bool_]:
    """In which set-ups the two differ significantly, (set-ups,); not where a test has no p."""
    p = [row["p"][f"{first}, {second}"] for row in rows]
    return np.array([value is not None and value < SIGNIFICANT for value in p])


def _nearest(setups: list[dict[str, float]], rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The set-ups whose six means are nearest to Table D.1: by the largest factor that one is off."""
    titles = (INERTIAL, NO_PITCH, PITCH)
    text = np.array([(published.OUTAGE[t].position, published.OUTAGE[t].speed) for t in titles])
    off = [
        float(np.exp(np.abs(np.log(np.array([row["mean_error"][t] for t in titles]) / text)).max()))
        for row in rows
    ]
    order = np.argsort(off)[:NEAREST]
    return [{"off_by": round(off[k], 3), "setup": int(k) + 1, **rows[k], "factors": setups[k]} for k in order]


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the shares, and what goes with the ratio of the errors."""
    table = new_table()
    table.add_column("position error at the end")
    for heading in (
        "better in",
        "95 %",
        "significantly\nbetter",
        "significantly\nworse",
        f"below {SLOW:g} m/s:\nbetter in",
    ):
        table.add_column(heading, justify="right")
    table.add_column("median ratio", justify="right")
    for answer in result["questions"]:
        better, slow = answer["better"], answer["better_when_slow"]
        table.add_row(
            f"{answer['second']} against {answer['first']}",
            _percent(better["share"]),
            f"{_percent(better['low'])} to {_percent(better['high'])}",
            _percent(answer["significantly_better"]["share"]),
            _percent(answer["significantly_worse"]["share"]),
            _percent(slow["share"]) if slow else "-", f"{answer['median_ratio']:.2f}",
        )  # fmt: skip
    print_table(table, console)
    for answer in result["questions"]:
        strongest = list(answer["rank_correlation"].items())[:5]
        console.print(
            f"  {answer['second']} against {answer['first']}, rank correlation of the ratio with "
            + ", ".join(f"{name} {value:+.2f}" for name, value in strongest),
            style="dim", highlight=False, markup=False, soft_wrap=True,
        )  # fmt: skip
    nearest = result["nearest"][0]
    errors = ", ".join(f"{t} {e[0]:.1f} m / {e[1]:.1f} m/s" for t, e in nearest["mean_error"].items())
    console.print(
        f"{result['setups']} set-ups, each of {result['trials']} trials of its own. Nearest to Table D.1, "
        f"off by a factor of {nearest['off_by']:.2f}: set-up {nearest['setup']}, {errors}",
        highlight=False, markup=False, soft_wrap=True,
    )  # fmt: skip


def _percent(value: float) -> str:
    return f"{100 * value:.0f} %"


@house_style()
def draw(result: Mapping[str, Any]) -> Mapping[str, Figure]:
    """For both questions the ratio of the errors over what goes with it most, and all rank correlations."""
    figure = new_figure(13, 8.5)
    grid = figure.subplots(2, 2, width_ratios=[1.25, 1])
    rows = result["rows"]
    for (left, right), answer in zip(grid, result["questions"], strict=True):
        first, second = answer["first"], answer["second"]
        ratio = _ratios(rows, first, second)
        name = next(iter(answer["rank_correlation"]))
        factor = np.array([row["factors"][name] / FACTORS[name].si for row in rows])
        significant = _significant(rows, first, second)
        for group, style in ((significant, {}), (~significant, {"facecolors": "none"})):
            label = "significant" if not style else "not significant"
            left.scatter(
                factor[group], ratio[group], s=16, edgecolors=ESTIMATES[0], label=label,
                **{"facecolors": ESTIMATES[0], **style},
            )  # fmt: skip
        left.axhline(1.0, color=TRUTH, linewidth=1.0)
        left.set_yscale("log")
        for which in (left.yaxis.set_major_formatter, left.yaxis.set_minor_formatter):
            which(FuncFormatter(lambda value, place: f"{value:g}"))
        left.set(xlabel=f"{name} [{FACTORS[name].unit}]", ylabel=f"error of {second} / error of {first}")
        better = answer["better"]
        left.tick_params(axis="y", which="both", labelsize=8)
        left.set_title(
            f"{second} is better in {_percent(better['share'])} of the set-ups "
            f"({_percent(better['low'])} to {_percent(better['high'])})",
            fontsize=11,
        )
        names = list(FACTORS)
        right.barh(names, [answer["rank_correlation"][n] for n in names], color=ESTIMATES[1], height=0.65)
        right.axvline(0.0, color=TRUTH, linewidth=0.8)
        right.invert_yaxis()
        right.set_xlim(-1, 1)
        right.set_xlabel("rank correlation with the ratio: negative helps " + second)
        right.tick_params(axis="y", labelsize=8)
        for axes in (left, right):
            axes.grid(**GRID)
            axes.set_axisbelow(True)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=len(labels), **BELOW)
    return {"tuning": figure}
