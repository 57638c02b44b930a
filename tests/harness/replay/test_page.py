"""The page of a replay has the replay's numbers, and answers in a browser."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.recording.signals import SensorSignals
from harness.replay import page
from harness.replay.comparison import HELD
from harness.replay.outage import Estimate, Outage, Replayed
from harness.replay.page import replay_data, replay_page
from tests.browser import DESK, TABLET, OpenPage

TICK = 0.04
TICKS = 1501  # a minute
MOST_BYTES = 250_000  # of the page without its data
NAMES = {HELD: HELD, "fuzzy": "fuzzy *"}


def signals(ticks: int = TICKS) -> SensorSignals:
    """A walk to the north at 1 m/s, with a fix each second."""
    time = np.arange(ticks) * TICK
    values: dict[str, Any] = {name: np.zeros(ticks) for name in SensorSignals.__dataclass_fields__}
    fix = np.arange(ticks) % 25 == 0
    held = np.floor(time + 1e-9)
    values |= {"t": time, "gps_fix": fix, "reference_fix": fix}
    values |= {"reference_north": held, "reference_speed": np.ones(ticks)}
    return SensorSignals(**values)


def estimate(time: np.ndarray[Any, Any], off: float) -> Estimate:
    """So far east of the walk."""
    return Estimate(time.copy(), np.full(len(time), off), np.full(len(time), 1.5))


def outage(start: float, errors: tuple[float, float]) -> Outage:
    """10 s, in which both configurations are off as they are at its end."""
    time = np.asarray(np.arange(round(start / TICK), round((start + 10) / TICK) + 1) * TICK, np.float64)
    named = dict(zip(NAMES, errors, strict=True))
    return Outage(
        start, start + 10, 10.0, {name: (error, 0.5) for name, error in named.items()},
        {name: estimate(time, error) for name, error in named.items()}, time,
    )  # fmt: skip


def replayed() -> Replayed:
    """Three outages, of which the second overlaps the first; with fixes the estimates are 0.1 m off."""
    outages = [outage(10, (3, 4)), outage(15, (5, 6)), outage(30, (7, 8))]
    before = np.arange(round(30 / TICK)) * TICK
    return Replayed(outages, {}, [], with_fixes={name: estimate(before, 0.1) for name in NAMES})


def test_in_an_outage_the_error_is_that_without_fixes_and_before_it_that_with_them() -> None:
    data = replay_data(signals(), replayed(), NAMES)
    time, error = np.array(data["time"]), np.array(data["signals"]["1.error"], dtype=float)
    # then by hand: 0.1 m with fixes, 4 m in the first outage, 8 m in the last, nothing after it
    assert error[time < 9.9] == pytest.approx(0.1)
    assert error[(time > 10.1) & (time < 19.9)] == pytest.approx(4)
    assert error[(time > 20.1) & (time < 29.9)] == pytest.approx(0.1)
    assert error[(time > 30.1) & (time < 39.9)] == pytest.approx(8)
    assert np.isnan(error[time > 40.1]).all()
    # and no line leads into an outage, or back
    assert np.isnan(error[np.isin(time, [10.0, 20.04, 30.0])]).all()


def test_outages_that_overlap_are_dots_and_no_bands() -> None:
    data = replay_data(signals(), replayed(), NAMES)
    assert [(band["from"], band["until"]) for band in data["bands"]] == [(10, 20), (30, 40)]
    ends = np.array(data["signals"]["0.end"], dtype=float)
    time = np.array(data["time"])
    assert dict(zip(time[~np.isnan(ends)], ends[~np.isnan(ends)], strict=True)) == {20: 3, 25: 5, 40: 7}
    assert data["events"] == [20, 25, 40]


def test_between_two_fixes_the_reference_is_on_a_line_and_in_a_hole_it_is_nowhere() -> None:
    # given fixes that are missing for 10 s
    walk = signals()
    seen = walk.reference_fix & ~((walk.t > 45) & (walk.t < 55))
    data = replay_data(replace(walk, reference_fix=seen), replayed(), NAMES)
    north, time = np.array(data["signals"]["reference.north"], dtype=float), np.array(data["time"])
    assert north[time == 12.48] == pytest.approx(12.48)
    assert np.isnan(north[(time > 45.1) & (time < 54.9)]).all()


def test_a_long_recording_is_thinned_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    # given room for some 300 of 1501 ticks, and a peak of one tick in an outage
    monkeypatch.setattr(page, "MOST_VALUES", 4000)
    of = replayed()
    of.outages[0].estimates["fuzzy"].east[77] = 50.0
    data = replay_data(signals(), of, NAMES)
    assert data["thinned"] == {"shown": len(data["time"]), "ticks": TICKS}
    assert len(data["time"]) < 400
    assert np.nanmax(np.array(data["signals"]["1.error"], dtype=float)) == pytest.approx(50)


def written(folder: Path, of: Replayed | None = None, names: dict[str, str] = NAMES) -> tuple[str, str]:
    """The address of a page, and its text."""
    path = folder / "replay.html"
    content = replay_page(
        signals(), of or replayed(), names, lambda console: console.print("a table", markup=False),
        title="<walk>", sentence="3 outages", notes=["a <note>"],
    )  # fmt: skip
    path.write_bytes(content)
    return path.as_uri(), content.decode()


def test_the_page_is_small_and_its_names_are_text(tmp_path: Path) -> None:
    _, text = written(tmp_path)
    data = re.search(r'id="data">(.*?)</script>', text)
    assert data
    assert len(text) - len(data[1]) < MOST_BYTES
    assert json.loads(data[1])["tracks"][1]["label"] == "fuzzy *"
    assert "&lt;walk&gt;" in text
    assert "a &lt;note&gt;" in text
    assert "bands are those of the outages that do not overlap" in text


def test_a_row_of_the_table_moves_the_cursor_and_panels_tell_the_errors(
    tmp_path: Path, open_page: OpenPage
) -> None:
    address, _ = written(tmp_path)
    visit = open_page(address)
    # when the end of the second outage is chosen, then the dots of that outage are read
    visit.page.get_by_role("button", name="0:25.00").click()
    panel = visit.page.locator(".plot", has_text="at the end of each outage")
    assert "speed held 5.00 m" in panel.inner_text()
    assert "fuzzy * 6.00 m" in panel.inner_text()
    assert "0:25.00" in visit.page.locator("tr.now").inner_text()
    assert visit.errors == []
    assert visit.requests == [address]


def test_a_name_hides_and_shows_its_lines(tmp_path: Path, open_page: OpenPage) -> None:
    address, _ = written(tmp_path)
    page = open_page(address).page
    fuzzy = page.locator("#legend").get_by_role("button", name="fuzzy *")
    assert fuzzy.get_attribute("aria-pressed") == "true"
    assert page.locator("path.track.series-2").count() > 0
    fuzzy.click()
    assert fuzzy.get_attribute("aria-pressed") == "false"
    assert page.locator("path.track.series-2").count() == 0
    assert page.locator(".reading:visible", has_text="fuzzy").count() == 0
    assert page.locator(".reading:visible", has_text="speed held").count() == 3
    fuzzy.click()
    assert page.locator("path.track.series-2").count() > 0


def test_of_many_configurations_the_best_are_shown_at_first(tmp_path: Path) -> None:
    # given ten, each worse than the one before it, and the speed held, worst of all
    names = {f"way {number}": f"way {number}" for number in range(10)} | {HELD: HELD}
    errors = {name: (float(number), 0.0) for number, name in enumerate(names)}
    first = replayed().outages[0]
    of = replace(first, errors=errors, estimates=dict.fromkeys(names, first.estimates["fuzzy"]))
    whole = dict.fromkeys(names, replayed().with_fixes["fuzzy"])
    data = replay_data(signals(), Replayed([of], {}, [], with_fixes=whole), names)
    shown = [track["label"] for track in data["tracks"] if track.get("shown")]
    assert shown == [*(f"way {number}" for number in range(6)), HELD]


def test_a_place_of_the_path_that_is_pointed_at_moves_the_cursor(tmp_path: Path, open_page: OpenPage) -> None:
    # given the walk of 60 m to the north; when its middle is pointed at
    address, _ = written(tmp_path)
    page = open_page(address).page
    box = page.locator("path.track:not(.series-1):not(.series-2)").bounding_box()
    assert box
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    shown = page.locator(".playback output").inner_text()
    assert float(shown.split()[0].removeprefix("0:")) == pytest.approx(30, abs=1)


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESK, TABLET])
def test_the_page_keeps_nobody_out(
    tmp_path: Path, open_page: OpenPage, size: tuple[int, int], theme: str
) -> None:
    visit = open_page(written(tmp_path)[0], size, theme)
    assert visit.harm() == []
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= size[0]
    assert visit.errors == []
