"""The STM32F405's firmware as it is flashed, in real time on QEMU: serial lines, interrupts, timer, pins."""

from __future__ import annotations

import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from codegen.firmware.bundle import bundle
from codegen.firmware.cortex_m4f import board_image
from codegen.firmware.image import Image
from codegen.firmware.key import Key
from codegen.firmware.targets import TARGETS
from codegen.firmware.telemetry import Flag, Telemetry
from harness.onboard.processors import ProcessorError
from harness.onboard.processors.stm32f405 import MACHINE, PACKAGE, QEMU, Board, Playing, open_board
from harness.onboard.radio import Decoder
from models.commands import Command
from tests.codegen.firmware.vest import check_telemetry, lead, lead_until_forward
from tests.harness.vest.devices import require_qemu

TARGET = TARGETS["stm32f405"]
QUIET = Playing(0, vibrate_left=False, vibrate_right=False)
WATCHDOG = "(?:IWDG|I2S2ext)"  # QEMU has given its addresses two names
PLAYED = {  # Table 4.1
    Command.FORWARD: Playing(1500, vibrate_left=False, vibrate_right=False),
    Command.STOP: Playing(3500, vibrate_left=False, vibrate_right=False),
    Command.RECALL: Playing(9500, vibrate_left=False, vibrate_right=False),
    Command.LEFT: Playing(0, vibrate_left=True, vibrate_right=False),
    Command.RIGHT: Playing(0, vibrate_left=False, vibrate_right=True),
}


@pytest.fixture(scope="module")
def image() -> Image:
    """The program, for a machine with QEMU."""
    require_qemu()
    return board_image(TARGET, bundle(TARGET))


@contextmanager
def connected(board: Board) -> Iterator[tuple[dict[str, Callable[[bytes], object]], Callable[[], bytes]]]:
    """What sends on each of a board's lines, and what gives the bytes of its radio."""
    lines = {name: socket.create_connection(("127.0.0.1", port)) for name, port in board.ports.items()}
    lines["radio"].setblocking(False)

    def heard() -> bytes:
        try:
            return lines["radio"].recv(65536)
        except BlockingIOError:
            return b""

    try:
        yield {name: line.sendall for name, line in lines.items()}, heard
    finally:
        for line in lines.values():
            line.close()


def writes(log: Path, device: str, offset: int) -> list[int]:
    """What was written to a register that QEMU does not model, in order."""
    found = re.findall(
        rf"^{device}: unimplemented device write \(size 4, offset 0x0*{offset:x}, value 0x(\w+)\)",
        log.read_text(),
        re.MULTILINE,
    )
    return [int(value, 16) for value in found]


def test_the_flashed_program_leads_and_each_command_is_played(image: Image, tmp_path: Path) -> None:
    # given the program on QEMU, with instruments and operator at its TCP lines
    log = tmp_path / "log"
    with Board(image, log) as board, connected(board) as (send, heard):
        # when it is given a mission and its start, then it tells so, and plays FORWARD
        check_telemetry(lead_until_forward(send["gps"], send["imu"], send["radio"], heard=heard))
        assert board.playing() == PLAYED[Command.FORWARD]
        # and the lines have their bit rates: 84 MHz / 115200, 42 MHz / 57600, 84 MHz / 38400
        assert [board.word(at + 8) for at in (0x40011000, 0x40004800, 0x40011400)] == [729, 729, 2188]

        # when the operator commands otherwise
        orders = list(PLAYED)
        told: Telemetry | None = None
        for told in lead(
            send["gps"], send["imu"], send["radio"], heard, seconds=60.0, override=lambda: orders[0]
        ):
            # then each is played by speaker or vibrators, as the telemetry tells
            if told.command == orders[0]:
                assert board.playing() == PLAYED[orders.pop(0)]
                if not orders:
                    break
        assert not orders
        assert told is not None

    # and the pins were written so: off at first, left on, right on, off; lamp on, as QEMU has no crystal
    lamp, right, left = (1 << pin for pin in (1, 2, 3))
    off = (left | right) << 16
    changes = [value for value in writes(log, "GPIOC", 0x18) if value not in (lamp, off | lamp << 16)]
    assert changes[0] == off
    assert [value for value in changes if value != off] == [left | right << 16, right | left << 16]
    # and the watchdog was started and set, and is fed by ticks alone
    keys = writes(log, WATCHDOG, 0)
    assert keys[:3] == [0xCCCC, 0x5555, 0xAAAA]
    assert set(keys[3:]) == {0xAAAA}
    assert (writes(log, WATCHDOG, 4), writes(log, WATCHDOG, 8)) == ([1], [1000])
    assert abs(len(keys[3:]) - told.time_ms // 40) <= 25  # those of a second after that telemetry


def session_of(board: Board) -> tuple[int, Decoder]:
    """The session that a board tells, and what read it."""
    decoder = Decoder(None)
    with connected(board) as (_, heard):
        end = time.monotonic() + 30
        while time.monotonic() < end:
            if reports := decoder.receive(heard()):
                return reports[-1][1].session, decoder
            time.sleep(0.02)
    raise AssertionError("the board is silent")


def test_a_reset_of_a_board_is_another_session_and_forgets_the_mission(image: Image) -> None:
    # given a board that leads
    with Board(image) as board, connected(board) as (send, heard):
        before = lead_until_forward(send["gps"], send["imu"], send["radio"], heard=heard)[-1]
        # when it is reset
        board.reset()
        # then it answers in another session, with nothing loaded, and plays STOP, then nothing
        decoder = Decoder(None)
        reports: list[Telemetry] = []
        end = time.monotonic() + 30
        while not any(report.time_ms > 3000 for report in reports):
            new = [report for _, report in decoder.receive(heard()) if report.session != before.session]
            reports += new
            if new and new[-1].time_ms < 1000:
                assert board.playing() == PLAYED[Command.STOP]
            assert time.monotonic() < end
            time.sleep(0.02)
        assert {report.session - before.session for report in reports} == {1}
        assert not any(Flag(report.flags) & (Flag.LOADED | Flag.STARTED) for report in reports)
        assert board.playing() == QUIET


def test_each_start_of_a_board_is_another_session(image: Image) -> None:
    sessions = set()
    for _ in range(2):
        with Board(image) as board:
            sessions.add(session_of(board)[0])
            # before anybody commands, STOP is played, then nothing (rule 12)
            end = time.monotonic() + 30
            while board.playing() != QUIET:
                assert board.playing() in (PLAYED[Command.STOP], QUIET)
                assert time.monotonic() < end
                time.sleep(0.1)
    assert len(sessions) == 2


def test_a_vests_own_key_goes_into_no_cache_and_signs(
    image: Image, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a key of a vest's own
    key = Key(bytes(range(100, 116)))
    monkeypatch.setattr("codegen.cache.cache_folder", lambda: tmp_path)
    # when a board has it
    with open_board(key=key) as board:
        path = board.image.path
        decoder = Decoder(key)
        with connected(board) as (_, heard):
            end = time.monotonic() + 30
            while not decoder.frames:
                decoder.receive(heard())
                assert time.monotonic() < end
                time.sleep(0.02)
        # then its frames are signed by it, and the program lies in a folder of the user's alone
        assert decoder.forged == 0
        assert path.parent.stat().st_mode & 0o077 == 0
    # and nowhere afterwards
    assert not path.exists()
    assert not list(tmp_path.rglob("board.elf"))


# --- QEMU itself ---


def test_a_board_without_qemu_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda _: None)
    program = Image(Path("board.elf"), {"first_session": 0x20000000})
    with pytest.raises(ProcessorError, match=rf"{QEMU} is missing; on Debian: apt install {PACKAGE}"):
        Board(program)


def test_a_program_that_qemu_refuses_is_told_in_its_words(image: Image, tmp_path: Path) -> None:
    broken = Image(tmp_path / "none.elf", image.symbols)
    with pytest.raises(ProcessorError, match=r"QEMU ended by itself, status 1: .*none\.elf"):
        Board(broken)


def test_a_board_whose_qemu_has_died_says_so(image: Image) -> None:
    with Board(image) as board:
        assert board.is_running
        board._process.kill()
        board._process.wait()
        assert not board.is_running
        with pytest.raises(ProcessorError, match="QEMU ended by itself, status -9"):
            board.playing()


def test_a_board_whose_qemu_does_not_answer_says_so(image: Image, monkeypatch: pytest.MonkeyPatch) -> None:
    with Board(image) as board:
        monkeypatch.setattr("harness.onboard.processors.stm32f405.PATIENCE", 0.2)
        board._process.send_signal(signal.SIGSTOP)
        with pytest.raises(ProcessorError, match=r"QEMU had no answer after 0\.2 s"):
            board.playing()
    # and it ends all the same
    assert not board.is_running


OWNER = """
import sys, time
from pathlib import Path
from codegen.firmware.image import Image
from harness.onboard.processors.stm32f405 import Board
board = Board(Image(Path(sys.argv[1]), {"first_session": int(sys.argv[2])}))
print(board._process.pid, flush=True)
time.sleep(600)
"""


def test_qemu_dies_with_a_process_that_is_killed(image: Image) -> None:
    if shutil.which("setpriv") is None:
        pytest.skip("setpriv is missing: apt install util-linux")
    # given a process with a board
    command = [sys.executable, "-c", OWNER, str(image.path), str(image.symbols["first_session"])]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        pid = int(owner.stdout.readline())
        assert MACHINE in Path(f"/proc/{pid}/cmdline").read_text()
        # when it is killed, then QEMU ends, too
        owner.kill()
    end = time.monotonic() + 20
    while is_alive(pid):
        assert time.monotonic() < end
        time.sleep(0.05)


def is_alive(pid: int) -> bool:
    """A process is there, and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
