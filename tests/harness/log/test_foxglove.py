"""What viewers draw: positions, frames, the route and events, as mcap's and protobuf's readers see them."""

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from harness.log.channel import Channel
from harness.log.container import Container
from harness.log.foxglove import Views
from harness.log.ground import Ground
from harness.log.route import Route
from harness.log.writer import LogWriter

PLANT = ("command", "north", "east", "heading")
SENSORS = ("gps_fix", "gps_north", "gps_east", "gps_h_acc")
CONTROLLER = ("command", "status", "waypoint", "anomaly")
TICK = 40_000_000  # ns
INFO, WARNING, ERROR = 2, 3, 4  # foxglove.Log's levels
HALF = math.sqrt(0.5)
MISSION = {
    "controller.waypoint_count": "2",
    "controller.waypoint_north[1]": "25.0",
    "controller.waypoint_east[1]": "-3.0",
    "controller.waypoint_north[2]": "50.0",
    "controller.waypoint_east[2]": "4.0",
    "controller.waypoint_north[3]": "99.0",
    "controller.waypoint_east[3]": "99.0",
    "controller.home_north": "1.0",
    "controller.home_east": "2.0",
    "controller.capture_radius": "7.0",
}
Rows = Sequence[Sequence[float]]
Shown = dict[str, list[tuple[int, Any]]]


def shown(
    signals: Mapping[str, Sequence[str]],
    rows: Mapping[str, Rows],
    *,
    origin: tuple[float, float] = (0.0, 0.0),
    route: Route | None = None,
    batch: int = 25,
    step: int = TICK,
    receiver: str = "sensors",
    ground: Ground | None = None,
) -> Shown:
    """What a viewer gets of ticks from t = 0: by topic the time in ns and the message."""
    file = io.BytesIO()
    container = Container(file, "test")
    views = Views(container, signals, origin, route, receiver=receiver, ground=ground)
    values = {name: np.array(ticks, dtype=float) for name, ticks in rows.items()}
    times = np.arange(len(next(iter(values.values()))), dtype=np.int64) * step
    for start in range(0, len(times), batch):
        part = slice(start, start + batch)
        messages = views.encode(times[part], {name: ticks[part] for name, ticks in values.items()})
        channels, at = [channel for channel, _, _ in messages], [time for _, time, _ in messages]
        container.add_messages(channels, at, [data for _, _, data in messages])
    container.finish()
    file.seek(0)
    topics: Shown = {}
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    for _, channel, message, decoded in reader.iter_decoded_messages():
        topics.setdefault(channel.topic, []).append((message.log_time, decoded))
    return topics


# positions


@pytest.mark.parametrize(
    ("latitude", "north", "east"),
    # m per degree of latitude and of longitude: the tables of WGS 84
    [(0.0, 110_574.3, 111_319.5), (30.0, 110_852.4, 96_486.2), (60.0, 111_412.3, 55_800.0)],
)
def test_a_degree_north_and_east_is_as_long_as_in_the_tables(
    latitude: float, north: float, east: float
) -> None:
    # given a dog a thousandth of a degree north and two thousandths west of the origin
    rows = [[0.0, north / 1000, -east / 500, 0.0]]
    [(_, fix)] = shown({"plant": PLANT}, {"plant": rows}, origin=(latitude, -85.5))["/map/truth"]
    # then
    assert fix.latitude - latitude == pytest.approx(0.001, rel=1e-5)
    assert fix.longitude + 85.5 == pytest.approx(-0.002, rel=1e-5)
    assert fix.frame_id == "map"
    assert list(fix.position_covariance) == []


@pytest.mark.parametrize(
    ("origin", "place", "expected"),  # deg; north, east [m]; deg
    [
        ((0.0, 179.9999), (0.0, 22.2639), (0.0, -179.9999)),
        ((0.0, -179.9999), (0.0, -22.2639), (0.0, 179.9999)),
        ((-30.0, 179.9999), (0.0, 19.2972), (-30.0, -179.9999)),
        ((89.999, 40.0), (335.0819, 0.0), (89.998, -140.0)),
        ((-89.999, -40.0), (-335.0819, 0.0), (-89.998, 140.0)),
    ],
)
def test_a_map_shows_no_longitude_beyond_180_deg_and_no_latitude_beyond_a_pole(
    origin: tuple[float, float], place: tuple[float, float], expected: tuple[float, float]
) -> None:
    [(_, fix)] = shown({"plant": PLANT}, {"plant": [[0.0, *place, 0.0]]}, origin=origin)["/map/truth"]
    assert (fix.latitude, fix.longitude) == pytest.approx(expected, abs=1e-7)


def test_a_position_is_shown_five_times_a_second() -> None:
    rows = [[0.0, k / 10, 0.0, 0.0] for k in range(51)]  # 2 s
    topics = shown({"plant": PLANT}, {"plant": rows})
    times = [time / 1e9 for time, _ in topics["/map/truth"]]
    assert times == [0, 0.2, 0.4, 0.6, 0.8, 1, 1.2, 1.4, 1.6, 1.8, 2]
    assert times == [time / 1e9 for time, _ in topics["/3d/frames"]]
    assert [(fix.timestamp.seconds, fix.timestamp.nanos) for _, fix in topics["/map/truth"]][4:7] == [
        (0, 800_000_000), (1, 0), (1, 200_000_000)
    ]  # fmt: skip


def test_ticks_longer_than_the_period_are_all_shown() -> None:
    rows = [[0.0, k, 0.0, 0.0] for k in range(4)]
    times = [time for time, _ in shown({"plant": PLANT}, {"plant": rows}, step=300_000_000)["/map/truth"]]
    assert times == [0, 300_000_000, 600_000_000, 900_000_000]


def test_a_position_that_is_not_finite_is_left_out_of_the_map() -> None:
    rows = [[0.0, math.nan, 0.0, 0.0], [0.0, 0.0, math.inf, 0.0], [0.0, 1.0, 2.0, 0.0]]
    assert [time for time, _ in shown({"plant": PLANT}, {"plant": rows}, step=10**9)["/map/truth"]] == [
        2 * 10**9
    ]


def test_the_map_has_every_gps_fix_with_its_accuracy() -> None:
    # given fixes on the first, third and fourth tick; the accuracy is 2 standard deviations (eq. 3.15)
    rows = [[1, 5.0, 5.0, 4.0], [0, 5.0, 5.0, 4.0], [1, 6.0, 5.0, 4.0], [1, 7.0, 5.0, 3.0]]
    fixes = shown({"sensors": SENSORS}, {"sensors": rows})["/map/gps"]
    # then
    assert [time for time, _ in fixes] == [0, 2 * TICK, 3 * TICK]
    assert [list(fix.position_covariance) for _, fix in fixes] == [
        [variance, 0, 0, 0, variance, 0, 0, 0, 0] for variance in (4.0, 4.0, 2.25)
    ]
    assert {fix.position_covariance_type for _, fix in fixes} == {1}  # APPROXIMATED


def test_the_map_has_the_fixes_that_the_estimator_got_where_they_are_others() -> None:
    rows = {"sensors": [[1, 5.0, 5.0, 4.0]] * 2, "estimator": [[0, 9.0, 5.0, 4.0], [1, 9.0, 5.0, 4.0]]}
    names = {"sensors": SENSORS, "estimator": SENSORS}
    ((time, fix),) = shown(names, rows, receiver="estimator")["/map/gps"]
    assert time == TICK
    assert fix.latitude == pytest.approx(9 / 110_574.3, abs=1e-9)


def test_a_gps_without_an_accuracy_has_no_covariance() -> None:
    [(_, fix)] = shown({"sensors": SENSORS[:3]}, {"sensors": [[1, 5.0, 5.0]]})["/map/gps"]
    assert list(fix.position_covariance) == []
    assert fix.position_covariance_type == 0


# frames


@pytest.mark.parametrize(
    ("heading", "z", "w"),
    [
        (0.0, HALF, HALF),  # north: a quarter turn counterclockwise from east
        (90.0, 0.0, 1.0),  # east
        (180.0, -HALF, HALF),  # south: a quarter turn clockwise
        (-90.0, 1.0, 0.0),  # west: half a turn
        (math.nan, 0.0, 1.0),
    ],
)
def test_a_frame_turns_counterclockwise_from_east(heading: float, z: float, w: float) -> None:
    rows = [[0.0, 2.5, -8.0, math.radians(heading)]]
    [(_, frames)] = shown({"plant": PLANT}, {"plant": rows})["/3d/frames"]
    [dog] = frames.transforms
    assert (dog.parent_frame_id, dog.child_frame_id) == ("map", "dog")
    assert (dog.translation.x, dog.translation.y, dog.translation.z) == (-8.0, 2.5, 0.0)
    assert (dog.rotation.x, dog.rotation.y) == (0.0, 0.0)
    assert (dog.rotation.z, dog.rotation.w) == pytest.approx((z, w))


def test_dog_and_estimate_move_together_in_one_message() -> None:
    signals = {"plant": PLANT, "estimator": ("heading", "east", "north")}
    rows: dict[str, Rows] = {
        "plant": [[0.0, k, 2.0 * k, 0.1] for k in range(6)],
        "estimator": [[0.2, 2.5 * k, k + 0.5] for k in range(6)],
    }
    [_, (time, frames)] = shown(signals, rows)["/3d/frames"]
    assert time == 5 * TICK
    assert [(t.child_frame_id, t.translation.x, t.translation.y) for t in frames.transforms] == [
        ("dog", 10.0, 5.0), ("estimate", 12.5, 5.5)
    ]  # fmt: skip
    assert {(t.timestamp.seconds, t.timestamp.nanos) for t in frames.transforms} == {(0, 200_000_000)}


# route


def test_a_route_has_the_waypoints_in_use_and_home_last() -> None:
    assert Route.of(MISSION) == Route(
        (("waypoint 1", 25.0, -3.0), ("waypoint 2", 50.0, 4.0), ("home", 1.0, 2.0)), 7.0
    )


@pytest.mark.parametrize("name", ["waypoint_count", "waypoint_north[1]", "home_east", "capture_radius"])
@pytest.mark.parametrize("value", ["inf", "nan", "<b>"])
def test_a_route_of_which_a_number_is_not_finite_is_none(name: str, value: str) -> None:
    assert Route.of(MISSION | {f"controller.{name}": value}) is None


@pytest.mark.parametrize("missing", ["waypoint_count", "waypoint_east[2]", "home_north", "capture_radius"])
def test_parameters_that_lack_a_part_of_the_route_have_none(missing: str) -> None:
    assert Route.of({name: x for name, x in MISSION.items() if name != f"controller.{missing}"}) is None
    assert Route.of({**MISSION, f"controller.{missing}": "north"}) is None


def test_the_scene_has_places_with_their_circles_once() -> None:
    rows = [[0.0, 0.0, 0.0, 0.0]] * 30
    [(time, scene)] = shown({"plant": PLANT}, {"plant": rows}, route=Route.of(MISSION))["/3d/scene"]
    assert time == 0
    entities = {entity.id: entity for entity in scene.entities}
    assert list(entities) == ["dog", "waypoint 1", "waypoint 2", "home"]
    assert entities["dog"].frame_id == "dog"
    assert entities["dog"].frame_locked
    [circle] = entities["waypoint 2"].lines
    assert (circle.pose.position.x, circle.pose.position.y) == (4.0, 50.0)
    assert (circle.points[0].x, circle.points[0].y) == (7.0, 0.0)
    assert (circle.points[12].x, circle.points[12].y) == pytest.approx((0.0, 7.0))  # a quarter of 48
    assert {round(math.hypot(p.x, p.y), 9) for p in circle.points} == {7.0}
    assert entities["home"].texts[0].text == "home"


FENCED = {**MISSION, "controller.fence_count": "3", "controller.guarded": "1.0"}
FENCED |= {f"controller.fence_north[{i}]": str(x) for i, x in enumerate((-5.0, 60.0, 60.0), start=1)}
FENCED |= {f"controller.fence_east[{i}]": str(x) for i, x in enumerate((-9.0, -9.0, 9.0), start=1)}


def test_rule_7_the_scene_has_the_fence_that_held() -> None:
    route = Route.of(FENCED)
    assert route
    assert route.fence == ((-5.0, -9.0), (60.0, -9.0), (60.0, 9.0))
    rows = [[0.0, 0.0, 0.0, 0.0]] * 30
    [(_, scene)] = shown({"plant": PLANT}, {"plant": rows}, route=route)["/3d/scene"]
    [fence] = [entity for entity in scene.entities if entity.id == "fence"]
    assert [(p.x, p.y) for p in fence.lines[0].points] == [(-9.0, -5.0), (-9.0, 60.0), (9.0, 60.0)]
    assert fence.lines[0].type == fence.lines[0].LINE_LOOP


@pytest.mark.parametrize("lacking", [{"fence_count": "0"}, {"guarded": "0"}, {"fence_east[3]": "?"}])
def test_a_route_whose_fence_does_not_act_has_none(lacking: dict[str, str]) -> None:
    route = Route.of(FENCED | {f"controller.{name}": value for name, value in lacking.items()})
    assert route == Route.of(MISSION)


CROSSING = {
    "plant.street_count": "2",
    "plant.street_north[1]": "0.0", "plant.street_east[1]": "0.0",
    "plant.street_end_north[1]": "30.0", "plant.street_end_east[1]": "0.0",
    "plant.street_half_width[1]": "2.0",
    "plant.street_north[2]": "20.0", "plant.street_east[2]": "-10.0",
    "plant.street_end_north[2]": "20.0", "plant.street_end_east[2]": "15.0",
    "plant.street_half_width[2]": "1.0",
    "plant.pole_count": "1", "plant.pole_north[1]": "25.0", "plant.pole_east[1]": "-3.0",
}  # fmt: skip


def test_the_scene_has_the_streets_and_poles_of_the_simulated_dog() -> None:
    # given two streets of 30 and 25 m with round ends, 2 and 1 m from their middles to the walls, and a pole
    ground = Ground.of(CROSSING)
    rows = [[0.0, 0.0, 0.0, 0.0]] * 30
    [(_, scene)] = shown({"plant": PLANT}, {"plant": rows}, ground=ground)["/3d/scene"]
    entities = {entity.id: entity for entity in scene.entities}
    things = [f"{thing} of the simulated dog" for thing in ("street 1", "street 2", "pole 1")]
    assert list(entities) == ["dog", *things]
    # then each is drawn whole: its triangles, seen from above, have its area
    for number, length, half_width in ((1, 30, 2), (2, 25, 1)):
        [piece] = entities[f"street {number} of the simulated dog"].triangles
        corners = np.array([(p.x, p.y) for p in piece.points])[list(piece.indices)].reshape(-1, 3, 2)
        one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        areas = 0.5 * (one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
        assert (areas > 0).all()
        assert areas.sum() == pytest.approx(2 * length * half_width + math.pi * half_width**2, rel=0.01)
        assert piece.pose.position.z < 0, "under what is drawn on the ground"
    [second] = entities["street 2 of the simulated dog"].triangles
    east, north = zip(*((p.x, p.y) for p in second.points), strict=True)
    assert (min(east), max(east), min(north), max(north)) == pytest.approx((-11, 16, 19, 21))
    [pole] = entities["pole 1 of the simulated dog"].cylinders
    assert (pole.pose.position.x, pole.pose.position.y) == (-3.0, 25.0)
    assert pole.pose.position.z == pole.size.z / 2, "it stands on the ground"


def test_a_mission_that_becomes_known_leaves_the_streets_in_the_scene() -> None:
    container = Container(io.BytesIO(), "test")
    views = Views(container, {"plant": PLANT}, (0.0, 0.0), None, ground=Ground.of(CROSSING))
    views.settle((0.0, 0.0), Route.of(MISSION))
    scene = SceneUpdate.FromString(views.drawing)
    assert {"waypoint 1", "street 2 of the simulated dog"} <= {entity.id for entity in scene.entities}


def test_a_log_has_the_streets_of_its_parameters_in_its_scene(tmp_path: Path) -> None:
    # given a log that is written tick by tick
    blank = ("",) * len(PLANT)
    plant = Channel("plant", "canine_in_streets", PLANT, blank, ("Real",) * len(PLANT), blank)
    path, metadata = tmp_path / "trial.mcap", {"parameters": CROSSING}
    with LogWriter(path, [plant], origin=(0.0, 0.0), metadata=metadata, attachments={}) as log:
        log.write_rows(np.array([0.0]), {"plant": np.zeros((1, len(PLANT)))})
    with path.open("rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages("/3d/scene")
        [(_, _, _, scene)] = messages
    assert "street 2 of the simulated dog" in {entity.id for entity in scene.entities}


@pytest.mark.parametrize("value", ["nan", "inf", "-1", "1e9", "?"])
def test_a_log_that_tells_no_number_of_streets_has_none(value: str) -> None:
    assert Ground.of(CROSSING | {"plant.street_count": value, "plant.pole_count": "0"}) is None


@pytest.mark.parametrize("name", ["street_end_north[1]", "pole_east[1]"])
@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_log_with_a_place_that_is_not_finite_has_no_streets(name: str, value: str) -> None:
    assert Ground.of(CROSSING | {f"plant.{name}": value}) is None


def test_a_log_with_a_street_that_reaches_beyond_all_numbers_has_no_streets() -> None:
    # given a street whose end and half-width are finite, and whose round end is not
    huge = {"plant.street_half_width[1]": "1.7e308", "plant.street_end_north[1]": "1.7e308"}
    assert Ground.of(CROSSING | huge) is None


# events


def test_events_tell_what_the_controller_did() -> None:
    # given six ticks; the anomaly is reported on two ticks running
    ticks = [(0, 0, 0, 0), (1, 1, 0, 0), (1, 1, 0, 1), (2, 1, 0, 1), (3, 1, 1, 0), (9, 2, 1, 0)]
    events = shown({"controller": CONTROLLER}, {"controller": ticks})["/log/events"]
    assert [(time // TICK, event.message, event.level) for time, event in events] == [
        (1, "the trial has begun", INFO),
        (1, "command FORWARD", INFO),
        (2, "the animal did not go forward when told to (forward failure)", WARNING),
        (3, "command STOP", INFO),
        (3, "the animal did not go forward when told to (forward failure)", WARNING),
        (4, "command RECALL", INFO),
        (4, "waypoint 1 reached", INFO),
        (5, "the trial has succeeded", INFO),
        (5, "command 9", INFO),
    ]
    assert {event.name for _, event in events} == {"controller"}
    assert events[2][1].timestamp.nanos == 2 * TICK


def test_an_end_that_is_no_success_is_marked() -> None:
    ticks = [(0, 3, 0, 0), (0, 4, 0, 0), (0, 0, 0, 0)]
    events = shown({"controller": CONTROLLER}, {"controller": ticks})["/log/events"]
    assert [(event.message, event.level) for _, event in events] == [
        ("the trial has failed", ERROR), ("the trial was stopped", WARNING), ("no trial is under way", INFO)
    ]  # fmt: skip


@pytest.mark.parametrize("batch", [1, 2, 7])
def test_what_is_shown_does_not_depend_on_the_batches(batch: int) -> None:
    signals = {"plant": PLANT, "sensors": SENSORS, "controller": CONTROLLER}
    rows: dict[str, Rows] = {
        "plant": [[0.0, k, k, k] for k in range(40)],
        "sensors": [[k % 6 == 0, k, k, 3.0] for k in range(40)],
        "controller": [[k // 9, 1, k // 12, k in {20, 21}] for k in range(40)],
    }
    assert texts(shown(signals, rows, batch=batch)) == texts(shown(signals, rows))


def texts(topics: Shown) -> dict[str, list[str]]:
    return {topic: [f"{time} {message}" for time, message in messages] for topic, messages in topics.items()}


# topics


@pytest.mark.parametrize(
    ("signals", "topics"),
    [
        ({"plant": PLANT}, {"/map/truth", "/3d/frames", "/3d/scene"}),
        ({"plant": ("north", "east")}, {"/map/truth"}),
        ({"estimator": PLANT}, {"/map/estimate", "/3d/frames", "/3d/scene"}),
        ({"sensors": SENSORS}, {"/map/gps"}),
        ({"sensors": SENSORS[1:]}, set()),
        ({"controller": CONTROLLER}, {"/log/events"}),
        ({"controller": ("distance",)}, set()),
    ],
)
def test_a_topic_is_there_if_its_signals_are(signals: dict[str, Sequence[str]], topics: set[str]) -> None:
    rows = {name: [[1.0] * len(names)] for name, names in signals.items()}
    assert set(shown(signals, rows)) == topics
