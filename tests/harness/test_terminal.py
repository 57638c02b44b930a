"""Tables and consoles: nothing is cut, in a pipe or on a narrow terminal."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from rich.table import Table

from harness import terminal
from harness.terminal import new_table, print_table

HARNESS = Path(terminal.__file__).parent
RUN = "import sys; from harness.main import run; sys.exit(run(sys.argv[1:]))"


def printed(table: Table, width: int) -> list[str]:
    """The lines of a table on a terminal of this width."""
    console = Console(width=width, file=io.StringIO(), record=True)
    print_table(table, console)
    return console.export_text().splitlines()


def wide() -> Table:
    """Three columns: a text, numbers under a long heading, and numbers."""
    table = new_table("what it is")
    table.add_column("95 % interval", justify="right")
    table.add_column("timeouts", justify="right")
    table.add_row("rate of the [bold]trials[/]", "29.9-31.4", "7")
    return table


def test_a_wide_terminal_shows_a_table_in_full_width() -> None:
    assert [line.split("  ") for line in printed(wide(), 80)][1][0] == "rate of the trials"
    assert len(printed(wide(), 80)) == 2


def test_headings_and_texts_wrap_at_words_before_anything_is_left_out() -> None:
    # given the least width: longest word 6, interval 9, heading "timeouts" 8, and a gap of 2 after each
    lines = printed(wide(), 29)
    # then all is there, in several lines
    assert {"29.9-31.4", "timeouts", "interval"} <= set(" ".join(lines).split())
    assert not any("…" in line for line in lines)
    assert max(map(len, lines)) <= 29
    assert not any("note" in line for line in lines)


def test_a_column_without_room_is_left_out_whole_and_named() -> None:
    lines = printed(wide(), 28)
    shown, _, note = " ".join(lines).partition("note: ")
    assert "29.9-31.4" in shown
    assert "timeouts" not in shown
    assert note.startswith("no room for timeouts; ")


def test_a_single_column_wider_than_the_terminal_is_folded() -> None:
    table = new_table("x")
    table.add_row("abcdefghij")
    assert "".join(printed(table, 8)).replace(" ", "") == "xabcdefghij"


def test_tables_are_made_in_one_place() -> None:
    # given the sources, when they are searched for rich's tables, then one file alone makes them
    assert [path.name for path in HARNESS.rglob("*.py") if "rich.table" in path.read_text()] == [
        "terminal.py"
    ]


def shown() -> Mapping[str, Callable[[Console], None]]:
    """Each table of the commands with results as they are at their widest."""
    from harness.fit import report  # noqa: PLC0415 - slow libraries
    from harness.fit.estimate import pool  # noqa: PLC0415
    from harness.fit.tracks import Trial  # noqa: PLC0415
    from harness.pil import compare  # noqa: PLC0415
    from harness.replay import replay  # noqa: PLC0415
    from harness.replay.outage import COLUMNS  # noqa: PLC0415
    from harness.sweep import sweep  # noqa: PLC0415
    from harness.sweep.table import Point  # noqa: PLC0415
    from harness.trial import parameters, seeds, summary  # noqa: PLC0415
    from models.system import BLOCKS  # noqa: PLC0415

    cost = {kind: {"worst": 1234567, "mean": 1234567} for kind in ("clocks", "accesses", "instructions")}
    one: dict[str, Any] = {
        "scenario": "three_waypoint_by_night", "seed": 2**31 - 1, "outcome": "success", "time_s": 1234.56,
        "stopped_by": None, "estimator": "canine_tracker with canine_ahrs",
        "waypoints_reached": 16, "directional_commands": 12345, "anomalies": {"forward_failure": 12345},
        "position_error_m": {"mean": 1234.56, "max": 1234.56, "final": 1234.56}, "ticks": 12345678,
        "real_time_factor": 1234.5, "log": "out/x/trial.mcap",
    }  # fmt: skip
    numbers = dict.fromkeys(("mean", "sd", "median", "p90"), 1234.567)
    replayed = {
        "configurations": {"speed held": {"n": 12345, **dict.fromkeys(COLUMNS, numbers)}},
        **{"paired_t_tests": [], "left_out": {}, "dropped": {}, "broken": "", "verdicts": {"dog.fmu": "x"}},
        "set": {"speed held": ["four_state.position_sd_floor=0.5"]},
    }
    planned = sweep.plan_sweep("two", thresholds="20:21", vary=["cmec.capture_radius=5:6:1"], trials=10)
    table = [
        Point(written, 10**8, 3 * 10**7, 10**12, 10**17, 10**9, 12345678, {}, {})
        for written in planned.points
    ]
    advice = {"advice": ["x"]}
    dogs = [Trial("t", dict.fromkeys(("cruise_speed", "left_turn_rate"), -123.4 + k)) for k in range(3)]
    bits = {
        "target": "cortex-m4f", "estimator": "four_state", "ticks": 1, "receiver": "x", "trial": one,
        "without_fix": cost, "with_fix": cost, "code_bytes": 12345678,
    }  # fmt: skip
    return {
        "run": lambda console: summary.show(one, console),
        "run --seeds": lambda console: seeds.show([one, one], console),
        "sweep": lambda console: sweep.show(planned, table, advice, console),
        "replay": lambda console: replay.show(replayed, console),
        "fit": lambda console: report.show({**pool(dogs, 0.1), "sources": ["plant"]}, console),
        "pil": lambda console: compare.show(bits, console),
        "parameters": lambda console: parameters.show(parameters.parameters_of(BLOCKS), console),
    }


@pytest.mark.parametrize("width", [terminal.UNLIMITED, 80, 60, 40])
@pytest.mark.parametrize("command", ["run", "run --seeds", "sweep", "replay", "fit", "pil", "parameters"])
def test_no_table_of_a_command_is_cut_at_any_width(command: str, width: int) -> None:
    # given
    console = Console(width=width, file=io.StringIO(), record=True)
    # when
    shown()[command](console)
    # then
    text = console.export_text()
    assert "…" not in text
    if width == terminal.UNLIMITED:
        assert "no room" not in text


def piped(*arguments: str, cwd: Path) -> list[str]:
    """What a command prints into a pipe, called in a narrow window."""
    done = subprocess.run(
        [sys.executable, "-c", RUN, *arguments], cwd=cwd, env=os.environ | {"COLUMNS": "40"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "…" not in done.stdout
    return done.stdout.splitlines()


def test_a_piped_table_has_a_line_for_each_row_however_narrow_the_window(tmp_path: Path) -> None:
    # when
    scenarios = piped("scenarios", cwd=tmp_path)
    parameters = piped("parameters", "cmec", cwd=tmp_path)
    ranges = ("--thresholds", "20:60:40", "--vary", "cmec.capture_radius=5:7:1")
    sweep = piped("sweep", "two", "--trials", "40", *ranges, cwd=tmp_path)
    # then
    row = r"two_waypoint +1 +full +Two waypoints: the start, and a point 25 m north"
    assert any(re.match(row, line) for line in scenarios)
    assert sum(line.startswith("cmec.") for line in parameters) == len(parameters) - 1
    rows = [line for line in sweep if re.match(r" *(20|60) +[567] ", line)]
    assert len(rows) == 6
    assert all(re.search(r"\d+\.\d-\d+\.\d", row) for row in rows)


def test_a_terminal_is_as_wide_as_it_says(tmp_path: Path) -> None:
    # given a terminal of 40 columns
    ours, theirs = pty.openpty()
    # when
    subprocess.run(
        [sys.executable, "-c", RUN, "parameters", "cmec", "--reading", "guarded"], cwd=tmp_path,
        stdout=theirs, stderr=theirs,
        env=os.environ | {"COLUMNS": "40", "LINES": "25", "TERM": "dumb"}, check=True,
    )  # fmt: skip
    os.close(theirs)
    lines = os.read(ours, 1 << 16).decode(errors="replace").splitlines()
    os.close(ours)
    # then the table keeps within it; the terminal breaks a note
    assert max(len(line) for line in lines if not line.startswith("note: ")) <= 40
    assert any("no room for" in line for line in lines)
