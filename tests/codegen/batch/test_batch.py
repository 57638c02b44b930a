"""The native batch runner: its results depend on nothing but the trial; any wired system; errors; vectors."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from codegen.batch import batch as runner
from codegen.batch.batch import Batch, Change, Results
from codegen.blocks.block_c import write_files
from codegen.toolchains.compiler import CompileError, build_library
from models.canine import Canine
from models.cmec import Cmec
from models.command_module import CommandModule
from models.day import CanineAllDay
from models.differential_drive import DifferentialDrive
from models.errors import CanineError, ParameterError, WiringError
from models.four_state import FourState
from models.kit.block import Block, triggered
from models.kit.declaration import Input, Integer, Output, Parameter, State
from models.kit.link import Link
from models.kit.model import Model
from models.modes import ENDED
from models.pedestrian import Pedestrian
from models.proportional import Proportional
from models.quarter_turn import QuarterTurn
from models.sensors import Sensors
from models.streets import CanineInStreets
from models.system import SYSTEMS, System, by_name, trial_simulator

ENDS = (2, 3, 4)
STOP = ("controller.status", ENDS)
CTS = SYSTEMS["cts"]
OBSERVED = ("controller.status", "controller.anomalies[2]", "plant.north", "plant.east", "plant.heading")
MISSION = {
    "start": 1.0, "waypoint_count": 2.0, "waypoint_north[1]": 35.73, "waypoint_north[2]": 35.73,
    "waypoint_east[2]": 35.73,
}  # fmt: skip
VALUES = {"controller": MISSION}
LONGEST = 3000


@pytest.fixture(scope="module")
def cts() -> Batch:
    """The trial simulator at different thresholds and speeds."""
    return Batch(CTS, ["controller.moving_deviation", "plant.cruise_speed"], OBSERVED, STOP)


POINTS = np.array([[0.3, 4.86], [0.9, 4.0], [1.5, 5.5]])


def jobs(count: int) -> tuple[Any, Any]:
    """Random points and seeds for trials."""
    rng = np.random.default_rng(count)
    return rng.integers(len(POINTS), size=count), rng.integers(2**31, size=count)


def same(a: Results, b: Results, of: Any = slice(None)) -> None:
    """Compare the second results with these trials of the first."""
    assert a.ticks[of].tobytes() == b.ticks.tobytes()
    assert a.values[of].tobytes() == b.values.tobytes()


# A trial's results depend on nothing but the trial


@pytest.fixture(scope="module")
def thousand(cts: Batch) -> Results:
    results = cts.run(VALUES, POINTS, *jobs(1000), LONGEST)
    assert len(np.unique(results.ticks)) > 200
    assert set(results.values[:, 0]) >= {2.0, 3.0}
    return results


def test_results_do_not_depend_on_the_order_of_trials(cts: Batch, thousand: Results) -> None:
    point, seed = jobs(1000)
    order = np.random.default_rng(1).permutation(1000)
    same(thousand, cts.run(VALUES, POINTS, point[order], seed[order], LONGEST), order)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 15, 16, 17, 127, 128, 129])
def test_results_do_not_depend_on_how_many_trials_run_together(
    cts: Batch, thousand: Results, count: int
) -> None:
    point, seed = jobs(1000)
    for start in (0, 1000 - count):
        some = slice(start, start + count)
        same(thousand, cts.run(VALUES, POINTS, point[some], seed[some], LONGEST), some)


def test_results_do_not_depend_on_the_other_points(cts: Batch, thousand: Results) -> None:
    point, seed = jobs(1000)
    for k in range(len(POINTS)):
        mine = np.flatnonzero(point == k)
        same(thousand, cts.run(VALUES, POINTS[k : k + 1], point[mine] * 0, seed[mine], LONGEST), mine)


def test_results_do_not_depend_on_other_threads(cts: Batch, thousand: Results) -> None:
    # given the same trials in two threads at once, and halves of them in others
    point, seed = jobs(1000)
    parts = [slice(None), slice(None), slice(0, 500), slice(500, None)] * 2

    def run(part: slice) -> Results:
        return cts.run(VALUES, POINTS, point[part], seed[part], LONGEST)

    with ThreadPoolExecutor(2) as pool:
        for part, results in zip(parts, pool.map(run, parts), strict=True):
            same(thousand, results, part)


@pytest.mark.parametrize(("wide", "flights"), [(True, 64), (False, 3)])
def test_results_do_not_depend_on_the_number_of_lanes_and_flights(
    wide: bool, flights: int, thousand: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "_is_wide", lambda: wide)
    monkeypatch.setattr(runner, "FLIGHTS", flights)
    other = Batch(CTS, ["controller.moving_deviation", "plant.cruise_speed"], OBSERVED, STOP)
    assert f"#define LANES {16 if wide else 8}\n" in other.sources()["batch.c"]
    assert f"#define FLIGHTS {flights} " in other.sources()["batch.c"]
    same(thousand, other.run(VALUES, POINTS, *jobs(1000), LONGEST))


def test_results_do_not_depend_on_whether_a_parameter_is_varied_or_common(cts: Batch) -> None:
    point, seed = jobs(40)
    varied = cts.run(VALUES, np.array([[0.7, 4.2]]), point * 0, seed, LONGEST)
    none = Batch(CTS, [], OBSERVED, STOP)
    values = {"controller": MISSION | {"moving_deviation": 0.7}, "plant": {"cruise_speed": 4.2}}
    same(varied, none.run(values, np.zeros((1, 0)), point * 0, seed, LONGEST))


def test_results_do_not_depend_on_the_other_observed_variables(cts: Batch) -> None:
    # given the plant's place at the end, observed alone and with all states and outputs of the system
    point, seed = jobs(40)
    expected = cts.run(VALUES, POINTS, point, seed, LONGEST)
    everything = [
        f"{component}.{name}"
        for component, block in CTS.components.items()
        for kind in ("state", "output")
        for name in block.flat_names(kind)
    ]
    for observed in (["plant.north"], everything):
        other = Batch(CTS, ["controller.moving_deviation", "plant.cruise_speed"], observed, STOP)
        results = other.run(VALUES, POINTS, point, seed, LONGEST)
        assert results.ticks.tobytes() == expected.ticks.tobytes()
        for name in set(observed) & set(OBSERVED):
            a, b = expected.values[:, OBSERVED.index(name)], results.values[:, observed.index(name)]
            assert a.tobytes() == b.tobytes()


def test_a_run_of_no_trials_has_empty_results(cts: Batch) -> None:
    results = cts.run(VALUES, POINTS, [], [], LONGEST)
    assert results.ticks.shape == (0,)
    assert results.values.shape == (0, len(OBSERVED))


def test_a_runner_that_observes_nothing_gives_the_last_ticks() -> None:
    ends = Batch(CTS, ["controller.moving_deviation", "plant.cruise_speed"], [], STOP)
    seen = Batch(CTS, ["controller.moving_deviation", "plant.cruise_speed"], OBSERVED, STOP)
    point, seed = jobs(9)
    results = ends.run(VALUES, POINTS, point, seed, LONGEST)
    assert results.values.shape == (9, 0)
    assert np.array_equal(results.ticks, seen.run(VALUES, POINTS, point, seed, LONGEST).ticks)


# Any wired system, against the models in Python


def stepped(
    batch: Batch,
    values: Mapping[str, Mapping[str, float]],
    ticks: int,
    seed: int = 1,
    changes: Sequence[Change] = (),
) -> tuple[int, list[float]]:
    """A trial stepped in Python: its last tick, and the observed values."""
    system = batch.system
    models = {
        c: Model(block, {"seed": seed} if "seed" in block.flat_names("parameter") else {})
        for c, block in system.components.items()
    }
    for component, model in models.items():
        for name, value in values.get(component, {}).items():
            model[name] = value
        model.initialize()
    plants = [c for c, block in system.components.items() if block.moore]

    def feed(component: str) -> None:
        for link in system.links:
            if link.target == component:
                models[component][link.target_variable] = models[link.source][link.source_variable]

    for tick in range(ticks + 1):
        for change in changes:
            if change.tick == tick:
                models[change.component][change.variable] = change.value
        for component in system.order():
            if component not in plants:
                feed(component)
                models[component].step()
        ended = batch.stop is not None and models[batch.stop[0][0]][batch.stop[0][1]] in batch.stop[1]
        if ended or tick == ticks:
            return tick, [models[c][name] for c, name in batch.observed]
        for component in plants:  # all get their inputs before any moves
            feed(component)
        for component in plants:
            models[component].step()
    raise AssertionError


def compare(
    system: System,
    values: Mapping[str, Mapping[str, float]],
    observe: Collection[str],
    ticks: int,
    *,
    stop: tuple[str, Collection[int]] | None = None,
    changes: Sequence[Change] = (),
    seeds: Sequence[int] = (1, 2, 3),
) -> list[int]:
    """Compare the runner with Python, seed by seed; returns the last ticks."""
    batch = Batch(system, [], list(observe), stop)
    copies = 20  # so that trials share lanes with others that end sooner or later
    done = batch.run(
        values, np.zeros((1, 0)), [0] * len(seeds) * copies, list(seeds) * copies, ticks, changes=changes
    )
    expected = [stepped(batch, values, ticks, seed, changes) for seed in seeds] * copies
    assert done.ticks.tolist() == [tick for tick, _ in expected]
    for row, (_, want) in zip(done.values, expected, strict=True):
        assert row.tobytes() == np.array(want).tobytes(), (row, want)
    return [tick for tick, _ in expected[: len(seeds)]]


MOTION = ("plant.north", "plant.east", "plant.speed", "plant.heading")


@pytest.mark.parametrize(
    ("plant", "controller"),
    [(Pedestrian, Cmec), (DifferentialDrive, QuarterTurn), (DifferentialDrive, Proportional)],
)
def test_trials_of_other_plants_and_controllers_are_those_of_python(
    plant: type[Block], controller: type[Block]
) -> None:
    system = trial_simulator(plant, controller)
    (tick,) = compare(system, VALUES, ["controller.status", *MOTION], 7500, stop=STOP, seeds=[1])
    assert 500 < tick < 7500


def test_trials_in_streets_with_poles_are_those_of_python() -> None:
    # given a corner to the right, a drift that leans on the wall, decoys, and speeds that are drawn
    streets = {
        "street_count": 2, "street_end_north[1]": 90, "street_half_width[1]": 2, "street_north[2]": 34,
        "street_end_north[2]": 34, "street_east[2]": -90, "street_end_east[2]": 90, "street_half_width[2]": 3,
        "pole_count": 2, "pole_north[1]": 55, "pole_north[2]": 34, "pole_east[2]": 40, "pole_chance": 0.8,
    }  # fmt: skip
    dog = {"drift": 0.1, "cruise_speed_deviation": 1.0, "slowing_down_deviation": 1.0}
    system = trial_simulator(CanineInStreets)
    observe = ["controller.status", "plant.street", "plant.fancied", *MOTION]
    ticks = compare(system, VALUES | {"plant": streets | dog}, observe, LONGEST, stop=STOP, seeds=range(1, 6))
    assert len(set(ticks)) == 5


def test_trials_of_a_dog_through_its_day_are_those_of_python() -> None:
    # given a dog that is tired, gets used to vibrations, obeys most of them and draws its speed
    dog = {
        "start_fatigue": 0.6, "start_habituation": 0.1, "free_vibrations": 0, "habituation_gain": 0.05,
        "left_success": 1, "right_success": 1, "cruise_speed_deviation": 1.0,
    }  # fmt: skip
    system = trial_simulator(CanineAllDay)
    observe = ["controller.mode", "plant.fatigue", "plant.habituation", "plant.accustomed", *MOTION]
    stop = ("controller.mode", [int(mode) for mode in ENDED])  # home again, after a failure too
    ticks = compare(system, VALUES | {"plant": dog}, observe, LONGEST, stop=stop)
    assert len(set(ticks)) == 3


def test_trials_with_two_command_modules_are_those_of_python() -> None:
    components: dict[str, type[Block]] = {
        "controller": Cmec, "left": CommandModule, "right": CommandModule, "plant": Canine,
    }  # fmt: skip
    links = {"controller": "plant", "left": "controller", "right": "controller", "plant": "controller"}
    system = System("two_modules", components, by_name(components, links))
    values = VALUES | {"left": {"recall_tone": 100.0}, "right": {"recall_tone": 200.0, "stop_tone": 300.0}}
    observe = ["left.tone_hz", "right.tone_hz", "right.vibrate_left", "controller.status", *MOTION]
    for longest in (150, 7500):
        compare(system, values, observe, longest, stop=STOP)


def test_trials_of_plant_and_sensors_without_controller_end_at_the_last_tick() -> None:
    components: dict[str, type[Block]] = {"sensors": Sensors, "plant": Canine}
    system = System("open_loop", components, by_name(components, {"sensors": "plant"}))
    observe = ["sensors.accel_x", "sensors.gps_north", "sensors.mag_y", "plant.pitch", *MOTION]
    # given a dog that is told to run, to turn and to come home by an input that changes
    changes = [Change(k, "plant", "command", c) for k, c in ((0, 1.0), (40, 2.0), (80, 5.0), (120, 3.0))]
    assert compare(system, {}, observe, 150, changes=changes) == [150] * 3
    assert compare(system, {}, observe, 0, changes=changes) == [0] * 3


@pytest.mark.parametrize("observe", [["plant.north", "plant.pitch"], ["plant.stride", "plant.velocity"]])
def test_trials_of_a_plant_alone_are_those_of_python(observe: list[str]) -> None:
    system = System("plant_alone", {"plant": Canine}, ())
    compare(system, {"plant": {"command": 1.0}}, observe, 90)


def test_trials_of_an_estimator_at_rest_are_those_of_python() -> None:
    components: dict[str, type[Block]] = {"sensors": Sensors, "estimator": FourState, "plant": Pedestrian}
    links = {"sensors": "plant", "estimator": "sensors"}
    system = System("at_rest", components, by_name(components, links))
    observe = ["estimator.north", "estimator.accel_bias", "estimator.valid", "estimator.north_sd"]
    compare(system, {"sensors": {"outage_start[1]": 2.0, "outage_end[1]": 4.0}}, observe, 200)


def test_trials_of_a_block_without_states_are_those_of_python() -> None:
    system = System("no_states", {"module": CommandModule}, ())
    compare(system, {"module": {"command": 2.0}}, ["module.tone_hz", "module.vibrate_left"], 10)


class Walker(Block):
    """Takes a step on each tick, longer the farther it is pushed."""

    source = "none"
    moore = True

    push = Input("m", "how far", start=0)
    at = Output("m", "where it is")
    pace = Parameter("m", "a step", start=0.1)
    place = State("m", "where it is")
    rests = State(Integer, "how often it rested")

    @triggered(lambda m: m.place > 3 * (m.rests + 1), seldom=True)
    def rest(m) -> None:
        """Count a rest, once in three metres."""
        m.rests = m.rests + 1

    def move(m) -> None:
        """Take a step, and a tenth of the push."""
        m.place = m.place + m.pace + 0.1 * m.push

    def output(m) -> None:
        """Its place."""
        m.at = m.place


@pytest.mark.parametrize("names", ["ab", "ba"])
def test_a_plant_that_feeds_another_gives_its_output_before_the_tick(names: str) -> None:
    # given two plants, whichever stands first, of which one follows the other
    system = System(
        "followers", dict.fromkeys(names, Walker), (Link("a", "at", "b", "push"),)
    )  # fmt: skip
    compare(system, {"a": {"pace": 1.0}}, ["a.at", "b.at", "b.place", "b.rests"], 30)


class Beats(Block):
    """Counts up to a period and begins again; a beat now and then."""

    source = "none"
    moore = True

    beat = Output("1", "a hundred a beat, and all counts")
    count = State(Integer, "ticks since the last beat")
    counts = State("1", "all counts")
    beats = State("1", "a hundred a beat")

    def go(m) -> None:
        """Count."""
        m.count = ca.if_else(m.count >= 3, 0, m.count + 1)

    @triggered(lambda m: ca.logic_not(m.count), seldom=True)
    def strike(m) -> None:
        """Its guard is a number, which may be more than 1."""
        m.beats = m.beats + 100

    def gather(m) -> None:
        """Sum the counts."""
        m.counts = m.counts + m.count

    def output(m) -> None:
        """Set the output."""
        m.beat = m.counts + m.beats


def test_a_number_used_as_a_condition_keeps_its_value() -> None:
    compare(System("beats", {"plant": Beats}, ()), {}, ["plant.beat", "plant.count"], 30)


class Signs(Block):
    """Zeros with signs, stored for some ticks."""

    source = "none"

    offset = Input("1", "nothing", start=0)
    factor = Input("1", "changes the sign", start=-1)
    y = Output("1", "the kept one")
    x = State("1", "0.0 and -0.0 in turns")
    count = State(Integer, "ticks")
    total = State("1", "x a tick ago and nothing")
    product = State("1", "nothing times a factor")
    kept = State("1", "the total a tick ago")
    kept_product = State("1", "the product a tick ago")
    kept_x = State("1", "x, which equals zero on every tick")
    kept_kept_x = State("1", "the same a tick ago")
    odd = State(Integer, "times that x was not zero")

    def move(m) -> None:
        """Shift the values on, and change the sign of x."""
        m.kept, m.kept_product = m.total, m.product
        m.total, m.product = m.x + m.offset, m.offset * m.factor
        m.x = m.factor * m.x
        m.count = m.count + 1

    @triggered(lambda m: m.x != 0, seldom=True)
    def wonder(m) -> None:
        """Count; this never happens."""
        m.odd = m.odd + 1

    def keep(m) -> None:
        """Store x, so that it passes through the lanes."""
        m.kept_kept_x, m.kept_x = m.kept_x, m.x
        m.y = m.kept


@pytest.mark.parametrize("ticks", [4, 5, 6, 7])
def test_zeros_keep_their_signs(ticks: int) -> None:
    system = System("signs", {"signs": Signs}, ())
    observe = ["signs.kept", "signs.kept_product", "signs.kept_kept_x", "signs.x", "signs.y", "signs.odd"]
    compare(system, {}, observe, ticks)


# Changes of inputs


def trial_with(changes: Sequence[Change], longest: int = 600) -> list[int]:
    """A trial with changes of all four free inputs, so that one runner serves all tests."""
    starts = {"start": 1.0, "override": 0.0, "link_ok": 1.0, "valid": 1.0}
    changed_at_once = {c.variable for c in changes if c.tick == 0}
    first = [change(0, name, value) for name, value in starts.items() if name not in changed_at_once]
    return compare(CTS, VALUES, OBSERVED, longest, stop=STOP, changes=[*first, *changes])


def change(tick: int, name: str, value: float) -> Change:
    return Change(tick, "controller", name, value)


@pytest.mark.parametrize(
    "changes",
    [
        [change(50, "override", 3), change(90, "override", 0)],
        [change(0, "link_ok", 0), change(1, "link_ok", 1)],
        [
            change(30, "valid", 0),
            change(31, "valid", 1),
            change(31, "override", 2),
            change(70, "override", 0),
        ],
        [change(100, "start", 0)],
        [change(0, "start", 0), change(40, "start", 1), change(120, "start", 0), change(200, "start", 1)],
        [change(599, "override", 2)],
        [change(600, "override", 2)],
    ],
    ids=["override", "link", "several", "withdrawn", "again", "just before the end", "at the end"],
)
def test_inputs_change_on_their_tick_in_every_trial(changes: list[Change]) -> None:
    trial_with(changes)


def test_a_change_after_the_last_tick_does_not_delay_the_end() -> None:
    # given a last tick while the dogs run, and a change after it
    ticks = trial_with([change(200, "override", 2)], longest=100)
    assert ticks == [100] * 3


@pytest.mark.parametrize("values", [(3.0, 0.0), (0.0, 3.0), (5.0, 1.0, 2.0)])
def test_the_last_of_several_changes_on_one_tick_holds(values: tuple[float, ...]) -> None:
    trial_with([change(50, "override", value) for value in values])


def test_changes_may_come_in_any_order() -> None:
    changes = [change(90, "override", 0), change(200, "link_ok", 0), change(50, "override", 3)]
    assert trial_with(changes) == trial_with(sorted(changes, key=lambda c: c.tick))


# Errors


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("controler.moving_deviation", r'no component "controler"; did you mean "controller"'),
        ("controller.moving_devation", r'no parameter "moving_devation"; did you mean "moving_deviation"'),
        ("controller.status", 'controller cmec has no parameter "status"'),
        ("controller", "controller"),
    ],
)
def test_unknown_varied_parameters_are_refused(name: str, words: str) -> None:
    with pytest.raises((ParameterError, WiringError), match=words):
        Batch(CTS, [name], OBSERVED, STOP)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("plnt.north", r'no component "plnt"; did you mean "plant"'),
        ("plant.nort", r'plant canine has no state or output "nort"; did you mean "north"'),
        ("controller.moving_deviation", 'no state or output "moving_deviation"'),
    ],
)
def test_unknown_observed_variables_are_refused(name: str, words: str) -> None:
    with pytest.raises((ParameterError, WiringError), match=words):
        Batch(CTS, [], [name], STOP)


def test_an_unknown_output_that_ends_trials_is_refused() -> None:
    with pytest.raises(ParameterError, match=r'no output "statsu"; did you mean "status"'):
        Batch(CTS, [], OBSERVED, ("controller.statsu", ENDS))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"controler": {"start": 1.0}}, r'"controler".*did you mean "controller"'),
        ({"controller": {"strat": 1.0}}, r'strat".*did you mean ".*start"'),
        ({"plant": {"cruise_sped": 1.0}}, r'cruise_sped".*did you mean ".*cruise_speed"'),
        ({"controller": {"north": 1.0}}, "north"),  # it is connected
        ({"plant": {"velocity": 1.0}}, "velocity"),  # a state
    ],
)
def test_values_of_variables_that_cannot_be_set_are_refused(cts: Batch, values: Any, words: str) -> None:
    with pytest.raises(CanineError, match=words):
        cts.run(values, POINTS, [0], [1], 10)


def test_values_of_variables_that_are_not_needed_change_nothing(cts: Batch, thousand: Results) -> None:
    point, seed = jobs(1000)
    values = VALUES | {"command_module": {"stop_tone": 1.0}, "plant": {"run_stride": 1.0}}
    same(thousand, cts.run(values, POINTS, point[:50], seed[:50], LONGEST), slice(50))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (Change(5, "controler", "override", 1.0), r'controler.*did you mean ".*controller'),
        (Change(5, "controller", "overide", 1.0), r'overide.*did you mean ".*override"'),
        (Change(5, "controller", "north", 1.0), "north"),  # it is connected
        (Change(5, "controller", "moving_deviation", 1.0), "moving_deviation"),  # a parameter
    ],
)
def test_changes_of_variables_that_are_not_free_inputs_are_refused(
    cts: Batch, change: Change, words: str
) -> None:
    with pytest.raises(CanineError, match=words):
        cts.run(VALUES, POINTS, [0], [1], 10, changes=[change])


@pytest.mark.parametrize(
    ("job", "words"),
    [
        ((POINTS[:, :1], [0], [1], 10), r"points has shape \(3, 1\); expected \(points, 2\)"),
        ((POINTS[0], [0], [1], 10), r"points has shape \(2,\)"),
        ((POINTS, [0, 1], [1], 10), r"shapes \(2,\) and \(1,\)"),
        ((POINTS, [[0]], [[1]], 10), "shapes"),
        ((POINTS, [0, 3], [1, 1], 10), "to 3; expected"),
        ((POINTS, [-1, 0], [1, 1], 10), "from -1"),
        ((np.zeros((0, 2)), [0], [1], 10), "0 points"),
        ((POINTS, [0], [-1], 10), "seed is -1"),
        ((POINTS, [0], [2**31], 10), "seed"),
        ((POINTS, [0], [2**32 + 1], 10), "seed"),
        ((POINTS, [2**32], [1], 10), "point"),
        ((POINTS, [0], [1], -1), "ticks is -1; expected 0"),
        ((POINTS, [0], [1], 2**31), "ticks is 2147483648"),
    ],
)
def test_wrong_shapes_and_indices_are_refused(cts: Batch, job: Any, words: str) -> None:
    points, point, seed, ticks = job
    with pytest.raises(ParameterError, match=words):
        cts.run(VALUES, points, np.array(point), np.array(seed), ticks)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_value_that_is_not_finite_is_refused(cts: Batch, value: float) -> None:
    with pytest.raises(ParameterError, match=r"override.*(nan|inf)"):
        cts.run({"controller": MISSION | {"override": value}}, POINTS, [0], [1], 10)


# Vectors, and the cache


def test_a_loop_over_lanes_that_stays_scalar_does_not_compile(cts: Batch, tmp_path: Path) -> None:
    # given the runner's source, and the same with a call in the loop over lanes
    files = cts.sources((), {("controller", "start"): 1.0, ("controller", "link_ok"): 1.0})
    source = files["batch.c"]
    loop = "        departing[l] = departs ? active[l] : 0;\n"
    assert source.count(loop) == source.count("#pragma clang loop vectorize(assume_safety)") >= 1
    call = "        spoiled(l);\n"
    spoiled = "void spoiled(int l);\nstatic inline uint64_t tick_1("
    broken = source.replace("static inline uint64_t tick_1(", spoiled).replace(loop, loop + call, 1)
    write_files(files | {"batch.c": broken}, tmp_path)
    # then the compiler refuses it
    with pytest.raises(CompileError, match=r"batch\.c:\d+:\d+: error: loop not vectorized"):
        build_library(tmp_path, ["batch.c"], tmp_path / "a.so", what="spoiled", flags=runner._flags())


def test_a_runner_in_the_cache_is_not_built_again(
    cts: Batch, thousand: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a runner that some process has built on this machine
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("built again")

    monkeypatch.setattr(runner, "build_library", refuse)
    runner._load.cache_clear()
    again = Batch(CTS, ["controller.moving_deviation", "plant.cruise_speed"], OBSERVED, STOP)
    point, seed = jobs(1000)
    same(thousand, again.run(VALUES, POINTS, point[:9], seed[:9], LONGEST), slice(9))
    # and another system, or the same with other values of inputs, is another runner
    with pytest.raises(AssertionError, match="built again"):
        again.run({"controller": MISSION | {"override": 4.0}}, POINTS, [0], [1], 123)


def test_the_same_system_gives_the_same_source(cts: Batch) -> None:
    again = Batch(CTS, ["controller.moving_deviation", "plant.cruise_speed"], OBSERVED, STOP)
    assert again.sources() == cts.sources()


def test_a_runner_comes_from_the_cache_without_tracing(tmp_path: Path) -> None:
    # given a sweep's runner in an empty cache
    script = """
import sys
import numpy as np
from codegen.batch.batch import Batch
from models.system import SYSTEMS
batch = Batch(SYSTEMS["cts"], [], ["plant.north"], ("controller.status", (2, 3, 4)))
results = batch.run({"controller": {"start": 1.0}}, np.zeros((3, 0)), [0, 1, 2], [1, 2, 3], 100)
print("casadi" in sys.modules, *results.values[:, 0])
"""
    environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": str(tmp_path)}

    def run() -> list[str]:
        done = subprocess.run(
            [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
        )
        return done.stdout.split()

    traced, *north = run()
    # when another process runs it
    again, *same_north = run()
    # then the models are not traced, and the results are the same
    assert (traced, again) == ("True", "False")
    assert same_north == north
    # and a damaged entry is made anew
    for path in (tmp_path / "batch").iterdir():
        if path.suffix in (".so", ".json"):
            path.write_bytes(b"damaged")
    mended, *mended_north = run()
    assert (mended, mended_north) == ("True", north)


def test_another_block_of_the_same_name_has_a_runner_of_its_own() -> None:
    # given another pedestrian, with the name and the module of ours
    class Elsewhere(Pedestrian):
        """Runs faster."""

        def output(m) -> None:
            super().output()
            m.north = m.north + 1.0

    Elsewhere.__name__, Elsewhere.__module__ = Pedestrian.__name__, Pedestrian.__module__
    ours, theirs = (Batch(trial_simulator(block), [], ["plant.north"]) for block in (Pedestrian, Elsewhere))
    values, one = np.zeros((1, 0)), np.zeros(1, np.int32)
    # when both run a tick, then each by its own equations
    assert theirs.run({}, values, one, one, 0).values == ours.run({}, values, one, one, 0).values + 1.0
