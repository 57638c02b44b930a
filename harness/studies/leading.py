"""How often each estimator leads the simulated dog, with the simulated attitude and with that of our AHRS.

The trials are those of `canine sweep three --system full --estimator NAME`, at the threshold of 5.3.7's field
trials. All estimators meet the same dogs and the same sensors, the shipped ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure
from rich.console import Console

from harness.drawing import BELOW, ESTIMATES, GRID, house_style, new_figure
from harness.studies.statistics import share
from harness.studies.study import Options, Progress, Result
from harness.sweep.chunks import Outcomes, pool_at, run_all
from harness.sweep.sweep import plan_sweep
from harness.sweep.table import table_of
from harness.terminal import new_table, percent, print_table
from models.system import ESTIMATORS

TAKES = frozenset({"seeds"})
TRIALS = 2000
THRESHOLD_DEG = 49.0  # where the field's rate is compared with ours
RECORDED, OWN = "sensors", "canine_ahrs"  # whose roll, pitch and heading
COLORS = dict(zip((RECORDED, OWN), (ESTIMATES[0], ESTIMATES[1]), strict=True))


def run(options: Options, progress: Progress) -> Result:
    """The share of successful trials of each estimator; the option `seeds` counts trials."""
    trials = options.seeds or TRIALS
    kinds = [(name, attitude) for name in ESTIMATORS for attitude in (RECORDED, OWN)]
    rows = []
    for done, (name, attitude) in enumerate(kinds, 1):
        rows.append({"estimator": name, "attitude": attitude, **_success(trials, name, attitude == OWN)})
        progress(100 * done / (len(kinds) + 1))
    return {
        "trials": trials, "threshold_deg": THRESHOLD_DEG, "rows": rows, "true_state": _success(trials),
    }  # fmt: skip


def _success(trials: int, estimator: str | None = None, ahrs: bool = False) -> dict[str, Any]:
    """The share of trials that succeed; without an estimator the controller has the true state."""
    sweep = plan_sweep(
        "three", thresholds=f"{THRESHOLD_DEG:g}", trials=trials,
        system="full" if estimator else "cts", estimator=estimator, ahrs=ahrs,
    )  # fmt: skip
    outcomes = Outcomes(sweep.job)
    with pool_at(None, sweep.job) as pool:
        run_all(outcomes, pool, keep=lambda chunk: None)
    (point,) = table_of(sweep.points, outcomes)
    return {**share(point.successes, point.trials), "timeouts": point.timeouts}


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the shares with their intervals, an estimator to a line."""
    table = new_table()
    table.add_column("the estimator that leads")
    for heading in ("roll, pitch, heading of\nthe sensors", "\n95 %", "\ncanine_ahrs", "\n95 %"):
        table.add_column(heading, justify="right")
    for name in dict.fromkeys(row["estimator"] for row in result["rows"]):
        cells = [
            cell
            for attitude in (RECORDED, OWN)
            for row in result["rows"]
            if (row["estimator"], row["attitude"]) == (name, attitude)
            for cell in _cells(row)
        ]
        table.add_row(name, *cells)
    table.add_row("none: the true state", *_cells(result["true_state"]), "", "")
    print_table(table, console)
    console.print(
        f"share of {result['trials']} trials that succeed: `canine sweep three --system full "
        f"--estimator NAME [--ahrs] --thresholds {THRESHOLD_DEG:g} --trials {result['trials']}`",
        highlight=False, markup=False, soft_wrap=True,
    )  # fmt: skip


def _cells(row: Mapping[str, Any]) -> tuple[str, str]:
    return percent(row["share"]), f"{100 * row['low']:.1f}-{100 * row['high']:.1f}"


@house_style()
def draw(result: Mapping[str, Any]) -> Mapping[str, Figure]:
    """The shares with their intervals."""
    figure = new_figure(9, 4)
    axes = figure.subplots()
    names = list(dict.fromkeys(row["estimator"] for row in result["rows"]))
    for attitude, shift in ((RECORDED, -0.12), (OWN, 0.12)):
        rows = [row for row in result["rows"] if row["attitude"] == attitude]
        places = [names.index(row["estimator"]) + shift for row in rows]
        shares = [100 * row["share"] for row in rows]
        errors = [
            [100 * (row["share"] - row["low"]) for row in rows],
            [100 * (row["high"] - row["share"]) for row in rows],
        ]
        label = f"attitude of {'the sensors' if attitude == RECORDED else attitude}"
        axes.errorbar(shares, places, xerr=errors, fmt="o", color=COLORS[attitude], label=label, capsize=3)
    true = 100 * result["true_state"]["share"]
    axes.axvline(true, color="#111111", linewidth=1.0, linestyle=":", label="the true state leads")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel(
        f"successes of {result['trials']} three-waypoint trials, h' = {result['threshold_deg']:g} deg [%]"
    )
    axes.grid(**GRID)
    axes.set_axisbelow(True)
    figure.legend(loc="outside upper center", ncols=3, **BELOW)
    return {"leading": figure}
