"""The loop in C against its reference in Python: the same rows, errors and ends."""

import ctypes
import math
import platform
import signal
import time
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import pytest

from codegen.toolchains.compiler import CompileError
from harness.cosim import walk
from harness.cosim.fmu import Call, Clock, Fault, FmuError, FmuInstance
from harness.cosim.layout import OUTSIDE, Cast, Conversion, Replacement
from harness.cosim.loop import Array, Outcome, Simulation, Stop
from harness.cosim.recorder import Recorder
from harness.cosim.ssp import FmuComponent, FmuSystem, ScaledLink
from harness.cosim.stepping import Event, Loop, Order
from harness.cosim.walk import Guard, Native, NativeWalk, Walk
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

# plant: x+ = 0.7 x + u, and its single precision twin; controller: y = -x / 3 + offset, n counts
PLANT = [V("u", "input"), V("x"), V("half", type="Float32")]
CONTROLLER = [V("x", "input"), V("offset", "input"), V("y"), V("n", type="Integer"), V("odd", type="Boolean")]
LINKS = (ScaledLink("plant", "x", "controller", "x"), ScaledLink("controller", "y", "plant", "u"))
EVENTS = (Event(0.1, "controller", "offset", 0.5), Event(1.0, "controller", "offset", -0.25))


def toy(
    folder: Path,
    *,
    plant: str = "",
    controller: str = "",
    links: tuple[ScaledLink, ...] = LINKS,
    variables: Sequence[V] = PLANT,
) -> FmuSystem:
    """The closed loop; `plant` and `controller` are more C for their steps, `variables` the plant's."""
    paths = {
        "controller": tiny_fmu(
            folder / "controller.fmu",
            CONTROLLER,
            f"v[2] = -v[0] / 3 + v[1]; v[3] += 1; v[4] = (int)v[3] % 2; {controller}",
        ),
        "plant": tiny_fmu(
            folder / "plant.fmu",
            variables,
            f"v[1] = 0.7 * v[1] + v[0]; v[2] = v[1] / 2; {plant}",
            version=3,
            depends=False,
            start="v[1] = 0.1;",
        ),
    }
    return FmuSystem("toy", {name: FmuComponent(name, path) for name, path in paths.items()}, links)


Run = tuple[Outcome | str, list[float], dict[str, Array]]


def run(
    system: FmuSystem,
    *,
    loop: Loop,
    order: Order = "sequential",
    stop: Stop | None = None,
    events: Sequence[Event] = EVENTS,
) -> Run:
    """How it ended, and all rows."""
    times: list[float] = []
    rows: dict[str, list[Array]] = {name: [] for name in system.components}

    def record(moments: Array, values: dict[str, Array]) -> None:
        times.extend(moments.tolist())
        for name, part in values.items():
            rows[name].append(part)

    with Simulation(system, {}, order, loop=loop) as simulation:
        try:
            end: Outcome | str = simulation.run(events, duration=2.4, stop=stop, record=record)
        except FmuError as error:
            end = str(error)
    return end, times, {name: np.concatenate(parts) for name, parts in rows.items()}


def assert_same(system: FmuSystem, *, order: Order = "sequential", stop: Stop | None = None) -> Run:
    """Both loops give the same; what they give."""
    reference = run(system, loop="python", order=order, stop=stop)
    native = run(system, loop="native", order=order, stop=stop)
    assert native[:2] == reference[:2]
    assert {n: v.tobytes() for n, v in native[2].items()} == {n: v.tobytes() for n, v in reference[2].items()}
    return native


@pytest.fixture
def only_c(monkeypatch: pytest.MonkeyPatch) -> None:
    """A loop in Python would fail."""

    def refuse(*_: object) -> None:
        raise AssertionError("the loop in Python")

    monkeypatch.setattr(Walk, "run", refuse)


@pytest.mark.parametrize("order", ["sequential", "jacobi"])
def test_both_loops_give_the_same_rows(tmp_path: Path, order: Order) -> None:
    end, times, rows = assert_same(toy(tmp_path), order=order)
    assert end == Outcome(61, 60 * 0.04, None)
    assert times == [k * 0.04 for k in range(61)]
    # and the events acted on the ticks 3 and 25
    assert np.unique(rows["controller"][:, 1], return_index=True)[1].tolist() == [25, 0, 3]


@pytest.mark.usefixtures("only_c")
def test_functions_of_c_are_called_from_c(tmp_path: Path) -> None:
    assert run(toy(tmp_path), loop="native")[0] == Outcome(61, 60 * 0.04, None)
    with pytest.raises(AssertionError, match="the loop in Python"):
        run(toy(tmp_path), loop="python")


@pytest.mark.usefixtures("only_c")
def test_a_conversion_on_the_way_is_made_in_c(tmp_path: Path) -> None:
    # given a controller that takes 2 x + 1 of the plant, and its double precision half in single precision
    links = (ScaledLink("plant", "x", "controller", "x", 2.0, 1.0), LINKS[1])
    # when
    _, _, rows = run(toy(tmp_path, links=links), loop="native")
    # then
    x = rows["plant"][:, 1]
    assert rows["controller"][:, 0].tolist() == (2.0 * x + 1.0).tolist()


CONVERTED = (
    ScaledLink("plant", "half", "controller", "x", -1 / 3, 0.1),
    ScaledLink("controller", "y", "plant", "u", 0.7),
)
# n is an int32, which the plant takes as an int64, and as a Boolean of a byte
CAST_PLANT = [*PLANT, V("n", "input", "Int64"), V("odd", "input", "Boolean"), V("y", "input", "Float32")]
CAST = (
    ScaledLink("plant", "half", "controller", "x"),
    ScaledLink("controller", "y", "plant", "u"),
    ScaledLink("controller", "n", "plant", "n"),
    ScaledLink("controller", "odd", "plant", "odd"),
    ScaledLink("controller", "y", "plant", "y"),
)


@pytest.mark.parametrize("order", ["sequential", "jacobi"])
@pytest.mark.parametrize("links", [CONVERTED, CAST])
def test_both_loops_convert_to_the_same_bits(
    tmp_path: Path, order: Order, links: tuple[ScaledLink, ...]
) -> None:
    plant = CAST_PLANT if links is CAST else PLANT
    end, times, _ = assert_same(toy(tmp_path, links=links, variables=plant), order=order)
    assert end == Outcome(61, 60 * 0.04, None)
    assert len(times) == 61


REALS = [0.0, -0.0, 0.1, -2.5, 3.5, 1e-50, 1e300, -1e300, math.inf, math.nan]
TYPES = ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")


OUT = "out of range"


def carried(function: Cast, loop: type[Walk]) -> list[Any]:
    """The target after one tick that makes only this; [OUT] if a value does not fit."""

    def fail(status: int, call: Call) -> None:
        assert status == OUTSIDE
        assert call == (function, ())
        raise OverflowError

    function.target[:] = 77
    call = (function, ())
    alone = SimpleNamespace(
        answer=[call],
        advance=[],
        tick=[call],
        turns={},
        numbered=lambda: ([(0, call)], []),
        due=lambda numbered, tick: numbered,
        clock=Clock(),
        fail=fail,
    )
    nothing = SimpleNamespace(block=np.zeros(8, dtype=np.uint8), reals=list)
    options: dict[str, Any] = {} if loop is Walk else {"native": Native(cast(Any, alone))}
    stop = (np.zeros(1), frozenset[int]())
    try:
        loop(cast(Any, alone), cast(Any, nothing), 0.04, Recorder(8), stop, **options).run(0, 1, 0)
    except OverflowError:
        return [OUT]
    return [value.tobytes() for value in function.target]


def extremes(kind: str) -> npt.NDArray[Any]:
    """The numbers at which a type's conversion might go wrong."""
    if kind in ("float64", "float32"):
        with np.errstate(over="ignore"):
            return np.array(REALS).astype(kind)
    low, high = int(np.iinfo(kind).min), int(np.iinfo(kind).max)
    return np.array([low, low + 1, 0, 1, 7, 100, high // 2 + 1, high - 1, high], dtype=kind)


def fits(value: float, target: str) -> bool:
    """Does the type hold it, as near as may be?"""
    if target == "float64" or not math.isfinite(value):
        return True
    if target == "float32":
        return -(2.0**128) < value < 2.0**128
    span = 1 << int(target.lstrip("uint"))
    return 0 <= value < span if target[0] == "u" else -span <= 2 * value < span


@pytest.mark.parametrize(
    ("source", "target"), [*product(TYPES, TYPES), *product(("float64", "float32"), repeat=2)]
)
def test_both_loops_carry_the_extremes_of_every_type_alike(source: str, target: str) -> None:
    values = extremes(source)
    # those that fit are carried together, and each of the others ends the tick
    fitting = [place for place, value in enumerate(values.tolist()) if fits(value, target)]
    picked = np.array(fitting)[::-1].copy()
    goal = np.zeros(len(picked), dtype=target)
    with np.errstate(over="ignore"):
        expected = [value.tobytes() for value in values[picked].astype(target)]
    assert carried(Cast(goal, values, picked), NativeWalk) == expected
    assert carried(Cast(goal, values, picked), Walk) == expected
    for place in {*range(len(values))} - {*fitting}:
        alone = Cast(np.zeros(1, dtype=target), values, np.array([place]))
        assert carried(alone, NativeWalk) == carried(alone, Walk) == [OUT]
    picked = np.arange(len(values))
    goal = np.zeros(len(values), dtype=target)
    for factor, offset in [(1.0, 0.0), (-1.0, 0.5), (0.5, 0.0), (1e3, -1e-3), (1e300, 0.0)]:
        scale = np.full(len(values), factor), np.full(len(values), offset)
        conversion = Conversion(goal, values, picked, *scale)
        assert carried(conversion, NativeWalk) == carried(conversion, Walk)


@pytest.mark.parametrize(("source", "target"), [*product(TYPES, TYPES)])
def test_both_loops_replace_whole_numbers_by_their_tables_alike(source: str, target: str) -> None:
    # given a table for each second number: 7 becomes 1, 1 becomes 100, -1 becomes 0; others stay
    values = np.append(extremes(source), np.array([-1]).astype(source))  # -1, or the largest: the same bits
    table: dict[int, int] = {7: 1, 1: 100, -1: 0}
    tables = [table, {}] * 4 + [table] * 2
    replaced = [table.get(value, value) for value, table in zip(values.tolist(), tables, strict=True)]
    fitting = np.array([place for place, value in enumerate(replaced) if fits(value, target)])
    goal = np.zeros(len(fitting), dtype=target)
    # when
    replacement = Replacement(goal, values, fitting, [tables[place] for place in fitting])
    # then 1 and 7 lie at places with a table and without
    expected = np.array([replaced[place] for place in fitting], dtype=target)
    assert carried(replacement, Walk) == [value.tobytes() for value in expected]
    assert carried(replacement, NativeWalk) == carried(replacement, Walk)
    # and what stays and does not fit ends the tick
    for place in {*range(len(values))} - {*fitting.tolist()}:
        alone = Replacement(np.zeros(1, dtype=target), values, np.array([place]), [tables[place]])
        assert carried(alone, NativeWalk) == carried(alone, Walk) == [OUT]


@pytest.mark.parametrize("loop", [Walk, NativeWalk])
@pytest.mark.parametrize(("source", "target"), [("int32", "uint8"), ("int32", "int32"), ("uint8", "int32")])
def test_a_boolean_is_true_unless_it_is_0(loop: type[Walk], source: str, target: str) -> None:
    values = np.array([0, 1, 2, 128, 256, -256][: 6 if source == "int32" else 4], dtype=source)
    truth, places, kept = [False] + [True] * (len(values) - 1), np.arange(len(values)), {"is_boolean": True}
    goal, factor = np.zeros(len(values), dtype=target), np.full(len(values), -1.0)
    # when it is cast, negated by a table, or by 1 - x
    carried(Cast(goal, values, places, **kept), loop)
    assert goal.tolist() == truth
    carried(Replacement(goal, values, places, [{0: 1, 1: 0}] * len(values), **kept), loop)
    assert goal.tolist() == [not x for x in truth]
    carried(Conversion(goal, values, places, factor, -factor, **kept), loop)
    assert goal.tolist() == [not x for x in truth]


@pytest.mark.parametrize("order", ["sequential", "jacobi"])
def test_a_boolean_of_fmi_2_is_true_in_fmi_3_whatever_its_bits(tmp_path: Path, order: Order) -> None:
    # given a controller whose true is 256 on each second tick, and 0 on the others
    system = toy(tmp_path, links=CAST, variables=CAST_PLANT, controller="v[4] = v[4] != 0 ? 256 : 0;")
    # when
    _, _, rows = assert_same(system, order=order)
    # then the plant, which takes a byte, gets 1, and in jacobi order a tick later
    odd = rows["plant"][:6, 2].tolist()
    assert odd == {"sequential": [1, 0, 1, 0, 1, 0], "jacobi": [0, 1, 0, 1, 0, 1]}[order]


@pytest.mark.parametrize("order", ["sequential", "jacobi"])
@pytest.mark.parametrize(
    ("link", "goal", "text"),
    [
        (ScaledLink("plant", "n", "controller", "y"), "Int32",
         "5000000000 to {} -2147483648 to 2147483647 (int32)"),
        (ScaledLink("plant", "n", "controller", "y", table=((0, 7),)), "Int32",
         "5000000000 to {} -2147483648 to 2147483647 (int32)"),
        (ScaledLink("plant", "x", "controller", "y"), "Float32",
         "1e+300 to {} -3.402823466e+38 to 3.402823466e+38 (float32)"),
        (ScaledLink("plant", "x", "controller", "y", 2.0), "Float32",
         "2e+300 to {} -3.402823466e+38 to 3.402823466e+38 (float32)"),
    ],
)  # fmt: skip
def test_a_value_that_an_input_cannot_hold_ends_the_trial(
    tmp_path: Path, order: Order, link: ScaledLink, goal: str, text: str
) -> None:
    # given a plant that gives 5e9 and 1e300 from the end of the step at 0.4 s on, to an input of 32 bits
    step = "v[1] = t > 0.39 ? 1e300 : 0; v[0] = t > 0.39 ? 5e9 : 0;"
    outputs = [V("n", type="Int64"), V("x")]
    plant = tiny_fmu(tmp_path / "plant.fmu", outputs, step, version=3, depends=False)
    controller = tiny_fmu(tmp_path / "controller.fmu", [V("y", "input", goal)], version=3)
    paths = {"controller": controller, "plant": plant}
    system = FmuSystem("toy", {name: FmuComponent(name, path) for name, path in paths.items()}, (link,))
    ends = []
    for loop in ("native", "python"):
        with Simulation(system, {}, order, loop=loop) as simulation, pytest.raises(FmuError) as raised:
            simulation.run(duration=2.4)
        ends.append((str(raised.value), raised.value.fault))
    # then both loops say which output, what it gave and what it was given to
    output = f'output "{link.source_variable}"'
    text = f"plant plant.fmu: {output} gives {text.format('controller.y at t = 0.44 s; expected')}"
    assert ends[0] == ends[1] == (text, Fault("out of range", "plant", "plant.fmu", output, 0.44))


@pytest.mark.skipif(platform.machine() != "x86_64", reason="only x86 has a unit of its own for long double")
@pytest.mark.parametrize("loop", ["native", "python"])
def test_the_precision_of_long_doubles_is_restored_behind_each_call(tmp_path: Path, loop: Loop) -> None:
    # given a plant that asks for sums of single precision in the unit for long doubles, and nothing else
    asks = 'unsigned short word = 0x7F; __asm__ volatile("fldcw %0" : : "m"(word));'
    third = "volatile long double third = v[3] + 1; third /= 3; v[2] = third;"
    rows = []
    for name, step in (("quiet", ""), ("asking", asks)):
        (tmp_path / name).mkdir()
        system = toy(tmp_path / name, plant=step, controller=third)
        parts: list[Array] = []
        # when
        with Simulation(system, {}, loop=loop, guard=Guard()) as simulation:
            simulation.run(duration=0.4, record=lambda _, values: parts.append(values["controller"][:, 2]))  # noqa: B023
        rows.append(np.concatenate(parts).tolist())
    # then the controller's thirds are those beside a plant that leaves the unit alone
    assert rows[0][:3] == [2 / 3, 1.0, 4 / 3]
    assert rows[1] == rows[0]


def test_nothing_is_stepped_after_the_last_tick(tmp_path: Path) -> None:
    # given a plant that refuses the step which begins on the last tick, at 2.4 s
    end, times, _ = assert_same(toy(tmp_path, plant="if (t > 2.39) return 3;"))
    # then
    assert end == Outcome(61, 60 * 0.04, None)
    assert times[-1] == 60 * 0.04


@pytest.mark.parametrize("order", ["sequential", "jacobi"])
def test_a_table_on_the_way_replaces_whole_numbers(tmp_path: Path, order: Order) -> None:
    # given a plant that takes the controller's count, 2 in the place of 1 and -5 in the place of 3
    n = V("n", "input", "Int32")
    links = (*LINKS, ScaledLink("controller", "n", "plant", "n", table=((1, 2), (3, -5))))
    # when
    _, _, rows = assert_same(toy(tmp_path, links=links, variables=[*PLANT, n]), order=order)
    # then the rows of the plant have it in the same tick, or in jacobi order a tick later
    taken = rows["plant"][:, 1].astype(int).tolist()
    assert taken[:6] == {"sequential": [2, 2, -5, 4, 5, 6], "jacobi": [0, 2, 2, -5, 4, 5]}[order]


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("loop", ["native", "python"])
def test_fmus_begin_at_the_start_time_and_rows_at_zero(tmp_path: Path, version: int, loop: Loop) -> None:
    # given a plant that gives the time at the end of its step, and a start at 10.5 s
    clock = tiny_fmu(tmp_path / "clock.fmu", [V("now")], "v[0] = t + h;", version=version)
    system = FmuSystem("toy", {"clock": FmuComponent("clock", clock)}, (), start_time=10.5)
    # when
    end, times, rows = run(system, loop=loop, events=())
    # then
    assert end == Outcome(61, 60 * 0.04, None)
    assert times == [k * 0.04 for k in range(61)]
    assert rows["clock"][:, 0].tolist() == [0.0, *(10.5 + k * 0.04 + 0.04 for k in range(60))]


@pytest.mark.parametrize("version", [2, 3])
def test_an_error_tells_the_trial_s_time_whatever_the_start_time(tmp_path: Path, version: int) -> None:
    bad = tiny_fmu(tmp_path / "bad.fmu", [V("y")], "if (t > 10.99) return 3;", version=version)
    system = FmuSystem("toy", {"bad": FmuComponent("bad", bad)}, (), start_time=10.0)
    text = f"bad bad.fmu: fmi{version}DoStep returned error at t = 1 s"
    assert run(system, loop="native", events=())[0] == text
    assert run(system, loop="python", events=())[0] == text


@pytest.mark.parametrize("loop", [Walk, NativeWalk])
@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ("int8", [2, 4, -2, 127, -128, 127]),
        ("uint8", [2, 4, 0, 129, 0, 255]),
        # the largest double below 2^63 and 2^64
        ("int64", [2, 4, -2, 129, -200, 2**63 - 1024]),
        ("uint64", [2, 4, 0, 129, 0, 2**64 - 2048]),
    ],
)
def test_a_converted_whole_number_is_rounded_to_even_and_stays_within_its_type(
    loop: type[Walk], target: str, expected: list[int]
) -> None:
    # given 2.5, 3.5, -2.5, 129, -200 and 1e20
    source = np.array([5, 7, -5, 258, -400, 10**6], dtype=np.int32)
    goal = np.zeros(6, dtype=target)
    factor = np.array([0.5] * 5 + [1e14])
    # when
    carried(Conversion(goal, source, np.arange(6), factor, np.zeros(6)), loop)
    # then
    assert goal.tolist() == expected


@pytest.mark.parametrize("count", [1, 24, 25, 26, 50])
def test_both_loops_stop_on_the_same_tick(tmp_path: Path, count: int) -> None:
    stop = Stop("controller", "n", frozenset({-1, count}))
    end, times, _ = assert_same(toy(tmp_path), stop=stop)
    assert end == Outcome(count, (count - 1) * 0.04, count)
    assert len(times) == count


@pytest.mark.parametrize(
    ("plant", "controller", "text", "ticks"),
    [
        ("if (t > 0.39) return 3;", "", "plant.fmu: fmi3DoStep returned error at t = 0.4 s", 11),
        ("", "if (t > 0.39) return 3;", "controller.fmu: fmi2DoStep returned error at t = 0.4 s", 10),
        ("", "if (t > 0.97) v[2] = NAN;", 'output "y" is nan at t = 1 s; expected a finite number', 26),
        ("if (t > 0.97) v[2] = 1 / 0.0;", "", 'output "half" is inf at t = 1.04 s; expected a finite', 27),
        ("v[31] = t > 0.39;", "", "plant.fmu: asks to end the simulation at t = 0.4 s", 11),
        ("if (t > 0.39) return 2;", "", "plant.fmu: fmi3DoStep returned discard at t = 0.4 s", 11),
        ("", "if (t > 0.39) return 4;", "controller.fmu: fmi2DoStep returned fatal at t = 0.4 s", 10),
        ("", "if (t > 0.39) return 5;", "controller.fmu: fmi2DoStep returned pending at t = 0.4 s", 10),
        ("if (t > 0.39) return -7;", "", "fmi3DoStep returned the illegal status -7 at t = 0.4 s", 11),
        ("v[27] = 3 * (t > 0.39);", "", "plant.fmu: fmi3GetFloat64 of x returned error at t = 0.4 s", 11),
        ("v[28] = 3 * (t > 0.39);", "", "plant.fmu: fmi3SetFloat64 of u returned error at t = 0.44 s", 12),
        ("", "v[27] = 3 * (t > 0.39);", "fmi2GetReal of y returned error at t = 0.4 s", 10),
        ("", "v[28] = 3 * (t > 0.39);", "fmi2SetReal of x returned error at t = 0.44 s", 11),
        ('if (t > 0.39) { say("it bites"); return 3; }', "", 't = 0.4 s; it says: "it bites"', 11),
    ],
)  # fmt: skip
def test_a_fault_has_the_same_words_and_keeps_the_same_rows(
    tmp_path: Path, plant: str, controller: str, text: str, ticks: int
) -> None:
    end, times, _ = assert_same(toy(tmp_path, plant=plant, controller=controller))
    assert isinstance(end, str)
    assert text in end
    assert len(times) == ticks


@pytest.mark.parametrize("plant", ["if (t > 0.39) return 1;", "v[27] = v[28] = 1;"])
def test_a_warning_is_accepted(tmp_path: Path, plant: str) -> None:
    end, times, _ = assert_same(toy(tmp_path, plant=plant))
    assert isinstance(end, Outcome)
    assert len(times) == 61


@pytest.mark.parametrize(
    ("plant", "text"),
    [
        ("v[29] = 1;", "asks for an event at t = 0.4 s"),
        ("v[30] = 1;", "fmi3DoStep returned early at t = 0.4 s"),
        ("v[26] = 1e-6;", "fmi3DoStep returned early at t = 0.4 s"),
    ],
)
def test_an_event_and_a_step_that_is_not_made_whole_are_refused(
    tmp_path: Path, plant: str, text: str
) -> None:
    end, times, _ = assert_same(toy(tmp_path, plant=f"if (t > 0.39) {plant}"))
    assert isinstance(end, str)
    assert text in end
    assert len(times) == 11


def test_a_step_that_reaches_its_end_but_for_rounding_is_accepted(tmp_path: Path) -> None:
    end, _, _ = assert_same(toy(tmp_path, plant="v[26] = 1e-9;"))
    assert isinstance(end, Outcome)


@pytest.fixture
def alarm() -> Iterator[None]:
    """Ctrl-C after 0.2 s."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


def test_ctrl_c_is_heard_between_slow_steps_and_keeps_the_rows(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    # given a plant whose steps take 30 ms: a second of trial time takes 0.75 s
    system = toy(tmp_path, plant="extern int usleep(unsigned); usleep(30000);")
    times: list[float] = []
    with Simulation(system) as simulation:
        request.getfixturevalue("alarm")
        start = time.perf_counter()
        # when
        with pytest.raises(KeyboardInterrupt):
            simulation.run(record=lambda moments, _: times.extend(moments.tolist()))
        elapsed = time.perf_counter() - start
    # then it ends long before the 225 s of the whole trial, and the rows up to there are handed over
    assert elapsed < 30
    assert times
    assert times == [k * 0.04 for k in range(len(times))]


@pytest.mark.usefixtures("only_c")
def test_a_damaged_loop_is_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given half of the library
    monkeypatch.setattr("codegen.cache.cache_folder", lambda: tmp_path)
    walk._library.cache_clear()
    try:
        assert isinstance(walk._library(), ctypes.CDLL)
        (library,) = (tmp_path / "cosim").glob("*.so")
        whole = library.read_bytes()
        library.unlink()  # this process still runs it
        library.write_bytes(whole[: len(whole) // 2])
        walk._library.cache_clear()
        # when
        end, times, _ = run(toy(tmp_path), loop="native")
    finally:
        walk._library.cache_clear()
    # then the loop in C ran
    assert end == Outcome(61, 60 * 0.04, None)
    assert len(times) == 61
    assert library.read_bytes() == whole


class InPython(FmuInstance):
    """An FMU whose steps are called by Python."""

    def stepping(self, clock: Clock, size: float, count: int = 1) -> Call:
        function, arguments = super().stepping(clock, size, count)
        return partial(function), arguments


def test_a_stand_in_that_python_answers_for_is_named(tmp_path: Path) -> None:
    system = toy(tmp_path)
    plant = InPython("plant", system.components["plant"].fmu)
    with Simulation(system, stand_ins={"plant": cast(Any, plant)}) as simulation:
        assert simulation.notes == ["the loop is Python's, a tenth as fast: Python answers for plant"]
        assert simulation.run(duration=2.4) == Outcome(61, 60 * 0.04, None)


def test_without_a_compiler_the_loop_is_pythons(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> Path:
        raise CompileError("no compiler for this machine")

    system = toy(tmp_path)
    expected = run(system, loop="native")
    monkeypatch.setattr(walk, "build_library", refuse)
    monkeypatch.setattr("codegen.cache.cache_folder", lambda: tmp_path)
    walk._library.cache_clear()
    try:
        without = run(system, loop="native")
        with Simulation(system) as simulation:
            notes = simulation.notes
    finally:
        walk._library.cache_clear()
    # then it says so, and the rows are the same
    assert notes == ["the loop is Python's, a tenth as fast: no compiler for this machine"]
    assert without[:2] == expected[:2]
