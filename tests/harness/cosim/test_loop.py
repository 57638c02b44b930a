"""The master against plain Python: orders, delays, events, stops, conversions."""

import random
import signal
from collections.abc import Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from harness.cosim.loop import Array, Simulation, Stop
from harness.cosim.ssp import FmuComponent, FmuSystem, ScaledLink, StartValue
from harness.cosim.stepping import Event, Order
from harness.log.channel import Channel
from harness.log.log import read_log
from harness.log.writer import LogWriter
from models.errors import ParameterError
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

# plant: x+ = x + u, y = x. filter: y = 2 u. controller: command = u + offset, n counts.
PLANT = ([V("u", "input"), V("y"), V("zero")], "v[1] += v[0];")
FILTER = ([V("u", "input"), V("y")], "v[1] = 2 * v[0];")
CONTROLLER = (
    [V("u", "input"), V("offset", "input"), V("y"), V("n", type="Integer")],
    "v[2] = v[0] + v[1]; v[3] += 1;",
)
LINKS = (
    ScaledLink("plant", "y", "filter", "u"),
    ScaledLink("filter", "y", "controller", "u"),
    ScaledLink("controller", "y", "plant", "u"),
)


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("fmus")
    plant = tiny_fmu(folder / "plant.fmu", *PLANT, depends=False, start="v[1] = 1;")
    return {
        "plant": plant,
        "filter": tiny_fmu(folder / "filter.fmu", *FILTER, version=3),
        "controller": tiny_fmu(folder / "controller.fmu", *CONTROLLER),
    }


def system(fmus: dict[str, Path], links: tuple[ScaledLink, ...] = LINKS, **values: float) -> FmuSystem:
    start = {"controller": {name: StartValue(x) for name, x in values.items()}}
    members = {name: FmuComponent(name, path, {}, start.get(name, {})) for name, path in fmus.items()}
    return FmuSystem("toy", members, links)


def rows_of(
    toy: FmuSystem, order: Order = "sequential", ticks: int = 4, events: Sequence[Event] = ()
) -> dict[str, list[float]]:
    """All signals over some ticks."""
    chunks: list[dict[str, Array]] = []
    with Simulation(toy, {}, order) as simulation:
        simulation.run(events, duration=0.04 * (ticks - 1), record=lambda _, values: chunks.append(values))
        return {
            f"{name}.{column.name}": np.concatenate([values[name] for values in chunks])[:, i].tolist()
            for name in simulation.components
            for i, column in enumerate(simulation.columns(name))
        }


def test_sequential_only_the_plant_delays(fmus: dict[str, Path]) -> None:
    # given x0 = 1; within a tick the command is 2 x, so x+ = x + 2 x
    rows = rows_of(system(fmus))
    # then each row holds the plant's output at t_k and the others' answer to it
    assert rows["plant.y"] == [1, 3, 9, 27]
    assert rows["filter.u"] == [1, 3, 9, 27]
    assert rows["filter.y"] == [2, 6, 18, 54]
    assert rows["controller.y"] == [2, 6, 18, 54]
    assert rows["plant.u"] == [2, 6, 18, 54]


def test_jacobi_every_link_delays_one_tick(fmus: dict[str, Path]) -> None:
    # given exchange all, then step all, in plain Python
    x, f, c = 1.0, 0.0, 0.0
    expected = []
    for _ in range(8):
        into_filter, into_controller, into_plant = x, f, c
        f, c = 2 * into_filter, into_controller
        expected.append((x, into_filter, f, into_controller, c, into_plant))
        x += into_plant
    # when
    rows = rows_of(system(fmus), "jacobi", ticks=8)
    # then
    names = ("plant.y", "filter.u", "filter.y", "controller.u", "controller.y", "plant.u")
    assert list(zip(*(rows[name] for name in names), strict=True)) == expected
    assert rows["plant.y"] == [1, 1, 1, 3, 5, 7, 13, 23]


def test_time_is_a_multiple_and_rows_come_in_whole(fmus: dict[str, Path]) -> None:
    # given 161 ticks: batches of 25, 75 and 61, or more of 25 if they take long
    times: list[float] = []
    with Simulation(system(fmus)) as simulation:
        outcome = simulation.run(duration=6.4, record=lambda t, v: times.extend(t.tolist()))
    assert times == [k * 0.04 for k in range(161)]
    assert (outcome.ticks, outcome.time, outcome.stopped_by) == (161, 160 * 0.04, None)


@pytest.mark.parametrize(("seconds", "expected"), [(1.0, [25] * 6 + [11]), (0.0, [25, 75, 61])])
def test_rows_are_handed_over_a_second_at_a_time_and_longer_where_the_loop_is_fast(
    fmus: dict[str, Path], monkeypatch: pytest.MonkeyPatch, seconds: float, expected: list[int]
) -> None:
    # given a clock that goes on by so much from one batch to the next
    moments = count()
    monkeypatch.setattr("harness.cosim.loop.clock", lambda: next(moments) * seconds)
    batches: list[int] = []
    # when
    with Simulation(system(fmus)) as simulation:
        simulation.run(duration=6.4, record=lambda t, v: batches.append(len(t)))
    # then
    assert batches == expected


def test_it_stops_with_a_row_for_the_tick_that_stops_it(fmus: dict[str, Path]) -> None:
    rows: list[float] = []
    with Simulation(system(fmus)) as simulation:
        stop = Stop("controller", "n", frozenset({7}))
        outcome = simulation.run(stop=stop, record=lambda t, v: rows.extend(v["controller"][:, -1]))
    assert outcome.stopped_by == 7
    assert outcome.time == pytest.approx(6 * 0.04)
    assert rows == [1, 2, 3, 4, 5, 6, 7]


def test_events_act_from_the_first_tick_at_or_after_their_time(fmus: dict[str, Path]) -> None:
    # given 0.05 s lies between tick 1 and tick 2, 0.12 s is tick 3
    events = [Event(0.12, "controller", "offset", 0.5), Event(0.05, "controller", "offset", -1.0)]
    rows = rows_of(system(fmus), ticks=5, events=events)
    assert rows["controller.offset"] == [0, 0, -1, 0.5, 0.5]


def test_events_of_one_tick_act_together(fmus: dict[str, Path]) -> None:
    # given two values for one input at one time, and another one tick later
    events = [Event(t, "controller", "offset", x) for t, x in ((0.04, 1.0), (0.04, 2.0), (0.08, 3.0))]
    rows = rows_of(system(fmus), ticks=4, events=events)
    assert rows["controller.offset"] == [0, 2, 3, 3]


def test_conversion_and_types_on_the_way(fmus: dict[str, Path]) -> None:
    # given y in other units: 0.5 y + 10
    links = (ScaledLink("plant", "y", "filter", "u", 0.5, 10.0), *LINKS[1:])
    rows = rows_of(system(fmus, links), ticks=2)
    assert rows["filter.u"] == [10.5, 10.5 + 21 / 2]
    assert rows["plant.y"] == [1, 22]


def test_start_values_of_the_package_hold(fmus: dict[str, Path]) -> None:
    assert rows_of(system(fmus, offset=3.0), ticks=2)["controller.y"] == [5, 15]


def test_only_free_inputs_can_be_set(fmus: dict[str, Path]) -> None:
    for variable, text in (
        ("u", "controller.u is connected; only free inputs can be set"),
        ("offste", 'controller.offste is not an input; did you mean "offset"?'),
    ):
        with Simulation(system(fmus)) as simulation, pytest.raises(ParameterError) as caught:
            simulation.run([Event(0.0, "controller", variable, 1.0)])
        assert str(caught.value) == text


def test_ctrl_c_at_any_moment_keeps_every_tick_that_was_finished(
    fmus: dict[str, Path], tmp_path: Path
) -> None:
    # given a controller that counts its ticks, and a user who ends runs at random moments
    path, dice, interrupts = tmp_path / "a.mcap", random.Random(1), 0
    counts = Channel("controller", "toy", ("n",), ("",), ("Integer",), ("ticks so far",))
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        for _ in range(40):
            with (
                suppress(KeyboardInterrupt),
                Simulation(system(fmus, LINKS[:2])) as simulation,
                LogWriter(path, [counts], origin=(0, 0), metadata={}, attachments={}) as log,
            ):
                column = [q.name for q in simulation.columns("controller")].index("n")
                (integers,) = [values for names, values in simulation.outputs("controller") if "n" in names]

                def record(times: Array, values: dict[str, Array]) -> None:
                    log.write_rows(times, {"controller": values["controller"][:, [column]]})  # noqa: B023

                signal.setitimer(signal.ITIMER_REAL, dice.uniform(0.001, 0.03))
                try:
                    simulation.run(duration=1e4, record=record)
                finally:
                    finished = int(integers[0])
                pytest.fail("the run was not interrupted")
            # then the log has each tick once, up to the last one that the controller finished
            if not path.exists():
                assert finished <= 1
                continue
            interrupts += 1
            back = read_log(path)
            assert back["controller.n"].tolist() == list(range(1, len(back.time) + 1))
            assert np.array_equal(np.rint(back.time / 0.04), np.arange(len(back.time)))
            assert len(back.time) in (finished - 1, finished)  # a tick may end before its row is copied
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert interrupts > 20
