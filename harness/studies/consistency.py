"""Are the estimators as good as they say? NEES, NIS, whiteness, and what a stated deviation covers.

In the *filter's own world*, linear motion and the white noise of D.12 to D.14, theory says what comes out,
so that a filter is judged alone. Its process noise must be 0.2 there, not the text's 0.1: noise of 1 m/s2 in
each sample moves the speed by 0.04 m/s a tick, and eq. 3.16 adds sigma^2 * 0.04 s. In the other worlds the
motion of the pack and the errors of the receiver are not what any of the filters assumes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from rich.console import Console
from scipy import stats

from codegen.batch.series import Series
from harness.drawing import BELOW, ESTIMATES, GRID, TRUTH, house_style, new_figure, set_title
from harness.studies.innovations import (
    Innovations,
    autocorrelation,
    covariance_of,
    innovations_of,
    mean_bounds,
    nees,
    observed,
    state_of,
)
from harness.studies.paths import GAITS, walk
from harness.studies.published import OUTAGE_S
from harness.studies.statistics import share
from harness.studies.study import Options, Progress, Result, in_threads
from harness.studies.tracking import Configuration
from harness.terminal import new_table, print_table
from models.canine_tracker import CanineTracker
from models.errors import UsageError, nearest
from models.estimator import BIAS, SPEED, Estimator
from models.four_state import FourState
from models.kit.timing import TICK
from models.readings import CAP, FLOORS
from models.recorded import Recorded
from models.sensors import Sensors
from models.sets import SETS
from models.system import ESTIMATORS, System, by_name

Array = npt.NDArray[np.float64]

TAKES = frozenset({"seeds", "set"})
SEEDS = 200
SETTLE_S = 10.0
LAGS = 10  # fixes
COLORS = ("#A6761D", "#666666", "#56B4E9", "#E6AB02")  # beyond those of ESTIMATES
OWN, SHIPPED = "the filter's own", "shipped"
SIGMAS = (
    1.0,
    2.0,
)  # stated deviations, whose ellipses are to cover what a normal error in one dimension does
ACCEL_NOISE, SPEED_NOISE, POSITION_NOISE = 1.0, 0.05, 0.1  # m/s2, m/s, m (D.12, D.14)
BIAS_WALK = 1e-3  # m/s2 per tick, as eq. 3.16 assumes


BIAS_TOLD = ("accel_bias", "accel_bias_sd")
STATED = (*BIAS_TOLD, "north_sd", "east_sd")


ALONE: dict[str, Configuration] = {
    "four_state, sigma 0.2": Configuration(FourState, {"fuzzy": 0, "sigma_constant": 0.2}),
    "four_state, sigma 0.1 (D.7)": Configuration(FourState, {"fuzzy": 0}),
    "four_state, fuzzy": Configuration(FourState),
}
TOGETHER: dict[str, Configuration] = {
    "four_state, sigma 0.1 (D.7)": Configuration(FourState, {"fuzzy": 0}),
    "four_state, fuzzy": Configuration(FourState),
    "four_state, floors and cap": Configuration(FourState, {**FLOORS, **CAP}),
    **{title: Configuration(block) for title, block in ESTIMATORS.items() if block is not FourState},
}


@dataclass(frozen=True, eq=False)
class Trial:
    """What one trial shows of an estimator.

    Attributes:
        innovations: after it has settled, before the outage.
        errors, covariances: of speed, bias, north, east at the last fix (4,) and (4, 4), and at the end; the
            variances of the position are those that the estimator states, of which the tracker's exceed P's.
        has_bias: the second of these is the bias; in the tracker's state it stands together with the mean
            speed, so it is left out of NEES.
        bias_error_per_sd: of the bias that the estimator tells, at the last fix.
    """

    innovations: Innovations
    errors: tuple[Array, Array]
    covariances: tuple[Array, Array]
    has_bias: bool
    bias_error_per_sd: float


def run(options: Options, progress: Progress) -> Result:
    """Every estimator in its own world and in those of the shipped sensors and of the sets.

    Raises:
        UsageError: there is no such set.
    """
    if options.set is not None and options.set not in SETS:
        raise UsageError(f'there is no set "{options.set}"{nearest(options.set, SETS)}')
    seeds = range(1, (options.seeds or SEEDS) + 1)
    sets = {options.set: SETS[options.set]} if options.set else {SHIPPED: {}, **SETS}
    worlds: dict[str, Any] = {}
    own = OwnWorld()
    trials = list(in_threads(own.run, seeds))
    worlds[OWN] = {name: judge([t[name] for t in trials]) for name in ALONE}
    simulated = Simulated()
    for number, (name, values) in enumerate(sets.items(), 1):
        progress(100 * number / (len(sets) + 1))
        trials = list(in_threads(partial(simulated.run, values=values), seeds))
        worlds[name] = {title: judge([t[title] for t in trials]) for title in TOGETHER}
    return {"seeds": len(seeds), "outage_s": OUTAGE_S, "settle_s": SETTLE_S, "worlds": worlds}


class OwnWorld:
    """Straight motion whose speed is linear in every tick, and the noise that the filter assumes."""

    def __init__(self) -> None:
        self._series = Series(
            FourState, observe=[*observed(FourState), *(f"four_state.{name}" for name in STATED)]
        )

    def run(self, seed: int) -> dict[str, Trial]:
        """A trial of 50 s, whose last 10 s have no fixes."""
        rng = np.random.default_rng(seed)
        ticks = round(50 / TICK)
        k = np.arange(ticks)
        speed = 3.0 + 1.5 * np.sin(0.4 * k * TICK + rng.uniform(0, 2 * np.pi))
        past = np.concatenate([speed[:1], speed[:-1]])
        heading = rng.uniform(-np.pi, np.pi)
        way = np.cumsum(0.5 * (speed + past) * TICK)
        north, east = way * np.cos(heading), way * np.sin(heading)
        bias = rng.normal(0, 1) + np.cumsum(rng.normal(0, BIAS_WALK, ticks))
        fixes = np.zeros(ticks, dtype=bool)
        fixes[-(-25 * np.arange(ticks * 4 // 25) // 4)] = True
        fixes[k * TICK > (ticks - 1) * TICK - OUTAGE_S] = False
        signals = {
            "accel_x": (speed - past) / TICK + bias + rng.normal(0, ACCEL_NOISE, ticks),
            "pitch_meas": 0.0,
            "heading_meas": heading,
            "gps_fix": fixes,
            "gps_north": north + rng.normal(0, POSITION_NOISE, ticks),
            "gps_east": east + rng.normal(0, POSITION_NOISE, ticks),
            "gps_speed": speed + rng.normal(0, SPEED_NOISE, ticks),
            "gps_h_acc": 2 * POSITION_NOISE,  # eq. 3.15 takes half of it
            "gps_s_acc": SPEED_NOISE,
        }
        inputs = {f"four_state.{name}": values for name, values in signals.items()}
        truth = np.column_stack([speed, bias, north, east])
        return {
            name: _trial(
                FourState,
                "four_state",
                self._series.run(inputs, {"four_state": judged.parameters}, ticks),
                truth,
                fixes,
            )
            for name, judged in ALONE.items()
        }


class Simulated:
    """An animal that searches, its pack and its sensors, all estimators beside each other."""

    def __init__(self) -> None:
        self._places = {name: f"estimator_{i}" for i, name in enumerate(TOGETHER)}
        components = {"plant": Recorded, "sensors": Sensors} | {
            self._places[name]: judged.block for name, judged in TOGETHER.items()
        }
        links = {"sensors": "plant"} | dict.fromkeys(self._places.values(), "sensors")
        system = System("study_consistency", components, by_name(components, links))
        observe = [f"plant.{name}" for name in ("speed", "north", "east")] + ["sensors.gps_fix"]
        for name, judged in TOGETHER.items():
            observe += observed(judged.block, self._places[name])
            observe += [f"{self._places[name]}.{output}" for output in STATED]
        self._series = Series(system, observe)

    def run(self, seed: int, values: Mapping[str, Mapping[str, float]]) -> dict[str, Trial]:
        """A trial of 40 to 45 s in a world of these parameters, whose last 10 s have no fixes."""
        path = walk(GAITS["detection"], seed)
        ticks = len(path.north)
        sensors = {
            "seed": seed,
            "outage_start[1]": (ticks - 1) * TICK - OUTAGE_S,
            "outage_end[1]": ticks * TICK,
        }
        parameters = {
            "plant": {"seed": seed, **values.get("plant", {})},
            "sensors": {**sensors, **values.get("sensors", {})},
            **{self._places[name]: judged.parameters for name, judged in TOGETHER.items()},
        }
        rows = self._series.run(
            {"plant.path_north": path.north, "plant.path_east": path.east}, parameters, ticks
        )
        bias = parameters["sensors"].get("accel_bias[1]", SHIPPED_BIAS)
        motion = [rows[f"plant.{name}"] for name in ("speed", "north", "east")]
        truth = np.column_stack([motion[0], np.full(ticks, bias), *motion[1:]])
        fixes = rows["sensors.gps_fix"] > 0
        return {
            name: _trial(judged.block, self._places[name], rows, truth, fixes)
            for name, judged in TOGETHER.items()
        }


SHIPPED_BIAS = float(Sensors.variables()["accel_bias"].start[0])


def _trial(
    block: type[Estimator],
    component: str,
    rows: Mapping[str, Array],
    truth: Array,
    fixes: npt.NDArray[np.bool_],
) -> Trial:
    """What the rows of a run show, against the truth (ticks, 4) of speed, bias, north, east."""
    states = [SPEED, BIAS, block.north_state, block.east_state]
    last = int(np.flatnonzero(fixes)[-1])
    at = [last, len(truth) - 1]
    errors = state_of(block, rows, component)[at][:, states] - truth[at]
    P = covariance_of(block, rows, component)[at][:, np.array(states)[:, None], np.array(states)]
    for i, name in ((2, "north_sd"), (3, "east_sd")):
        P[:, i, i] = rows[f"{component}.{name}"][at] ** 2
    innovations = innovations_of(block, rows, component).between(SETTLE_S, np.inf)
    bias, sd = (rows[f"{component}.{name}"][last] for name in BIAS_TOLD)
    has_bias = block is not CanineTracker
    return Trial(
        innovations, (errors[0], errors[1]), (P[0], P[1]), has_bias, float((bias - truth[last, 1]) / sd)
    )


def judge(trials: Sequence[Trial]) -> dict[str, Any]:
    """NIS, whiteness, NEES and coverage over trials, with the bounds of a filter that knows its noise."""
    number = len(trials)
    fixes = sum(len(t.innovations.time) for t in trials)
    freedom = sum(int(t.innovations.used.sum()) for t in trials) / fixes
    lags = np.mean([autocorrelation(t.innovations.whitened, LAGS) for t in trials], axis=0)
    before, after = (np.array([t.errors[i] for t in trials]) for i in (0, 1))
    P_before, P_after = (np.array([t.covariances[i] for t in trials]) for i in (0, 1))
    states = [0, 1, 2, 3] if trials[0].has_bias else [0, 2, 3]
    position = nees(after[:, 2:], P_after[:, 2:, 2:])
    speed = after[:, 0] ** 2 / P_after[:, 0, 0]
    return {
        "fixes": fixes,
        "nis_expected": freedom,
        "nis": sum(float(t.innovations.nis.sum()) for t in trials) / fixes,
        "nis_bounds": mean_bounds(freedom, fixes),
        "nis_by_value": _mean(t.innovations.whitened**2 for t in trials),
        "autocorrelation": lags.tolist(),
        "autocorrelation_bound": float(stats.norm.ppf(0.975) / np.sqrt(fixes * freedom)),
        "nees": float(nees(before[:, states], P_before[:, states][:, :, states]).mean()),
        "nees_bounds": mean_bounds(len(states), number),
        "states": len(states),
        "bias_error_per_sd": float(np.sqrt(np.mean([t.bias_error_per_sd**2 for t in trials]))),
        "position_error_m": float(np.hypot(*after[:, 2:].T).mean()),
        "position_sd_m": float(np.sqrt(np.trace(P_after[:, 2:, 2:], axis1=1, axis2=2)).mean()),
        "position_within": [_within(position, sigma, 2) for sigma in SIGMAS],
        "speed_within": [_within(speed, sigma, 1) for sigma in SIGMAS],
    }


def _within(squared: Array, sigma: float, dimensions: int) -> dict[str, Any]:
    """The share of normalized squared errors (k,) in the ellipse that holds as many as sigma does of one."""
    expected = stats.chi2.cdf(sigma**2, 1)
    hits = int((squared <= stats.chi2.ppf(expected, dimensions)).sum())
    return {"sigma": sigma, "expected": float(expected), **share(hits, len(squared))}


def _mean(rows: Iterable[Array]) -> list[float]:
    return [float(v) for v in np.concatenate(list(rows)).mean(axis=0)]


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print a table for each world."""
    for world, rows in result["worlds"].items():
        table = new_table(gap=1)
        table.add_column(f"world: {world},\n{result['seeds']} seeds\n")
        for heading in (
            "NIS\nper\nvalue", "bounds,\n95 %\n", "lag 1\n\n", "bounds,\n95 %\n", "NEES\nper\nstate",
            "bounds,\n95 %\n", "bias\nerror\nper sd", f"position\nerror at\n{result['outage_s']:g} s",
            "sd\nstated\n\\[m]", "position in\n1 sigma\n(68 %)", "\n2 sigma\n(95 %)",
            "speed in\n1 sigma\n(68 %)", "\n2 sigma\n(95 %)",
        ):  # fmt: skip
            table.add_column(heading, justify="right")
        for name, row in rows.items():
            expected, states = row["nis_expected"], row["states"]
            table.add_row(
                name,
                f"{row['nis'] / expected:.3f}",
                "..".join(f"{b / expected:.3f}" for b in row["nis_bounds"]),
                f"{row['autocorrelation'][0]:+.2f}",
                f"±{row['autocorrelation_bound']:.2f}",
                f"{row['nees'] / states:.3g}",
                "..".join(f"{b / states:.2f}" for b in row["nees_bounds"]),
                f"{row['bias_error_per_sd']:.2g}",
                f"{row['position_error_m']:.3g}",
                f"{row['position_sd_m']:.3g}",
                *(f"{100 * s['share']:.0f}" for key in ("position_within", "speed_within") for s in row[key]),
            )
        print_table(table, console)


def draw(result: Mapping[str, Any]) -> Mapping[str, Figure]:
    """The study's picture."""
    return {"consistency": _picture(result)}


@house_style()
def _picture(result: Mapping[str, Any]) -> Figure:
    """NIS and NEES per degree of freedom, what stated deviations cover, the innovations' correlation."""
    picture = new_figure(15, 9)
    (ratio, covered), (correlated, own) = picture.subplots(2, 2)
    worlds = result["worlds"]
    names = list(dict.fromkeys(name for rows in worlds.values() for name in rows))
    colors = {name: (*ESTIMATES, *COLORS)[i] for i, name in enumerate(names)}
    for place, rows in enumerate(worlds.values()):
        for i, name in enumerate(names):
            if name not in rows:
                continue
            row, x = rows[name], place + 0.8 * ((i + 0.5) / len(names) - 0.5)
            ratio.plot(x, row["nis"] / row["nis_expected"], "o", color=colors[name])
            ratio.plot(x, row["nees"] / row["states"], "x", color=colors[name])
            one = row["position_within"][0]
            error = [[100 * (one["share"] - one["low"])], [100 * (one["high"] - one["share"])]]
            covered.errorbar(x, 100 * one["share"], yerr=error, fmt="o", color=colors[name], capsize=2)
            covered.plot(x, 100 * row["position_within"][1]["share"], "x", color=colors[name])
    ratio.set_yscale("log")
    ratio.axhline(1, color=TRUTH, linewidth=1.0)
    ratio.set_ylabel("per degree of freedom; 1 is consistent")
    ratio.set_title("NIS (o) and NEES (x)", fontsize=10)
    covered.set_ylabel("trials [%]")
    covered.set_ylim(-3, 103)
    for expected in (68.3, 95.4):
        covered.axhline(expected, color=TRUTH, linewidth=1.0)
    covered.set_title(
        f"position after {result['outage_s']:g} s alone: within 1 (o) and 2 (x) stated deviations",
        fontsize=10,
    )
    for axes in (ratio, covered):
        axes.set_xticks(range(len(worlds)), list(worlds))
        axes.grid(axis="y", **GRID)
    for axes, world in ((correlated, OWN), (own, list(worlds)[1])):
        _correlation(axes, worlds[world], colors)
        axes.set_title(f"autocorrelation of the innovations, world: {world}", fontsize=10)
    picture.legend(
        handles=[Line2D([], [], color=colors[n], marker="o", linestyle="", label=n) for n in names],
        loc="outside lower center", ncols=4, **BELOW,
    )  # fmt: skip
    set_title(picture, f"Are the estimators as good as they say? {result['seeds']} seeds")
    return picture


def _correlation(axes: Axes, rows: Mapping[str, Any], colors: Mapping[str, str]) -> None:
    for name, row in rows.items():
        axes.plot(range(1, LAGS + 1), row["autocorrelation"], "o-", color=colors[name], markersize=4)
    bound = next(iter(rows.values()))["autocorrelation_bound"]
    axes.axhspan(-bound, bound, color="#D3D7DD", zorder=0.5)
    axes.set_ylim(-0.5, 1.0)
    axes.set_xlabel("lag [fixes]")
    axes.grid(**GRID)
