"""How often each estimator leads the simulated dog."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from harness.report.figures import charts_of
from harness.studies import leading
from harness.studies.study import Options, run_study
from harness.sweep import sweep
from models.system import ESTIMATORS


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    some = {name: ESTIMATORS[name] for name in ("four_state", "six_state", "seven_state")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(leading, "ESTIMATORS", some)  # each is compiled, twice
        return run_study("leading", Options(seeds=100))


def rate(result: dict[str, Any], estimator: str, attitude: str = leading.RECORDED) -> dict[str, Any]:
    (row,) = (r for r in result["rows"] if (r["estimator"], r["attitude"]) == (estimator, attitude))
    return dict(row)


def test_the_shares_are_those_of_the_sweep_that_the_table_names(
    result: dict[str, Any], tmp_path: Path
) -> None:
    planned = sweep.plan_sweep(
        "three", thresholds="49", trials=100, system="full", estimator="seven_state", ahrs=True
    )
    ((point,), _) = sweep.run(planned, tmp_path)
    ours = rate(result, "seven_state", leading.OWN)
    assert (ours["share"], ours["n"]) == (point.success_rate, 100)
    assert (ours["low"], ours["high"]) == pytest.approx(point.interval)


def test_six_and_seven_states_lead_badly_and_six_do_not_notice_the_ahrs(result: dict[str, Any]) -> None:
    four, six = rate(result, "four_state"), rate(result, "six_state")
    assert six["high"] < four["low"]
    assert rate(result, "seven_state")["share"] < four["share"]
    assert rate(result, "six_state", leading.OWN) == {**six, "attitude": leading.OWN}
    assert result["true_state"]["share"] > 0.5


def test_table_and_picture_show_each_estimator(result: dict[str, Any]) -> None:
    text = io.StringIO()
    leading.show(result, Console(file=text, width=170))
    lines = text.getvalue().splitlines()
    six = rate(result, "six_state")
    (line,) = (line for line in lines if line.startswith("six_state"))
    rate_and_interval = (f"{100 * six[key]:.1f}" for key in ("share", "low", "high"))
    assert re.findall(r"[\d.]+", line)[:3] == list(rate_and_interval)
    assert any(line.startswith("none: the true state") for line in lines)
    (figure,) = leading.draw(result).values()
    assert all(chart["marks"] for grid in charts_of(figure) for chart in grid)
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()][:2] == ["four_state", "six_state"]
