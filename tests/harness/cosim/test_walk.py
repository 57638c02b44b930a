"""The loop in C against its reference in Python: the same rows, errors and ends."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from codegen.toolchains.compiler import CompileError
from harness.cosim import walk
from harness.cosim.fmu import FmuError
from harness.cosim.loop import Array, Outcome, Simulation, Stop
from harness.cosim.ssp import FmuComponent, FmuSystem, ScaledLink
from harness.cosim.stepping import Event, Order
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

# plant: x+ = 0.7 x + u, and its single precision twin; controller: y = -x / 3 + offset, n counts
PLANT = [V("u", "input"), V("x"), V("half", type="Float32")]
CONTROLLER = [V("x", "input"), V("offset", "input"), V("y"), V("n", type="Integer"), V("odd", type="Boolean")]
LINKS = (ScaledLink("plant", "x", "controller", "x"), ScaledLink("controller", "y", "plant", "u"))
EVENTS = (Event(0.1, "controller", "offset", 0.5), Event(1.0, "controller", "offset", -0.25))


def toy(
    folder: Path, *, plant: str = "", controller: str = "", links: tuple[ScaledLink, ...] = LINKS
) -> FmuSystem:
    """The closed loop; `plant` and `controller` are more C for their steps."""
    paths = {
        "controller": tiny_fmu(
            folder / "controller.fmu",
            CONTROLLER,
            f"v[2] = -v[0] / 3 + v[1]; v[3] += 1; v[4] = (int)v[3] % 2; {controller}",
        ),
        "plant": tiny_fmu(
            folder / "plant.fmu",
            PLANT,
            f"v[1] = 0.7 * v[1] + v[0]; v[2] = v[1] / 2; {plant}",
            version=3,
            depends=False,
            start="v[1] = 0.1;",
        ),
    }
    return FmuSystem("toy", {name: FmuComponent(name, path) for name, path in paths.items()}, links)


Run = tuple[Outcome | str, list[float], dict[str, Array]]


def run(system: FmuSystem, *, native: bool, order: Order = "sequential", stop: Stop | None = None) -> Run:
    """How it ended, and all rows."""
    times: list[float] = []
    rows: dict[str, list[Array]] = {name: [] for name in system.components}

    def record(moments: Array, values: dict[str, Array]) -> None:
        times.extend(moments.tolist())
        for name, part in values.items():
            rows[name].append(part)

    with Simulation(system, {}, order, native=native) as simulation:
        try:
            end: Outcome | str = simulation.run(EVENTS, duration=2.4, stop=stop, record=record)
        except FmuError as error:
            end = str(error)
    return end, times, {name: np.concatenate(parts) for name, parts in rows.items()}


def assert_same(system: FmuSystem, *, order: Order = "sequential", stop: Stop | None = None) -> Run:
    """Both loops give the same; what they give."""
    reference = run(system, native=False, order=order, stop=stop)
    native = run(system, native=True, order=order, stop=stop)
    assert native[:2] == reference[:2]
    assert {n: v.tobytes() for n, v in native[2].items()} == {n: v.tobytes() for n, v in reference[2].items()}
    return native


@pytest.fixture
def only_c(monkeypatch: pytest.MonkeyPatch) -> None:
    """A loop in Python would fail."""

    def refuse(*_: object) -> None:
        raise AssertionError("the loop in Python")

    monkeypatch.setattr(walk.Walk, "run", refuse)


@pytest.mark.parametrize("order", ["sequential", "jacobi"])
def test_both_loops_give_the_same_rows(tmp_path: Path, order: Order) -> None:
    end, times, rows = assert_same(toy(tmp_path), order=order)
    assert end == Outcome(61, 60 * 0.04, None)
    assert times == [k * 0.04 for k in range(61)]
    # and the events acted on the ticks 3 and 25
    assert np.unique(rows["controller"][:, 1], return_index=True)[1].tolist() == [25, 0, 3]


@pytest.mark.usefixtures("only_c")
def test_functions_of_c_are_called_from_c(tmp_path: Path) -> None:
    assert run(toy(tmp_path), native=True)[0] == Outcome(61, 60 * 0.04, None)
    with pytest.raises(AssertionError, match="the loop in Python"):
        run(toy(tmp_path), native=False)


def test_a_conversion_on_the_way_is_made_in_python(tmp_path: Path, only_c: None) -> None:
    links = (ScaledLink("plant", "x", "controller", "x", 2.0), LINKS[1])
    with pytest.raises(AssertionError, match="the loop in Python"):
        run(toy(tmp_path, links=links), native=True)


@pytest.mark.parametrize("count", [1, 24, 25, 26, 50])
def test_both_loops_stop_on_the_same_tick(tmp_path: Path, count: int) -> None:
    stop = Stop("controller", "n", frozenset({count, 60}))
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
        ("v[31] = t > 0.39;", "", "plant.fmu: asks to end the simulation at t = 0.44 s", 12),
    ],
)  # fmt: skip
def test_a_fault_has_the_same_words_and_keeps_the_same_rows(
    tmp_path: Path, plant: str, controller: str, text: str, ticks: int
) -> None:
    end, times, _ = assert_same(toy(tmp_path, plant=plant, controller=controller))
    assert isinstance(end, str)
    assert text in end
    assert len(times) == ticks


def test_a_warning_is_accepted(tmp_path: Path) -> None:
    end, times, _ = assert_same(toy(tmp_path, plant="if (t > 0.39) return 1;"))
    assert isinstance(end, Outcome)
    assert len(times) == 61


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
    # then it ends within a few steps, and the rows up to there are handed over
    assert elapsed < 0.5
    assert 3 <= len(times) <= 16
    assert times == [k * 0.04 for k in range(len(times))]


@pytest.mark.usefixtures("only_c")
def test_a_damaged_loop_is_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given half of the library
    monkeypatch.setattr("codegen.cache.cache_folder", lambda: tmp_path)
    walk._library.cache_clear()
    try:
        assert walk._library()
        (library,) = (tmp_path / "cosim").glob("*.so")
        whole = library.read_bytes()
        library.unlink()  # this process still runs it
        library.write_bytes(whole[: len(whole) // 2])
        walk._library.cache_clear()
        # when
        end, times, _ = run(toy(tmp_path), native=True)
    finally:
        walk._library.cache_clear()
    # then the loop in C ran
    assert end == Outcome(61, 60 * 0.04, None)
    assert len(times) == 61
    assert library.read_bytes() == whole


def test_without_a_compiler_the_loop_is_pythons(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> Path:
        raise CompileError("no compiler for this machine")

    system = toy(tmp_path)
    expected = run(system, native=True)
    monkeypatch.setattr(walk, "build_library", refuse)
    monkeypatch.setattr("codegen.cache.cache_folder", lambda: tmp_path)
    walk._library.cache_clear()
    try:
        without = run(system, native=True)
        assert walk._library() is None
    finally:
        walk._library.cache_clear()
    assert without[:2] == expected[:2]
