"""The program on board: its bounds and what it forgets; each has a mutant that only its test notices."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from codegen.firmware.bundle import library, processor_in_the_loop
from codegen.firmware.image import host_image
from codegen.firmware.targets import find_target
from codegen.firmware.telemetry import Flag, Ready, Refusal, Telemetry
from codegen.toolchains.library import load_library
from harness.onboard.instruments import Receiver
from harness.onboard.memory import Memory
from harness.onboard.processors.host import Host
from harness.onboard.radio import Abort, Decoder, Heartbeat, Mission, Position, Start
from models.estimator import SPEED
from models.four_state import EAST, NORTH
from models.modes import Anomaly, Mode
from tests.harness.onboard.frames import encode
from tests.harness.onboard.inside import inside
from tests.harness.onboard.vest import HERE, PLANE, Vest, place

HOME = place(0, 0)
A = Mission(HOME, (place(50, 0),))


@pytest.fixture
def vest() -> Iterator[Vest]:
    made = Vest()
    yield made
    made.processor.close()


def is_loaded(vest: Vest) -> bool:
    """Does the vest hold a mission, as it tells?"""
    vest.ticks(10)
    return bool(vest.telemetry.flags & Flag.LOADED)


def test_rule_9_a_mission_alone_asks_for_no_start(vest: Vest) -> None:
    vest.ticks(10)
    vest.load(A)
    memory = vest.ticks(10)
    assert memory["controller.output.mode"] == Mode.IDLE
    assert vest.telemetry.refusal == Refusal.NONE


def test_rule_9_a_mission_behind_a_start_undoes_it_without_a_refusal(vest: Vest) -> None:
    # given a mission that is ready
    vest.ticks(10)
    vest.load(A)
    # when it comes again right behind its START
    vest.tick(Start(A.id), A, fix=False)
    memory = vest.ticks(20)
    # then nothing begins, and nothing is refused
    assert memory["controller.output.mode"] == Mode.IDLE
    assert vest.telemetry.refusal == Refusal.NONE


@pytest.mark.parametrize(("pause", "taken"), [(5, True), (6, False)])
def test_a_frame_may_pause_for_five_ticks(vest: Vest, pause: int, taken: bool) -> None:
    # given a frame that comes in two pieces
    frame = vest.encode(A)
    vest.tick(frame[:20], fix=False)
    for _ in range(pause - 1):
        vest.tick(fix=False)
    vest.tick(frame[20:], fix=False)
    # then it is taken if the second comes within five ticks
    assert is_loaded(vest) == taken


def test_a_message_behind_a_frame_that_never_ends_is_obeyed_when_that_is_abandoned(vest: Vest) -> None:
    # given the beginning of a long frame, and a mission behind it
    vest.tick(vest.encode(Mission(HOME, (place(60, 0),) * 16))[:8] + vest.encode(A), fix=False)
    # when the radio is silent
    held = [vest.tick(fix=False)["radio.mission.count"] for _ in range(6)]
    # then it is held after five ticks, in which the frame could have gone on
    assert held == [0] * 5 + [1]


@pytest.mark.parametrize(
    ("accuracy", "settled"),
    [
        ({"gps_h_acc": 100.0}, 1),
        ({"gps_h_acc": 100.001}, 0),
        ({"gps_h_acc": 100.0, "gps_s_acc": 10.0}, 1),
        ({"gps_s_acc": 10.01}, 0),
    ],
)
def test_a_fix_settles_the_plane_if_it_is_accurate_to_100_m_and_10_m_s(
    vest: Vest, accuracy: dict[str, float], settled: int
) -> None:
    assert vest.tick(fix=True, **accuracy)["local_plane.state.settled"] == settled


@pytest.mark.parametrize("axis", [(1, 0), (0, 1), (-1, 0), (0, -1)])
@pytest.mark.parametrize("far", [0, 1, 2])
@pytest.mark.parametrize(("distance", "missing"), [(99_900.0, ()), (100_100.0, (Ready.REACH,))])
def test_rule_8_every_place_of_a_mission_must_be_in_reach(
    vest: Vest, axis: tuple[int, int], far: int, distance: float, missing: tuple[Ready, ...]
) -> None:
    # given a mission of which one place is far away to one side: home, the first or the last waypoint
    places = [place(20, 20), place(50, 0), place(0, 50)]
    places[far] = place(axis[0] * distance, axis[1] * distance)
    vest.ticks(12)
    vest.tick(Mission(places[0], (places[1], places[2])), fix=False)
    vest.ticks(12)
    # then it is ready if all are in reach
    assert Ready(vest.telemetry.ready).missing == missing


@pytest.mark.parametrize(("mm_s", "settled"), [(10_000, 1), (10_001, 0)])
def test_a_receiver_that_tells_mm_s_settles_the_plane_up_to_10_m_s(
    vest: Vest, mm_s: int, settled: int
) -> None:
    vest.receiver = Receiver(PLANE, pvt=True)
    assert vest.tick(fix=True, gps_s_acc=1e-3 * mm_s)["local_plane.state.settled"] == settled


def test_rule_8_a_fence_that_is_not_projected_yet_is_not_held_against_the_animal(vest: Vest) -> None:
    # given a fence around it
    vest.ticks(12)
    fence = (place(-20, -20), place(-20, 20), place(70, 20), place(70, -20))
    vest.tick(replace(A, fence=fence), fix=False)
    # when telemetry comes before its corners are projected
    while vest.telemetry.mission_id != replace(A, fence=fence).id:
        vest.tick(fix=False)
    # then that alone is missing
    assert Ready(vest.telemetry.ready).missing == (Ready.PLANNED,)


@pytest.mark.parametrize("count", [1, 2, 16])
def test_the_controller_has_the_number_of_waypoints_and_of_the_fences_corners(vest: Vest, count: int) -> None:
    vest.ticks(12)
    for fence, corners in (((place(-20, -50), place(-20, 350), place(300, 0)), 3), ((), 0)):
        memory = vest.load(Mission(HOME, tuple(place(50, 20 * i) for i in range(count)), fence))
        assert memory["controller.parameter.waypoint_count"] == count
        assert memory["controller.parameter.fence_count"] == corners


# the sources


def test_the_operator_counts_as_heard_for_2_s(vest: Vest) -> None:
    vest.ticks(12)
    vest.tick(HERE, fix=False)
    # then 50 ticks
    memories = [vest.tick(fix=False) for _ in range(52)]
    for word in ("watchdog.output.link_ok", "controller.input.link_ok"):
        assert [memory[word] for memory in memories] == [1] * 50 + [0] * 2


@pytest.mark.parametrize("size", [1, 512])
def test_a_tick_reads_two_blocks_of_a_source_that_never_runs_dry(size: int) -> None:
    # given a board that gives as many bytes again, however often it is asked
    board = {"endless.c": Path(__file__).with_name("endless.c").read_text()}
    path = host_image(find_target("host"), library() | board).path
    program = load_library(path, "endless")
    memory = inside(program)
    program.onboard_init(ctypes.byref(memory))
    ctypes.c_uint16.in_dll(program, "block_size").value = size
    blocks = (ctypes.c_uint32 * 3).in_dll(program, "blocks_given")
    blocks[:] = [0, 0, 0]
    frame = encode(Heartbeat(9), 1)
    (ctypes.c_uint8 * 512).in_dll(program, "first_block")[: len(frame)] = list(frame)
    # when
    program.onboard_tick(ctypes.byref(memory))
    # then
    assert list(blocks) == [2, 2, 2]
    # and a message in the first block counts although the second has none
    assert memory.radio.nonce == (9 if size == 512 else 0)
    assert memory.watchdog.out.link_ok == (size == 512)


def test_a_frame_may_come_byte_by_byte(vest: Vest) -> None:
    for byte in vest.encode(Heartbeat(9)):
        memory = vest.tick(bytes([byte]), fix=False)
    assert memory["radio.nonce"] == 9


def nonces(vest: Vest, fix: bool) -> list[float]:
    """Those that the vest has after each of six ticks, on each of which the next one is sent."""
    vest.ticks(10)
    vest.tick(fix=False)
    return [vest.tick(Heartbeat(11 + k), fix=fix)["radio.nonce"] for k in range(6)]


def test_a_fix_on_every_tick_makes_the_radio_wait_on_every_second(vest: Vest) -> None:
    assert nonces(vest, fix=True) == [7, 12, 12, 14, 14, 16]


def test_without_a_fix_the_radio_does_not_wait(vest: Vest) -> None:
    assert nonces(vest, fix=False) == [11, 12, 13, 14, 15, 16]


def test_the_program_begins_with_nothing_whatever_its_memory_held(vest: Vest) -> None:
    # given a program that has begun, and one that begins with other memory
    begun = Memory(vest.processor.start)
    memory = vest.inside
    ctypes.memset(ctypes.byref(memory), 0xFF, ctypes.sizeof(memory))
    library = vest.processor._library  # type: ignore[attr-defined]
    library.pil_start()
    again = Memory(bytes((ctypes.c_uint32 * len(begun.values)).in_dll(library, "pil_recorded")))
    # then they are the same, and beside the session's number and the counts' limits nothing is on
    assert list(again.values) == list(begun.values)
    for word in ("time_ms", "asked", "refusal", "last_anomaly", "planned", "place", "route", "pause", "busy"):
        assert begun[word] == 0
    for word in ("reporting", "waited", "battery_mv", "temperature", "radio.mission.count"):
        assert begun[word] == 0
    assert begun["radio.session"] == 1
    assert begun["watchdog.state.link_limit"] == 50


# the plane


@pytest.mark.parametrize("axis", ["north", "east"])
@pytest.mark.parametrize("side", [1, -1])
def test_rule_8_a_place_is_in_reach_up_to_100_km_to_each_side(vest: Vest, axis: str, side: int) -> None:
    # given a plane on which a unit of 1e-7 deg is 2^-6 m: 100 km are 6 400 000
    vest.ticks(12)
    plane = vest.inside.local_plane.state
    plane.north_scale = plane.east_scale = 2.0**-6
    here = (plane.origin_latitude, plane.origin_longitude)
    for units, missing in ((6_400_000, ()), (6_400_001, (Ready.REACH,))):
        there = [here[0] + side * units * (axis == "north"), here[1] + side * units * (axis == "east")]
        vest.load(Mission(HOME, (Position(1e-7 * there[0], 1e-7 * there[1]),)))
        # then
        assert Ready(told(vest).ready).missing == missing


def test_an_inaccurate_fix_far_away_does_not_settle_the_plane_again(vest: Vest) -> None:
    origin = vest.ticks(12)["local_plane.state.origin_latitude"]
    memory = vest.ticks(12, gps_north=150_000.0, gps_h_acc=5000.0)
    assert memory["local_plane.state.origin_latitude"] == origin


def test_rule_8_two_waypoints_at_one_place_are_closer_than_any_radius(vest: Vest) -> None:
    vest.ticks(12)
    vest.inside.controller.par.capture_radius = 0.0
    vest.load(Mission(HOME, (place(50, 0), place(50, 0))))
    assert Ready.LEGS in Ready(told(vest).ready).missing


HEPTAGON = ((-50, 0), (-30, 40), (10, 50), (45, 20), (45, -20), (10, -50), (-30, -40))
DIAMOND = (place(-20, 0), place(0, 20), place(20, 0), place(0, -20))
SQUARE = (place(0, -20), place(0, 20), place(40, 20), place(40, -20))


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize(
    ("fence", "home", "inside"),
    [
        (DIAMOND, (0, 0), True),  # due north and due south of it is a corner
        (DIAMOND, (30, 0), False),
        (DIAMOND, (-30, 0), False),
        (DIAMOND, (0, 30), False),
        (SQUARE, (0, 0), True),  # on its south edge: one edge is to the north
        (SQUARE, (40, 0), False),  # on its north edge: none is
        (SQUARE[:3], (30, 0), False),
        (SQUARE[:3], (10, 15), True),
        (SQUARE[1:], (10, 0), False),
        (SQUARE[1:], (30, 0), True),
    ],
)
def test_rule_8_home_is_inside_a_fence_if_an_odd_number_of_its_edges_is_north_of_it(
    vest: Vest, fence: tuple[Position, ...], home: tuple[float, float], inside: bool, turn: int
) -> None:
    # given another fence before it
    vest.ticks(12)
    vest.load(Mission(HOME, (place(10, 10),), tuple(place(n, e) for n, e in HEPTAGON)))
    # when
    vest.load(Mission(place(*home), (place(8, 10) if fence is DIAMOND else place(30, 18),), fence[::turn]))
    # then
    assert (Ready.FENCE not in Ready(told(vest).ready).missing) == inside


# the telemetry; counts that take days, and places at the poles, are set in memory


def told(vest: Vest) -> Telemetry:
    """The next telemetry."""
    before = vest.telemetry
    while vest.telemetry is before:
        vest.tick(fix=False)
    return vest.telemetry


@pytest.mark.parametrize(
    ("origin", "expected"),
    [
        ((900_000_000, 5), (900_000_000, 5)),
        ((900_000_001, 5), (899_999_999, -1_799_999_995)),
        ((900_000_001, -5), (899_999_999, 1_799_999_995)),
        ((900_000_001, 1_000_000_000), (899_999_999, -800_000_000)),
        ((900_000_001, -1_000_000_000), (899_999_999, 800_000_000)),
        ((-900_000_000, 5), (-900_000_000, 5)),
        ((-900_000_001, 5), (-899_999_999, -1_799_999_995)),
        ((0, 1_800_000_000), (0, 1_800_000_000)),
        ((0, 1_800_000_001), (0, -1_799_999_999)),
        ((0, -1_800_000_000), (0, -1_800_000_000)),
        ((0, -1_800_000_001), (0, 1_799_999_999)),
    ],
)
def test_telemetry_beyond_a_pole_or_the_date_line_is_of_the_same_place_on_earth(
    vest: Vest, origin: tuple[int, int], expected: tuple[int, int]
) -> None:
    # given an animal at the origin, in 1e-7 deg
    vest.ticks(12)
    state = vest.inside.local_plane.state
    state.origin_latitude, state.origin_longitude = origin
    # then a unit beyond 90 deg lies a unit on the other side of the pole, on the opposite meridian
    got = told(vest)
    assert (got.latitude, got.longitude) == expected


@pytest.mark.parametrize("side", [1, -1])
def test_an_estimate_far_from_the_origin_is_told_within_10_deg_of_it(vest: Vest, side: int) -> None:
    vest.ticks(12)
    vest.inside.local_plane.state.origin_latitude = vest.inside.local_plane.state.origin_longitude = 0
    # when it is 2000 km away: 18 deg
    vest.inside.estimator.state.x[NORTH], vest.inside.estimator.state.x[EAST] = side * 2e6, side * -2e6
    got = told(vest)
    assert (got.latitude, got.longitude) == (side * 100_000_000, side * -100_000_000)


def test_telemetry_tells_what_the_budget_leaves_of_issues_vibration_and_tones(vest: Vest) -> None:
    # given 8 issues and 600 and 6000 ticks, of which 3, 100 and 1001 are spent
    vest.ticks(60)
    state = vest.inside.controller.state
    state.allowance[:], state.spent[:] = (8, 600, 6000), (3, 100, 1001)
    # then 5 issues, 500 ticks of 0.04 s and 4999 are left, in whole tenths of a second
    got = told(vest)
    assert (got.issues_left, got.vibration_left, got.tone_left) == (5, 200, 1999)
    state.spent[:] = (7, 597, 5997)
    got = told(vest)
    assert (got.issues_left, got.vibration_left, got.tone_left) == (1, 1, 1)
    # and never less than none
    state.spent[:] = (9, 601, 6001)
    got = told(vest)
    assert (got.issues_left, got.vibration_left, got.tone_left) == (0, 0, 0)
    # and without limits as much as can be told
    vest.inside.controller.par.guarded = False
    got = told(vest)
    assert (got.issues_left, got.vibration_left, got.tone_left) == (65535, 65535, 65535)


@pytest.mark.parametrize(
    ("spent", "missing"),
    [
        ((39, 1999, 5999), ()),
        ((40, 0, 0), (Ready.BUDGET,)),
        ((0, 2000, 0), (Ready.BUDGET,)),
        ((0, 0, 6000), (Ready.BUDGET,)),
    ],
)
def test_rule_8_a_start_needs_something_of_each_stimulus_left_in_the_window(
    vest: Vest, spent: tuple[int, int, int], missing: tuple[Ready, ...]
) -> None:
    # given 40 issues, 80 s of vibration and 240 s of tones in a window, and what is spent in this one
    vest.ticks(60)
    vest.load(A)
    state = vest.inside.controller.state
    state.earlier_spent[:] = (7, 70, 700)
    state.spent[:] = [7 + spent[0], 70 + spent[1], 700 + spent[2]]
    # then
    assert Ready(told(vest).ready).missing == missing
    # and without limits nothing is missing
    vest.inside.controller.par.guarded = False
    assert Ready(told(vest).ready).missing == ()


def test_rule_8_courses_that_contradict_the_heading_are_told(vest: Vest) -> None:
    # given an animal that looks to the north and walks south at 1.2 m/s for more than 3 s
    vest.ticks(12)
    for k in range(120):
        vest.ticks(1, gps_north=-0.048 * k, gps_speed=1.2, gps_course=math.pi)
    # then
    assert Ready.HEADING in Ready(told(vest).ready).missing


@pytest.mark.parametrize("limit", ["window_issues", "window_vibration", "window_tone"])
def test_rule_8_a_window_that_allows_none_leaves_none(vest: Vest, limit: str) -> None:
    vest.ticks(60)
    vest.load(A)
    assert Ready(told(vest).ready).missing == ()
    setattr(vest.inside.controller.par, limit, 0)
    assert Ready(told(vest).ready).missing == (Ready.BUDGET,)


def test_rule_9_the_last_anomaly_of_a_trial_is_told_until_the_next_one_begins(vest: Vest) -> None:
    # given a trial that ends with the link
    vest.ticks(60)
    vest.begin(A)
    for _ in range(60):
        vest.tick()
    assert vest.telemetry.anomaly == Anomaly.LOST_LINK
    # when the operator is heard again, and ends it
    vest.ticks(6)
    vest.tick(Abort())
    vest.ticks(60)
    assert vest.telemetry.anomaly == Anomaly.NONE
    assert vest.telemetry.last_anomaly == Anomaly.LOST_LINK
    # then it is told until there is another trial
    vest.ticks(6, Start(A.id))
    assert Flag.STARTED in Flag(vest.telemetry.flags)
    assert vest.telemetry.last_anomaly == Anomaly.NONE


WALKING = {"gps_speed": 1.2, "gps_course": 0.3, "heading_meas": 0.4, "gps_north": 2.0, "gps_east": -1.0}


def walk(vest: Vest) -> None:
    """The animal is led to A, and walks past it."""
    vest.ticks(60)
    vest.begin(A)
    vest.ticks(12, **WALKING)


def test_the_controller_gets_the_estimate(vest: Vest) -> None:
    walk(vest)
    memory = vest.tick(fix=False, **WALKING)
    for name in ("north", "east", "speed", "speed_sd", "heading"):
        assert memory[f"controller.input.{name}"] == memory[f"estimator.output.{name}"] != 0


def test_telemetry_tells_the_estimate_and_the_controller_in_whole_units(vest: Vest) -> None:
    # given an animal whose north is less certain than its east, or more
    walk(vest)
    variances = vest.inside.estimator.state.covariance  # of UD factors, D comes first
    for north, east in ((4.0, 1.0), (1.0, 4.0)):
        variances[0], variances[1] = north, east
        before = vest.telemetry
        while vest.telemetry is before:
            memory = vest.tick(fix=False, **WALKING)
        got = vest.telemetry
        sds = [memory[f"estimator.output.{axis}_sd"] for axis in ("north", "east")]
        assert (sds[0] > sds[1]) == (north > east)
        # then
        assert got.position_sd == round(100 * max(sds))
        for field, word, unit in (
            ("speed", "estimator.output.speed", 1e-2), ("heading", "estimator.output.heading", 1e-4),
            ("speed_sd", "estimator.output.speed_sd", 1e-2),
            ("distance", "controller.output.distance", 1e-1),
            ("deviation", "controller.output.deviation", 1e-4), ("command", "controller.output.command", 1),
            ("mode", "controller.output.mode", 1), ("status", "controller.output.status", 1),
            ("received", "radio.received", 1),
        ):  # fmt: skip
            assert getattr(got, field) == round(memory[word] / unit) != 0, field
        latitude, longitude = PLANE.from_plane(
            *(memory[f"estimator.output.{axis}"] for axis in ("north", "east"))
        )
        assert got.latitude == pytest.approx(1e7 * math.degrees(latitude), abs=3)
        assert got.longitude == pytest.approx(1e7 * math.degrees(longitude), abs=3)
        assert (got.session, got.nonce, got.mission_id) == (1, 7, A.id)
        assert got.time_ms == 40 * (vest.k - 1)
        assert got.flags == 0b0111111  # all but INSECURE


@pytest.mark.parametrize(
    ("speed", "expected"), [(1.234, 123), (1.236, 124), (-1.234, -123), (-1.236, -124), (0.0, 0)]
)
def test_telemetry_is_rounded_to_the_nearest_unit(vest: Vest, speed: float, expected: int) -> None:
    vest.ticks(60)
    vest.inside.estimator.state.x[SPEED] = speed
    got = told(vest)
    assert got.speed == expected
    assert got.distance == 0


def test_telemetry_before_the_first_fix_has_no_place(vest: Vest) -> None:
    got = told(vest)
    assert (got.latitude, got.longitude) == (0, 0)
    assert Flag(got.flags) == Flag.IMU_OK


@pytest.mark.parametrize(
    ("place", "field", "counts"),
    [
        ("gps.scanner.frames", "gps_frames", {65535: 65535, 65536: 0, 65539: 3}),
        ("imu.scanner.frames", "imu_frames", {65534: 65535, 65535: 0, 65538: 3}),
        ("gps.scanner.errors", "gps_errors", {3: 3, 65535: 65535, 65536: 65535}),
        ("imu.scanner.errors", "imu_errors", {3: 3, 65535: 65535, 65536: 65535}),
        ("radio.scanner.errors", "link_errors", {3: 3, 65535: 65535, 65536: 65535}),
        ("radio.forged", "link_forged", {3: 3, 65535: 65535, 65536: 65535}),
        ("radio.replayed", "link_replayed", {3: 3, 65535: 65535, 65536: 65535}),
        ("estimator.state.rejections", "rejected_fixes", {3: 3, 30000: 30000}),
        ("estimator.state.jumped", "jumps", {3: 3, 255: 255, 256: 255, 30000: 255}),
        ("estimator.state.renewals", "recoveries", {3: 3, 255: 255, 256: 255, 30000: 255}),
        ("controller.state.issued", "directional_commands", {3: 3, 1000: 1000}),
        ("controller.state.reached", "waypoint", {3: 3, 16: 16}),
    ],
)
def test_telemetry_counts_as_far_as_its_field_goes(
    vest: Vest, place: str, field: str, counts: dict[int, int]
) -> None:
    # given telemetry that is due on the next tick: the inertial unit's sample of that tick counts, too
    *members, name = place.split(".")
    for count, expected in counts.items():
        told(vest)
        for _ in range(4):
            vest.tick(fix=False)
        holder = vest.inside
        for member in members:
            holder = getattr(holder, member)
        setattr(holder, name, count)
        # then
        assert getattr(told(vest), field) == expected


def test_telemetry_that_is_due_with_a_fix_comes_a_tick_later(vest: Vest) -> None:
    vest.ticks(10)
    told(vest)
    before = vest.telemetry
    came = []
    for k in range(1, 12):
        vest.tick(fix=k == 5)
        if vest.telemetry is not before:
            before = vest.telemetry
            came.append(k)
    assert came == [6, 10]


def test_a_program_without_a_key_says_that_it_is_insecure() -> None:
    files = library(key=None) | processor_in_the_loop()
    vest = Vest(Host(host_image(find_target("host"), files)))
    vest.decoder = Decoder(None)
    assert Flag.INSECURE in Flag(told(vest).flags)
    vest.processor.close()
