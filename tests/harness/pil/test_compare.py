"""The processor in the loop: planted differences, figures by hand, the commands `pil` and `firmware`."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from codegen.firmware.bundle import recorded
from codegen.firmware.image import Footprint
from harness.log.log import read_log
from harness.onboard.memory import Memory
from harness.onboard.processors import Cost, Processor, Received, Reply, open_processor
from harness.pil import compare
from harness.pil.compare import Compared, DifferenceError, report, show
from harness.trial.firmware import firmware_of
from models.modes import Anomaly
from tests.harness.command import canine
from tests.harness.onboard.traffic import traffic

Change = Callable[[int, Reply], Reply]
BITS = r"\(0x[0-9a-f]{8}\)"


class Planted:
    """The host, which counts what a tick costs, and answers as `change` has it."""

    def __init__(self, processor: Processor, change: Change = lambda tick, reply: reply) -> None:
        self.processor, self.change, self.ticks, self.closed = processor, change, 0, False
        self.image, self.start = processor.image, processor.start

    def tick(self, received: Received) -> Reply:
        reply = self.change(self.ticks, replace(self.processor.tick(received), cost=Cost(1000 + self.ticks)))
        self.ticks += 1
        return reply

    def stack(self) -> int | None:
        return 512

    def close(self) -> None:
        self.closed = True
        self.processor.close()


@pytest.fixture
def compared() -> Iterator[Callable[[Change], Compared]]:
    """`compared(change)`: the host against the host that answers otherwise."""
    made: list[Compared] = []

    def make(change: Change) -> Compared:
        made.append(Compared("cortex-m4f", Planted(open_processor("host"), change), open_processor("host")))
        return made[-1]

    yield make
    for one in made:
        one.close()


def run_ticks(watched: Compared, ticks: int = 40) -> None:
    for received in traffic(ticks):
        watched.tick(received)


def flipped(record: bytes, word: str, bit: int) -> bytes:
    """The record with one bit of a word turned."""
    words = np.frombuffer(record, "<u4").copy()
    words[list(recorded()).index(word)] ^= np.uint32(1 << bit)
    return words.tobytes()


def test_processors_that_agree_pass_and_their_ticks_are_counted(
    compared: Callable[[Change], Compared],
) -> None:
    watched = compared(lambda tick, reply: reply)
    run_ticks(watched)
    # then a fix comes with every sixth tick of that traffic
    assert [cost.instructions for cost, _ in watched.costs] == list(range(1000, 1040))
    assert [k for k, (_, fix) in enumerate(watched.costs) if fix] == list(range(0, 40, 6))


@pytest.mark.parametrize(
    ("word", "bit", "message"),
    [
        # whole numbers: the unit counts its samples, and none of them was bad
        ("imu.counter", 0, "is 16 on tick 17, on the host 17"),
        ("estimator.state.bad_samples", 4, "is 16 on tick 17, on the host 0"),
        # a real's sign: -0.0 is not 0.0
        ("controller.output.deviation", 31, rf"is .* {BITS} on tick 17, on the host .* {BITS}"),
    ],
)  # fmt: skip
def test_a_bit_that_differs_is_named_with_tick_word_and_both_values(
    compared: Callable[[Change], Compared], word: str, bit: int, message: str
) -> None:
    # given a processor that remembers one bit otherwise on tick 17
    watched = compared(
        lambda k, reply: replace(reply, record=flipped(reply.record, word, bit)) if k == 17 else reply
    )
    # then
    with pytest.raises(DifferenceError, match=rf"^cortex-m4f: {re.escape(word)} {message}$"):
        run_ticks(watched)
    assert len(watched.costs) == 17


def test_a_float_that_differs_is_named_with_value_and_bits(compared: Callable[[Change], Compared]) -> None:
    # given the lowest bit of a real, far below what its decimals tell
    values: list[float] = []

    def change(tick: int, reply: Reply) -> Reply:
        values.append(Memory(reply.record)["estimator.output.accel_bias_sd"])
        word = "estimator.output.accel_bias_sd"
        return replace(reply, record=flipped(reply.record, word, 0)) if tick == 17 else reply

    # then both are there to 24 bits
    with pytest.raises(DifferenceError) as caught:
        run_ticks(compared(change))
    match = re.search(r"is (.*) \(0x(\w+)\) on tick 17, on the host (.*) \(0x(\w+)\)", str(caught.value))
    assert match
    got, ours = (int(match[i], 16) for i in (2, 4))
    assert got ^ ours == 1
    assert np.array([ours], "<u4").view("<f4")[0] == np.float32(values[17])
    assert match[3] == str(np.float32(values[17]))


def test_a_missing_byte_of_telemetry_is_found(compared: Callable[[Change], Compared]) -> None:
    # given a processor that loses the last byte that it sends from tick 17 on
    lost: list[tuple[int, bytes]] = []

    def change(tick: int, reply: Reply) -> Reply:
        if tick < 17 or not reply.sent:
            return reply
        lost.append((tick, reply.sent))
        return replace(reply, sent=reply.sent[:-1])

    # then
    with pytest.raises(DifferenceError) as caught:
        run_ticks(compared(change))
    ((tick, sent),) = lost
    assert str(caught.value) == f"cortex-m4f: sent is {sent[:-1]!r} on tick {tick}, on the host {sent!r}"


@pytest.mark.parametrize(
    ("name", "value"), [("tone_hz", 441), ("vibrate_left", True), ("vibrate_right", True)]
)
def test_a_tone_or_vibrator_that_differs_is_found(
    compared: Callable[[Change], Compared], name: str, value: Any
) -> None:
    changes: dict[str, Any] = {name: value}

    def change(tick: int, reply: Reply) -> Reply:
        return replace(reply, **changes) if tick == 17 else reply

    with pytest.raises(DifferenceError, match=f"{name} is {value!r} on tick 17, on the host"):
        run_ticks(compared(change))


def test_a_record_that_differs_at_the_start_is_found_before_the_first_tick() -> None:
    # given
    host, other = open_processor("host"), Planted(open_processor("host"))
    other.start = flipped(other.start, "watchdog.state.link_limit", 1)
    # then 2 s are 50 ticks, 0b110010
    with pytest.raises(DifferenceError, match=r"link_limit is 48 before the first tick, on the host 50"):
        Compared("rabbit4000", other, host)
    host.close()
    other.close()


def test_records_of_different_lengths_are_an_error() -> None:
    host, other = open_processor("host"), Planted(open_processor("host"))
    other.start = other.start[:-4]
    words = len(recorded())
    with pytest.raises(
        DifferenceError, match=f"{words - 1} words before the first tick, on the host {words}"
    ):
        Compared("rabbit4000", other, host)
    host.close()
    other.close()


# --- figures ---


def measured(target: str, costs: list[tuple[Cost, bool]], footprint: Footprint | None = None) -> Compared:
    """A comparison that cost this."""
    idle: Any = SimpleNamespace(image=SimpleNamespace(footprint=footprint), start=b"")
    return Compared(target, idle, idle, costs, most_stack=620)


# 589 800 clocks are 10 ms at 58.98 MHz; 117 960 accesses are 2 ms for each wait state
RABBIT = [
    (Cost(40_000, 589_800, 117_960), False),
    (Cost(20_000, 294_900, 58_980), False),
    (Cost(60_000, 1_179_600, 235_920), True),
]


def test_reported_costs_are_worst_and_mean_with_and_without_a_fix() -> None:
    figures = report("rabbit4000", measured("rabbit4000", RABBIT, Footprint(30_000, 2_000, 1_500)))
    assert figures == {
        "target": "rabbit4000",
        "estimator": "four_state",
        "ticks": 3,
        "identical": True,
        "receiver": "NAV-POSLLH, NAV-SOL, NAV-VELNED",
        "without_fix": {
            "ticks": 2,
            "instructions": {"worst": 40_000, "mean": 30_000},
            "clocks": {"worst": 589_800, "mean": 442_350},
            "accesses": {"worst": 117_960, "mean": 88_470},
            "worst_ms_by_wait_states": [10.0, 12.0, 14.0, 16.0, 18.0],
        },
        "with_fix": {
            "ticks": 1,
            "instructions": {"worst": 60_000, "mean": 60_000},
            "clocks": {"worst": 1_179_600, "mean": 1_179_600},
            "accesses": {"worst": 235_920, "mean": 235_920},
            "worst_ms_by_wait_states": [20.0, 24.0, 28.0, 32.0, 36.0],
        },
        "stack_bytes": 620,
        "code_bytes": 30_000,
        "constants_bytes": 2_000,
        "ram_bytes": 1_500,
    }


def test_the_worst_tick_is_sought_for_each_number_of_wait_states() -> None:
    # given a tick of 10 ms without accesses, and one of 9 ms with 2 ms for each wait state
    costs = [(Cost(1, 589_800, 0), False), (Cost(1, 530_820, 117_960), False)]
    # then
    figures = report("rabbit4000", measured("rabbit4000", costs))
    assert figures["without_fix"]["worst_ms_by_wait_states"] == [10.0, 11.0, 13.0, 15.0, 17.0]


def test_without_known_clocks_only_instructions_are_reported() -> None:
    figures = report(
        "cortex-m4f", measured("cortex-m4f", [(Cost(9000), True), (Cost(5001), True), (Cost(5000), True)])
    )
    assert figures["with_fix"] == {"ticks": 3, "instructions": {"worst": 9000, "mean": 6334}}
    assert figures["without_fix"] == {"ticks": 0}
    assert figures["receiver"] == "NAV-PVT"
    assert "code_bytes" not in figures


def test_printed_table_shows_the_costs_and_the_bytes() -> None:
    result = report("rabbit4000", measured("rabbit4000", RABBIT, Footprint(30_000, 2_000, 1_500)))
    console = Console(width=120, record=True, file=Path("/dev/null").open("w"))  # noqa: SIM115
    show(
        result | {"trial": {"scenario": "patrol", "seed": 3, "outcome": "success", "time_s": 107.48}}, console
    )
    text = console.export_text()
    assert "rabbit4000, four_state: 3 ticks of patrol, seed 3 (success, 107.48 s): every bit as" in text
    for row in (
        "tick without a fix, clocks 589,800 442,350",
        "tick without a fix, ms of 40 at 0 to 4 wait states 10.00, 12.00, 14.00, 16.00, 18.00",
        "tick with a fix, instructions 60,000 60,000",
        "code, bytes 30,000",
        "stack, bytes 620",
    ):
        assert row in " ".join(text.split()), row


# --- the command `pil` ---

SHORT = "waypoints = [[35.73, 0.0]]\nduration = 3.0\n"


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> Callable[[Change], list[Planted]]:
    """`simulated(change)`: processors of `canine pil` are hosts that answer so; returns them."""

    def install(change: Change = lambda tick, reply: reply) -> list[Planted]:
        made: list[Planted] = []

        def opened(target: str, values: Any, navigation: Any, *, constants: bool = False) -> Any:
            processor = open_processor("host", values, navigation, constants=constants)
            if target == "host":
                return processor
            made.append(Planted(processor, change))
            return made[-1]

        monkeypatch.setattr(compare, "open_processor", opened)
        return made

    return install


def test_canine_pil_runs_a_trial_on_both_processors_and_leaves_its_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], simulated: Callable[..., list[Planted]]
) -> None:
    # given
    (tmp_path / "short.toml").write_text(SHORT)
    made = simulated()
    # when
    status, text, _ = canine(
        capsys, "pil", tmp_path / "short.toml", "--target", "cortex-m4f", "--seed", 4, "--json",
        "--out", tmp_path / "out",
    )  # fmt: skip
    # then 3 s are 76 ticks, 13 of them with a fix (0, 0.25, .. 3 s)
    result = json.loads(text)
    assert status == 0
    assert result == json.loads((tmp_path / "out" / "pil.json").read_text())
    assert (result["ticks"], result["without_fix"]["ticks"], result["with_fix"]["ticks"]) == (76, 63, 13)
    assert (result["stack_bytes"], result["trial"]["seed"]) == (512, 4)
    assert (tmp_path / "out" / "trial.mcap").is_file()
    assert [p.closed for p in made] == [True]


def test_canine_pil_ends_with_1_and_names_the_difference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], simulated: Callable[..., list[Planted]]
) -> None:
    # given a processor that remembers one bit otherwise on tick 17
    (tmp_path / "short.toml").write_text(SHORT)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "pil.json").write_text("of an earlier run, which was identical")
    made = simulated(lambda k, r: replace(r, record=flipped(r.record, "imu.counter", 1)) if k == 17 else r)
    # when
    status, text, error = canine(
        capsys, "pil", tmp_path / "short.toml", "--target", "rabbit4000", "--out", tmp_path / "out"
    )
    # then 17 is 0b10001
    assert (status, text) == (1, "")
    assert error == "canine: rabbit4000: imu.counter is 19 on tick 17, on the host 17\n"
    assert not (tmp_path / "out" / "pil.json").exists()
    assert [p.closed for p in made] == [True]


def test_ctrl_c_ends_both_processors_with_130(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], simulated: Callable[..., list[Planted]]
) -> None:
    # given a user who has enough on tick 17
    (tmp_path / "short.toml").write_text(SHORT)

    def change(tick: int, reply: Reply) -> Reply:
        if tick == 17:
            raise KeyboardInterrupt
        return reply

    made = simulated(change)
    # when
    status, _, _ = canine(
        capsys, "pil", tmp_path / "short.toml", "--target", "cortex-m4f", "--out", tmp_path / "out"
    )
    # then
    assert [p.closed for p in made] == [True]
    assert status == 130


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--target", "host"], '--target "host": expected a simulated one: cortex-m4f, rabbit4000'),
        (
            ["--target", "stm32f405"],
            '"stm32f405" does not run with the processor in the loop: cortex-m4f, which does, has the same '
            "processor and program; expected one of host, cortex-m4f, rabbit4000",
        ),
        (
            ["--target", "rabbit400"],
            'made for host, cortex-m4f, rabbit4000, stm32f405, not for "rabbit400"; did you mean '
            '"rabbit4000"?',
        ),
        (["two_waypoint", "--target", "cortex-m4f", "--set", "watchdog.link_timeot=1"], "link_timeout"),
        (
            ["--target", "cortex-m4f", "--estimator", __file__],
            f"canine: --estimator {__file__}: firmware is made of our own estimators; expected one of "
            "four_state, six_state, seven_state, two_bias, canine_tracker",
        ),
    ],
)
def test_wrong_use_of_canine_pil_ends_with_2_and_says_what_is_expected(
    capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    status, text, error = canine(capsys, "pil", *arguments)
    assert (status, text) == (2, "")
    assert message in error
    assert "Traceback" not in error


# --- `run --onboard` ---


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--onboard", "pil:x86"],
            'onboard "pil:x86": expected one of fmu, pil:host, pil:cortex-m4f, pil:rabbit4000',
        ),
        (["--onboard", "host"], 'onboard "host": expected one of fmu, pil:host'),
        (["--onboard", ""], "--onboard is empty; expected a value"),
        (
            ["--onboard", "pil:host", "--order", "jacobi"],
            "--onboard pil:host: the firmware answers within a tick; expected --order sequential",
        ),
        (["--onboard", "fmu", "--set", "watchdog.link_timeout=1"], "watchdog"),
    ],
)  # fmt: skip
def test_wrong_use_of_onboard_ends_with_2_and_says_what_is_expected(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str], message: str
) -> None:
    status, text, error = canine(capsys, "run", "two_waypoint", *arguments, "--out", tmp_path)
    assert (status, text) == (2, "")
    assert message in error
    assert list(tmp_path.iterdir()) == []


def test_firmware_cannot_run_beside_another_controller_or_without_sensors(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    # given
    cts = tmp_path / "cts.toml"
    cts.write_text(f'system = "cts"\n{SHORT}')
    other = tmp_path / "other.fmu"
    other.touch()
    # when, then
    status, _, error = canine(capsys, "run", "--onboard", "pil:host", "--controller", other)
    assert (status, error) == (
        2,
        "canine: --onboard pil:host: the firmware takes the place of the controller; "
        "leave --controller out\n",
    )
    status, _, error = canine(capsys, "run", cts, "--onboard", "pil:host")
    assert (status, error) == (
        2,
        'canine: --onboard pil:host: system "cts" lacks our sensors and estimator; '
        'expected a scenario with system = "full"\n',
    )


def test_commands_with_the_same_tone_are_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    status, _, error = canine(
        capsys, "run", "two_waypoint", "--onboard", "pil:host", "--set", "command_module.stop_tone=9500",
        "--out", tmp_path,
    )  # fmt: skip
    assert status == 2
    assert "command_module.recall_tone is 9500 Hz, as for STOP; expected a tone of its own" in error


@pytest.mark.parametrize(("settings", "timeout"), [([], 2.0), (["--set", "watchdog.link_timeout=0.8"], 0.8)])
def test_link_timeout_of_the_scenario_reaches_the_program(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, settings: list[str], timeout: float
) -> None:
    # given a link that is lost at 3 s
    scenario = tmp_path / "lost.toml"
    scenario.write_text(
        'waypoints = [[100.0, 0.0]]\nduration = 7.0\n[[set]]\nat = 3.0\n"controller.link_ok" = false\n'
    )
    # when
    status, _, _ = canine(
        capsys, "run", scenario, "--onboard", "pil:host", *settings, "--out", tmp_path / "out", "--json"
    )
    # then the vest finds it that long after the last message, which came 0.4 s before at most (and a tick)
    log = read_log(tmp_path / "out" / "trial.mcap")
    lost = log.time[(log["controller.anomaly"] == Anomaly.LOST_LINK) & (log.time > 1)]
    assert status == 0
    assert len(lost) == 1
    assert 3.0 - 0.4 + timeout <= lost[0] <= 3.0 + timeout + 0.04
    assert float(log.metadata["parameters"]["watchdog.link_timeout"]) == timeout


# --- the command `firmware` ---


def assigned(folder: Path) -> dict[str, float]:
    """What parameters.c sets, by member and name."""
    text = (folder / "parameters.c").read_text()
    tables = re.findall(r"static const struct \w+ (\w+)_parameters = \{\n(.*?)\n    \};", text, re.DOTALL)
    return {
        f"{member}.{name}": _number(value)
        for member, rows in tables
        for name, value in re.findall(r"\.(\w+) = ([^,\s]+)", rows)
    }


def _number(literal: str) -> float:
    truths = {"true": 1.0, "false": 0.0}
    return truths[literal] if literal in truths else float(literal.rstrip("fF"))


def test_parameters_come_from_the_scenario_in_deg_and_from_set_over_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    # given a scenario without waypoints, which come by radio
    mine = tmp_path / "mine.toml"
    mine.write_text(
        "[parameters]\n"
        '"cmec.moving_deviation" = 37\n"cmec.stop_deviation" = 12\n"cmec.reset_turns" = true\n'
        '"watchdog.link_timeout" = 3.5\n"four_state.max_age" = 9\n'
    )
    # when
    status, text, _ = canine(
        capsys, "firmware", "--insecure", "--target", "host", "--parameters", mine,
        "--set", "cmec.stop_deviation=14", "--out", tmp_path / "fw",
    )  # fmt: skip
    # then
    assert status == 0
    parameters = assigned(tmp_path / "fw")
    assert parameters["controller.moving_deviation"] == pytest.approx(37 * math.pi / 180, rel=6e-8)
    assert parameters["controller.stop_deviation"] == pytest.approx(14 * math.pi / 180, rel=6e-8)
    assert parameters["controller.reset_turns"] == 1
    assert (parameters["watchdog.link_timeout"], parameters["estimator.max_age"]) == (3.5, 9)
    # and a parameter that is not set has its declared start (Table 4.2)
    assert parameters["controller.capture_radius"] == 7
    assert not any("waypoint" in name or "home" in name for name in parameters)
    assert f"{len(list((tmp_path / 'fw').iterdir()))} files" in text


def test_parameters_of_firmware_from_a_scenario_are_those_of_its_trial(tmp_path: Path) -> None:
    # patrol sets the controller's, the sensors' and no others: the program has no sensors
    _, values = firmware_of("patrol", ["watchdog.report_period=0.4"])
    assert values["controller"]["reset_turns"] == 1
    assert values["controller"]["max_turns"] == 3
    assert values["watchdog"] == {"report_period": 0.4}
    assert "sensors" not in values
    assert not any(name.startswith(("waypoint", "home")) for name in values["controller"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--target", "z80"], 'firmware is made for host, cortex-m4f, rabbit4000, stm32f405, not for "z80"'),
        (["--target", "cortex-m4"], 'did you mean "cortex-m4f"?'),
        (["--target", "host", "--set", "cmec.moving_devation=37"], "moving_deviation"),
        (["--target", "host", "--set", "watchdog.link_timeout=0"], "link_timeout"),
        (["--target", "host", "--parameters", "no_such"], "no_such"),
    ],
)
def test_wrong_use_of_canine_firmware_ends_with_2_and_writes_nothing(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str], message: str
) -> None:
    status, text, error = canine(capsys, "firmware", "--insecure", *arguments, "--out", tmp_path / "fw")
    assert (status, text) == (2, "")
    assert message in error
    assert "Traceback" not in error
    assert not (tmp_path / "fw").exists()
