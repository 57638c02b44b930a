"""Components with steps of their own: 1 ms and 0.2 s beside the tick of 0.04 s."""

import re
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from harness.cosim.fmu import Fault, FmuError, describe
from harness.cosim.loop import Array, Outcome, Simulation, Stop
from harness.cosim.recorder import Position
from harness.cosim.ssp import FmuComponent, FmuSystem, ScaledLink
from harness.cosim.stepping import Event, Limits, Loop, Order
from harness.cosim.worker.contained import Contained
from models.errors import WiringError
from tests.harness.cosim.tiny_fmu import V, strict, tiny_fmu

LINK = ScaledLink
LOOPS: tuple[Loop, ...] = get_args(Loop)
COUNTS = [V("u", "input"), V("y"), V("n", type="Integer")]


def component(
    path: Path, step: str, size: float, *, version: int = 2, depends: bool = True, start: str = ""
) -> Path:
    """An FMU that takes steps of one size only; its n counts them."""
    return tiny_fmu(
        path,
        COUNTS,
        strict(size) + step,
        version=version,
        depends=depends,
        start=start,
        step_size=size,
        fixed=True,
    )


@pytest.fixture(scope="module", params=[2, 3])
def fmus(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Plants whose y grows by u on each step, and components that answer 3 - u."""
    folder, version = tmp_path_factory.mktemp(f"fmi{request.param}"), request.param
    built = {"same": component(folder / "same.fmu", "v[1] = v[0];", 0.04, version=version)}
    for size in (0.001, 0.2):
        path, grow = folder / f"plant_{size}.fmu", "v[1] += v[0];"
        built[path.stem] = component(path, grow, size, version=version, depends=False, start="v[1] = 1;")
    for size in (0.01, 0.04, 0.2):
        path = folder / f"answer_{size}.fmu"
        built[path.stem] = component(path, "v[1] = 3 - v[0];", size, version=version)
    return built


def loop_of(plant: Path, same: Path, controller: Path) -> FmuSystem:
    """The plant's y through `same` to the controller, and its answer back."""
    parts = {"plant": plant, "same": same, "controller": controller}
    links = (
        LINK("plant", "y", "same", "u"),
        LINK("same", "y", "controller", "u"),
        LINK("controller", "y", "plant", "u"),
    )
    return FmuSystem("toy", {name: FmuComponent(name, path) for name, path in parts.items()}, links)


Rows = dict[str, list[float]]


def run(
    system: FmuSystem,
    loop: Loop,
    order: Order = "sequential",
    *,
    ticks: int = 12,
    events: Sequence[Event] = (),
    stop: Stop | None = None,
) -> tuple[Outcome, Rows]:
    """All signals over some ticks."""
    chunks: list[dict[str, Array]] = []
    with Simulation(system, {}, order, loop=loop) as simulation:
        outcome = simulation.run(
            events, duration=0.04 * (ticks - 1), stop=stop, record=lambda _, values: chunks.append(values)
        )
        names = [(name, i, q) for name in system.components for i, q in enumerate(simulation.columns(name))]
    rows = {f"{n}.{q.name}": np.concatenate([c[n] for c in chunks])[:, i].tolist() for n, i, q in names}
    return outcome, rows


@pytest.mark.parametrize("loop", LOOPS)
def test_a_plant_of_1_ms_makes_40_steps_a_tick_and_a_controller_of_200_ms_one_in_5(
    fmus: dict[str, Path], loop: Loop
) -> None:
    system = loop_of(fmus["plant_0.001"], fmus["same"], fmus["answer_0.2"])
    _, rows = run(system, loop)
    # then the controller's answers on ticks 0, 5 and 10 are held, and y grows by 40 u a tick
    assert rows["plant.y"] == [1, 81, 161, 241, 321, 401, -15519, -31439, -47359, -63279, -79199, 3088881]
    assert rows["same.y"] == rows["plant.y"]
    assert rows["controller.u"] == [1] * 5 + [401] * 5 + [-79199] * 2
    assert rows["controller.y"] == [2] * 5 + [-398] * 5 + [79202] * 2
    assert rows["plant.u"] == rows["controller.y"]
    assert rows["plant.n"] == [40 * k for k in range(12)]
    assert rows["controller.n"] == [1] * 5 + [2] * 5 + [3] * 2


@pytest.mark.parametrize("loop", LOOPS)
def test_in_jacobi_order_a_controller_of_200_ms_is_heard_when_its_step_has_ended(
    fmus: dict[str, Path], loop: Loop
) -> None:
    system = loop_of(fmus["plant_0.001"], fmus["same"], fmus["answer_0.2"])
    _, rows = run(system, loop, "jacobi")
    # then its answer to the 0 of tick 0 moves the plant from tick 5 on, to the 1 of tick 5 from tick 10 on
    assert rows["controller.u"] == [0] * 5 + [1] * 5 + [481] * 2
    assert rows["plant.u"] == [0] * 5 + [3] * 5 + [2] * 2
    assert rows["plant.y"] == [1] * 6 + [121, 241, 361, 481, 601, 681]
    assert rows["same.y"] == rows["plant.y"]
    # and, as all answers in this order, it is in the row before
    assert rows["controller.y"] == [0] * 4 + [3] * 5 + [2] * 3


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("order", ["sequential", "jacobi"])
def test_a_plant_of_200_ms_shows_its_outputs_when_its_step_has_ended(
    fmus: dict[str, Path], loop: Loop, order: Order
) -> None:
    # given a controller that answers 3 - y on each tick; in jacobi order to the y of the tick before
    system = loop_of(fmus["plant_0.2"], fmus["same"], fmus["answer_0.04"])
    _, rows = run(system, loop, order)
    # then
    if order == "sequential":
        assert rows["plant.u"] == [2] * 5 + [0] * 5 + [0] * 2
        assert rows["plant.y"] == [1] * 5 + [3] * 5 + [3] * 2
        assert rows["controller.y"] == [2] * 5 + [0] * 7
    else:
        assert rows["plant.u"] == [0] * 5 + [2] * 5 + [2] * 2
        assert rows["plant.y"] == [1] * 10 + [3] * 2
        assert rows["controller.y"] == [3] + [2] * 10 + [0]
    assert rows["plant.n"] == [0] * 5 + [1] * 5 + [2] * 2
    assert rows["controller.n"] == [*range(1, 13)]


@pytest.mark.parametrize("loop", LOOPS)
def test_an_answer_of_several_steps_is_there_in_the_same_tick(fmus: dict[str, Path], loop: Loop) -> None:
    _, rows = run(loop_of(fmus["plant_0.2"], fmus["same"], fmus["answer_0.01"]), loop)
    assert rows["controller.y"] == [2] * 5 + [0] * 7
    assert rows["controller.n"] == [4 * k for k in range(1, 13)]


@pytest.mark.parametrize("order", ["sequential", "jacobi"])
@pytest.mark.parametrize(("plant", "controller"), list(product((0.001, 0.2), (0.01, 0.04, 0.2))))
def test_both_loops_give_the_same_bits(
    fmus: dict[str, Path], order: Order, plant: float, controller: float
) -> None:
    # given a conversion to thirds on the way, which is made on the ticks of its target
    system = loop_of(fmus[f"plant_{plant}"], fmus["same"], fmus[f"answer_{controller}"])
    links = (*system.links[:2], LINK("controller", "y", "plant", "u", 1 / 3, 0.1))
    system = FmuSystem("toy", system.components, links)
    # when
    (native, python) = (run(system, loop, order, ticks=153) for loop in LOOPS)
    # then
    assert native == python


@pytest.mark.parametrize("order", ["sequential", "jacobi"])
def test_values_are_as_old_as_the_wiring_says(tmp_path: Path, order: Order) -> None:
    # given plants and others with steps of 1, 4 and 6 ticks that tell when their last step began
    sizes = {f"{kind}{ticks}": ticks for kind in ("plant", "other") for ticks in (1, 4, 6)}
    parts = {
        name: FmuComponent(
            name,
            component(
                tmp_path / f"{name}.fmu", "v[1] = t;", 0.04 * n, depends=name[0] == "o", start="v[1] = -1;"
            ),
        )
        for name, n in sizes.items()
    }
    for source, target in product(sizes, ("other1", "other4", "plant6")):
        if source == target:
            continue
        members = {name: parts[name] for name in (source, target)}
        system = FmuSystem("toy", members, (LINK(source, "y", target, "u"),), tick=0.04)
        # when
        _, rows = run(system, "native", order, ticks=61)
        with Simulation(system, {}, order) as simulation:
            ((_, delay),) = simulation.wiring.delays
        # then
        begins = range(12, 61, sizes[target])
        ages = {round(tick - rows[f"{target}.u"][tick] / 0.04) for tick in begins}
        assert (min(ages), max(ages)) == (delay.least, delay.most)


def test_steps_of_foreign_fmus_alone_make_the_shortest_the_tick(fmus: dict[str, Path]) -> None:
    # given a plant of 1 ms and a controller of 0.2 s, and nothing of 0.04 s
    parts = {name: FmuComponent(name, fmus[name]) for name in ("plant_0.001", "answer_0.2")}
    links = (LINK("plant_0.001", "y", "answer_0.2", "u"), LINK("answer_0.2", "y", "plant_0.001", "u"))
    with Simulation(FmuSystem("toy", parts, links)) as simulation:
        assert simulation.wiring.step == 0.001
        assert [str(delay) for _, delay in simulation.wiring.delays] == ["1 tick", "0 to 199 ticks"]
        assert simulation.run(duration=1.0) == Outcome(1001, 1.0, None)


@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_that_varies_its_steps_takes_ticks(tmp_path: Path, version: int) -> None:
    # given one that prefers 1 ms, which it can vary, beside one of 0.2 s
    free = tiny_fmu(tmp_path / "free.fmu", COUNTS, strict(0.04), version=version, step_size=0.001)
    slow = component(tmp_path / "slow.fmu", "", 0.2, version=version)
    parts = {"free": FmuComponent("free", free), "slow": FmuComponent("slow", slow)}
    # when
    _, rows = run(FmuSystem("toy", parts, (), tick=0.04), "native")
    # then
    assert rows["free.n"] == [*range(1, 13)]
    assert rows["slow.n"] == [1] * 5 + [2] * 5 + [3] * 2


def test_the_internal_step_of_an_fmi_3_unit_counts_before_its_preferred_one(tmp_path: Path) -> None:
    inner = tiny_fmu(
        tmp_path / "inner.fmu", COUNTS, strict(0.008), version=3, step_size=0.04, fixed=True, internal=0.008
    )
    _, rows = run(FmuSystem("toy", {"inner": FmuComponent("inner", inner)}, (), tick=0.04), "native")
    assert rows["inner.n"] == [5 * k for k in range(1, 13)]


# ends, events and faults


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("ticks", [1, 4, 5, 6, 10])
def test_a_run_may_end_within_the_step_of_a_slow_component(
    fmus: dict[str, Path], loop: Loop, ticks: int
) -> None:
    outcome, rows = run(loop_of(fmus["plant_0.2"], fmus["same"], fmus["answer_0.2"]), loop, ticks=ticks)
    assert outcome == Outcome(ticks, (ticks - 1) * 0.04, None)
    assert rows["plant.n"] == [k // 5 for k in range(ticks)]
    assert rows["controller.n"] == [k // 5 + 1 for k in range(ticks)]


@pytest.mark.parametrize("loop", LOOPS)
def test_a_slow_component_stops_the_run_on_the_tick_of_its_answer(fmus: dict[str, Path], loop: Loop) -> None:
    system = loop_of(fmus["plant_0.001"], fmus["same"], fmus["answer_0.2"])
    outcome, rows = run(system, loop, stop=Stop("controller", "n", frozenset({2})))
    assert outcome == Outcome(6, 5 * 0.04, 2)
    assert len(rows["plant.y"]) == 6


@pytest.mark.parametrize("loop", LOOPS)
def test_an_event_acts_from_the_next_step_of_a_slow_component_on(fmus: dict[str, Path], loop: Loop) -> None:
    # given a controller of 0.2 s whose input is free: values from ticks 1, 3 and 6 on
    parts = {name: FmuComponent(name, fmus[name]) for name in ("same", "answer_0.2")}
    events = [Event(tick * 0.04, "answer_0.2", "u", value) for tick, value in ((1, 7.0), (3, 8.0), (6, 9.0))]
    _, rows = run(FmuSystem("toy", parts, ()), loop, events=events)
    assert rows["answer_0.2.u"] == [0] * 5 + [8] * 5 + [9] * 2
    assert rows["answer_0.2.y"] == [3] * 5 + [-5] * 5 + [-6] * 2


def failing(folder: Path, version: int, what: str, *, size: float = 0.001) -> FmuSystem:
    """A component that does `what` in the step from t = 0.101 s, or the first later one."""
    bad = component(folder / "bad.fmu", f"if (t > 0.1005) {{ {what} }}", size, version=version)
    return FmuSystem("toy", {"bad": FmuComponent("bad", bad)}, (), tick=0.04)


@pytest.mark.parametrize(
    ("version", "what", "kind", "text"),
    [
        (2, "return 3;", "status", "fmi2DoStep returned error"),
        (3, "return 3;", "status", "fmi3DoStep returned error"),
        (3, "v[31] = 1;", "ended", "asks to end the simulation"),
        (3, "v[29] = 1;", "event", "asks for an event"),
        (3, "v[30] = 1;", "early", "fmi3DoStep returned early"),
        (3, "v[26] = 1e-6;", "early", "fmi3DoStep returned early"),
    ],
)
def test_a_fault_within_a_tick_has_the_time_of_its_step(
    tmp_path: Path, version: int, what: str, kind: str, text: str
) -> None:
    # given the 22nd of 40 steps in tick 2: 0.08 s + 21 ms
    system = failing(tmp_path, version, what)
    moment, call = 0.08 + 21 * 0.001, f"fmi{version}DoStep"
    # as a plant, which is stepped after the row of a tick, and as a component that is stepped before it
    for loop, plants in product(LOOPS, (list[str](), ["bad"])):
        with Simulation(system, plants=plants, loop=loop) as simulation:
            memory = bytearray(simulation.recorder_size(25))
            # when
            with pytest.raises(FmuError, match=rf"bad bad\.fmu: {text} at t = 0\.101 s") as caught:
                simulation.run(memory=memory)
            names = simulation.call_names
        # then the step, its time and the rows before it are known
        assert caught.value.fault == Fault(kind, "bad", "bad.fmu", call, moment)
        position = Position.from_buffer(memory)
        assert (position.tick, position.rows, position.time) == (2, 2 + len(plants), moment)
        assert names[position.call] == ("bad", call)


def test_no_step_is_made_after_one_that_asks_to_end(tmp_path: Path) -> None:
    # given a component that asks to end in the step from 0.101 s, and would fail in the next
    system = failing(tmp_path, 3, "if (v[31]) return 3; v[31] = 1;")
    for loop in LOOPS:
        with Simulation(system, loop=loop) as simulation, pytest.raises(FmuError, match="asks to end"):
            simulation.run()


def test_what_a_slow_plant_gives_is_not_finite_where_its_step_ends(tmp_path: Path) -> None:
    # given a step from 0.2 s to 0.4 s with a NaN at its end
    system = failing(tmp_path, 2, "v[1] = NAN;", size=0.2)
    for loop in LOOPS:
        with (
            Simulation(system, plants=["bad"], loop=loop) as simulation,
            pytest.raises(FmuError, match=r'output "y" is nan at t = 0\.4 s'),
        ):
            simulation.run()


def test_a_crash_within_a_tick_has_the_time_of_its_step(tmp_path: Path) -> None:
    system = failing(tmp_path, 2, "*(volatile int *)8 = 1;")
    described = {"bad": describe(system.components["bad"].fmu)}
    for loop in LOOPS:
        times: list[Array] = []
        with (
            pytest.raises(FmuError) as caught,
            Contained(system, described, plants=["bad"], loop=loop) as contained,
        ):
            contained.run(record=lambda moments, _, to=times: to.append(moments))  # type: ignore[misc]
        assert str(caught.value) == (
            "bad bad.fmu: fmi2DoStep ended the process at t = 0.101 s: segmentation fault"
        )
        assert np.concatenate(times).tolist() == [0, 0.04, 0.08]


def test_the_limit_for_a_call_is_for_each_step_of_a_tick(tmp_path: Path) -> None:
    # given 20 steps in a tick that take 0.15 s each, and 2 s for a call
    slow = component(
        tmp_path / "slow.fmu", "extern int usleep(unsigned); usleep(150000);", 0.002, depends=False
    )
    system = FmuSystem("toy", {"slow": FmuComponent("slow", slow)}, (), tick=0.04)
    with Contained(system, {"slow": describe(slow)}, limits=Limits(call=2.0)) as contained:
        assert contained.run(duration=0.04).ticks == 2


def test_a_step_that_fits_no_tick_is_refused_with_both_numbers(tmp_path: Path, fmus: dict[str, Path]) -> None:
    odd = component(tmp_path / "odd.fmu", "", 0.03)
    parts = {"same": FmuComponent("same", fmus["same"]), "odd": FmuComponent("odd", odd)}
    text = (
        "odd odd.fmu has a fixed step of 0.03 s; expected a whole multiple or fraction of the tick of 0.04 s "
        "of our blocks: export it with 0.02 or 0.04 s"
    )
    with pytest.raises(WiringError, match=f"^{re.escape(text)}$"):
        Simulation(FmuSystem("toy", parts, ()))
