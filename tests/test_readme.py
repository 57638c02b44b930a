"""The commands of README.md, run as they are printed and in their order, in a folder like a fresh clone's."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from codegen.toolchains import sdcc
from codegen.toolchains.compiler import CompileError

PROJECT = Path(__file__).resolve().parents[1]
TEXT = (PROJECT / "README.md").read_text()
FENCES = re.findall(r"^```(\w*)\n(.*?)^```", TEXT, flags=re.M | re.S)
COMMANDS = [
    line for language, body in FENCES if not language for line in body.splitlines()
    if line.startswith((".venv/bin/", "cp "))
]  # fmt: skip
RABBIT = [line for line in COMMANDS if "sdcc" in line or ("pil" in line and "rabbit4000" in line)]
PYTHON = [body for language, body in FENCES if language == "python"]
VARYING = "times real time"  # the one line of the demo that depends on the machine


def demo() -> str:
    """The command behind `make demo`."""
    line = re.search(r"^demo:.*\n\t\$\(BIN\)/(.*)$", (PROJECT / "Makefile").read_text(), flags=re.M)
    assert line
    return f".venv/bin/{line[1]}"


def told() -> list[str]:
    """What `make demo` says after it."""
    recipe = re.search(r"^demo:.*\n((?:\t.*\n)+)", (PROJECT / "Makefile").read_text(), flags=re.M)
    assert recipe
    return [words.replace("$(BIN)", ".venv/bin") for words in re.findall(r'@echo "(.*)"', recipe[1])]


def run(command: str, folder: Path) -> str:
    """What a command prints; it must succeed."""
    done = subprocess.run(
        shlex.split(command), cwd=folder, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    assert "Traceback" not in done.stderr, command
    return done.stdout


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A folder with the project's floors and the virtual environment, where commands may write."""
    for name in ("models", "codegen", "fmus", "harness"):
        (tmp_path / name).symlink_to(PROJECT / name)
    (tmp_path / ".venv").symlink_to(sys.prefix)
    return tmp_path


def test_readme_commands_work_as_printed_and_in_order(clone: Path) -> None:
    # given a folder in which the demo has run, and printed what the README shows
    printed = [*run(demo(), clone).splitlines(), *told()]
    shown = next(body for _, body in FENCES if body.startswith("scenario ")).splitlines()
    assert [line.rstrip() for line in printed if VARYING not in line] == [
        line for line in shown if VARYING not in line
    ]

    # when every command is given in turn, then each succeeds
    for command in COMMANDS:
        if command not in RABBIT:
            run(command, clone)

    # and so does each piece of Python
    for number, code in enumerate(PYTHON):
        (clone / f"example_{number}.py").write_text(code)
        assert run(f".venv/bin/python example_{number}.py", clone)


def test_readme_commands_for_the_rabbit_work_as_printed(clone: Path) -> None:
    try:
        sdcc.home()
    except CompileError:
        pytest.skip("SDCC 4.5 is missing: python -m codegen.toolchains.sdcc")
    for command in RABBIT:
        assert run(command, clone)


def test_readme_names_no_command_that_the_test_leaves_out() -> None:
    # given every line of the README that calls the command, when those are taken out that are run or printed
    calls = [line for _, body in FENCES for line in body.splitlines() if "canine " in line]
    # then only those are left that set it up
    assert [line for line in calls if line not in (*COMMANDS, *told())] == []
