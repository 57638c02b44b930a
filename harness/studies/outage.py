"""Estimators through trials whose last 10 s have no GPS (Tables 3.1, D.1, D.2, Figures 3.6-3.8, D.5-D.13)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from rich.console import Console

from harness.drawing import house_style
from harness.recording.positions import read_positions, stretches
from harness.recording.recording import RecordingError
from harness.replay.comparison import HELD, MEAN_S
from harness.studies import published
from harness.studies.outage_pictures import DETECTION, figure_of_means, figure_of_trial
from harness.studies.paths import GAITS, Path, walk
from harness.studies.published import FUZZY, INERTIAL, NO_PITCH, OUTAGE_S, PITCH
from harness.studies.statistics import paired, summary, unpaired
from harness.studies.study import Options, Progress, Result, in_threads
from harness.studies.tracking import Configuration, Tracking, Trial
from harness.terminal import new_table, print_table
from models.canine_tracker import CanineTracker
from models.errors import UsageError, nearest
from models.four_state import FourState
from models.readings import CAP, FLOORS
from models.recorded import Recorded
from models.sets import SETS
from models.system import ESTIMATORS

Array = npt.NDArray[np.float64]
TAKES = frozenset({"seeds", "set", "recording"})
SEEDS = 300
RECORDED, RECORDED_S = "recorded path", 30.0  # a trial along the path of a live animal, without overlap
MEAN, OURS = f"mean speed of {MEAN_S:g} s", CanineTracker.title()
REFERENCES = (INERTIAL, HELD, MEAN)  # without a filter
CONFIGURATIONS: dict[str, Configuration] = {
    NO_PITCH: Configuration(FourState, {"use_pitch": 0, "fuzzy": 0}),
    PITCH: Configuration(FourState, {"use_pitch": 1, "fuzzy": 0}),
    FUZZY: Configuration(FourState, {"use_pitch": 1, "fuzzy": 1}),
    f"{FUZZY}, floors and cap": Configuration(FourState, {"fuzzy": 1, **FLOORS, **CAP}),
    f"{PITCH}, canine_ahrs": Configuration(FourState, {"fuzzy": 0}, ahrs=True),
    **{title: Configuration(block) for title, block in ESTIMATORS.items() if block is not FourState},
    f"{OURS}, canine_ahrs": Configuration(CanineTracker, ahrs=True),
}
PAIRS = (
    (INERTIAL, NO_PITCH), (INERTIAL, PITCH), (NO_PITCH, PITCH), (PITCH, FUZZY), (HELD, PITCH), (HELD, OURS),
    (MEAN, OURS), (PITCH, OURS),
)  # fmt: skip
PRINTED = ((INERTIAL, NO_PITCH), (NO_PITCH, PITCH), (PITCH, FUZZY), (HELD, OURS), (PITCH, OURS))
COLUMNS = ("position_error_m", "speed_error_m_s")
SIGNIFICANT = 0.05
REPEATS = 2000  # studies of the text's size that are drawn from our trials
SHOWN = (NO_PITCH, PITCH, FUZZY, OURS)  # in the sample trial


def run(options: Options, progress: Progress) -> Result:
    """Errors at the ends of the trials, for each set and gait, with their tests; a sample trial of each.

    The error is measured against the truth; the text's is against the receiver. That of accelerometer and
    heading alone belongs to the whole trial, as in the text.

    Along the path of a live animal, where a table of its positions or a trial's log is given.

    Raises:
        UsageError: there is no such set.
        RecordingError: the table cannot be read, or has fewer than two pieces that are long enough.
    """
    if options.set is not None and options.set not in SETS:
        raise UsageError(f'there is no set "{options.set}"{nearest(options.set, SETS)}')
    sets = [options.set] if options.set else list(SETS)
    paths: dict[str, Callable[[int], Path]] = {gait: partial(walk, of) for gait, of in GAITS.items()}
    count, pieces = options.seeds or SEEDS, []
    if options.recording:
        recorded = read_positions(options.recording, shortest=RECORDED_S)
        pieces = [Path(piece.north, piece.east) for piece in stretches(recorded, RECORDED_S)]
        paths, count = {RECORDED: lambda seed: pieces[seed - 1]}, min(options.seeds or SEEDS, len(pieces))
        if count < 2:
            raise RecordingError(
                f"{options.recording}: got one stretch of {RECORDED_S:g} s without a jump; expected two"
            )
    seeds = range(1, count + 1)
    tracking = Tracking("study_outage", Recorded, CONFIGURATIONS)
    results: dict[str, Any] = {name: {} for name in sets}
    total, done = len(sets) * len(paths) * len(seeds), 0
    for set_name in sets:
        for gait, path in paths.items():
            errors = []
            for one in in_threads(partial(errors_of, tracking, path, set_name), seeds):
                errors.append(one)
                progress(100 * (done := done + 1) / total)
            sample = _sample(trial(tracking, path, set_name, seeds[0]))
            results[set_name][gait] = {**_judged(errors), "sample": sample}
    recorded_path = {"stretches": len(pieces), "stretch_s": RECORDED_S} if pieces else None
    return {
        "seeds": len(seeds), "outage_s": OUTAGE_S, "recorded_path": recorded_path, "sets": results,
        "published": _published(),
    }  # fmt: skip


def trial(tracking: Tracking, path_of: Callable[[int], Path], set_name: str, seed: int) -> Trial:
    """A trial along a seed's path with a set; the outage ends with it."""
    path = path_of(seed)
    signals = {"path_north": path.north, "path_east": path.east}
    return tracking.run(len(path.north), seed, signals, SETS[set_name], OUTAGE_S)


def errors_of(
    tracking: Tracking, path_of: Callable[[int], Path], set_name: str, seed: int
) -> dict[str, tuple[float, float]]:
    """Each configuration's error of position [m] and speed [m/s] at the end of a trial."""
    one = trial(tracking, path_of, set_name, seed)
    estimates = {INERTIAL: one.inertial(), HELD: one.held(), MEAN: one.held(MEAN_S), **one.estimates}
    return {
        title: (float(one.position_error(estimate)[-1]), float(one.speed_error(estimate)[-1]))
        for title, estimate in estimates.items()
    }


def _judged(errors: Sequence[Mapping[str, tuple[float, float]]]) -> dict[str, Any]:
    """Statistics and tests of the errors of all trials."""
    table = {title: np.array([one[title] for one in errors]) for title in errors[0]}  # (n, 2)
    return {
        "configurations": {
            title: {column: summary(values[:, i]) for i, column in enumerate(COLUMNS)}
            for title, values in table.items()
        },
        "paired_t_tests": [
            {"first": a, "second": b}
            | {column: paired(table[a][:, i], table[b][:, i]) for i, column in enumerate(COLUMNS)}
            for a, b in PAIRS
        ],
        "unpaired_t_tests": _unpaired(table[PITCH], table[FUZZY]),
        "errors": {title: np.round(values, 3).T.tolist() for title, values in table.items()},
    }


def _unpaired(standard: Array, adaptive: Array) -> dict[str, Any]:
    """Pitch against fuzzy by Table 3.1's way: each by trials of its own, halves of ours, and 31 and 36.

    How such a study comes out by chance is seen from many that are drawn from our trials.
    """
    n, m, half = published.OUTAGE[PITCH].n, published.OUTAGE[FUZZY].n, len(standard) // 2
    tests: dict[str, Any] = {"first": PITCH, "second": FUZZY}
    rng = np.random.default_rng(1)
    for i, column in enumerate(COLUMNS):
        tests[column] = {"halves": unpaired(standard[:half, i], adaptive[half:, i])}
        if len(standard) < n + m:
            continue
        better = significant = 0
        for _ in range(REPEATS):
            rows = rng.permutation(len(standard))
            first, second = standard[rows[:n], i], adaptive[rows[n : n + m], i]
            is_better = bool(second.mean() < first.mean())
            better += is_better
            p = unpaired(first, second)["p"]
            significant += is_better and p is not None and p < SIGNIFICANT
        tests[column] |= {
            "31_and_36": unpaired(standard[:n, i], adaptive[n : n + m, i]),
            # without an interval: the draws overlap, and more of them would not make the trials more
            "fuzzy_better": {"n": REPEATS, "share": better / REPEATS},
            "significantly": {"n": REPEATS, "share": significant / REPEATS},
        }
    return tests


def _published() -> dict[str, Any]:
    return {
        "configurations": {title: values._asdict() for title, values in published.OUTAGE.items()},
        "paired_t_tests": [
            {"first": a, "second": b, "place": published.PAIRED_PLACE, "position_t": t, "speed_t": u}
            for (a, b), (t, u) in published.PAIRED.items()
        ],
        "unpaired_t_tests": [
            {"first": a, "second": b, "place": published.UNPAIRED_PLACE, "position_p": p, "speed_p": q}
            for (a, b), (p, q) in published.UNPAIRED.items()
        ],
    }


def _sample(one: Trial) -> dict[str, Any]:
    """A trial for the pictures, rounded."""

    def rounded(values: Array, digits: int = 2) -> list[float]:
        return [round(float(value), digits) for value in values]

    fixes = np.flatnonzero(one.sensed["gps_fix"])
    return {
        "time_s": rounded(one.time),
        "truth": {n: rounded(one.truth[n]) for n in ("north", "east", "speed")},
        "gps": {n: rounded(one.sensed[f"gps_{n}"][fixes]) for n in ("north", "east", "speed")}
        | {"time_s": rounded(one.time[fixes])},
        "estimates": {
            title: {n: rounded(one.estimates[title][n]) for n in ("north", "east", "speed")}
            | {n: rounded(one.estimates[title][n], 3) for n in ("accel_bias", "sigma_accel")}
            | {"position_error_m": rounded(one.position_error(one.estimates[title]))}
            for title in SHOWN
        },
    }


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print a table for each set and gait, the text's numbers beside ours."""
    for set_name, gaits in result["sets"].items():
        for gait, values in gaits.items():
            text = result["published"]["configurations"] if gait == DETECTION else {}
            console.print(f"[bold]set {set_name}, {gait}[/]: {result['seeds']} trials", highlight=False)
            _show_errors(values["configurations"], text, console)
            tests = [t for t in values["paired_t_tests"] if (t["first"], t["second"]) in PRINTED]
            lines = [_in_words(test) for test in tests]
            if gait == DETECTION:
                lines += _chances(values["unpaired_t_tests"])
            console.print(
                "\n".join(lines), "", style="dim", highlight=False, markup=False, soft_wrap=True, sep="\n"
            )
    if path := result["recorded_path"]:
        console.print(
            f"{result['seeds']} trials: the path has {path['stretches']} stretches without a jump or overlap"
            f", each of {path['stretch_s']:g} s and for one trial",
            highlight=False, markup=False, soft_wrap=True,
        )  # fmt: skip
    if any(DETECTION in gaits for gaits in result["sets"].values()):
        console.print(
            "In brackets: the dissertation (Tables D.1, 3.1). The set dissertation was chosen by them.",
            highlight=False, markup=False, soft_wrap=True,
        )  # fmt: skip


def _show_errors(configurations: Mapping[str, Any], text: Mapping[str, Any], console: Console) -> None:
    table = new_table()
    table.add_column("error at the end")
    for first in ("position, m\nmean", "speed, m/s\nmean"):
        for heading in (first, "\nsd", "\nmedian", "\np90"):
            table.add_column(heading, justify="right")
    for title, values in configurations.items():
        cells = []
        for column, name in zip(COLUMNS, ("position", "speed"), strict=True):
            for key in ("mean", "sd", "median", "p90"):
                cell = f"{values[column][key]:.2f}"
                if title in text and key in ("mean", "sd"):
                    cell += f" ({text[title][name if key == 'mean' else f'{name}_sd']:g})"
                cells.append(cell)
        table.add_row(title, *cells)
    print_table(table, console)


def _in_words(test: Mapping[str, Any]) -> str:
    """A paired test: the difference of both errors."""
    parts = []
    for column, unit in zip(COLUMNS, ("m", "m/s"), strict=True):
        values = test[column]
        if values["t"] is None:
            parts.append("no difference" if values["difference"] == 0 else "no spread")
        else:
            parts.append(
                f"{values['difference']:+.2f} {unit} ({values['low']:+.2f} to {values['high']:+.2f}), "
                f"t({values['df']}) = {values['t']:.2f}, p = {values['p']:.2g}"
            )
    return f"  {test['first']} less {test['second']}, paired: {'; '.join(parts)}"


def _p_of(test: Mapping[str, Any]) -> str:
    return "too few for a test" if test["p"] is None else f"p = {test['p']:.2g}"


def _chances(tests: Mapping[str, Any]) -> list[str]:
    """The unpaired tests, and how they would come out by chance."""
    lines = []
    for column, name in zip(COLUMNS, ("position", "speed"), strict=True):
        values = tests[column]
        line = f"  {tests['first']} against {tests['second']} in {name}, unpaired: "
        line += f"halves of the trials {_p_of(values['halves'])}"
        if "31_and_36" in values:
            better, significantly = (
                f"{100 * values[key]['share']:.0f} %" for key in ("fuzzy_better", "significantly")
            )
            line += (
                f", 31 and 36 of them {_p_of(values['31_and_36'])}; in {values['fuzzy_better']['n']} "
                f"such draws fuzzy is better in {better}, significantly in {significantly}"
            )
        lines.append(line)
    return lines


def _title(gait: str) -> str:
    """The name of a gait's picture."""
    return f"outage_{gait}".replace(" ", "_")


PICTURES = ("outage", *map(_title, (*GAITS, RECORDED)))


@house_style()
def draw(result: Mapping[str, Any]) -> Mapping[str, Figure]:
    """Means of all configurations beside the text's, and a sample trial of the first set for each gait."""
    first = next(iter(result["sets"]))
    groups = {"without a filter": REFERENCES, "our own": tuple(t for t in CONFIGURATIONS if OURS in t)}
    pictures = {"outage": figure_of_means(result["sets"], result["published"]["configurations"], groups)}
    for gait, values in result["sets"][first].items():
        pictures[_title(gait)] = figure_of_trial(
            values["sample"], result["outage_s"], f"set {first}, {gait}, seed 1"
        )
    return pictures
