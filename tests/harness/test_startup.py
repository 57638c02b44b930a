"""Starting quickly: what a command must not import, and Ctrl-C while it starts."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fmus.build import build_all
from fmus.folder import build_folder

SLOW = {
    "casadi", "matplotlib", "scipy", "control", "mcap", "google", "foxglove_schemas_protobuf", "zstandard",
    "pyubx2", "dask", "distributed", "jinja2", "pandas", "ahrs", "elftools", "unicorn",
}  # fmt: skip
RUN = "import sys; from harness.main import run; status = run(sys.argv[1:])"
DELAYS = 12


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


def test_declarations_are_read_without_casadi() -> None:
    script = "import sys, models.system, models.readings; assert 'casadi' not in sys.modules"
    subprocess.run([sys.executable, "-c", script], check=True)


def interrupted(arguments: list[str], delay: float, folder: Path) -> tuple[int, str]:
    """Exit status and standard error of a command that gets SIGINT this long [s] after its entry took charge.

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
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    return process.returncode, stderr


@pytest.mark.parametrize("arguments", [["sweep", "two", "--trials", "20"], ["run"], ["wiring"]], ids=" ".join)
def test_ctrl_c_at_any_moment_is_one_line_and_status_130(arguments: list[str], tmp_path: Path) -> None:
    build_all()
    dice = random.Random(1)
    for _ in range(DELAYS):
        delay = dice.uniform(0.005, 1.5)
        status, stderr = interrupted(arguments, delay, tmp_path)
        where = f"after {delay:.3f} s: status {status}\n{stderr}"
        assert status in (0, 130), where
        assert len(stderr.splitlines()) == (status == 130), where
        assert "Traceback" not in stderr, where
        assert not list(tmp_path.rglob("*.part")), where
