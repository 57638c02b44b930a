"""FMUs that go wrong, in the worker: a fault that names them, all rows up to it, and nothing left behind."""

import mmap
import os
import re
import signal
import tempfile
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from platform import machine

import numpy as np
import pytest

from harness.cosim.fmu import Fault, FmuError, describe
from harness.cosim.loop import Simulation
from harness.cosim.ssp import FmuComponent, FmuSystem, ScaledLink, StartValue
from harness.cosim.stepping import Event, Limits, Loop
from harness.cosim.worker.contained import Contained
from harness.cosim.worker.process import Subject, WorkerProcess
from harness.cosim.worker.shared import SOUND, SharedMemory, Sizes
from harness.cosim.worker.supervisor import descendants
from models.errors import ParameterError, WiringError
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

COUNTS = [V("n"), V("x", "input", start="0"), V("p", "parameter", start="1")]
LIMITS = Limits(call=60.0, start=60.0, free=60.0, memory=400 * 2**20)
HASTE = replace(LIMITS, call=1.0, free=1.0)  # where a call never comes back
DIES_AT = 10  # the tick, of 0.04 s
LATE = "if (t > 0.39) "  # on that tick and later


def toy(
    folder: Path, *, version: int = 2, step: str = "", start: str = "", free: str = "", outside: str = ""
) -> FmuSystem:
    """A plant that counts and then does `step`, and a component beside it that sums up what it counts."""
    tiny_fmu(
        folder / "bad.fmu",
        COUNTS,
        f"v[0] += v[2]; {step}",
        version=version,
        start=f"v[2] = 1; {start}",
        free=free,
        outside=outside,
        depends=False,
    )
    tiny_fmu(folder / "sum.fmu", COUNTS, "v[0] += v[1] / 3;", version=version)
    return FmuSystem(
        "toy",
        {
            "plant": FmuComponent("plant", folder / "bad.fmu"),
            "sum": FmuComponent("sum", folder / "sum.fmu", values={"p": StartValue(2.0)}),
        },
        (ScaledLink("plant", "n", "sum", "x"),),
    )


def lives(number: int) -> bool:
    """Does a process run? One that has ended may wait to be taken note of."""
    with suppress(OSError):
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


def started(process: WorkerProcess) -> list[int]:
    """The supervisor, the worker, and what that has started."""
    return [process.pid, *descendants(process.pid)]


@dataclass
class Run:
    """What came of a run: the rows of `plant.n`, the notes, the error."""

    rows: list[float]
    notes: list[str]
    error: FmuError | None


def run(system: FmuSystem, limits: Limits = LIMITS, duration: float = 1.0, loop: Loop = "native") -> Run:
    """Run it, and see that nothing is left of the worker."""
    rows: list[float] = []
    error, contained, processes = None, None, list[int]()

    def record(times: np.ndarray, values: Mapping[str, np.ndarray]) -> None:
        assert np.array_equal(times, 0.04 * np.arange(len(rows), len(rows) + len(times)))
        rows.extend(values["plant"][:, -1].tolist())

    fmus = {name: describe(part.fmu) for name, part in system.components.items()}
    try:
        with Contained(system, fmus, limits=limits, loop=loop) as contained:
            processes = started(contained.process)
            contained.run(duration=duration, record=record)
    except FmuError as raised:
        error = raised
    if contained is not None:
        assert len(processes) > 1
        assert not any(map(lives, processes))
        assert not contained.process.folder.exists()
    return Run(rows, contained.notes if contained else [], error)


ENDS = {
    "exit(0)": ("extern void exit(int); exit(0);", "exit", "ended the process.*, with exit status 0"),
    "_exit(77)": ("extern void _exit(int); _exit(77);", "exit", "ended the process.*, with exit status 77"),
    "a segfault": ("*(volatile int *)8 = 1;", "crash", "ended the process.*: segmentation fault"),
    "abort": ("extern void abort(void); abort();", "crash", "ended the process.*: aborted"),
    "a stack overflow": (
        "volatile char big[100000]; big[0] = 1; step(m, t, h); big[1] = 1;",
        "crash",
        "ended the process.*: segmentation fault",
    ),
    "an endless loop": ("for (volatile int i = 0;; i++) { }", "hang", "did not come back within 1 s"),
    "a long sleep, deaf to signals": (
        "extern void *signal(int, void *); extern unsigned sleep(unsigned); signal(2, (void *)1);"
        "signal(15, (void *)1); for (;;) sleep(100);",
        "hang",
        "did not come back within 1 s",
    ),
    "much memory": (
        "extern void *malloc(unsigned long); extern void *memset(void *, int, unsigned long);"
        "extern int usleep(unsigned);"
        "static void *volatile kept; for (;;) { kept = memset(malloc(1 << 24), 1, 1 << 24); usleep(9000); }",
        "memory",
        r"took 0\.\d+ GiB of memory.*; the limit is 0\.391 GiB",
    ),
    "much memory in a process of its own": (
        "extern void *malloc(unsigned long); extern void *memset(void *, int, unsigned long);"
        "extern int fork(void); extern unsigned sleep(unsigned);"
        "static void *volatile kept;"
        "if (fork() == 0) kept = memset(malloc(3ul << 27), 1, 3ul << 27); for (;;) sleep(100);",
        "memory",
        r"took 0\.\d+ GiB of memory.*; the limit is 0\.391 GiB",
    ),
    "10 GB at once": (
        "extern void *malloc(unsigned long); extern void *memset(void *, int, unsigned long);"
        "static void *volatile kept; kept = memset(malloc(10ul << 30), 1, 10ul << 30);",
        "crash",
        "ended the process.*: segmentation fault",  # there is no memory at the address that it gets
    ),
    "an interrupt": ("extern int raise(int); raise(2);", "crash", "ended the process.*: interrupt"),
    "an error": ("return 3;", "status", "returned error"),
    "fatal": ("return 4;", "status", "returned fatal"),
    "discard": ("return 2;", "status", "returned discard"),
    "pending": ("return 5;", "status", "returned pending"),
    "no status": ("return 77;", "status", "returned the illegal status 77"),
}


CONSTRUCTOR = "__attribute__((constructor)) static void first(void) { *(volatile int *)8 = 1; }"
DESTRUCTOR = "__attribute__((destructor)) static void last(void) { for (volatile int i = 0;; i++) { } }"


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("name", ENDS)
def test_a_step_that_goes_wrong_is_named_with_all_rows_before_it(
    tmp_path: Path, name: str, version: int
) -> None:
    step, kind, text = ENDS[name]
    # when
    system = toy(tmp_path, version=version, step=f"{LATE}{{ {step} }}")
    result = run(system, HASTE if kind == "hang" else LIMITS)
    # then
    assert result.rows == [*range(DIES_AT + 1)]
    assert result.error is not None
    call = f"fmi{version}DoStep"
    assert result.error.fault == Fault(kind, "plant", "bad.fmu", call, 0.4)
    assert re.fullmatch(rf"plant bad\.fmu: {call} {text}( at t = 0\.4 s)?", str(result.error))
    assert "at t = 0.4 s" in str(result.error)


@pytest.mark.parametrize(("version", "value"), [(2, "0.0 / 0.0"), (3, "1.0 / 0.0")])
def test_an_output_that_is_not_finite_is_named(tmp_path: Path, value: str, version: int) -> None:
    result = run(toy(tmp_path, version=version, step=f"{LATE}v[0] = {value};"))
    assert result.error is not None
    assert result.error.fault is not None
    assert (result.error.fault.kind, result.error.fault.call) == ("not finite", 'output "n"')
    assert len(result.rows) == DIES_AT + 2


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("where", "call"),
    [
        ({"outside": CONSTRUCTOR}, "load and fmi{v}Instantiate"),
        ({"start": "*(volatile int *)8 = 1;"}, "load and fmi{v}Instantiate"),
        ({"start": "extern void exit(int); exit(0);"}, "load and fmi{v}Instantiate"),
        ({"free": "*(volatile int *)8 = 1;"}, "fmi{v}FreeInstance"),
        ({"free": "for (volatile int i = 0;; i++) { }"}, "fmi{v}FreeInstance"),
        ({"outside": DESTRUCTOR}, "fmi{v}FreeInstance"),
    ],
)
def test_a_fault_before_the_first_tick_or_after_the_last_is_named(
    tmp_path: Path, where: dict[str, str], call: str, version: int
) -> None:
    never = any("for (" in code for code in where.values())
    result = run(toy(tmp_path, version=version, **where), HASTE if never else LIMITS)
    assert result.error is not None
    assert result.error.fault is not None
    assert (result.error.fault.component, result.error.fault.call) == ("plant", call.format(v=version))
    assert len(result.rows) == (26 if "Free" in call else 0)


@pytest.mark.parametrize(
    ("ask", "text"),
    [
        (31, "asks to end the simulation at t = 0.4 s"),
        (29, "asks for an event at t = 0.4 s"),
        (30, "fmi3DoStep returned early at t = 0.4 s"),
    ],
)
def test_what_an_fmi_3_step_asks_for_is_refused(tmp_path: Path, ask: int, text: str) -> None:
    result = run(toy(tmp_path, version=3, step=f"{LATE}v[{ask}] = 1;"))
    assert result.error is not None
    assert text in str(result.error)


def test_a_step_that_says_it_reached_less_than_its_end_is_refused(tmp_path: Path) -> None:
    result = run(toy(tmp_path, version=3, step=f"{LATE}v[26] = 0.01;"))
    assert result.error is not None
    assert "fmi3DoStep returned early at t = 0.4 s" in str(result.error)


def test_what_an_fmu_prints_is_a_note_and_its_folder_and_files_are_its_own(tmp_path: Path) -> None:
    # given a plant that prints, goes elsewhere and closes the standard streams
    step = "extern int printf(const char *, ...), fflush(void *), chdir(const char *), close(int); fflush(0);"
    step += 'printf("t %g\\n", t); chdir("/"); if (t > 0.35) { fflush(0); close(0); close(1); close(2); }'
    here = Path.cwd()
    # when
    result = run(toy(tmp_path, step=step))
    # then the run goes on
    assert result.error is None
    assert result.rows == [*range(26)]
    assert Path.cwd() == here
    assert (
        "an FMU wrote to stdout: t 0 | t 0.04 | t 0.08 | t 0.12 | t 0.16 (and 5 lines more)" in result.notes
    )


def test_an_fmu_that_closes_all_files_is_found_out(tmp_path: Path) -> None:
    result = run(toy(tmp_path, step=f"extern int close(int); {LATE}for (int i = 0; i < 99; i++) close(i);"))
    assert result.error is not None
    assert "an FMU closed files of the process that are not its own" in str(result.error)
    assert result.rows[:11] == [*range(11)]


@pytest.mark.skipif(machine() != "x86_64", reason="its C is for x86-64")
def test_the_smallest_numbers_stay_though_an_fmu_makes_them_0(tmp_path: Path) -> None:
    # given a component that has sums flushed to 0, and one beside it that halves the smallest normal number
    system = toy(tmp_path, step='__asm__ volatile("ldmxcsr %0" : : "m"((unsigned){0x9fc0}));')
    small = "v[0] = 2.2250738585072014e-308 * (v[2] / 4);"
    tiny_fmu(tmp_path / "sum.fmu", COUNTS, small, start="v[2] = 2;")
    fmus = {name: describe(part.fmu) for name, part in system.components.items()}
    values: list[float] = []
    # when
    with Contained(system, fmus, limits=LIMITS) as contained:
        contained.run(duration=1.0, record=lambda _, rows: values.extend(rows["sum"][:, -1]))
    # then
    assert values == [2.2250738585072014e-308 / 2] * 26
    assert any("plant bad.fmu: fmi2DoStep, changed how sums are rounded" in note for note in contained.notes)


@pytest.mark.parametrize("when", ["step", "start"])
def test_rounding_that_an_fmu_changes_is_restored_before_another_one_is_called(
    tmp_path: Path, when: str
) -> None:
    # given a plant that has sums rounded down, before a component that sums thirds
    change = "extern int fesetround(int); fesetround(0x400);"
    system = toy(tmp_path / "bad", start=change) if when == "start" else toy(tmp_path / "bad", step=change)
    expected, sums = [], []
    with Simulation(toy(tmp_path / "good")) as simulation:
        simulation.run(duration=20, record=lambda _, values: expected.append(values["sum"].copy()))
    # when
    fmus = {name: describe(part.fmu) for name, part in system.components.items()}
    with Contained(system, fmus, limits=LIMITS) as contained:
        contained.run(duration=20, record=lambda _, values: sums.append(values["sum"].copy()))
    # then every bit of the sums is as without it, and it is told
    assert np.array_equal(np.concatenate(sums), np.concatenate(expected))
    call = "fmi2DoStep" if when == "step" else "load and fmi2Instantiate"
    restored = [note for note in contained.notes if "changed how sums are rounded" in note]
    assert len(restored) == 1
    assert f"plant bad.fmu: {call}" in restored[0]


def test_rows_of_a_long_run_are_all_handed_over_though_the_parent_is_slow(tmp_path: Path) -> None:
    rows: list[float] = []

    def slow(_: np.ndarray, values: Mapping[str, np.ndarray]) -> None:
        rows.extend(values["plant"][:, -1].tolist())
        time.sleep(0.002)

    system = toy(tmp_path)
    fmus = {name: describe(part.fmu) for name, part in system.components.items()}
    with Contained(system, fmus, limits=LIMITS) as contained:
        outcome = contained.run([Event(200.0, "plant", "x", 1.0)], duration=400, record=slow)
    assert rows == [*range(10_001)]
    assert (outcome.ticks, outcome.stopped_by) == (10_001, None)


def test_errors_that_are_no_fault_of_an_fmu_are_raised_as_without_a_worker(tmp_path: Path) -> None:
    system = toy(tmp_path)
    fmus = {name: describe(part.fmu) for name, part in system.components.items()}
    with pytest.raises(ParameterError, match=r"input sum\.x is connected"):
        Contained(system, fmus, {"sum": {"x": 1.0}}, limits=LIMITS)
    with pytest.raises(WiringError, match="is fed twice"):
        Contained(replace(system, links=system.links * 2), fmus, limits=LIMITS)
    with (
        Contained(system, fmus, limits=LIMITS) as contained,
        pytest.raises(ParameterError, match=r"sum\.x is connected"),
    ):
        contained.run([Event(0.0, "sum", "x", 1.0)], duration=0.2)


def test_ctrl_c_ends_a_worker_whose_fmu_never_comes_back(tmp_path: Path) -> None:
    # given a plant that hangs, and much patience
    rows: list[float] = []
    system = toy(tmp_path, step=f"{LATE}for (volatile int i = 0;; i++) {{ }}")
    fmus = {name: describe(part.fmu) for name, part in system.components.items()}
    with Contained(system, fmus, limits=replace(LIMITS, call=1000.0)) as contained:
        processes = started(contained.process)
        position = contained.process.memory.recorder.position

        def press() -> None:
            while position.rows <= DIES_AT:
                time.sleep(0.01)
            os.kill(os.getpid(), signal.SIGINT)

        threading.Thread(target=press).start()
        with pytest.raises(KeyboardInterrupt):
            contained.run(duration=1, record=lambda _, values: rows.extend(values["plant"][:, -1].tolist()))
    # then its rows are there, and it is gone
    assert rows == [*range(DIES_AT + 1)]
    assert not any(map(lives, processes))


def test_memory_that_is_taken_a_little_on_each_step_is_noticed(tmp_path: Path) -> None:
    # given a plant that keeps 4 MiB more after each step
    step = "extern void *malloc(unsigned long); extern void *memset(void *, int, unsigned long);"
    step += "extern int usleep(unsigned); static void *volatile kept;"
    step += "kept = memset(malloc(1 << 22), 1, 1 << 22); usleep(2000);"
    # when
    result = run(toy(tmp_path, step=step), duration=400.0)
    # then
    assert result.error is not None
    assert result.error.fault is not None
    assert result.error.fault.kind == "memory"
    assert 20 < len(result.rows) < 400
    assert result.rows == [*range(len(result.rows))]


def test_a_crash_is_told_though_a_process_that_the_fmu_started_lives_on(tmp_path: Path) -> None:
    step = f"extern int fork(void); extern unsigned sleep(unsigned); {LATE}"
    step += "{ if (fork() == 0) { sleep(100); } *(volatile int *)8 = 1; }"
    result = run(toy(tmp_path, step=step), replace(LIMITS, call=30.0))
    assert result.error is not None
    assert "ended the process at t = 0.4 s: segmentation fault" in str(result.error)
    assert result.rows == [*range(DIES_AT + 1)]


def test_what_an_fmu_printed_before_it_ended_is_part_of_the_error(tmp_path: Path) -> None:
    start = 'extern int puts(const char *); extern void exit(int); puts("no licence"); exit(1);'
    result = run(toy(tmp_path, start=start))
    assert str(result.error) == (
        "plant bad.fmu: load and fmi2Instantiate ended the process at t = 0 s, with exit status 1; "
        "an FMU wrote to stdout: no licence"
    )


def test_rows_are_handed_over_once_though_they_cannot_be_written(tmp_path: Path) -> None:
    # given a disk that is full from the first rows on
    tried: list[int] = []

    def full(times: np.ndarray, _: Mapping[str, np.ndarray]) -> None:
        tried.extend(np.rint(times / 0.04).astype(int).tolist())
        raise OSError("full")

    system = toy(tmp_path)
    fmus = {name: describe(part.fmu) for name, part in system.components.items()}
    with Contained(system, fmus, limits=LIMITS) as contained, pytest.raises(OSError, match="full"):
        contained.run(duration=2000, record=full)
    # then no row is tried twice
    assert len(tried) == len(set(tried)) > 0


def test_an_fmu_whose_values_are_all_texts_runs(tmp_path: Path) -> None:
    fmu = tiny_fmu(tmp_path / "text.fmu", [V("name", type="String")], depends=False)
    with Simulation(FmuSystem("text", {"text": FmuComponent("text", fmu)}, ())) as simulation:
        assert simulation.run(duration=1.0).ticks == 26


def test_one_worker_runs_many_simulations_and_a_fault_harms_none_of_the_others(tmp_path: Path) -> None:
    # given a good plant, one that prints, and one that crashes
    good = toy(tmp_path / "good")
    prints = 'extern int puts(const char *), fflush(void *); if (t > 0.94) { puts("hi"); fflush(0); }'
    systems = [
        good,
        toy(tmp_path / "prints", step=prints),
        good,
        toy(tmp_path / "dies", step=ENDS["abort"][0]),
    ]
    runs: list[list[float]] = []
    numbers, notes = [], []

    def record(_: np.ndarray, values: Mapping[str, np.ndarray]) -> None:
        runs[-1].extend(values["plant"][:, -1].tolist())

    # when one after the other runs, and the good one again
    with WorkerProcess(LIMITS) as process:
        for system in [*systems, good]:
            runs.append([])
            fmus = {name: describe(part.fmu) for name, part in system.components.items()}
            with suppress(FmuError), Contained(system, fmus, process=process) as contained:
                contained.run(duration=1.0, record=record)
            numbers.append(process.pid)
            notes += contained.notes
    # then all share a process until it crashes
    assert numbers[0] == numbers[1] == numbers[2] == numbers[3] != numbers[4]
    assert [len(rows) for rows in runs] == [26, 26, 26, 1, 26]
    assert runs[0] == runs[2] == runs[4] == [*range(26)]
    assert notes == ["an FMU wrote to stdout: hi"]
    assert not process.folder.exists()


POSITION = "8 + 8 + 8 + 8 + 400 + 8"  # behind the call that is being made
OVERWRITES = """extern void *fopen(const char *, const char *); extern char *fgets(char *, int, void *);
extern char *strstr(const char *, const char *); extern unsigned long strtoul(const char *, char **, int);
extern void *memset(void *, int, unsigned long);
if (t > 0.39) { void *f = fopen("/proc/self/maps", "r"); char line[999]; while (fgets(line, 999, f))
  if (strstr(line, "memfd:canine-rows")) { char *end; unsigned long from = strtoul(line, &end, 16);
    memset((char *)from + %s, 0x7f, %s); } }
"""


@pytest.mark.parametrize(
    ("place", "size"),
    [
        ("0", "strtoul(end + 1, 0, 16) - from"),  # all
        (POSITION, "24"),
        (f"{POSITION} + 24", "16"),  # behind tick, call and rows: who changed the rounding, and how often
    ],
)
def test_an_fmu_that_writes_over_what_the_worker_shares_is_found_out(
    tmp_path: Path, place: str, size: str
) -> None:
    # given a plant that fills its rows' memory with rubbish, and comes back never or after a while
    step = OVERWRITES % (place, size) + "extern unsigned sleep(unsigned); if (t > 0.39) sleep(9);"
    # when
    result = run(toy(tmp_path, step=step))
    # then what was taken before stands, and no rubbish
    assert result.error is not None
    assert result.error.fault is not None
    assert result.error.fault.kind == "overwritten"
    assert "wrote over memory that is not its own" in str(result.error)
    assert "one of plant bad.fmu, sum sum.fmu" in str(result.error)
    assert result.rows == [*range(len(result.rows))]


@pytest.mark.parametrize(
    ("name", "within", "beyond"),
    [
        ("rows", (5, 15), (4, 16)),
        ("tick", (0, 15), (-1, 16)),
        ("call", (-1, 2), (-2, 3)),
        ("restorer", (0, 2), (-1, 3)),
        ("restored", (0, 9), (-1,)),
        ("before", (SOUND,), (SOUND + 1,)),
        ("after", (SOUND,), (SOUND + 1,)),
    ],
)
def test_each_number_that_the_worker_shares_must_be_one_that_it_writes(
    name: str, within: tuple[int, ...], beyond: tuple[int, ...]
) -> None:
    # given memory for 10 rows, of which 5 are taken, and a tick of 3 calls
    process, sizes = WorkerProcess(LIMITS), Sizes(8, 0, 10)
    process.subject = Subject({}, {}, 0.04, [("plant", "fmi2DoStep")] * 3)
    process.memory = SharedMemory(mmap.mmap(-1, sizes.all), sizes)
    flight, position = process.memory.flight, process.memory.recorder.position
    flight.begin()
    process.take(5)
    position.rows = 5
    # when it is just within its range, or just beyond
    for value in (*within, *beyond):
        setattr(flight if hasattr(flight, name) else position, name, value)
        # then it can be what the worker wrote, or cannot
        assert process.is_sound == (value in within), value


SPOILS = {  # what harms the trials after it, unless they have a worker of their own
    "its folder is gone": 'system("rm -rf $TMPDIR");',
    "its folder has another name": 'system("mv $TMPDIR $TMPDIR-x");',
    "its working folder is gone": 'system("rm -rf $PWD");',
    "no file may be opened": "unsigned long none[2] = {0, 0}; setrlimit(7, none);",
}


@pytest.mark.parametrize("name", SPOILS)
def test_an_fmu_that_spoils_the_worker_harms_neither_its_trial_nor_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    # given a folder for temporary files, and a plant that spoils what the worker needs
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    outside = "extern int system(const char *), setrlimit(int, const void *);"
    spoils = toy(tmp_path / "spoils", outside=outside, step=f"if (t == 0) {{ {SPOILS[name]} }}")
    rows: list[float] = []
    # when it runs twice, and then a good one
    with WorkerProcess(LIMITS) as process:
        for system in (spoils, spoils, toy(tmp_path / "good")):
            fmus = {name: describe(part.fmu) for name, part in system.components.items()}
            with Contained(system, fmus, process=process) as contained:
                contained.run(duration=1.0, record=lambda _, values: rows.extend(values["plant"][:, -1]))
            assert contained.notes == []
    # then all trials are whole, and nothing is left
    assert rows == [*range(26)] * 3
    assert list(temporary.iterdir()) == []


def test_memory_that_both_processes_use_cannot_be_cut_off(tmp_path: Path) -> None:
    # given a plant that empties all open files, and all in its folder
    outside = "extern int ftruncate(int, long), system(const char *);"
    step = "for (int i = 0; i < 99; i++) ftruncate(i, 0);"
    step += "system(\"find $TMPDIR -type f ! -name '*.so' -exec truncate -s 0 {} +\");"
    # when
    result = run(toy(tmp_path, outside=outside, step=f"if (t == 0) {{ {step} }}"))
    # then
    assert result.error is None
    assert result.rows == [*range(26)]


@pytest.mark.parametrize("loop", ["native", "python"])
def test_a_copy_of_the_worker_that_an_fmu_makes_ends_when_it_returns(tmp_path: Path, loop: Loop) -> None:
    # given a plant that forks as it starts and on each step, and waits for the copy to come back
    outside = "extern int fork(void), usleep(unsigned);"
    copies = "if (fork()) usleep(20000);"
    # when
    result = run(toy(tmp_path, outside=outside, start=copies, step=f"if (t < 0.2) {copies}"), loop=loop)
    # then the trial has its rows once, and no word from a copy
    assert result.error is None
    assert result.notes == []
    assert result.rows == [*range(26)]


def daemon(number: Path) -> str:
    """C that starts a process in a session and with an environment of its own, and awaits its number."""
    shell = f"echo $$ > {number}-; mv {number}- {number}; exec sleep 1000"
    return (
        "extern int system(const char *), access(const char *, int), usleep(unsigned);"
        f"system(\"setsid env -i sh -c '{shell}' < /dev/null > /dev/null 2>&1 &\");"
        f'while (access("{number}", 0)) usleep(1000);'
    )


def test_a_process_that_an_fmu_sends_into_a_session_of_its_own_is_ended(tmp_path: Path) -> None:
    number = tmp_path / "number"
    result = run(toy(tmp_path, step=f"if (t == 0) {{ {daemon(number)} }}"))
    assert result.error is None
    assert not lives(int(number.read_text()))


def test_nothing_lives_on_when_the_parent_is_killed(tmp_path: Path) -> None:
    # given a trial whose plant has started a process, and hangs
    number = tmp_path / "number"
    system = toy(tmp_path, step=f"{daemon(number)} for (;;) usleep(9999);")
    parent = get_context("spawn").Process(target=run, args=(system, replace(LIMITS, call=1000.0)))
    parent.start()
    while not number.exists():
        assert parent.is_alive()
        time.sleep(0.01)
    processes = [*descendants(parent.ident or 0)]
    assert int(number.read_text()) in processes
    # when
    parent.kill()
    parent.join()
    # then
    until = time.monotonic() + 60.0
    while any(map(lives, processes)) and time.monotonic() < until:
        time.sleep(0.01)
    assert not any(map(lives, processes))


def test_a_process_that_cannot_be_ended_is_a_note_and_holds_nothing_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a plant that stops the process that would end it
    monkeypatch.setattr("harness.cosim.worker.process.DEATH", 0.1)
    system = toy(tmp_path, step="extern int kill(int, int), getppid(void); if (t == 0) kill(getppid(), 19);")
    fmus = {name: describe(part.fmu) for name, part in system.components.items()}
    # when
    with Contained(system, fmus, limits=LIMITS) as contained:
        supervisor, worker = started(contained.process)
        contained.run(duration=1.0)
    # then
    assert contained.notes == [f"processes that an FMU started cannot be ended: {worker}"]
    os.kill(supervisor, signal.SIGCONT)
    os.waitpid(supervisor, 0)
    assert not lives(worker)


ODD = {  # what an FMU may do without harm: C outside of functions, in its first step, and a note
    "a thread that goes on for ever": (
        "extern int pthread_create(void *, void *, void *(*)(void *), void *);"
        "extern unsigned sleep(unsigned);"
        "static void *idle(void *x) { for (;;) sleep(100); return x; }",
        "static unsigned long thread; pthread_create(&thread, 0, idle, 0);",
        "",
    ),
    "a handler of signals": (
        "extern void *signal(int, void *); extern int raise(int); static void on(int n) { (void)n; }",
        "signal(14, on); signal(2, on); signal(15, on); raise(14); raise(2); raise(15);",
        "",
    ),
    "limits of its own": (
        "extern int setrlimit(int, const void *);",
        "unsigned long none[2] = {0, 0}; setrlimit(7, none); setrlimit(1, none);",  # open files, their sizes
        "",
    ),
    "what it reads and writes on standard input": (
        "extern long read(int, void *, unsigned long), write(int, const void *, unsigned long);",
        'char c; if (read(0, &c, 1) != 0) return 3; write(0, "x", 1);',
        "",
    ),
    "megabytes on standard error": (
        "extern long write(int, const void *, unsigned long); static char big[1 << 20];",
        "for (int i = 0; i < 1 << 20; i++) big[i] = 'x';for (int i = 0; i < 20; i++) write(2, big, 1 << 20);",
        r"an FMU wrote to stderr: (x{200} \| ){4}x{200} \(and 315 lines more\)",
    ),
    "a process that it leaves behind": (
        "extern int fork(void); extern unsigned sleep(unsigned);",
        "if (fork() == 0) for (;;) sleep(100);",
        "",
    ),
}


@pytest.mark.parametrize("name", ODD)
def test_what_an_fmu_does_to_its_own_process_harms_no_trial(tmp_path: Path, name: str) -> None:
    outside, step, note = ODD[name]
    # when
    result = run(toy(tmp_path, outside=outside, step=f"if (t == 0) {{ {step} }}"))
    # then the trial is whole, and nothing is left
    assert result.error is None
    assert result.rows == [*range(26)]
    assert re.fullmatch(note, "".join(result.notes))
