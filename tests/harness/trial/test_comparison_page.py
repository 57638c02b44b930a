"""The page of two logs has the numbers of both, and what they differ by."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.log.compare import compare
from harness.log.log import Log
from harness.trial.comparison_page import comparison_data, write_comparison
from tests.browser import OpenPage
from tests.harness.trial.logs import COMMANDS, TICKS, trial, with_signal


def shorter(log: Log, ticks: int) -> Log:
    values = {name: rows[:ticks] for name, rows in log.values.items()}
    return replace(log, time=log.time[:ticks], values=values)


def data_of(a: Log, b: Log) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(comparison_data(a, b, compare(a, b))))
    return found


def test_both_logs_and_their_difference_are_there() -> None:
    # given a second dog that is 2 m further east, and whose trial ends four ticks earlier
    a, b = trial(), trial()
    b = shorter(with_signal(b, "plant.east", a["plant.east"] + 2), TICKS - 4)
    signals = data_of(a, b)["signals"]
    # then signals are there of each, B's up to its end
    assert signals["a.plant.east"] == a["plant.east"].tolist()
    assert signals["b.plant.east"][: TICKS - 4] == b["plant.east"].tolist()
    assert np.isnan(signals["b.plant.east"][TICKS - 4 :]).all()
    assert signals["difference.plant.east"][: TICKS - 4] == [2] * (TICKS - 4)
    assert "difference.plant.north" not in signals  # it does not differ
    assert signals["b.controller.command"][: TICKS - 4] == COMMANDS[: TICKS - 4]


def test_angles_differ_by_the_shorter_way_round() -> None:
    a, b = trial(), trial()
    a, b = with_signal(a, "plant.heading", 3.1), with_signal(b, "plant.heading", -3.1)
    for log in (a, b):
        channel = next(c for c in log.channels if c.component == "plant")
        object.__setattr__(channel, "units", ("m", "m", "m/s", "rad"))
    difference = data_of(a, b)["signals"]["difference.plant.heading"]
    assert difference == pytest.approx([2 * np.pi - 6.2] * TICKS, abs=1e-5)


def test_a_log_with_other_ticks_holds_its_values_between_them() -> None:
    # given a log of every third tick
    a, b = trial(), trial()
    values = {name: rows[::3] for name, rows in b.values.items()}
    b = with_signal(replace(b, time=b.time[::3], values=values), "plant.north", np.arange(5.0) * 10)
    signals = data_of(a, b)["signals"]
    assert signals["b.plant.north"][:7] == [0, 0, 0, 10, 10, 10, 20]
    # differences are those of the ticks that both have
    assert signals["difference.plant.north"][:7] == [0, 0, 0, 7, 7, 7, 14]


def test_the_page_shows_both_in_a_browser(tmp_path: Path, open_page: OpenPage) -> None:
    a, b = trial(), trial()
    b = shorter(with_signal(b, "plant.east", a["plant.east"] + 2), TICKS - 4)
    path = tmp_path / "both.html"
    write_comparison(a, b, compare(a, b), path)
    visit = open_page(path.as_uri())
    assert (visit.errors, visit.requests) == ([], [path.as_uri()])
    text = visit.page.inner_text("body")
    assert "Differ 1 of " in text
    assert "plant.east" in text
    assert "B: command FORWARD" in text
    # when time is moved to a command of B
    visit.page.get_by_role("button", name="0:05.00").first.click()
    heads = visit.page.locator(".plot-head").all_inner_texts()
    assert any(head.startswith("plant.east, B - A") and head.endswith("B - A 2") for head in heads)
    # then both strips have blocks, B's up to its end
    rows = visit.page.locator(".strip-row")
    assert rows.count() == 2
    assert rows.nth(0).locator(".strip-block").count() > rows.nth(1).locator(".strip-block").count() > 0
    assert visit.page.locator(".animal").count() == 2
    assert visit.harm() == []


def test_logs_that_agree_say_so(tmp_path: Path) -> None:
    path = tmp_path / "same.html"
    write_comparison(trial(), trial(), compare(trial(), trial()), path)
    page = path.read_text()
    assert ">Agree</strong>" in page
    assert "0 of " in page
