"""The onboard program on the simulated Rabbit 4000: the same bits as here, at its cost."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from codegen.firmware.bundle import library, processor_in_the_loop, recorded
from codegen.firmware.rabbit4000 import program_image, rabbit4000_image
from codegen.firmware.targets import TARGETS
from codegen.toolchains.debian import ToolchainError
from codegen.toolchains.sdcc import home
from harness.onboard.processors import Processor, ProcessorError, Received, Reply, open_processor
from harness.onboard.processors.rabbit4000 import Rabbit4000
from harness.pil.printed_defuzzifier import SOURCE, printed_defuzzifier
from tests.harness.onboard.traffic import traffic

TARGET = TARGETS["rabbit4000"]


@pytest.fixture(scope="module", autouse=True)
def sdcc() -> None:
    try:
        home()
    except ToolchainError as reason:
        if os.environ.get("CI") == "true":
            pytest.fail(str(reason))
        pytest.skip(f"no sdcc 4.5: {reason}")


@pytest.fixture
def rabbit() -> Iterator[Processor]:
    processor = open_processor("rabbit4000")
    yield processor
    processor.close()


def differences(got: bytes, expected: bytes) -> list[str]:
    """Words that differ, by name."""
    words = (np.frombuffer(x, "<u4") for x in (got, expected))
    return [
        f"{name}: {a:#010x}, expected {b:#010x}"
        for name, a, b in zip(recorded(), *words, strict=True)
        if a != b
    ]


def answer(reply: Reply) -> tuple[bytes, int, bool, bool]:
    return reply.sent, reply.tone_hz, reply.vibrate_left, reply.vibrate_right


def test_160_ticks_of_good_bad_and_no_bytes_give_the_bits_of_this_machine(rabbit: Processor) -> None:
    host = open_processor("host")
    assert differences(rabbit.start, host.start) == []
    tones, telemetry = set(), 0
    for k, received in enumerate(traffic(160)):
        got, expected = rabbit.tick(received), host.tick(received)
        assert differences(got.record, expected.record) == [], f"tick {k}"
        assert answer(got) == answer(expected), f"tick {k}"
        tones.add(got.tone_hz)
        telemetry += len(got.sent) > 0
    host.close()
    assert len(tones) > 1  # it was led
    assert telemetry == 32  # 5 a second


def test_the_same_bytes_take_the_same_clocks_on_two_rabbits_at_once(rabbit: Processor) -> None:
    with_fix, another = traffic(7), open_processor("rabbit4000")
    costs = [(rabbit.tick(r).cost, another.tick(r).cost) for r in with_fix]
    another.close()
    assert all(a == b for a, b in costs)
    assert all(a is not None and a.clocks > a.accesses > a.instructions > 10_000 for a, _ in costs)


def test_the_program_on_the_rabbit_stays_within_memory_and_tick(rabbit: Processor) -> None:
    footprint = rabbit.image.footprint
    assert footprint is not None
    assert 20_000 < footprint.code + footprint.constants <= TARGET.code
    assert 1_000 < footprint.ram <= TARGET.ram
    costs = [cost for r in traffic(60) if (cost := rabbit.tick(r).cost)]
    # with four wait states, at 58.98 MHz, a tick has 40 ms
    assert max(c.clocks + 4 * c.accesses for c in costs) / 58.98e3 < 40.0
    stack = rabbit.stack()
    assert stack is not None
    assert 100 < stack < 1_000


def test_a_program_that_does_not_come_back_is_named_and_its_simulator_gone() -> None:
    files = library(banked=True) | processor_in_the_loop()
    begin = "void onboard_tick(onboard *m)\n{\n"
    assert begin in files["onboard.c"]
    files["onboard.c"] = files["onboard.c"].replace(begin, begin + "    while (m->time_ms == 40U) {\n    }\n")
    rabbit = Rabbit4000(rabbit4000_image(TARGET, files))
    rabbit.tick(Received())
    begun = time.monotonic()
    with pytest.raises(
        ProcessorError, match=r"stopped at 0x[0-9a-f]{4} \(onboard_tick .*expected it at pil_done"
    ):
        rabbit.tick(Received())
    assert time.monotonic() - begun < 30.0
    rabbit.close()
    with pytest.raises((ProcessorError, ValueError)):
        rabbit.tick(Received())


def test_damaged_objects_and_images_are_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given a program whose objects, image and map lie in the cache, with a bit changed in each
    monkeypatch.setattr("codegen.cache.cache_folder", lambda: tmp_path)
    files = {SOURCE.name: SOURCE.read_text()}
    image = program_image(TARGET, files)
    entries = [p for p in tmp_path.rglob("*.*") if p.suffix in (".rel", ".ihx", ".map")]
    whole = {path: path.read_bytes() for path in entries}
    assert {path.suffix for path in whole} == {".rel", ".ihx", ".map"}
    for path, content in whole.items():
        path.write_bytes(content[:-2] + bytes([content[-2] ^ 1]) + content[-1:])
    # when, then
    assert program_image(TARGET, files) == image
    assert {path: path.read_bytes() for path in whole} == whole


def test_more_bytes_than_the_mailbox_holds_are_refused(rabbit: Processor) -> None:
    with pytest.raises(ProcessorError, match="imu: 513 bytes"):
        rabbit.tick(Received(imu=bytes(513)))


def test_a_simulator_that_dies_is_an_error_and_leaves_no_process(rabbit: Processor) -> None:
    assert isinstance(rabbit, Rabbit4000)
    process = rabbit._console._process
    process.kill()
    with pytest.raises(ProcessorError, match="ended by itself, status -9"):
        rabbit.tick(Received())
    rabbit.close()
    assert process.poll() == -9


def test_printed_defuzzifier_takes_longer_than_a_tick_and_gives_the_same_noise() -> None:
    # values of the sum: errata.md, note 6, to the round-off of 1501 additions in float32
    rows = printed_defuzzifier((0.25, 1.0, 3.5, 5.0))
    assert [sigma for *_, sigma in rows] == pytest.approx([1.133, 1.0667, 150.47, 151.70], rel=1e-3)
    assert all(clocks / 58.98e3 > 40.0 for _, clocks, _ in rows)
