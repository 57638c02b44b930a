"""An estimator before and after tuning, on the part of a recording that the tuning has not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from codegen.batch.series import Series
from harness.replay.comparison import HELD, hold_speed
from harness.replay.replay import COLUMNS, paired_t_test
from harness.replay.source import ReplaySource
from harness.replay.windows import Window
from harness.studies.innovations import Innovations, autocorrelation, mean_bounds
from harness.tune.likelihood import inputs_of
from models.estimator import Estimator

Array = npt.NDArray[np.float64]

LAGS = 20  # fixes


@dataclass(frozen=True)
class Errors:
    """Errors at the last withheld fix of each outage, (outages,) each: position [m] and speed [m/s]."""

    position: Array
    speed: Array


def outage_errors(
    source: ReplaySource,
    block: type[Estimator],
    ways: Mapping[str, Mapping[str, float]],
    windows: Sequence[Window],
) -> dict[str, Errors]:
    """Errors of an estimator with several sets of parameters, and of `speed held`, in the same outages."""
    title = block.title()
    series = Series(block, observe=[f"{title}.{name}" for name in ("north", "east", "speed")])
    errors: dict[str, list[tuple[float, float]]] = {HELD: [], **{name: [] for name in ways}}
    for window in windows:
        signals = source.signals([window])
        within = (signals.t >= window[0]) & (signals.t <= window[1])
        last = int(np.flatnonzero(within & signals.reference_fix)[-1])
        runs = {HELD: hold_speed(signals, last + 1)}
        inputs = {name: values[: last + 1] for name, values in inputs_of(block, signals).items()}
        for name, parameters in ways.items():
            run = series.run(inputs, {title: parameters})
            runs[name] = {key.removeprefix(f"{title}."): values for key, values in run.items()}
        for name, run in runs.items():
            off = [
                run[key][last] - getattr(signals, f"reference_{key}")[last]
                for key in ("north", "east", "speed")
            ]
            errors[name].append((float(np.hypot(off[0], off[1])), float(abs(off[2]))))
    return {name: Errors(*np.array(values).T) for name, values in errors.items()}


def summary_of(innovations: Innovations) -> dict[str, Any]:
    """NIS with the bounds of its mean, each value's share of it, log-likelihood and whiteness."""
    number = len(innovations.time)
    low, high = mean_bounds(innovations.freedom, number)
    return {
        "fixes": number,
        "nis": float(innovations.nis.mean()),
        "nis_expected": innovations.freedom,
        "nis_bounds": [low, high],
        "nis_by_value": [
            float(squared.sum() / max(1, used))
            for squared, used in zip((innovations.whitened**2).T, innovations.used.sum(axis=0), strict=True)
        ],
        "log_likelihood_per_fix": float(innovations.log_likelihood.mean()),
        "autocorrelation": autocorrelation(innovations.whitened, LAGS).tolist(),
        "autocorrelation_bound": float(stats.norm.ppf(0.975) / np.sqrt(innovations.used.sum())),
    }


def compare_errors(
    errors: Mapping[str, Errors], apart: Sequence[int], first: str, second: str
) -> dict[str, Any]:
    """Means and medians of the errors, and a paired t-test over the outages that do not overlap."""
    result: dict[str, Any] = {"ways": {}, "apart": len(apart)}
    for name, values in errors.items():
        result["ways"][name] = {
            column: {"mean": float(v.mean()), "median": float(np.median(v)), "each": v.tolist()}
            for column, v in zip(COLUMNS, (values.position, values.speed), strict=True)
        }
    for column, attribute in zip(COLUMNS, ("position", "speed"), strict=True):
        one, other = (getattr(errors[name], attribute)[list(apart)] for name in (first, second))
        test = paired_t_test(one - other) if len(apart) > 2 else None
        result[f"{column}_p"] = None if test is None else float(test.pvalue)
    return result
