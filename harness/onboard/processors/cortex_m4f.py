"""An ARM Cortex-M4F, simulated by Unicorn, which executes and counts each instruction.

Faults of the processor are ProcessorErrors: addresses without memory, writes to flash, code outside it,
undefined instructions, and every handler of startup.c.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

from elftools.elf.elffile import ELFFile
from unicorn import unicorn_const as u
from unicorn.arm_const import UC_ARM_REG_LR, UC_ARM_REG_PC, UC_ARM_REG_SP, UC_CPU_ARM_CORTEX_M4
from unicorn.unicorn_py3.unicorn import Uc, UcError

from codegen.firmware.bundle import recorded
from codegen.firmware.cortex_m4f import cortex_m4f_image
from codegen.firmware.image import Image, with_key
from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.targets import Target
from codegen.scratch import Scratch
from harness.interrupts import held_interrupts
from harness.onboard.processors.processor import (
    COUNTS,
    MAX_BYTES,
    Cost,
    Mailbox,
    ProcessorError,
    Received,
    Reply,
)

FLASH, RAM = 0x00000000, 0x20000000  # where link.ld puts them
SYSTEM, SYSTEM_SIZE = 0xE000E000, 0x1000  # the system control space; only CPACR is simulated
CPACR = 0xE000ED88 - SYSTEM
FPU_ACCESS = 0xF << 20
LIMIT = 2_000_000  # instructions from one stop to the next: all of 40 ms at 50 MHz
PAINT = 0xA5
FETCH = {u.UC_MEM_FETCH_UNMAPPED, u.UC_MEM_FETCH_PROT}
WRITE = {u.UC_MEM_WRITE_UNMAPPED, u.UC_MEM_WRITE_PROT}
PROTECTED = {u.UC_MEM_WRITE_PROT, u.UC_MEM_READ_PROT, u.UC_MEM_FETCH_PROT}
INVALID = u.UC_HOOK_MEM_READ_INVALID | u.UC_HOOK_MEM_WRITE_INVALID | u.UC_HOOK_MEM_FETCH_INVALID


class CortexM4F:
    """The processor from its reset on, stopped before each tick."""

    def __init__(self, image: Image, navigation: Navigation = DEFAULT) -> None:
        self.image = image
        self._record_bytes = 4 * len(recorded(navigation))
        self.instructions = 0  # executed since the last stop
        self._lengths: dict[tuple[int, int], int] = {}  # instructions by address and bytes of a block
        self._segments: list[tuple[int, int, bytes]] = []  # address in flash and of use, content
        self.simulator = _simulator()
        self.simulator.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M4)
        # before any run: code that was translated without the stops would run through them
        self.simulator.ctl_exits_enabled(True)
        self.simulator.ctl_set_exits([image.symbols["pil_wait"], image.symbols["pil_done"]])
        self.simulator.mem_map(FLASH, image.symbols["flash_size"], u.UC_PROT_READ | u.UC_PROT_EXEC)
        self.simulator.mem_map(RAM, image.symbols["ram_size"], u.UC_PROT_READ | u.UC_PROT_WRITE)
        self.simulator.mmio_map(SYSTEM, SYSTEM_SIZE, self._read_system, None, self._write_system, None)
        self.functions: list[tuple[int, int, str]] = []  # begin, end, name
        self._load()
        self._stack = image.symbols["stack_bottom"], image.symbols["stack_top"]
        self.simulator.mem_write(self._stack[0], bytes([PAINT]) * (self._stack[1] - self._stack[0]))
        self.simulator.hook_add(u.UC_HOOK_BLOCK, self._count)
        self.simulator.hook_add(u.UC_HOOK_INTR, self._interrupt)
        self.simulator.hook_add(INVALID, self._no_access)
        for begin, _, name in self.functions:
            if name.endswith("_Handler") and name != "Reset_Handler":
                self.simulator.hook_add(u.UC_HOOK_BLOCK, self._handler, name, begin, begin)
        self._reset()

    def reset(self, session: int) -> None:
        """As `Resettable.reset`."""
        self.simulator.mem_write(self._place_in_flash("pil_session"), session.to_bytes(4, "little"))
        self._reset()

    def _place_in_flash(self, name: str) -> int:
        """Where the start-up gets a variable's value from."""
        address = self.image.symbols[name]
        for there, begin, data in self._segments:
            if begin <= address < begin + len(data):
                return there + address - begin
        raise ProcessorError(f"cortex-m4f: the image has no value for {name}")

    def _load(self) -> None:
        with self.image.path.open("rb") as file:
            elf: Any = ELFFile(file)
            for segment in elf.iter_segments("PT_LOAD"):
                self._segments.append((segment["p_paddr"], segment["p_vaddr"], segment.data()))
                self.simulator.mem_write(segment["p_paddr"], segment.data())
            for symbol in elf.get_section_by_name(".symtab").iter_symbols():
                if symbol["st_info"]["type"] == "STT_FUNC":
                    begin = symbol["st_value"] & ~1
                    self.functions.append((begin, begin + symbol["st_size"], symbol.name))

    def _reset(self) -> None:
        self.mailbox, self._fault = Mailbox(), ""
        self._enabled = 0  # CPACR
        stack, reset = struct.unpack("<II", self.simulator.mem_read(FLASH, 8))
        self.simulator.reg_write(UC_ARM_REG_SP, stack)
        self._run(reset, "pil_wait")
        if self._enabled & FPU_ACCESS != FPU_ACCESS:
            raise ProcessorError(
                f"cortex-m4f: the start-up leaves the FPU off, whose first instruction would be a fault: "
                f"CPACR is {self._enabled:#010x}, expected {FPU_ACCESS:#010x}"
            )
        self.start = self._record()

    # --- hooks, called while it runs ---

    def _count(self, uc: Any, address: int, size: int, _: object) -> None:
        """Count a block of code that begins: it is entered only at its start and left at its end."""
        key = address, size
        try:
            self.instructions += self._lengths[key]
        except KeyError:
            self._lengths[key] = instructions_in(bytes(uc.mem_read(address, size)))
            self.instructions += self._lengths[key]
        if self.instructions > LIMIT:
            self._stop(f"does not come back: {LIMIT} instructions are over", address)

    def _handler(self, uc: Any, address: int, size: int, name: str) -> None:
        self._stop(f"stopped by {name}", address)

    def _interrupt(self, uc: Any, number: int, _: object) -> None:
        self._stop(f"stopped by exception {number} of the simulator", uc.reg_read(UC_ARM_REG_PC))

    def _no_access(self, uc: Any, access: int, address: int, size: int, value: int, _: object) -> bool:
        what = "execute" if access in FETCH else "write to" if access in WRITE else "read from"
        why = "which is protected" if access in PROTECTED else "where there is no memory"
        if RAM - 0x1000 <= address < RAM:
            why += ": the stack is too small"
        self._stop(f"tried to {what} {address:#010x}, {why}", uc.reg_read(UC_ARM_REG_PC))
        return False

    def _read_system(self, uc: Any, offset: int, size: int, _: object) -> int:
        if offset != CPACR:
            self._no_access(uc, u.UC_MEM_READ_UNMAPPED, SYSTEM + offset, size, 0, None)
        return self._enabled

    def _write_system(self, uc: Any, offset: int, size: int, value: int, _: object) -> None:
        if offset != CPACR:
            self._no_access(uc, u.UC_MEM_WRITE_UNMAPPED, SYSTEM + offset, size, value, None)
        self._enabled = value

    def _stop(self, reason: str, pc: int) -> None:
        if not self._fault:
            self._fault = f"{reason}, at {self.place(pc)}"
        self.simulator.emu_stop()

    # --- from stop to stop ---

    def _run(self, begin: int, end: str) -> None:
        """Run until one of the two empty functions is called, and count the instructions."""
        self.instructions = 0
        until = self.image.symbols[end]
        try:
            with held_interrupts():  # what a hook raises between its call and its code is dropped
                self.simulator.emu_start(begin | 1, 0)  # Thumb; the end is one of the exits
        except UcError as reason:
            self._stop(f"stopped by the simulator ({reason})", self.simulator.reg_read(UC_ARM_REG_PC))
        pc = self.simulator.reg_read(UC_ARM_REG_PC)
        if not self._fault and pc != until:
            self._stop("stopped", pc)
        if self._fault:
            raise ProcessorError(f"cortex-m4f: the program {self._fault}, on the way to {end}")

    def resume(self, end: str) -> None:
        """Return from the function where it stopped, and run to the other.

        Raises:
            ProcessorError: it does not get there.
        """
        self._run(self.simulator.reg_read(UC_ARM_REG_LR), end)

    def write(self, received: Received) -> None:
        """Fill the mailbox.

        Raises:
            ProcessorError: a source has more bytes than the mailbox takes.
        """
        symbols = self.image.symbols
        left = COUNTS.unpack(self.simulator.mem_read(symbols["pil_counts"], COUNTS.size))
        waiting = self.mailbox.put(received, left)
        for i, data in enumerate(waiting):
            self.simulator.mem_write(symbols["pil_received"] + i * MAX_BYTES, data)
        self.simulator.mem_write(symbols["pil_counts"], COUNTS.pack(*map(len, waiting)))

    def tick(self, received: Received) -> Reply:
        """One tick of the program; its cost is that between pil_wait and pil_done."""
        self.write(received)
        self.resume("pil_done")
        cost = Cost(self.instructions)
        self.resume("pil_wait")
        symbols = self.image.symbols
        return Reply(
            self._record(),
            bytes(self.simulator.mem_read(symbols["pil_sent"], self._number("pil_sent_count", 2))),
            self._number("pil_tone_hz", 2),
            bool(self._number("pil_vibrate_left", 1)),
            bool(self._number("pil_vibrate_right", 1)),
            cost,
        )

    def _number(self, name: str, size: int) -> int:
        return int.from_bytes(self.simulator.mem_read(self.image.symbols[name], size), "little")

    def _record(self) -> bytes:
        return bytes(self.simulator.mem_read(self.image.symbols["pil_recorded"], self._record_bytes))

    def place(self, pc: int) -> str:
        """An address in the program, with the function that it is in."""
        for begin, end, name in self.functions:
            if begin <= pc < end:
                return f"{pc:#010x} ({name}+{pc - begin:#x})"
        return f"{pc:#010x}"

    def stack(self) -> int:
        """Most bytes of stack used so far, including pil_main.c's."""
        bottom, top = self._stack
        untouched = self.simulator.mem_read(bottom, top - bottom)
        return len(untouched.lstrip(bytes([PAINT])))

    def close(self) -> None:
        """Give back the simulator's memory."""
        del self.simulator


def _simulator() -> Any:
    """Unicorn, whose functions have no types."""
    return Uc(u.UC_ARCH_ARM, u.UC_MODE_THUMB | u.UC_MODE_MCLASS)


def instructions_in(block: bytes) -> int:
    """The number of instructions in a block of Thumb code (ARMv7-M manual, A5.1).

    Skipped instructions of an IT block count too: the processor executes them as no operation.
    """
    count = at = 0
    while at < len(block):
        at += 4 if block[at + 1] >> 3 in (0b11101, 0b11110, 0b11111) else 2
        count += 1
    return count


def start(
    target: Target,
    files: Mapping[str, str],
    navigation: Navigation = DEFAULT,
    key: Key = SIMULATION_KEY,
) -> CortexM4F:
    """The processor with a program of these sources, and this key in the place of the simulation's."""
    with Scratch() as folder:
        return CortexM4F(with_key(cortex_m4f_image(target, files), key, folder), navigation)
