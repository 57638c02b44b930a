"""A planned route, led to its end: from a map to a mission to a vest, through the bytes of the radio."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from harness.log.log import FILE, read_log
from harness.routes.map_file import load
from tests.harness.command import canine
from tests.harness.routes.maps import box, mark, polygon, write
from tests.harness.station.dogs import obedient


def test_a_planned_route_is_led_round_the_building_and_home(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a hut between home and a goal 35 m away, and a dog that obeys
    hut = polygon("hut", box(-3, 14, 6, 20))
    path = write(tmp_path, hut, mark("goal", 0, 35), origin=[-85.4877, 32.6062])
    dog, patience = obedient(tmp_path), '"watchdog.link_timeout" = 40.0\n'
    dog.write_text(dog.read_text().replace(patience, ""))  # of the vest, which a plan does without
    # when a route is planned with it, and the station leads the mission
    plan = ("plan", path, "--from", "0,0", "--to", "goal", "--scenario", dog, "--reading", "guarded")
    status, _, error = canine(capsys, *plan, "--trials", 64, "--out", tmp_path / "plan")
    assert status == 0, error
    route = tmp_path / "plan" / "route.toml"
    route.write_text(route.read_text() + patience)
    status, printed, error = canine(
        capsys, "station", "--simulate", route, "--headless", "--start", "--json",
        "--mission", tmp_path / "plan" / "mission.geojson", "--speed", 8, "--out", tmp_path / "led",
    )  # fmt: skip
    # then it reaches the end and comes home, and enters nothing on the way out
    assert status == 0, error
    routes = json.loads((tmp_path / "plan" / "routes.json").read_text())
    chosen = routes["routes"][routes["recommended"] - 1]
    assert chosen["success_rate"] > 0.95
    summary = json.loads(printed)
    assert (summary["outcome"], summary["waypoints_reached"]) == ("success", len(chosen["waypoints"])), error
    log, map_file = read_log(tmp_path / "led" / FILE), load(path)
    out = log["telemetry.waypoint"] < len(chosen["waypoints"])
    north, east = log["estimator.north"][out], log["estimator.east"][out]
    site = map_file.site((0.0, 0.0))
    assert np.nanmax(north) > 25
    places = [place for place in zip(north, east, strict=True) if not np.isnan(place).any()]
    assert not [place for place in places if site.area_at(place)]
