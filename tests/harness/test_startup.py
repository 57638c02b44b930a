"""Starting quickly: what a command must not import, and Ctrl-C while it starts."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from fmus.build import build_all
from fmus.folder import build_folder
from harness.log.log import read_log

SLOW = {
    "casadi", "matplotlib", "scipy", "control", "mcap", "google", "foxglove_schemas_protobuf", "zstandard",
    "pyubx2", "dask", "distributed", "jinja2", "pandas", "elftools", "unicorn",
}  # fmt: skip
RUN = "import sys; from harness.main import run; status = run(sys.argv[1:])"
DELAYS = 12
EARLY = 0.05  # s: no command is done by then
ROOT = Path(__file__).parents[2]


def modules_of(*arguments: str) -> set[str]:
    """The top-level modules that a command has imported when it ends."""
    script = RUN + "; print('modules:', *{name.partition('.')[0] for name in sys.modules}); sys.exit(status)"
    done = subprocess.run(
        [sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode in (0, 2), done.stderr
    return set(done.stdout.splitlines()[-1].split()[1:])


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["run", "--help"], ["bark"], ["run", "--bark"], ["firmware"], ["run", "--seed", "many"]],
    ids=" ".join,
)
def test_help_and_usage_errors_import_neither_numpy_nor_fmpy(arguments: list[str]) -> None:
    assert not modules_of(*arguments) & (SLOW | {"numpy", "fmpy", "models.system"})


@pytest.mark.parametrize("command", ["wiring", "check"])
def test_commands_that_only_look_import_nothing_slow(command: str) -> None:
    # given FMUs that are up to date
    build_all()
    fmu = str(build_folder() / "fmi2" / "four_state.fmu")
    # when
    modules = modules_of(command, *([fmu] if command == "check" else []))
    # then
    assert "fmpy" in modules
    assert not modules & SLOW


def test_a_sweep_does_without_fmpy(tmp_path: Path) -> None:
    modules = modules_of("sweep", "two", "--thresholds", "30", "--trials", "10", "--out", str(tmp_path))
    assert "numpy" in modules
    assert not modules & {"fmpy", "scipy", "mcap", "control", "distributed"}


def test_declarations_are_read_without_casadi() -> None:
    script = "import sys, models.system, models.readings; assert 'casadi' not in sys.modules"
    subprocess.run([sys.executable, "-c", script], check=True)


def test_a_question_whether_casadis_stand_in_is_a_package_does_not_import_casadi() -> None:
    script = """
import sys
from models.kit import casadi
assert not hasattr(casadi, "__path__")
assert not hasattr(casadi, "__wrapped__")
assert "casadi" not in sys.modules
assert casadi.SX(2) + 1 == 3
assert "casadi" in sys.modules
"""
    subprocess.run([sys.executable, "-c", script], check=True)


def interrupted(
    arguments: list[str], delay: float, folder: Path, number: int = signal.SIGINT
) -> tuple[int, str]:
    """Exit status and standard error of a command that gets a signal this long [s] after its entry began.

    Before that Python itself starts, whose answer is not ours.
    """
    script = "import sys, harness.main as m; sys.argv[0] = 'canine'; print('on', flush=True); m.main()"
    process = subprocess.Popen(
        [sys.executable, "-c", script, *arguments],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "on\n"
    time.sleep(delay)
    process.send_signal(number)
    _, stderr = process.communicate(timeout=60)
    return process.returncode, stderr


@pytest.mark.parametrize("arguments", [["sweep", "two", "--trials", "20"], ["run"], ["wiring"]], ids=" ".join)
def test_ctrl_c_at_any_moment_is_one_line_and_status_130(arguments: list[str], tmp_path: Path) -> None:
    build_all()
    dice = random.Random(1)
    for number in range(DELAYS):
        delay = EARLY / 2 if number == 0 else dice.uniform(0.005, 1.5)
        folder = tmp_path / str(number)  # a sweep that goes on says so
        folder.mkdir()
        status, stderr = interrupted(arguments, delay, folder)
        where = f"after {delay:.3f} s: status {status}\n{stderr}"
        assert status == 130 or (status == 0 and delay > EARLY), where
        assert len(stderr.splitlines()) == (status == 130), where
        assert "Traceback" not in stderr, where
        assert not list(tmp_path.rglob(".canine-scratch-*")), where
        for path in folder.rglob("trial.mcap"):
            assert np.allclose(np.diff(read_log(path).time), 0.04, rtol=0, atol=1e-9), where
            assert status == 0 or str(path.relative_to(folder)) in stderr, where


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)], ids=["SIGTERM", "SIGHUP"]
)
@pytest.mark.parametrize("arguments", [["run", "--set", "canine.drift=0"], ["wiring"]], ids=" ".join)
def test_other_signals_end_a_command_with_their_name_and_status(
    arguments: list[str], number: signal.Signals, status: int, tmp_path: Path
) -> None:
    build_all()
    got, stderr = interrupted(arguments, EARLY / 2, tmp_path, number)
    assert got == status
    assert stderr.startswith(f"canine: ended by {number.name}")
    assert len(stderr.splitlines()) == 1


def test_a_hangup_that_nohup_ignores_stays_ignored(tmp_path: Path) -> None:
    script = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
    script += "from harness.main import CtrlC; CtrlC(); print(signal.getsignal(signal.SIGHUP).name)"
    assert ended_by(script, tmp_path) == "SIG_IGN\n"


def test_an_interrupt_that_somebody_swallows_still_ends_the_command(tmp_path: Path) -> None:
    # given a command that catches everything and goes on to its end
    script = """
import os, signal, sys
from harness import main

def run(arguments):
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        for _ in range(1000):
            pass
    except BaseException:
        pass
    return 0

main.run = run
main.main()
"""
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (143, "canine: ended by SIGTERM\n")


def ended_by(script: str, folder: Path) -> str:
    """What a script with our answer to Ctrl-C prints."""
    begin = "import os, signal, sys, time; from harness.main import CtrlC; sys.path.insert(0, ''); CtrlC()\n"
    done = subprocess.run(
        [sys.executable, "-c", begin + script], cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert not done.stderr
    return done.stdout


def test_ctrl_c_waits_for_the_end_of_an_import_that_would_swallow_it(tmp_path: Path) -> None:
    (tmp_path / "greedy.py").write_text("""
import os, signal, time
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.1)
except BaseException:
    print("swallowed")
print("imported", flush=True)
""")
    script = """
try:
    import greedy
    time.sleep(5)
except KeyboardInterrupt:
    print("interrupted")
"""
    assert ended_by(script, tmp_path).split() == ["imported", "interrupted"]


def test_ctrl_c_in_a_destructor_is_not_lost(tmp_path: Path) -> None:
    script = """
class Thing:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)
try:
    Thing()
    time.sleep(5)
except KeyboardInterrupt:
    print("interrupted")
"""
    assert ended_by(script, tmp_path) == "interrupted\n"


def test_a_second_ctrl_c_ends_what_does_not_end(tmp_path: Path) -> None:
    script = """
try:
    os.kill(os.getpid(), signal.SIGINT)
except KeyboardInterrupt:
    os.kill(os.getpid(), signal.SIGINT)  # at once: the same press, passed on
    print("still here", flush=True)
    time.sleep(1.1)
    os.kill(os.getpid(), signal.SIGINT)
    print("and still")
"""
    assert ended_by(script, tmp_path) == "still here\n"
