"""The simulated Cortex-M4F: the host's bits, numbers of instructions, limits, faults; QEMU as a witness."""

from __future__ import annotations

import math
import os
import random
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from elftools.elf.elffile import ELFFile
from pyubx2 import GET, UBXMessage
from unicorn.unicorn_const import UC_HOOK_BLOCK, UC_HOOK_CODE

from codegen.blocks.block_c import write_files
from codegen.firmware.bundle import BLOCKS, library, processor_in_the_loop, recorded
from codegen.firmware.cortex_m4f import FLAGS, LINKING, PORTABLE, cortex_m4f_image
from codegen.firmware.image import host_image, own_files
from codegen.firmware.targets import find_target
from codegen.toolchains.compiler import WARNINGS, CompileError, zig
from harness.onboard import radio
from harness.onboard.processors import ProcessorError, Received, Reply, cortex_m4f, host, open_processor
from harness.onboard.processors.cortex_m4f import CortexM4F, instructions_in
from models.commands import Command
from tests.harness.onboard.frames import answering, encode

TARGET = find_target("cortex-m4f")
SCRIPT = f"-Wl,-T,{TARGET.script}"
TICKS = 240
BUDGET = (
    6_000  # instructions of a tick, signed telemetry included; costs.json has what they take, to the digit
)
BLOCKS_IN_C = [f"{block.title()}_" for block in BLOCKS.values()]
HOME = (326_000_000, -854_900_000)  # 1e-7 deg
SPECIAL = (math.nan, math.inf, -math.inf, -0.0, 1e-41, 3.4e38, 1e9)

# --- traffic: a walk north at 1 m/s, with the errors of wires and radio ---


def ubx(message: int, payload: bytes) -> bytes:
    return bytes(UBXMessage(b"\x01", bytes([message]), GET, payload=payload).serialize())


def epoch(time: int, fix: int = 3) -> bytes:
    """An epoch in three messages: 140 bytes."""
    latitude = HOME[0] + time * 90 // 1000  # 90e-7 deg are 1.0 m
    position = struct.pack("<IiiiiII", time, HOME[1], latitude, 200_000, 230_000, 2500, 4000)
    velocity = struct.pack("<IiiiIIiII", time, 100, 0, 0, 100, 100, 100_000, 20, 300_000)
    solution = struct.pack("<IihBBiiiIiiiIHBBI", time, 0, 1500, fix, 0x0D, *[0] * 8, 150, 0, 8, 0)
    return ubx(0x02, position) + ubx(0x12, velocity) + ubx(0x06, solution)


def pvt(time: int) -> bytes:
    """The same in one message, from newer receivers: 100 bytes."""
    payload = bytearray(92)
    struct.pack_into("<I", payload, 0, time)
    payload[11], payload[20:22] = 7, bytes((3, 1))
    struct.pack_into("<ii", payload, 24, HOME[1], HOME[0] + time * 90 // 1000)
    struct.pack_into("<I", payload, 40, 2500)
    struct.pack_into("<iiI", payload, 60, 1000, 100_000, 200)
    return ubx(0x07, bytes(payload))


def sample(counter: int, floats: bytes) -> bytes:
    """An MTData of twelve floats."""
    body = struct.pack(">BBB", 0xFF, 0x32, 50) + floats + struct.pack(">H", counter)
    return b"\xfa" + body + bytes([-sum(body) % 256])


def walking(tick: int, dice: random.Random) -> bytes:
    """Twelve floats of a dog that walks, turns slowly and shakes."""
    shake = [dice.gauss(0, 0.3) for _ in range(9)]
    return struct.pack(">12f", 25.0, *shake[:2], 9.8 + shake[2], *shake[3:9], 2 * shake[0], 30 + tick / 5)


def clean(ticks: int) -> list[Received]:
    """Nothing goes wrong; a fix in every sixth tick."""
    dice = random.Random(1)
    return [Received(epoch(40 * k) if k % 6 == 5 else b"", sample(k, walking(k, dice))) for k in range(ticks)]


MISSION = radio.Mission(
    radio.Position(32.6, -85.49),
    tuple(radio.Position(32.6 + north, -85.4899) for north in (0.0002, 0.0004, 0.0002)),
)
MESSAGES: dict[int, radio.Message] = {
    20: MISSION, 25: radio.Start(0xBAD), 30: radio.Start(MISSION.id), 100: radio.Override(Command.LEFT),
    110: radio.Override(Command.NONE), 190: radio.Abort(), 200: radio.Start(MISSION.id),
}  # fmt: skip


@cache
def stream() -> tuple[Received, ...]:
    """TICKS ticks: frames good, damaged, cut in two between ticks; noise; floats that are not numbers."""
    dice = random.Random(2010)
    held = {"gps": b"", "imu": b"", "radio": b""}
    ticks = []
    for k in range(TICKS):
        floats = bytearray(walking(k, dice))
        if dice.random() < 0.15:
            struct.pack_into(">f", floats, 4 * dice.randrange(12), dice.choice(SPECIAL))
        if dice.random() < 0.05:  # a signalling NaN, with bits of its own
            floats[44:48] = bytes.fromhex("ffa12345")
        coming = {"gps": b"", "imu": sample(k, bytes(floats)), "radio": b""}
        if k % 6 == 5 and not 120 < k < 160:
            coming["gps"] = pvt(40 * k) if k % 4 == 3 else epoch(40 * k, fix=dice.choice((3, 3, 3, 2)))
        if k in MESSAGES or k % 10 == 0:
            coming["radio"] = encode(MESSAGES.get(k, radio.Heartbeat(7)), answering(k))
        for source, data in coming.items():
            now = held[source] + data
            if now and dice.random() < 0.08 and k not in MESSAGES:  # a bit turned
                at = dice.randrange(len(now))
                now = now[:at] + bytes([now[at] ^ 1 << dice.randrange(8)]) + now[at + 1 :]
            if dice.random() < 0.08:
                now = dice.randbytes(dice.randrange(40)) + b"\xb5\xfa\xa5" + now
            cut = dice.randrange(len(now)) if now and dice.random() < 0.1 else len(now)
            coming[source], held[source] = now[:cut], now[cut:]
        ticks.append(Received(**coming))
    return tuple(ticks)


# --- processors ---


def sources() -> dict[str, str]:
    return library() | processor_in_the_loop()


@pytest.fixture
def cortex() -> Iterator[CortexM4F]:
    processor = cortex_m4f.start(TARGET, sources())
    yield processor
    processor.close()


def words(record: bytes) -> dict[str, int]:
    """The record by names."""
    return dict(zip(recorded(), struct.unpack(f"<{len(record) // 4}I", record), strict=True))


def difference(ours: Reply, theirs: Reply) -> dict[str, tuple[int, int]]:
    """Words of the record that are not the same."""
    a, b = words(ours.record), words(theirs.record)
    return {n: (a[n], b[n]) for n in a if a[n] != b[n]}


@cache
def replies_of_host() -> tuple[Reply, ...]:
    return tuple(reply for reply, _ in ticks_of_host())


@cache
def ticks_of_host() -> list[tuple[Reply, list[bytes]]]:
    """Each reply, and what lay in the mailbox before it."""
    processor = host.start(find_target("host"), sources())
    try:
        return [(processor.tick(received), list(processor.mailbox.contents)) for received in stream()]
    finally:
        processor.close()


# --- the same bits ---


def test_the_test_traffic_reaches_all_parts_of_the_program() -> None:
    # given the stream, when it has run
    replies = replies_of_host()
    seen = [words(reply.record) for reply in replies]
    # then all of it has been at work: fixes, gaps, damage, missions, commands, telemetry
    assert {w["estimator.output.valid"] for w in seen} == {0, 1}
    assert {w["controller.output.status"] for w in seen} >= {0, 1}
    assert len({w["controller.output.command"] for w in seen}) >= 3
    assert len({(r.tone_hz, r.vibrate_left, r.vibrate_right) for r in replies}) >= 3
    assert sum(bool(reply.sent) for reply in replies) == TICKS // 5
    last = seen[-1]
    assert min(last[f"{d}.{n}"] for d in ("gps", "imu", "radio") for n in ("frames", "errors")) > 0


def test_every_tick_on_the_cortex_leaves_the_bits_of_the_host(cortex: CortexM4F) -> None:
    # given the same program on this machine
    reference = host.start(find_target("host"), sources())
    assert cortex.start == reference.start
    reference.close()
    for k, (received, theirs) in enumerate(zip(stream(), replies_of_host(), strict=True)):
        # when both are given the same bytes
        ours = cortex.tick(received)
        # then they remember, send and play the same
        assert not difference(ours, theirs), f"tick {k}"
        assert replace(ours, cost=None) == theirs, f"tick {k}"


@pytest.mark.parametrize("target", ["host", "cortex-m4f"])
def test_a_damaged_image_is_made_anew(target: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given an image of which a bit changed
    monkeypatch.setattr("codegen.cache.cache_folder", lambda: tmp_path)
    image_of = {"host": host_image, "cortex-m4f": cortex_m4f_image}[target]
    image = image_of(find_target(target), sources())
    whole = image.path.read_bytes()
    image.path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    # when, then
    again = image_of(find_target(target), sources())
    assert again == image
    assert again.path.read_bytes() == whole


def test_parameters_as_constants_change_no_bit_on_the_cortex() -> None:
    processor = open_processor("cortex-m4f", constants=True)
    assert [replace(processor.tick(r), cost=None) for r in stream()[:60]] == list(replies_of_host()[:60])
    processor.close()


# --- the number of instructions ---


def instructions(processor: CortexM4F, ticks: list[Received]) -> list[int]:
    costs = [processor.tick(received).cost for received in ticks]
    return [cost.instructions for cost in costs if cost]


def test_same_bytes_take_the_same_instructions(cortex: CortexM4F) -> None:
    again = cortex_m4f.start(TARGET, sources())
    assert instructions(cortex, list(stream()[:60])) == instructions(again, list(stream()[:60]))
    again.close()


def test_instructions_counted_by_block_are_those_counted_one_by_one(cortex: CortexM4F) -> None:
    # given a processor that tells every instruction but those that an IT block passes over
    executed: Counter[int] = Counter()
    slow = cortex_m4f.start(TARGET, sources())
    slow.simulator.hook_add(UC_HOOK_CODE, lambda _uc, address, *_: executed.update([address]))
    slow.simulator.ctl_flush_tb()  # what the start-up has run already was translated without the hook
    passed_over = 0
    for received in stream()[:40]:
        # when it runs a tick
        executed.clear()
        slow.write(received)
        slow.resume("pil_done")
        seen, inside = dict(executed), set()
        slow.resume("pil_wait")
        # then each IT stands for all instructions of its block, and every other for itself
        count = 0
        for address, times in seen.items():
            code = bytes(slow.simulator.mem_read(address, 18))
            if code[1] == 0xBF and code[0] & 0xF:
                block = list(islice(addresses(code, address), 1, 5 - trailing_zeros(code[0] & 0xF)))
                inside.update(block)
                count += times * len(block)
                passed_over += times * len(block) - sum(seen.get(a, 0) for a in block)
        count += sum(times for address, times in seen.items() if address not in inside)
        # and another processor, which counts by blocks, has the same number
        cost = cortex.tick(received).cost
        assert cost
        assert cost.instructions == count
    assert passed_over > 0
    slow.close()


def addresses(code: bytes, begin: int) -> Iterator[int]:
    """Of the instructions from `begin` on: the first halfword of a long one is 0xE800 or more (A5.1)."""
    at = 0
    while at + 2 <= len(code):
        yield begin + at
        at += 4 if code[at + 1] >= 0xE8 else 2


def trailing_zeros(mask: int) -> int:
    return (mask & -mask).bit_length() - 1


@pytest.mark.parametrize(
    ("code", "count"),
    [
        ("4770", 1),  # bx lr
        ("00bf 4ff0ff30", 2),  # nop; mov.w r0, #-1
        ("b0ee400a dfed010a 00f002f8 0920", 4),  # vmov.f32; vldr; bl; movs
        ("08bf 0120", 2),  # it eq; moveq r0, #1
    ],
)
def test_instructions_of_two_and_of_four_bytes_are_told_apart(code: str, count: int) -> None:
    assert instructions_in(bytes.fromhex(code)) == count


# --- limits ---


def test_program_keeps_within_its_memory(cortex: CortexM4F) -> None:
    # given what the target may take, when a noisy stream has run
    for received in stream():
        cortex.tick(received)
    footprint = cortex.image.footprint
    # then code and constants, and variables and stack, fit
    assert footprint
    assert footprint.code + footprint.constants <= TARGET.code == 48_000
    assert footprint.ram + cortex.stack() <= TARGET.ram == 4_000
    assert 100 < cortex.stack() <= 512


def by_function(processor: CortexM4F, received: Received) -> Counter[str]:
    """Instructions of a tick by the function that they are in."""
    counts: Counter[str] = Counter()
    name = {a: n for begin, end, n in processor.functions for a in range(begin, end, 2)}

    def count(uc: Any, address: int, size: int, _: object) -> None:
        counts[name[address]] += instructions_in(bytes(uc.mem_read(address, size)))

    hook = processor.simulator.hook_add(UC_HOOK_BLOCK, count)
    processor.write(received)
    processor.resume("pil_done")
    processor.simulator.hook_del(hook)
    processor.resume("pil_wait")
    return counts


def test_blocks_keep_within_their_budget_with_a_fix(cortex: CortexM4F) -> None:
    # given ticks without damage, every sixth with a fix
    for received in clean(72):
        counts = by_function(cortex, received)
        # when it runs, then estimator, watchdog, controller, command module and plane keep within the budget
        blocks = {n: c for n, c in counts.items() if n.startswith(tuple(BLOCKS_IN_C))}
        assert {"four_state_step", "cmec_step", "watchdog_step", "command_module_step"} <= set(blocks)
        assert ("local_plane_step" in blocks) == bool(received.gps)
        assert sum(blocks.values()) <= BUDGET


def test_tick_keeps_within_its_budget_with_a_fix(cortex: CortexM4F) -> None:
    # given a sample in every tick, in every sixth an epoch of three messages, when they have run
    received = clean(240)
    costs = instructions(cortex, received)
    # then drivers and blocks together keep within the budget, telemetry in other ticks as well
    assert sum(bool(r.gps) for r in received) == 40
    assert max(costs) <= BUDGET


def test_footprint_leaves_out_mailbox_and_record() -> None:
    # given a mailbox twice as large and a record that does more
    files = sources()
    files["pil.h"] = files["pil.h"].replace("PIL_SIZE PORT_MOST", "PIL_SIZE 1024U")
    files["pil_record.c"] = files["pil_record.c"].replace(
        "words[0] =", "words[1] = m->time_ms / 7U;\n words[0] ="
    )
    before, after = cortex_m4f_image(TARGET, sources()), cortex_m4f_image(TARGET, files)
    assert after.symbols["bss_end"] - before.symbols["bss_end"] == 4 * 512
    # then the footprint is the same, while another variable of the program would count
    assert after.footprint == before.footprint
    files["onboard.h"] = files["onboard.h"].replace(
        "uint32_t time_ms;", "uint32_t spare[8]; uint32_t time_ms;"
    )
    larger = cortex_m4f_image(TARGET, files).footprint
    assert larger
    assert before.footprint
    assert larger.ram - before.footprint.ram == 32


def test_the_cortex_image_has_no_double_no_libm_and_no_heap(cortex: CortexM4F) -> None:
    # given the symbols of the image
    with cortex.image.path.open("rb") as file:
        table = ELFFile(file).get_section_by_name(".symtab")
        assert table is not None
        names = {s.name: s["st_shndx"] for s in table.iter_symbols() if s.name}  # type: ignore[attr-defined]
    # then nothing is left undefined, and what the compiler and the drivers call of a library are copies alone
    assert "SHN_UNDEF" not in names.values()
    assert {n for n in names if n.startswith("__")} <= {
        f"__aeabi_mem{n}{w}" for n in ("cpy", "move", "set", "clr") for w in ("", 4, 8)
    }
    assert not {"sin", "cos", "sinf", "cosf", "atan2f", "sqrt", "sqrtf", "floor", "malloc", "free"} & set(
        names
    )


# --- arithmetic and memory of our own against numpy and Python ---

PROBE = """#include "pil.h"
#include <math.h>
#include <string.h>
static float number(const uint8_t *bytes)
{
    float value;
    (void)memcpy(&value, bytes, sizeof(value));
    return value;
}
static void put(uint32_t *word, float value)
{
    (void)memcpy(word, &value, sizeof(value));
}
void pil_record(uint32_t *words)
{
    const uint8_t *const input = pil_received[PORT_RADIO];
    for (uint32_t i = 0U; i < 16U; i++) {
        const float x = number(&input[8U * i]);
        const float y = number(&input[(8U * i) + 4U]);
        put(&words[7U * i], sqrtf(x));
        put(&words[(7U * i) + 1U], floorf(x));
        put(&words[(7U * i) + 2U], fabsf(x));
        put(&words[(7U * i) + 3U], x + y);
        put(&words[(7U * i) + 4U], x - y);
        put(&words[(7U * i) + 5U], x * y);
        put(&words[(7U * i) + 6U], x / y);
    }
}
"""


def test_arithmetic_on_the_cortex_is_that_of_ieee_754() -> None:
    # given numbers of all kinds: whole and halves about every power of two, subnormal, random bits
    dice = random.Random(754)
    edges = [s * (2.0**e + d) for s in (1, -1) for e in range(-3, 26) for d in (-1, -0.5, 0, 0.5, 1)]
    edges += [2.0**23 - 0.5, 2.0**31, -(2.0**31), 2.0**32, 1e-45, 2**-126, 2**-127, *SPECIAL]
    bits = [struct.unpack("<f", dice.randbytes(4))[0] for _ in range(16 * 60 - len(edges))]
    x = np.array(edges + bits, dtype=np.float32)
    y = np.array(dice.sample(list(x), len(x)), dtype=np.float32)
    processor = cortex_m4f.start(TARGET, sources() | {"pil_record.c": PROBE})
    operands = np.column_stack([x, y]).astype("<f4")
    # when the processor does them
    records = [
        processor.tick(Received(radio=operands[k : k + 16].tobytes())).record for k in range(0, len(x), 16)
    ]
    processor.close()
    ours = np.concatenate([np.frombuffer(r, "<f4")[: 7 * 16].reshape(16, 7) for r in records])
    # then they are numpy's to the last bit; of NaN, whose bits differ between processors, that they are NaN
    with np.errstate(all="ignore"):
        theirs = np.column_stack([np.sqrt(x), np.floor(x), np.abs(x), x + y, x - y, x * y, x / y])
    same = (ours.view("<u4") == theirs.view("<u4")) | (np.isnan(ours) & np.isnan(theirs))
    assert same.all(), [(x[i], y[i], j, ours[i, j], theirs[i, j]) for i, j in np.argwhere(~same)[:5]]
    assert len(x) == 960


MOVES = """#include "pil.h"
#include <string.h>
static uint8_t area[128];
void pil_record(uint32_t *words)
{
    const uint8_t *const input = pil_received[PORT_RADIO];
    for (uint32_t i = 0U; i < sizeof(area); i++) {
        area[i] = (uint8_t)(i + 1U);
    }
    if (input[0] == 0U) {
        (void)memmove(&area[input[1]], &area[input[2]], input[3]);
    } else if (input[0] == 1U) {
        (void)memset(&area[input[1]], input[2], input[3]);
    } else {
        (void)memcpy(&area[input[1]], &area[input[2]], input[3]);
    }
    for (uint32_t i = 0U; i < (sizeof(area) / 4U); i++) {
        (void)memcpy(&words[i], &area[4U * i], sizeof(words[i]));
    }
}
"""


def test_memcpy_memmove_and_memset_work_at_any_alignment() -> None:
    processor = cortex_m4f.start(TARGET, sources() | {"pil_record.c": MOVES})
    dice = random.Random(4)
    cases = [(0, a, b, n) for a in range(6) for b in range(6) for n in (0, 1, 3, 4, 5, 9)]  # they overlap
    cases += [(1, dice.randrange(60), dice.randrange(256), dice.randrange(60)) for _ in range(60)]
    cases += [(2, dice.randrange(0, 30), dice.randrange(64, 90), dice.randrange(34)) for _ in range(60)]
    for case in cases:
        # given bytes 1, 2, ... when some are moved, filled or copied
        what, to, of, n = case
        record = processor.tick(Received(radio=bytes(case))).record[:128]
        # then it is what Python makes of them
        area = bytearray(range(1, 129))
        area[to : to + n] = bytes([of]) * n if what == 1 else bytes(area[of : of + n])
        assert record == bytes(area), case
    processor.close()


# --- what goes wrong ---


FAULTS = {
    "for (;;) {}": r"does not come back: 40000 instructions are over, at 0x\w+ \(onboard_tick\+",
    "*(volatile uint32_t *)0x40021000U = 1U;": r"write to 0x40021000, .* no memory, at .*\(onboard_tick\+",
    "(void)*(volatile uint8_t *)0x30000004U;": r"read from 0x30000004, .* no memory, at .*\(onboard_tick\+",
    "*(volatile uint32_t *)0x00000100U = 1U;": r"write to 0x00000100, .* protected, at .*\(onboard_tick\+",
    "((void (*)(void))0x30000001U)();": r"execute 0x30000000, where there is no memory",
    "((void (*)(void))0x20001001U)();": r"execute 0x20001000, which is protected",
    "*(volatile uint32_t *)0xE000ED0CU = 1U;": r"write to 0xe000ed0c, .* no memory, at .*\(onboard_tick\+",
    '__asm__ volatile("svc 0");': r"stopped by exception 2 .*\(onboard_tick\+",
    '__asm__ volatile("udf 0");': r"stopped by .*\(onboard_tick\+",
    "deep(&m->pause);": r"write to 0x1ff\w+, .* no memory: the stack is too small, at .*\((deep|mem\w+)\+",
}
DEEP = """#include <stdint.h>
#include <string.h>
void deep(uint8_t *byte);
void deep(uint8_t *byte)
{
    uint8_t bytes[2000];
    (void)memset(bytes, *byte, sizeof(bytes));
    *byte = bytes[*byte];
}
"""


def faulty() -> dict[str, str]:
    """The program, with a fault at the end of the tick: the one whose number the radio brings."""
    end, files = "m->time_ms += ONBOARD_TICK_MS;", sources()
    assert end in files["onboard.c"]
    cases = "\n".join(f"case {i}U: {{ {s} break; }}" for i, s in enumerate(FAULTS, 1))
    onboard = files["onboard.c"].replace(
        end, f"{end}\nswitch (pil_received[2][0]) {{ {cases} default: break; }}"
    )
    head = "#include <stdint.h>\nextern uint8_t pil_received[3][512];\nvoid deep(uint8_t *byte);\n"
    return files | {"onboard.c": head + onboard, "deep.c": DEEP}


@pytest.mark.parametrize("number", range(1, len(FAULTS) + 1), ids=list(FAULTS))
def test_a_fault_of_the_processor_is_named_with_its_place(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a program that may run for 40,000 instructions, and works
    processor = cortex_m4f.start(TARGET, faulty())
    monkeypatch.setattr(cortex_m4f, "LIMIT", 40_000)
    processor.tick(Received(radio=b"\0"))
    # when it does something forbidden, then the error names it and the place
    with pytest.raises(ProcessorError, match=list(FAULTS.values())[number - 1]):
        processor.tick(Received(radio=bytes([number])))
    processor.close()


def test_a_main_that_returns_ends_in_the_hard_fault_handler() -> None:
    main = """void pil_wait(void);
    void pil_done(void);
    int main(void);
    int main(void)
    {
        static volatile int ticks = 0;
        if (ticks > 0) {
            pil_wait();
            pil_done();
        }
        return 0;
    }
    """
    with pytest.raises(
        ProcessorError, match=r"stopped by HardFault_Handler, at 0x\w+ \(HardFault_Handler\+0x0\)"
    ):
        cortex_m4f.start(TARGET, sources() | {"pil_main.c": main})


def test_a_start_up_that_leaves_the_fpu_off_is_refused() -> None:
    startup = own_files(TARGET)["startup.c"].replace("CPACR |= FPU_ACCESS;", "CPACR |= 0U;")
    with pytest.raises(ProcessorError, match=r"FPU off.*CPACR is 0x00000000, expected 0x00f00000"):
        cortex_m4f.start(TARGET, sources() | {"startup.c": startup})


def test_variables_have_their_start_values_after_the_start_up() -> None:
    # given a variable in .data and one in .bss
    probe = """#include "pil.h"
    static uint32_t first = 0xC0FFEEU;
    static uint32_t second;
    void pil_record(uint32_t *words)
    {
        words[0] = first;
        words[1] = second;
        first += vest.time_ms;
        second++;
    }
    """
    # when it starts, and ticks once
    processor = cortex_m4f.start(TARGET, sources() | {"pil_record.c": probe})
    one, two = processor.start, processor.tick(Received()).record
    # then they were copied from flash and cleared
    assert struct.unpack("<2I", one[:8]) == (0xC0FFEE, 0)
    assert struct.unpack("<2I", two[:8]) == (0xC0FFEE, 1)
    processor.close()


def test_more_bytes_than_the_cortexs_mailbox_holds_are_refused(cortex: CortexM4F) -> None:
    with pytest.raises(ProcessorError, match="imu: 513 bytes wait, expected at most 512"):
        cortex.tick(Received(imu=bytes(513)))


def test_c_refused_for_the_cortex_is_reported_in_the_compilers_words() -> None:
    with pytest.raises(CompileError, match=r"onboard for the Cortex-M4F: .* refuses it:(.|\n)*no_such"):
        cortex_m4f_image(TARGET, sources() | {"more.c": "no_such();"})


# --- a second opinion, of a simulator that wants some words aligned, as boards do and Unicorn does not ---

TOOLS = ("arm-none-eabi-gcc", "qemu-system-arm")
ABSENT = [tool for tool in TOOLS if not shutil.which(tool)]
GCC = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
second_opinion = pytest.mark.skipif(
    bool(ABSENT) and os.environ.get("CI") != "true",
    reason=f"{', '.join(ABSENT)} not here; apt install gcc-arm-none-eabi qemu-system-arm",
)


def run_board(elf: Path, folder: Path, *options: str) -> None:
    """QEMU's Cortex-M4 board, until the program ends it."""
    board = [TOOLS[1], "-M", "mps2-an386", "-nographic", "-semihosting-config", "enable=on,target=native"]
    subprocess.run([*board, *options, "-kernel", str(elf)], cwd=folder, check=True, timeout=120)


def compile_with_gcc(units: list[str], folder: Path) -> None:
    command = [TOOLS[0], *GCC, *PORTABLE, *WARNINGS, "-I.", *LINKING, SCRIPT, "-o", "onboard.elf", *units]
    subprocess.run(command, cwd=folder, check=True)


def compile_with_zig(units: list[str], folder: Path) -> None:
    zig(["cc", *FLAGS, SCRIPT, "-o", "onboard.elf", *units], "onboard", folder)


@second_opinion
@pytest.mark.parametrize("compile", [compile_with_gcc, compile_with_zig])
def test_the_program_on_qemu_has_the_same_bits(
    compile: Callable[[list[str], Path], None], tmp_path: Path
) -> None:
    # given the same sources with a main that reads and writes files
    files = own_files(TARGET) | sources()
    for name in ("pil_main.c", "pil_stops.c", "main.c"):
        del files[name]
    files["semihosting.c"] = Path(__file__).with_name("semihosting.c").read_text()
    write_files(files, tmp_path)
    compile(sorted(n for n in files if n.endswith(".c")), tmp_path)
    boxes = [struct.pack("<3H512s512s512s", *map(len, waiting), *waiting) for _, waiting in ticks_of_host()]
    (tmp_path / "received").write_bytes(b"".join(boxes))
    # when the board runs it
    run_board(tmp_path / "onboard.elf", tmp_path)
    # then every reply is the host's
    layout = struct.Struct(f"<{4 * len(recorded())}sH512sH??")
    replies = [
        Reply(record, sent[:count], tone, left, right)
        for record, count, sent, tone, left, right in layout.iter_unpack((tmp_path / "replies").read_bytes())
    ]
    assert len(replies) == TICKS
    for k, (ours, theirs) in enumerate(zip(replies, replies_of_host(), strict=True)):
        assert not difference(ours, theirs), f"tick {k}"
        assert ours == theirs, f"tick {k}"


ENDING = """for (int32_t tick = 0; tick < 8; tick++) {
        pil_counts[PORT_GPS] = COUNTS[0];
        pil_counts[PORT_IMU] = COUNTS[1];
        pil_counts[PORT_RADIO] = COUNTS[2];
        pil_wait();
        pil_sent_count = 0U;
        onboard_tick(&vest);
        pil_done();
        pil_record(pil_recorded);
    }
    pil_wait();
    __asm__ volatile("movs r0, #0x18; movw r1, #0x26; movt r1, #2; bkpt 0xAB" ::: "r0", "r1");
    return 0;
"""


@second_opinion
def test_qemu_executes_as_many_instructions_as_unicorn(tmp_path: Path) -> None:
    # given an image with a mailbox that is always full of the same, and an end after 8 ticks
    received = Received(epoch(40), clean(1)[0].imu)
    data = (received.gps, received.imu, received.radio)
    contents = ", ".join("{" + ", ".join(map(str, d or [0])) + "}" for d in data)
    files = sources()
    mailbox = "pil_received[PORT_SOURCES][PIL_SIZE]"
    assert f"{mailbox};" in files["pil.c"]
    files["pil.c"] = files["pil.c"].replace(f"{mailbox};", f"{mailbox} = {{{contents}}};")
    main = files["pil_main.c"]
    main = main[: main.index("for (;;)")] + ENDING + "}\n"
    for i, d in enumerate(data):
        main = main.replace(f"COUNTS[{i}]", str(len(d)))
    files["pil_main.c"] = main
    processor = cortex_m4f.start(TARGET, files)
    counted = []
    for _ in range(8):  # the program fills its mailbox by itself
        processor.resume("pil_done")
        counted.append(processor.instructions)
        processor.resume("pil_wait")
    # when QEMU runs the same image, one instruction after another
    version = subprocess.run([TOOLS[1], "--version"], capture_output=True, text=True, check=True).stdout
    old = int(version.split("version ")[1].split(".")[0]) < 8
    one_by_one = ["-singlestep"] if old else ["-accel", "tcg,one-insn-per-tb=on"]
    run_board(processor.image.path, tmp_path, *one_by_one, "-d", "exec,nochain", "-D", "trace")
    trace = [line for line in (tmp_path / "trace").read_text().splitlines() if line.startswith("Trace")]
    pcs = [int(line.split("[")[1].split("/")[1], 16) for line in trace]
    # then there are as many between pil_wait's return and pil_done
    waits = [i for i, pc in enumerate(pcs) if pc == processor.image.symbols["pil_wait"]]
    dones = [i for i, pc in enumerate(pcs) if pc == processor.image.symbols["pil_done"]]
    assert [done - wait - 1 for wait, done in zip(waits, dones, strict=False)] == counted
    assert len(dones) == 8
    processor.close()


def test_a_signal_while_the_simulator_runs_is_raised_once_the_tick_is_done(
    cortex: CortexM4F, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a signal that raises what Ctrl-C raises, soon after the simulator's first callback of each tick
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    def set_off(*_: object) -> None:
        if due:
            signal.setitimer(signal.ITIMER_REAL, due.pop())

    due: list[float] = []  # s
    dropped: list[object] = []
    interrupts = 0
    monkeypatch.setattr(sys, "unraisablehook", dropped.append)
    cortex.simulator.hook_add(UC_HOOK_BLOCK, set_off)
    twin = cortex_m4f.start(TARGET, sources())
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        for _ in range(40):
            # when
            try:
                due.append(2e-5)
                cortex.resume("pil_done")
                time.sleep(0.01)
            except KeyboardInterrupt:
                interrupts += 1
            # then the program has come as far as one that nothing interrupts, by as many instructions
            twin.resume("pil_done")
            assert cortex.instructions == twin.instructions
            for processor in (cortex, twin):
                processor.resume("pil_wait")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        twin.close()
    assert dropped == []
    assert interrupts == 40
