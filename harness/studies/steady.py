"""Study `steady`: the covariance and gain that theory foresees, against those at which the filter settles.

Along a straight line the filter's errors in speed, bias and along-track position are a linear system, and its
fixes come in a pattern that repeats every 25 ticks: 25 Hz predictions, 4 Hz corrections. One period, lifted
to one step with four fixes, gives a Riccati equation whose process and measurement noise are correlated
(`control.dare`); its solution is exact. `control.dlqe` of one fix per 6.25 ticks is the textbook's shortcut.
After the last fix the variances grow by a polynomial in time, in closed form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import control
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from rich.console import Console
from rich.markup import escape
from scipy.linalg import expm

from codegen.batch.series import Series
from harness.drawing import BELOW, ESTIMATES, GRID, TRUTH, Style, house_style, new_figure, set_title
from harness.studies.study import Options, Progress, Result
from harness.terminal import new_table, print_table
from models.four_state import FourState
from models.kit.timing import TICK

Array = npt.NDArray[np.float64]

TAKES: frozenset[str] = frozenset()

SIGMAS = (
    0.04,
    0.1,
    0.2,
    0.5,
    1.07,
    5.0,
    20.0,
    151.7,
)  # m/s2; D.7 has 0.1, eq. 3.21 1.07 walking, 151.7 running
SHOWN = (0.1, 0.2, 1.07, 5.0, 151.7)  # m/s2, in the picture of an outage
H_ACC, S_ACC = 3.5, 0.1  # m, m/s that the receiver states (B.11): 1.75 m and 0.1 m/s after eq. 3.15
PERIOD, FIXES = 25, (0, 7, 13, 19)  # ticks of a period, and of its fixes: each on the first at or after n/4 s
SETTLE_S, OUTAGE_S = 1200, 10  # s
SETTLED = 5.0  # time constants after which less than 1 % of the start is left
NUDGE = 1e-3  # m/s, m: a measurement moved by this shows the filter's gain
STATES = ("speed", "bias", "north")
UNITS = ("m/s", "m/s2", "m")


def process_noise(sigma: float, sigma_bias: float = 1e-3, sigma_position: float = 1e-6) -> Array:
    """Q (3, 3) of a tick for speed, bias, north (eq. 3.16)."""
    return np.diag([sigma**2 * TICK, sigma_bias**2, sigma_position**2])


def transition(time: float) -> Array:
    """Phi (3, 3) over a time [s], heading north (eq. 3.10, 3.11)."""
    return np.array([[1.0, -time, 0.0], [0.0, 1.0, 0.0], [time, -(time**2) / 2, 1.0]])


H = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # eq. 3.14
R = np.diag([S_ACC**2, (0.5 * H_ACC) ** 2])  # eq. 3.15


def lifted(sigma: float) -> Array:
    """The covariance (3, 3) before the first fix of a period, from the Riccati equation of a whole period."""
    Q = process_noise(sigma)
    noise_to_state = np.hstack([transition((PERIOD - 1 - k) * TICK) for k in range(PERIOD)])
    noise_to_fixes = np.vstack(
        [
            np.hstack([H @ transition((fix - 1 - k) * TICK) if k < fix else 0 * H for k in range(PERIOD)])
            for fix in FIXES
        ]
    )
    A = transition(PERIOD * TICK)
    C = np.vstack([H @ transition(fix * TICK) for fix in FIXES])
    whole = np.kron(np.eye(PERIOD), Q)
    P, _, _ = control.dare(
        A.T,
        C.T,
        _symmetric(noise_to_state @ whole @ noise_to_state.T),
        _symmetric(noise_to_fixes @ whole @ noise_to_fixes.T) + np.kron(np.eye(len(FIXES)), R),
        noise_to_state @ whole @ noise_to_fixes.T,
    )
    return np.asarray(P)


def _symmetric(matrix: Array) -> Array:
    """Without what rounding leaves of its asymmetry, which `control` refuses."""
    return np.asarray((matrix + matrix.T) / 2)


def through_period(before: Array, sigma: float) -> list[tuple[Array, Array]]:
    """Gain (3, 2) and covariance (3, 3) after each fix of a period, from the covariance before the first."""
    P, fixes = before, []
    for tick in range(PERIOD):
        if tick in FIXES:
            gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)  # eq. 3.1
            P = P - gain @ H @ P  # eq. 3.3
            fixes.append((gain, P))
        P = transition(TICK) @ P @ transition(TICK).T + process_noise(sigma)  # eq. 3.5
    return fixes


def settling_time(fixes: Sequence[tuple[Array, Array]]) -> float:
    """Time constant [s] of the slowest error of the settled filter: its matrix over a period."""
    whole, past = np.eye(3), 0
    for fix, (gain, _) in zip(FIXES, fixes, strict=True):
        whole = (np.eye(3) - gain @ H) @ transition((fix - past) * TICK) @ whole
        past = fix
    whole = transition((PERIOD - past) * TICK) @ whole
    return float(-PERIOD * TICK / np.log(np.abs(np.linalg.eigvals(whole)).max()))


def single_rate(sigma: float) -> tuple[Array, Array]:
    """Gain and covariance after a fix by `control.dlqe`, one fix every 0.25 s, the noise spread over time."""
    time = PERIOD * TICK / len(FIXES)
    F = (transition(1.0) - np.eye(3)) * [[0, 1, 0], [0, 0, 0], [1, 0, 0]]
    generator = np.block([[-F, process_noise(sigma) / TICK], [np.zeros((3, 3)), F.T]])
    exponential = expm(generator * time)  # Van Loan 1978
    A = exponential[3:, 3:].T
    Q = A @ exponential[:3, 3:]
    gain, before, _ = control.dlqe(A, np.eye(3), H, _symmetric(Q), R)
    gain = np.linalg.solve(A, gain)  # dlqe's is that of the prediction, A K
    return gain, before - gain @ H @ before


def growth(after: Array, sigma: float, ticks: int, sigma_bias: float = 1e-3) -> dict[str, float]:
    """The variance [m2] of the position so many ticks after a fix, in closed form, by what it comes from.

    Sums of powers of k ticks stand for the noise of the tick that is k ticks old.
    """
    n, time = ticks, ticks * TICK
    squares = (n - 1) * n * (2 * n - 1) / 6  # sum of k^2, k < n
    fourths = (n - 1) * n * (2 * n - 1) * (3 * (n - 1) * n - 1) / 30  # sum of k^4, k < n
    V, b, N = 0, 1, 2
    return {
        "position": float(after[N, N] + 2 * time * after[N, V] - time**2 * after[N, b]),
        "speed": float(time**2 * after[V, V]),
        "bias": float(time**4 / 4 * after[b, b] - time**3 * after[V, b]),
        "acceleration noise": sigma**2 * TICK * TICK**2 * squares,
        "bias noise": sigma_bias**2 * TICK**4 / 4 * fourths,
    }


def settle(sigma: float) -> dict[str, Any]:
    """What the filter's own C settles at: deviations, gains, and the position's deviation in an outage."""
    names = ["speed_sd", "accel_bias_sd", "north_sd", "x[1]", "x[2]", "x[3]"]
    series = Series(FourState, observe=[f"four_state.{name}" for name in names])
    settled, outage = round(SETTLE_S / TICK), round(OUTAGE_S / TICK)
    ticks = settled + PERIOD + outage
    k = np.arange(ticks)
    fix = np.isin(k % PERIOD, FIXES) & (k < settled + 1)
    signals = {
        "accel_x": np.zeros(ticks),
        "pitch_meas": np.zeros(ticks),
        "heading_meas": np.zeros(ticks),
        "gps_fix": fix.astype(float),
        "gps_north": 1.5 * k * TICK,
        "gps_east": np.zeros(ticks),
        "gps_speed": np.full(ticks, 1.5),
        "gps_h_acc": np.full(ticks, H_ACC),
        "gps_s_acc": np.full(ticks, S_ACC),
    }
    parameters = {"four_state": {"fuzzy": 0.0, "use_pitch": 0.0, "sigma_constant": sigma}}

    def run(**nudged: float) -> dict[str, Array]:
        moved = {
            f"four_state.{name}": values + (k == settled) * nudged.get(name, 0.0)
            for name, values in signals.items()
        }
        return series.run(moved, parameters, ticks)

    plain = run()
    x = np.array([[plain[f"four_state.x[{i}]"][settled]] for i in (1, 2, 3)])
    moved = [run(gps_speed=NUDGE), run(gps_north=NUDGE)]
    gain = np.hstack([[[m[f"four_state.x[{i}]"][settled]] for i in (1, 2, 3)] - x for m in moved]) / NUDGE
    sd = np.array([plain[f"four_state.{name}"][settled] for name in names[:3]])
    return {"gain": gain, "sd": sd, "outage_sd": plain["four_state.north_sd"][settled : settled + outage + 1]}


def run(options: Options, progress: Progress) -> Result:
    """Filter and theory at each process noise of the acceleration."""
    rows = []
    for number, sigma in enumerate(SIGMAS):
        progress(100 * number / len(SIGMAS))
        own = settle(sigma)
        fixes = through_period(lifted(sigma), sigma)
        gain, after = fixes[0]
        lqe_gain, lqe_after = single_rate(sigma)
        parts = growth(after, sigma, round(OUTAGE_S / TICK))
        rows.append(
            {
                "sigma_accel": sigma,
                "settling_s": settling_time(fixes),
                "has_settled": settling_time(fixes) * SETTLED < SETTLE_S,
                "sd": {
                    name: {
                        "filter": float(own["sd"][i]),
                        "periodic": float(np.sqrt(after[i, i])),
                        "dlqe": float(np.sqrt(lqe_after[i, i])),
                    }
                    for i, name in enumerate(STATES)
                },
                "gain": {
                    f"{state} by {measured}": {
                        "filter": float(own["gain"][i, j]),
                        "periodic": float(gain[i, j]),
                        "dlqe": float(lqe_gain[i, j]),
                    }
                    for j, measured in enumerate(("speed", "north"))
                    for i, state in enumerate(STATES)
                },
                "outage_sd_m": {
                    "filter": [float(sd) for sd in own["outage_sd"][:: round(1 / TICK)]],
                    "closed_form": [
                        float(np.sqrt(sum(growth(after, sigma, round(t / TICK)).values())))
                        for t in range(OUTAGE_S + 1)
                    ],
                },
                "outage_shares": {name: value / sum(parts.values()) for name, value in parts.items()},
            }
        )
    return {"settled_s": SETTLE_S, "outage_s": OUTAGE_S, "rows": rows}


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print what the filter settles at, and how far it is from either theory, in percent."""
    table = new_table(gap=1)
    table.add_column("\nsigma\n\\[m/s2]", justify="right")
    table.add_column("time\nconstant\n\\[s]", justify="right")
    for state, unit in zip(STATES, UNITS, strict=True):
        for heading in (f"{state}\nsd\n[{unit}]", "\nperiodic\n[%]", "\ndlqe\n[%]"):
            table.add_column(escape(heading), justify="right")
    table.add_column("speed's\ngain\ndlqe [%]", justify="right")
    for heading in (
        f"north sd after\n{result['outage_s']} s alone\n[m]",
        "closed\nform\n[%]",
        "of it\nbias\n[%]",
    ):
        table.add_column(escape(heading), justify="right")
    for row in result["rows"]:
        cells = []
        for state in STATES:
            sd = row["sd"][state]
            cells += [f"{sd['filter']:.4f}", _percent(sd, "periodic"), _percent(sd, "dlqe")]
        alone = {name: values[-1] for name, values in row["outage_sd_m"].items()}
        table.add_row(
            f"{row['sigma_accel']:g}",
            f"{row['settling_s']:.1f}" + ("" if row["has_settled"] else "*"),
            *cells,
            _percent(row["gain"]["speed by speed"], "dlqe"),
            f"{alone['filter']:.2f}",
            _percent(alone, "closed_form"),
            f"{100 * row['outage_shares']['bias']:.0f}",
        )
    print_table(table, console)
    console.print(
        f"periodic: the filter after {result['settled_s']} s against the Riccati equation of a period of 25 "
        "predictions and 4 fixes; dlqe: against one fix every 6.25 predictions",
        style="dim", markup=False, highlight=False,
    )  # fmt: skip
    if late := [f"{row['sigma_accel']:g}" for row in result["rows"] if not row["has_settled"]]:
        console.print(
            f"* not settled after {result['settled_s']} s, {SETTLED:g} time constants are more: with sigma "
            f"{', '.join(late)} m/s2 the bias still falls, and is off from either theory for that",
            style="dim", markup=False, highlight=False, soft_wrap=True,
        )  # fmt: skip


def _percent(values: Mapping[str, float], theory: str) -> str:
    """How far the filter is from a theory; rounding is 0."""
    return f"{round(100 * (values['filter'] / values[theory] - 1), 3) + 0.0:+.3g}"


def draw(result: Mapping[str, Any]) -> Mapping[str, Figure]:
    """The study's picture."""
    return {"steady": _picture(result)}


@house_style()
def _picture(result: Mapping[str, Any]) -> Figure:
    """Deviations by process noise, and their growth without fixes: theory as lines, the filter's as marks."""
    picture = new_figure(13, 5.2)
    settled, alone = picture.subplots(1, 2)
    rows = result["rows"]
    sigmas = [row["sigma_accel"] for row in rows]
    for color, state, unit in zip(ESTIMATES, STATES, UNITS, strict=False):
        by = {name: [row["sd"][state][name] for row in rows] for name in ("filter", "periodic", "dlqe")}
        settled.loglog(sigmas, by["periodic"], color=color, label=f"{state} [{unit}]")
        settled.loglog(sigmas, by["dlqe"], color=color, linestyle=":")
        for has_settled, face in ((True, color), (False, "none")):
            marks = [i for i, row in enumerate(rows) if row["has_settled"] == has_settled]
            settled.loglog(
                [sigmas[i] for i in marks], [by["filter"][i] for i in marks], "o", color=color, markersize=5,
                markerfacecolor=face,
            )  # fmt: skip
    settled.set_xlabel("process noise of the acceleration, sigma [m/s2]")
    settled.set_ylabel("standard deviation after a fix")
    settled.set_title(f"after {result['settled_s']} s with fixes", fontsize=10)
    for color, row in zip(ESTIMATES, [row for row in rows if row["sigma_accel"] in SHOWN], strict=False):
        time = np.arange(result["outage_s"] + 1)
        alone.semilogy(
            time, row["outage_sd_m"]["closed_form"], color=color, label=f"sigma {row['sigma_accel']:g} m/s2"
        )
        alone.semilogy(time, row["outage_sd_m"]["filter"], "o", color=color, markersize=5)
    alone.set_xlabel("time without fixes [s]")
    alone.set_ylabel("standard deviation of the position [m]")
    alone.set_title("along the track, in an outage", fontsize=10)
    alone.set_ylim(bottom=0.01)
    for axes, corner in ((settled, "upper left"), (alone, "lower right")):
        axes.grid(**GRID)
        axes.legend(frameon=False, loc=corner)
    kinds: list[Style] = [
        {"color": TRUTH, "linestyle": "-", "label": "theory, whole period or closed form"},
        {"color": TRUTH, "linestyle": ":", "label": "theory, dlqe of a single rate"},
        {"color": TRUTH, "linestyle": "", "marker": "o", "label": "the filter's own"},
        {"color": TRUTH, "linestyle": "", "marker": "o", "markerfacecolor": "none", "label": "not settled"},
    ]
    picture.legend(
        handles=[Line2D([], [], **kind) for kind in kinds],
        loc="outside lower center",
        ncols=len(kinds),
        **BELOW,
    )
    set_title(picture, "four_state: deviations that theory foresees, and those at which it settles")
    return picture
