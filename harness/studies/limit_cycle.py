"""Study `limit_cycle`: the controller as a relay with hysteresis and delay, against the simulated loop.

The CMEC commands turns at a fixed rate, left or right (eq. 4.4), and a dog may answer late. So seen,
deviation to turn rate is a relay with the hysteresis h', in a loop with an integrator and a delay:
- the *describing function* (`control.describing_function_response`) foresees a sine's amplitude and period;
- the *exact relay* (Tsypkin's method; in the phase plane the heading is a triangle) foresees the amplitude
  h' + rate * delay and the period 4 (h' / rate + delay);
- *by events* counts what that relay lacks: the dog stops to turn and stands for `stop_hold`; a turn ends at
  `turn_end_deviation` with FORWARD, not with the turn back; and all of it happens on ticks.
The last foresees the simulation to the tick. It has a cycle only where the dog turns past h' on the other
side before it obeys FORWARD: rate * delay >= h' + `turn_end_deviation`. The describing function knows no such
condition, and no pause. A drift makes another cycle, which stays on one side: there the describing function
of a symmetrical sine does not apply.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import control
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from rich.console import Console

from codegen.batch.series import Series
from harness.cosim.stepping import first_tick
from harness.drawing import BELOW, ESTIMATES, GRID, TRUTH, Style, house_style, new_figure, set_title
from harness.studies.study import Options, Progress, Result
from harness.terminal import new_table, print_table
from models.canine import Canine
from models.cmec import Cmec
from models.kit.geometry import LONGEST
from models.kit.timing import TICK
from models.kit.units import DEG
from models.modes import Mode
from models.system import trial_simulator

Array = npt.NDArray[np.float64]

TAKES: frozenset[str] = frozenset()

RATE = 67.8 * DEG  # rad/s: the mean of both turn rates of Table 5.1, for a loop that is symmetrical
THRESHOLDS = (23.0, 37.0, 49.0)  # deg, h'
DELAYS = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)  # s
START = 1.0  # rad, deviation at the start: a late dog must be turned first
CYCLES = 40  # halves of a cycle that are followed, to its limit
PADE = 8  # order of the delay's approximation
SHOWN = (37.0, 0.8)  # deg, s: the cycle in the picture
LONG_S = 120.0  # s of a simulation
FAR_M = 9e4  # m to the waypoint: its bearing stays


def _start(block: type[Any], name: str) -> float:
    return float(block.variables()[name].start[0])


HOLD, TURN_END = _start(Cmec, "stop_hold"), _start(Cmec, "turn_end_deviation")
STOPPED, BRAKING = _start(Cmec, "stopped_speed"), _start(Canine, "slowing_down")
SPEED, LEFT_RATE = _start(Canine, "cruise_speed"), -_start(Canine, "left_turn_rate")
RIGHT_RATE, DRIFT = _start(Canine, "right_turn_rate"), _start(Canine, "drift")
WAYS = {
    "describing_function": "describing function",
    "exact_relay": "exact relay",
    "by_events": "by events",
    "simulated": "simulated loop",
}


def describing_function(threshold: float, delay: float, rate: float = RATE) -> tuple[float, float] | None:
    """Amplitude [rad] and period [s] of the sine at which the relay's describing function closes the loop."""
    numerator, denominator = control.pade(delay, PADE)
    loop = control.tf(numerator, denominator) * control.tf([1], [1, 0])
    relay = control.relay_hysteresis_nonlinearity(rate, threshold)
    amplitudes = threshold * np.geomspace(1.0001, 20, 100)
    frequencies = np.geomspace(0.02, 1.6, 500) / delay  # the delay's phase is less than a quarter turn
    crossings = control.describing_function_response(
        loop, relay, amplitudes, frequencies, warn_nyquist=False
    ).intersections
    if not crossings:
        return None
    amplitude, frequency = crossings[0]
    return float(amplitude), float(2 * np.pi / frequency)


def exact_relay(threshold: float, delay: float, rate: float = RATE) -> tuple[float, float]:
    """Amplitude [rad] and period [s] of the relay's own cycle: a triangle, as Tsypkin's method gives it."""
    amplitude = threshold + rate * delay
    return amplitude, 4 * amplitude / rate


def by_events(
    threshold: float, delay: float, rate: float = RATE, start: float = START
) -> tuple[float, float] | None:
    """Amplitude [rad] and period [s] of the CMEC's cycle, its events on ticks; None where it comes to rest.

    A turn is a whole number of ticks, so that the cycle remembers the deviation `start` [rad] it came from.
    """
    step, late = rate * TICK, first_tick(delay, TICK)
    peak, peaks, halves = start, [], []
    for _ in range(CYCLES):
        to_end = math.floor((peak - TURN_END) / step + 1e-9) + 1  # the turn ends inside `turn_end_deviation`
        rest = peak - to_end * step
        to_stop = math.ceil((rest + threshold) / step - 1e-9)  # and goes on, to h' on the other side
        if to_stop > late:  # the dog obeys FORWARD first
            return None
        peak = (to_stop + late) * step - rest
        peaks.append(peak)
        halves.append(to_end + to_stop + late + first_tick(HOLD, TICK))
    settled = slice(CYCLES // 2, None)
    return float(np.mean(peaks[settled])), 2 * TICK * float(np.mean(halves[settled]))


def drifting(threshold: float) -> tuple[float, float, float]:
    """Least and greatest heading [rad] and period [s] of a dog that drifts to the right and obeys at once.

    In the phase plane: it drifts to h', then on while it brakes, then turns left to `turn_end_deviation`.
    """
    to_rest = max(HOLD, (SPEED - STOPPED) / BRAKING)
    peak = threshold + DRIFT * SPEED / BRAKING
    ticks = math.floor((peak - TURN_END) / (LEFT_RATE * TICK)) + 1
    least = peak - ticks * LEFT_RATE * TICK
    return least, peak, (threshold - least) / DRIFT + to_rest + ticks * TICK


class Loop:
    """Controller and dog, a waypoint far to the north, turns without end."""

    def __init__(self) -> None:
        self.series = Series(trial_simulator(), observe=["plant.heading", "controller.mode"])

    def run(self, threshold: float, **dog: float) -> dict[str, Array]:
        """Heading [rad] and mode, (ticks,) each, for a threshold h' [rad] and a dog's parameters."""
        ticks = round(LONG_S / TICK)
        controller = {
            "moving_deviation": threshold,
            "waypoint_count": 1,
            "waypoint_north[1]": FAR_M,
            "max_turns": 1000,
            "forward_timeout": LONGEST,
            "turn_timeout": LONGEST,
        }
        obedient = {"left_success": 1.0, "right_success": 1.0, "drift_deviation": 0.0}
        steady = {"left_turn_rate_deviation": 0.0, "right_turn_rate_deviation": 0.0, "shaking": 0.0}
        result = self.series.run(
            {"controller.start": np.ones(ticks)},
            {"controller": controller, "plant": {**obedient, **steady, **dog}},
            ticks,
        )
        return {name.split(".")[1]: values for name, values in result.items()}

    def late(self, threshold: float, delay: float) -> dict[str, Array]:
        """The same, of a dog that answers late [s] and does not drift."""
        rates = {"left_turn_rate": -RATE, "right_turn_rate": RATE}
        return self.run(threshold, drift=0.0, response_delay=delay, start_heading=START, **rates)


def _cycle(log: Mapping[str, Array]) -> tuple[float, float] | None:
    """Amplitude [rad] and period [s] in the second half of a log, by its LEFT commands."""
    half = len(log["heading"]) // 2
    heading, left = log["heading"][half:], log["mode"][half:] == Mode.LEFT
    begins = np.flatnonzero(left[1:] & ~left[:-1])
    if len(begins) < 2:
        return None
    whole = heading[begins[0] : begins[-1]]
    return float(np.ptp(whole)) / 2, float(np.mean(np.diff(begins))) * TICK


def run(options: Options, progress: Progress) -> Result:
    """All cycles: those of a dog that answers late, and that of one that drifts."""
    loop = Loop()
    rows = []
    for number, threshold in enumerate(THRESHOLDS):
        progress(100 * number / len(THRESHOLDS))
        for delay in DELAYS:
            angle = threshold * DEG
            ways = {
                "describing_function": describing_function(angle, delay),
                "exact_relay": exact_relay(angle, delay),
                "by_events": by_events(angle, delay),
                "simulated": _cycle(loop.late(angle, delay)),
            }
            rows.append(
                {"threshold_deg": threshold, "delay_s": delay}
                | {way: _shown(values) for way, values in ways.items()}
            )
    log = loop.run(49 * DEG)
    half = len(log["heading"]) // 2
    _, period = _cycle(log) or (0.0, 0.0)
    low, high, predicted = drifting(49 * DEG)
    drift = {
        "predicted": {"least_deg": low / DEG, "greatest_deg": high / DEG, "period_s": predicted},
        "simulated": {
            "least_deg": float(log["heading"][half:].min() / DEG),
            "greatest_deg": float(log["heading"][half:].max() / DEG),
            "period_s": period,
        },
    }
    example = loop.late(SHOWN[0] * DEG, SHOWN[1])
    shown = slice(half, half + round(20 / TICK))
    return {
        "rate_deg_s": RATE / DEG,
        "critical_delay_s": {
            "at the mean rate": {f"{h:g}": (h * DEG + TURN_END) / RATE for h in THRESHOLDS},
            "at the slower rate of Table 5.1": {
                f"{h:g}": (h * DEG + TURN_END) / RIGHT_RATE for h in THRESHOLDS
            },
        },
        "late": rows,
        "drift": drift,
        "traces": {
            "late_deg": (example["heading"][shown] / DEG).tolist(),
            "drift_deg": (log["heading"][: round(60 / TICK)] / DEG).tolist(),
        },
    }


def _shown(cycle: tuple[float, float] | None) -> dict[str, float] | None:
    return None if cycle is None else {"amplitude_deg": cycle[0] / DEG, "period_s": cycle[1]}


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print the cycles of a late dog by way, then that of one that drifts."""
    table = new_table(gap=1)
    for heading in ("h'\n\\[deg]", "delay\n\\[s]"):
        table.add_column(heading, justify="right")
    for label in WAYS.values():
        table.add_column(label.replace(" ", "\n") + "\n\\[deg]", justify="right")
        table.add_column("\n\n\\[s]", justify="right")
    for row in result["late"]:
        cells: list[str] = []
        for way in WAYS:
            cycle = row[way]
            cells += (
                ["at rest", ""]
                if cycle is None
                else [f"{cycle['amplitude_deg']:.1f}", f"{cycle['period_s']:.2f}"]
            )
        table.add_row(f"{row['threshold_deg']:g}", f"{row['delay_s']:g}", *cells)
    print_table(table, console)
    predicted, simulated = result["drift"]["predicted"], result["drift"]["simulated"]
    at_the_mean, at_the_slower = result["critical_delay_s"].values()
    for text in (
        f"the table's dog turns at {result['rate_deg_s']:.1f} deg/s to both sides: a cycle needs a delay of "
        f"{_delays(at_the_mean)}; up to a tick of {TICK:g} s less, by where the ticks fall",
        f"the CMEC's periods exceed the exact relay's by {2 * HOLD:g} s and ticks: before each of both turns "
        f"the dog is stopped and stands for {HOLD:g} s (`stop_hold`), which a relay does not know",
        f"with the turn rates of Table 5.1 the slower side decides: {_delays(at_the_slower)}",
        f"drift, no delay, h' = 49 deg: by phase plane {predicted['least_deg']:.1f} to "
        f"{predicted['greatest_deg']:.1f} deg in {predicted['period_s']:.2f} s, simulated "
        f"{simulated['least_deg']:.1f} to {simulated['greatest_deg']:.1f} deg in "
        f"{simulated['period_s']:.2f} s; the describing function does not apply: "
        "the cycle lies on one side and the dog pauses in it",
    ):
        console.print(text, markup=False, highlight=False)


def _delays(by_threshold: Mapping[str, float]) -> str:
    return ", ".join(f"{delay:.2f} s (h' = {h} deg)" for h, delay in by_threshold.items())


def draw(result: Mapping[str, Any]) -> Mapping[str, Figure]:
    """The study's picture."""
    return {"limit_cycle": _picture(result)}


@house_style()
def _picture(result: Mapping[str, Any]) -> Figure:
    """Amplitude and period by delay, and two cycles in time."""
    picture = new_figure(15, 5.2)
    amplitude, period, time = picture.subplots(1, 3)
    styles: dict[str, Style] = {
        "describing_function": {"linestyle": ":"},
        "exact_relay": {"linestyle": "--", "linewidth": 1.0},
        "by_events": {"linestyle": "-"},
        "simulated": {"linestyle": "", "marker": "o", "markersize": 5},
    }
    for color, threshold in zip(ESTIMATES, THRESHOLDS, strict=False):
        rows = [row for row in result["late"] if row["threshold_deg"] == threshold]
        for axes, value in ((amplitude, "amplitude_deg"), (period, "period_s")):
            for way, style in styles.items():
                shown = [np.nan if row[way] is None else row[way][value] for row in rows]
                axes.plot([row["delay_s"] for row in rows], shown, color=color, **style)
            axes.plot([], [], color=color, label=f"h' = {threshold:g} deg")
    amplitude.set_ylabel("amplitude of the heading [deg]")
    period.set_ylabel("period [s]")
    period.set_ylim(0, 13)
    for axes in (amplitude, period):
        axes.set_xlabel("delay of the dog's answer [s]")
        axes.grid(**GRID)
        axes.legend(frameon=False, loc="upper left")
    for color, (name, trace) in zip(
        ESTIMATES[3:],
        (
            (f"late by {SHOWN[1]:g} s, h' = {SHOWN[0]:g} deg", result["traces"]["late_deg"]),
            ("drifts, answers at once, h' = 49 deg", result["traces"]["drift_deg"]),
        ),
        strict=False,
    ):
        time.plot(np.arange(len(trace)) * TICK, trace, color=color, label=name)
    time.set_ylim(-115, 165)
    time.set_xlabel("time [s]")
    time.set_ylabel("heading, the waypoint at 0 [deg]")
    time.grid(**GRID)
    time.legend(frameon=False, loc="upper left")
    picture.legend(
        handles=[Line2D([], [], color=TRUTH, label=WAYS[way], **style) for way, style in styles.items()],
        loc="outside lower center",
        ncols=4,
        **BELOW,
    )
    set_title(picture, "The heading's limit cycle under the CMEC: foreseen and simulated")
    return picture
