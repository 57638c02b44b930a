"""`canine vest` says where the radio is, runs by the clock, and tells at its end what became of the ticks."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from codegen.firmware.key import write_new
from harness.log.log import FILE, LogError, read_log
from harness.main import INTERRUPTED
from tests.harness.command import canine
from tests.harness.vest.leading import PATIENCE

SCENARIO = "two_waypoint"
PROJECT = Path(__file__).resolve().parents[3]
FAST = ("--speed", 100, "--duration", 4)
TICKS = 4 * 25 + 1


def test_a_vest_of_some_seconds_leaves_its_log_and_tells_its_deadlines(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    status, out, err = canine(capsys, "vest", SCENARIO, *FAST, "--seed", 3, "--out", tmp_path)

    assert status == 0
    first, last = out.splitlines()
    assert re.fullmatch(r"radio: /dev/\S+", first)
    assert re.match(rf"{TICKS} ticks, \d+ deadlines missed, [\d.]+ ms late at most", last)
    assert last.endswith(f"the log is {tmp_path / FILE}")
    assert "INSECURE: without --key it obeys whoever reaches its radio" in err
    assert "STOP" in err or "NONE" in err  # a line of its state
    log = read_log(tmp_path / FILE)
    assert len(log.time) == TICKS
    assert log.metadata["scenario"]["seed"] == "3"


def test_the_key_is_named_and_never_shown(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_new(tmp_path / "rex.key")
    secret = (tmp_path / "rex.key").read_text().splitlines()[-1]

    status, out, err = canine(
        capsys, "vest", SCENARIO, *FAST, "--target", "cortex-m4f", "--tcp", 0,
        "--key", tmp_path / "rex.key", "--out", tmp_path / "out",
    )  # fmt: skip

    assert status == 0
    assert re.search(r"^radio: tcp://127\.0\.0\.1:\d+$", out, flags=re.M)
    assert f"key: {tmp_path / 'rex.key'}" in out
    assert "INSECURE" not in err
    assert bytes.fromhex(secret) not in (tmp_path / "out" / FILE).read_bytes()
    assert secret not in out + err


def wait_for_a_tick(path: Path) -> None:
    """Until a log has one."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        with suppress(LogError):
            read_log(path)
            return
        time.sleep(0.05)
    raise AssertionError(f"{path} has no tick")


def test_ctrl_c_ends_it_with_what_happened_and_a_whole_log(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "harness.main", "vest", SCENARIO, "--out", str(tmp_path)],
        cwd=PROJECT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as vest:  # fmt: skip
        assert vest.stdout
        assert vest.stdout.readline().startswith("radio: ")
        wait_for_a_tick(tmp_path / FILE)
        vest.send_signal(signal.SIGINT)
        _, err = vest.communicate(timeout=120)

    assert vest.returncode == INTERRUPTED
    assert re.search(r"canine: ended by Ctrl-C; [\d,]+ ticks, \d+ deadlines missed, .* late at most", err)
    assert "Traceback" not in err
    assert read_log(tmp_path / FILE).broken == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--tcp", 0, "--bind", "0.0.0.0"), "--bind 0.0.0.0: whoever reaches it commands the vest"),
        (("--bind", "0.0.0.0"), "--bind 0.0.0.0: is where --tcp listens; expected --tcp PORT too"),
        (("--target", "rabbit4000"), "--target rabbit4000: runs no vest in real time"),
        (("--speed", 1000), "speed"),
        (("--key", "no.key"), "--key no.key: cannot be read"),
        (("--set", "cmec.moving_deviatoin=3"), "moving_deviation"),
    ],
)
def test_what_cannot_be_had_is_refused(
    arguments: tuple[object, ...], message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    status, _, err = canine(capsys, "vest", SCENARIO, "--duration", 1, "--out", tmp_path, *arguments)

    assert status == 2
    assert message in err
    assert "Traceback" not in err
