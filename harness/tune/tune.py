"""Tune an estimator on the first half of a recording, and judge it on the second."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from harness.recording.recording import RecordingError
from harness.replay.comparison import Comparison, Configuration, compare, refused_fixes
from harness.replay.replay import replay
from harness.replay.source import ReplaySource
from harness.replay.windows import SETTLE
from harness.studies.published import OUTAGE_S
from harness.tune.fit import LEVEL, Fit
from harness.tune.judge import compare_errors, doubts, summary_of
from harness.tune.likelihood import Filter, Tuned
from models.estimator import Estimator

FIXES = 40  # in either half, at least: 10 s at 4 Hz
EVERY_S = 5.0
BEFORE, CONSTANT, AFTER = "as declared", "fuzzy off", "tuned"


def tune(
    source: ReplaySource,
    block: type[Estimator],
    held: Sequence[str] = (),
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """The content of tune.json.

    Args:
        held: names of noises that stay as declared.
        progress: called with the percentage that is done.

    Raises:
        RecordingError: a half of the recording has too few fixes, or it lacks a sensor of the estimator.
        UsageError: a noise that is held does not exist, or all are held.
    """
    compare(block.title()).usable(source)
    signals = source.signals([])
    fixes = signals.t[signals.gps_fix]
    start = float(fixes[0] + SETTLE) if len(fixes) else 0.0
    middle = float((start + fixes[-1]) / 2) if len(fixes) else 0.0
    ekf = Filter(block, signals)
    taken = ekf.innovations({}).time
    for half, number in (
        ("first", int(((taken >= start) & (taken < middle)).sum())),
        ("second", int((taken >= middle).sum())),
    ):
        if number < FIXES:
            refused = refused_fixes(block.title(), signals)
            raise RecordingError(
                f"{source.name}: too short to tune by: {number} fixes in its {half} half after the first "
                f"{SETTLE:g} s; expected at least {FIXES} in each; {refused or 'record longer'}"
            )
    tuned = Tuned(block, signals, held)
    fit = Fit(ekf, tuned, start, middle, progress)
    # what tuning switches off is a way of its own: a better noise is not its doing
    ways = {BEFORE: {}, **({CONSTANT: tuned.fixed} if tuned.fixed else {}), AFTER: fit.parameters}
    innovations = {name: ekf.innovations(parameters) for name, parameters in ways.items()}
    chosen = source.outages(OUTAGE_S, EVERY_S)
    windows = [window for window in chosen.windows if window[0] >= middle]
    judged = {name: summary_of(values.between(middle, np.inf)) for name, values in innovations.items()}
    result: dict[str, Any] = {
        "recording": source.name,
        "estimator": block.title(),
        "held": list(held),
        "fitted_on_s": [start, middle],
        "judged_on_s": [middle, float(fixes[-1])],
        "fixes": fit.fixes,
        "log_likelihood": fit.log_likelihood,
        "level": LEVEL,
        "noises": [
            {
                "name": noise.name,
                "unit": noise.unit,
                "before": noise.before,
                "in_force_before": noise.name not in tuned.idle,
                "value": fitted.value,
                "interval": [fitted.low, fitted.high if np.isfinite(fitted.high) else None],
                "profile": [[value, loss] for value, loss in fitted.profile.items()],
            }
            for noise, fitted in zip(tuned.noises, fit.noises, strict=True)
        ],
        "parameters": fit.parameters,
        "ways": {name: dict(parameters) for name, parameters in ways.items()},
        "settled": fit.settled,
        "judged": judged,
        "doubts": doubts(judged, AFTER),
        "nis": {
            name: {"time_s": values.time.tolist(), "nis": values.nis.tolist()}
            for name, values in innovations.items()
        },
        "outage_s": OUTAGE_S,
        "outages": None,
        "dropped": dict(source.dropped),
        "notes": list(source.notes),
    }
    if windows:
        configurations = tuple(Configuration(name, block.title(), values) for name, values in ways.items())
        comparison = Comparison((block.title(),), (), configurations)
        try:
            replayed = replay(source, comparison, replace(chosen, windows=windows))
        except RecordingError as reason:
            result["notes"] += [str(reason)]
            return result
        result["notes"] += replayed.notes
        if all(name in replayed.outages[0].errors for name in ways):
            result["outages"] = {"starts_s": [outage.start for outage in replayed.outages]} | compare_errors(
                replayed.outages, [name for name in ways if name != AFTER], AFTER
            )
    return result
