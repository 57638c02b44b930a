"""The parts of the pages: the libraries are whole and licensed, and what is inlined keeps its meaning."""

import base64
import hashlib
import re
from pathlib import Path

import pytest

from harness.report.inline import LIBRARIES, PARTS, SCRIPTS, STYLES, policy, script, style
from harness.report.times import clock
from tests.browser import OpenPage

OURS = ["canine.js", "map.js", "plots.js", "strip.js", "answer.js", "points.js", "charts.js", "live.js"]
OF_PAGES = {  # of pages from logs alone
    "answer.js", "points.js", "charts.js", "live.js", "page.css", "charts.css", "points.css", "series.css",
}  # fmt: skip
PUBLISHED = {  # SHA-256 of the files in the packages that npm serves
    "leaflet-1.9.4/leaflet.js": "db49d009c841f5ca34a888c96511ae936fd9f5533e90d8b2c4d57596f4e5641a",
    "leaflet-1.9.4/leaflet.css": "a7837102824184820dfa198d1ebcd109ff6d0ff9a2672a074b9a1b4d147d04c6",
    "leaflet-1.9.4/LICENSE": "53e8dc25862014e4324741ca18fbe3611e11d42ef69f59f86ea8c5389647d4cb",
    "uplot-1.6.32/uPlot.iife.min.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    "uplot-1.6.32/uPlot.min.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
    "uplot-1.6.32/LICENSE": "8f989229699b4fe2f1a0432d0e9edc338a8a911e250e2d1b01ecd770a5f5b1bd",
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_libraries_are_as_they_were_published(name: str) -> None:
    assert hashlib.sha256((PARTS / name).read_bytes()).hexdigest() == PUBLISHED[name]


def test_the_libraries_are_all_that_is_not_ours() -> None:
    folders = {path.name for path in PARTS.iterdir() if path.is_dir()}
    files = {str(path.relative_to(PARTS)) for folder in folders for path in (PARTS / folder).iterdir()}
    assert files == set(PUBLISHED)
    assert {*SCRIPTS, *STYLES, *OF_PAGES} == {
        str(path.relative_to(PARTS)) for path in PARTS.rglob("*") if path.suffix in (".js", ".css")
    }


@pytest.mark.parametrize("name", OURS)
def test_our_scripts_make_no_html_and_no_code_of_text(name: str) -> None:
    text = (PARTS / name).read_text()
    assert not re.search(
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function|on\w+=\"", text
    )
    assert "fetch(" not in text
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text)


@pytest.mark.parametrize("name", OURS)
def test_no_literal_of_our_scripts_goes_over_several_lines(name: str) -> None:
    lines = (PARTS / name).read_text().splitlines()
    assert [line for line in lines if line.count("`") % 2] == []


def test_an_inlined_script_has_its_statements_and_no_comments() -> None:
    assert script("map.js").startswith('(function(){"use strict";const canine=(window.canine=')
    assert " // " not in script("map.js")
    assert "an animal that stands still" in (PARTS / "map.js").read_text()
    assert "an animal that stands still" not in script("map.js")
    assert '" of "' in script("canine.js")  # blanks in texts mean something
    assert "sourceMappingURL" not in script(LIBRARIES[0])
    assert script(LIBRARIES[0]).startswith("/* @preserve\n * Leaflet 1.9.4")


def test_an_inlined_style_asks_for_no_file() -> None:
    for name in STYLES:
        assert "url(" not in style(name).replace("url(#default#VML)", "")
    # and of a rule those selectors stay that something is drawn for, without what old browsers needed
    assert style(STYLES[0]).startswith(".leaflet-pane,.leaflet-marker-icon,.leaflet-pane > svg,")
    assert not re.search("popup|leaflet-tile|-webkit-transition|!important|font-family", style(STYLES[0]))
    assert ".leaflet-dragging .leaflet-grab{cursor:grabbing}" in style(STYLES[0])  # not move, then grabbing


def test_the_policy_names_each_script_and_style_by_its_hash() -> None:
    digest = base64.b64encode(hashlib.sha256(b"let x = 1;").digest()).decode()
    assert policy(["let x = 1;"], ["p{}"]).split("; ")[:2] == [
        "default-src 'none'",
        f"script-src 'sha256-{digest}'",
    ]


PAGE = """<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>parts</title>
<meta http-equiv="Content-Security-Policy" content="{policy}"><style>{style}</style></head>
<body><main><h1>parts</h1><div id="map"></div><div id="strip"></div><div id="plots"></div></main>
{scripts}</body></html>"""
DRAW = """
const times = [0, 1, 2, 3, 4], commands = ["NONE", "FORWARD", "FORWARD", "LEFT", "STOP"];
window.timeline = canine.timeline(0, 4);
const of = (id) => document.getElementById(id);
window.map = canine.map(of("map"));
map.mission({ waypoints: [[40, 0]], home: [0, 0], radius: 5 });
map.track("").set([[0, 0], [10, 0], [20, 1], null, [40, 0]], commands);
map.fit();
canine.strip(of("strip"), timeline).set({ command: canine.commandBlocks(times, commands) });
const plots = canine.plots(of("plots"), timeline);
const series = [{ label: "h", colour: "truth" }];
const panel = plots.add({ title: "deviation", unit: "rad", turn: 2 * Math.PI, series });
panel.set(times, [[0, 0.5, 1, null, -Math.PI / 2]]);
window.shown = () => ({
  reading: document.querySelector(".reading .number").textContent,
  cursors: [...document.querySelectorAll(".time-cursor")].map((cursor) => parseFloat(cursor.style.left)),
  blocks: [...document.querySelectorAll(".strip-block")].map((b) => [b.title, parseFloat(b.style.width)]),
  drawn: panel.u.data[1], tracks: document.querySelectorAll("path.track").length,
});
"""


@pytest.fixture
def parts_page(tmp_path: Path) -> str:
    scripts = [*(script(name) for name in SCRIPTS), DRAW]
    sheet = "".join(style(name) for name in STYLES)
    body = "".join(f"<script>{text}</script>" for text in scripts)
    page = tmp_path / "parts.html"
    page.write_text(PAGE.format(policy=policy(scripts, [sheet]), style=sheet, scripts=body))
    return page.as_uri()


def test_all_parts_show_the_time_of_the_cursor(parts_page: str, open_page: OpenPage) -> None:
    # given a page of a map, a strip and a plot; when time moves to the second row
    visit = open_page(parts_page)
    visit.page.evaluate("timeline.move(1.5)")
    shown = visit.page.evaluate("shown()")
    # then the plot reads that row (0.5 rad), and both cursors stand at 1.5 s of 4 s
    assert shown["reading"] == "28.6 deg"
    assert shown["cursors"] == [37.5, 37.5]
    assert shown["drawn"] == pytest.approx([0, 28.648, 57.296, None, -90], abs=1e-3)
    # and commands are blocks from their first row to the next command's
    assert shown["blocks"] == [
        ["NONE from 0:00.00 to 0:01.00", 25],
        ["FORWARD from 0:01.00 to 0:03.00", 50],
        ["LEFT from 0:03.00 to 0:04.00", 25],
    ]
    assert shown["tracks"] == 2  # the two stretches that have places at both ends
    assert visit.errors == []
    assert visit.requests == [parts_page]


def test_zooming_is_common_and_stays_within_the_trial(parts_page: str, open_page: OpenPage) -> None:
    visit = open_page(parts_page)
    visit.page.evaluate("timeline.move(3); timeline.zoom(0.5)")
    assert visit.page.evaluate("timeline.shown") == [1.5, 3.5]
    assert visit.page.evaluate("shown().cursors") == [75, 75]
    visit.page.evaluate("timeline.move(4)")  # beyond what is shown
    assert visit.page.evaluate("timeline.shown") == [2, 4]
    visit.page.evaluate("timeline.zoom(Infinity)")
    assert visit.page.evaluate("timeline.shown") == [0, 4]


def test_time_that_goes_on_takes_the_cursor_along(parts_page: str, open_page: OpenPage) -> None:
    page = open_page(parts_page).page
    page.evaluate("timeline.move(4); timeline.extend(5)")
    assert page.evaluate("[timeline.time, ...timeline.shown]") == [5, 0, 5]
    page.evaluate("timeline.show(3, 5); timeline.move(4); timeline.extend(6)")
    assert page.evaluate("[timeline.time, ...timeline.shown]") == [4, 4, 6]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0:00.00"),
        (12.345, "0:12.35"),
        (59.994, "0:59.99"),
        (59.996, "1:00.00"),
        (187.5, "3:07.50"),
        (3599.996, "1:00:00.00"),
        (3723.9, "1:02:03.90"),
        (None, "\u2013"),
    ],
)
def test_times_read_as_clocks_do(parts_page: str, open_page: OpenPage, seconds: float, text: str) -> None:
    assert open_page(parts_page).page.evaluate("(s) => canine.clock(s)", seconds) == text
    assert seconds is None or clock(seconds) == text


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_parts_keep_nobody_out(parts_page: str, open_page: OpenPage, theme: str) -> None:
    assert open_page(parts_page, theme=theme).harm() == []
