"""Components that are not stepped for a while."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from harness.cosim.fmu import FmuError, describe
from harness.cosim.loop import Array, Simulation
from harness.cosim.ssp import FmuComponent, FmuSystem, ScaledLink
from harness.cosim.stepping import Event, Loop, Order, Ticks, whole_steps
from harness.cosim.worker.contained import Contained
from tests.harness.cosim.tiny_fmu import V, strict, tiny_fmu

LOOPS: tuple[Loop, ...] = get_args(Loop)
ORDERS: tuple[Order, ...] = get_args(Order)
SEEN = [V("u", "input"), V("y"), V("n", type="Integer"), V("now"), V("w", "input")]
STEPS = (0.001, 0.04, 0.2)  # s
Rows = dict[str, list[float]]


def component(path: Path, size: float, *, version: int, depends: bool) -> Path:
    """An FMU whose y grows by u + w on each step; it fails if a step does not begin where the last one ended.

    Its n counts the steps, and its `now` is the time with which the last one began.
    """
    step = "if (v[2] == 0) v[20] = t; " + strict(size) + "v[1] += v[0] + v[4]; v[3] = t;"
    start = "v[1] = 1;" if not depends else ""
    return tiny_fmu(
        path, SEEN, step, version=version, depends=depends, start=start, step_size=size, fixed=True
    )


@pytest.fixture(scope="module", params=[2, 3])
def fmus(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A plant, whose y is 1 at first, and what answers, by step."""
    folder = tmp_path_factory.mktemp(f"fmi{request.param}")
    return {
        f"{name} {size}": component(
            folder / f"{name}_{size}.fmu", size, version=request.param, depends=name == "answer"
        )
        for name in ("plant", "answer")
        for size in STEPS
    }


def toy(
    fmus: dict[str, Path],
    stalls: dict[str, Ticks],
    *,
    plant: float = 0.04,
    answer: float = 0.04,
    start: float = 0.0,
) -> FmuSystem:
    """A plant that grows by w = 1, `answer`, which sums its y up, and `after`, which sums that up.

    Args:
        plant, answer: their steps, s.
        start: of the package, s.
    """
    parts = {"plant": f"plant {plant}", "answer": f"answer {answer}", "after": "answer 0.04"}
    links = (ScaledLink("plant", "y", "answer", "u"), ScaledLink("answer", "y", "after", "u"))
    components = {name: FmuComponent(name, fmus[part]) for name, part in parts.items()}
    spans = {name: (span,) for name, span in stalls.items()}
    return FmuSystem("toy", components, links, start_time=start, tick=0.04, stalls=spans)


def run(
    system: FmuSystem,
    loop: Loop = "native",
    order: Order = "sequential",
    *,
    ticks: int = 8,
    events: Sequence[Event] = (),
) -> Rows:
    """All signals over some ticks."""
    chunks: list[dict[str, Array]] = []
    values = {"plant": {"w": 1.0}}
    with Simulation(system, values, order, loop=loop) as simulation:
        assert simulation.notes == []
        simulation.run(events, duration=0.04 * (ticks - 1), record=lambda _, values: chunks.append(values))
        names = [(name, i, q) for name in system.components for i, q in enumerate(simulation.columns(name))]
    return {f"{n}.{q.name}": np.concatenate([c[n] for c in chunks])[:, i].tolist() for n, i, q in names}


@pytest.mark.parametrize("loop", LOOPS)
def test_what_answers_holds_its_outputs_and_goes_on_from_where_it_was(
    fmus: dict[str, Path], loop: Loop
) -> None:
    # given sums of 1, 2, 3, ... that are not made on the ticks 3, 4 and 5
    rows = run(toy(fmus, {"answer": (3, 6)}), loop)
    # then
    assert rows["plant.y"] == [1, 2, 3, 4, 5, 6, 7, 8]
    assert rows["answer.u"] == [1, 2, 3, 3, 3, 3, 7, 8]
    assert rows["answer.y"] == [1, 3, 6, 6, 6, 6, 13, 21]
    assert rows["answer.n"] == [1, 2, 3, 3, 3, 3, 4, 5]
    # and what reads it goes on meanwhile
    assert rows["after.y"] == [1, 4, 10, 16, 22, 28, 41, 62]


@pytest.mark.parametrize("loop", LOOPS)
def test_in_jacobi_order_its_readers_see_that_a_tick_later(fmus: dict[str, Path], loop: Loop) -> None:
    rows = run(toy(fmus, {"answer": (3, 6)}), loop, "jacobi")
    assert rows["answer.y"] == [1, 3, 6, 6, 6, 6, 13, 21]
    assert rows["after.u"] == [0, 1, 3, 6, 6, 6, 6, 13]


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("order", ORDERS)
def test_a_plant_stays_where_it_was_on_the_first_tick_of_the_stall(
    fmus: dict[str, Path], loop: Loop, order: Order
) -> None:
    rows = run(toy(fmus, {"plant": (3, 6)}), loop, order)
    assert rows["plant.y"] == [1, 2, 3, 4, 4, 4, 4, 5]
    assert rows["plant.n"] == [0, 1, 2, 3, 3, 3, 3, 4]


@pytest.mark.parametrize("loop", LOOPS)
def test_a_stall_from_the_start_holds_the_outputs_of_the_start(fmus: dict[str, Path], loop: Loop) -> None:
    rows = run(toy(fmus, {"answer": (0, 2), "plant": (0, 1)}), loop)
    assert rows["plant.y"] == [1, 1, 2, 3, 4, 5, 6, 7]
    assert rows["answer.u"] == [0, 0, 2, 3, 4, 5, 6, 7]
    assert rows["answer.y"] == [0, 0, 2, 5, 9, 14, 20, 27]


@pytest.mark.parametrize("loop", LOOPS)
def test_all_steps_of_a_tick_are_left_out(fmus: dict[str, Path], loop: Loop) -> None:
    rows = run(toy(fmus, {"plant": (3, 6)}, plant=0.001), loop)
    assert rows["plant.y"] == [1, 41, 81, 121, 121, 121, 121, 161]


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize(
    ("span", "counts"),
    [
        ((4, 6), [1] * 10 + [2] * 5 + [3]),  # the step of tick 5 is left out
        ((1, 5), [1] * 5 + [2] * 5 + [3] * 5 + [4]),  # none begins
        ((0, 11), [0] * 15 + [1]),  # those of 0, 5 and 10
    ],
)
def test_of_a_slow_component_whole_steps_are_left_out(
    fmus: dict[str, Path], loop: Loop, span: Ticks, counts: list[int]
) -> None:
    assert run(toy(fmus, {"answer": span}, answer=0.2), loop, ticks=16)["answer.n"] == counts


@pytest.mark.parametrize("loop", LOOPS)
def test_a_slow_plant_ends_the_step_that_is_under_way(fmus: dict[str, Path], loop: Loop) -> None:
    # given a step that begins on tick 5 and is over on tick 10, within the stall that leaves out that of 10
    rows = run(toy(fmus, {"plant": (7, 12)}, plant=0.2), loop, ticks=21)
    assert rows["plant.y"] == [1] * 5 + [2] * 5 + [3] * 10 + [4]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("size", STEPS)
def test_the_time_that_an_fmu_gets_has_no_gap_and_both_loops_give_the_same_bits(
    fmus: dict[str, Path], order: Order, size: float
) -> None:
    # given components that begin at 0.1 s and stall, one of them three times
    plain = toy(fmus, {}, plant=size, answer=size, start=0.1)
    stalls = {"plant": ((10, 15),), "answer": ((41, 60), (5, 20), (20, 25))}
    # when
    native, python = (run(replace(plain, stalls=stalls), loop, order, ticks=100) for loop in LOOPS)
    whole = run(plain, "native", order, ticks=100)
    # then each has had the times of one that goes on, later; a slow one stalls on the ticks 5 to 24, 45 to 59
    assert native == python
    for name, late in (("plant", 5), ("answer", 35 if size == 0.2 else 39)):
        assert native[f"{name}.now"][70:] == whole[f"{name}.now"][70 - late : -late]
    assert native["after.now"] == whole["after.now"]


@pytest.mark.parametrize("loop", LOOPS)
def test_an_input_that_is_set_meanwhile_is_taken_after_the_stall(fmus: dict[str, Path], loop: Loop) -> None:
    events = [
        Event(0.16, "answer", "w", 5.0),
        Event(0.2, "answer", "w", 100.0),
        Event(0.28, "answer", "w", 0),
    ]
    rows = run(toy(fmus, {"answer": (3, 6)}), loop, events=events)
    assert rows["answer.w"] == [0, 0, 0, 0, 0, 0, 100, 0]
    assert rows["answer.y"] == [1, 3, 6, 6, 6, 6, 113, 121]


def test_in_a_worker_it_is_the_same(fmus: dict[str, Path]) -> None:
    # given
    system, chunks = toy(fmus, {"answer": (3, 6)}, plant=0.001), []
    own = run(system)
    described = {name: describe(part.fmu) for name, part in system.components.items()}
    # when
    with Contained(system, described, {"plant": {"w": 1.0}}) as contained:
        contained.run(duration=0.28, record=lambda _, values: chunks.append(values["answer"]))
    # then
    columns = [own[f"answer.{q.name}"] for q in contained.columns("answer")]
    assert np.concatenate(chunks).T.tolist() == columns


@pytest.mark.parametrize("loop", LOOPS)
def test_an_error_after_a_stall_has_the_time_of_the_trial(tmp_path: Path, loop: Loop) -> None:
    fails = tiny_fmu(tmp_path / "a.fmu", [V("y")], "if (t > 0.11) return 3;", depends=True)
    system = FmuSystem("one", {"a": FmuComponent("a", fails)}, (), stalls={"a": ((1, 5),)})
    with Simulation(system, loop=loop) as simulation, pytest.raises(FmuError, match=r"at t = 0\.28 s"):
        simulation.run(duration=1.0)


def test_spans_become_whole_steps_apart_and_in_order() -> None:
    assert whole_steps([(7, 9), (0, 2), (1, 4), (4, 6), (8, 8)], 1) == ((0, 6), (7, 9))
    assert whole_steps([(6, 9), (1, 5), (11, 12), (14, 16)], 5) == ((15, 20),)
    assert whole_steps([(0, 1), (5, 6), (12, 31)], 5) == ((0, 10), (15, 35))
