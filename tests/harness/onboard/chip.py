"""An STM32F405 as ST's manual describes it, as far as the port goes: the flashed program runs on it.

Source: ST RM0090. Addresses and bits are written down here anew, so that port and chip agree only if both are
right. What the manual forbids is an error: a part that is used without its clock, a PLL that is set while it
runs, a flash that is too slow for its clock.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

from elftools.elf.elffile import ELFFile
from unicorn import unicorn_const as u
from unicorn.arm_const import (
    UC_ARM_REG_LR,
    UC_ARM_REG_PC,
    UC_ARM_REG_R0,
    UC_ARM_REG_R1,
    UC_ARM_REG_R2,
    UC_ARM_REG_SP,
    UC_CPU_ARM_CORTEX_M4,
)
from unicorn.unicorn_py3.unicorn import Uc

from codegen.firmware.image import Image

FLASH, RAM = 0x08000000, 0x20000000
PERIPHERALS, NOISE, SYSTEM = (0x40000000, 0x80000), (0x50060000, 0x1000), (0xE000E000, 0x1000)
FACTORY = 0x1FFF7000  # a page of what the factory has written
REFERENCE = 0x1FFF7A2A  # VREFINT_CAL: the reference as a converter with 3.3 V measures it
ENDLESS = 200_000  # turns of an empty loop
RETURN = RAM + 0x1FF00  # where a function that is called returns to: nothing is executed there


def _registers(base: int, names: str, begin: int = 0) -> Iterator[tuple[str, int]]:
    """Addresses of registers in a row; "-" is none."""
    prefix, _, rest = names.partition(": ")
    for i, name in enumerate(rest.split()):
        if name != "-":
            yield f"{prefix}_{name}", base + begin + 4 * i


GPIO = "MODER OTYPER OSPEEDR PUPDR IDR ODR BSRR LCKR AFRL AFRH"
USART = "SR DR BRR CR1 CR2 CR3"
ADDRESSES: dict[str, int] = {
    name: address
    for row in (
        _registers(
            0x40000800, "TIM4: CR1 CR2 SMCR DIER SR EGR CCMR1 CCMR2 CCER CNT PSC ARR - CCR1 CCR2 CCR3 CCR4"
        ),
        _registers(0x40003000, "IWDG: KR PR RLR SR"),
        _registers(0x40004800, f"USART3: {USART}"),
        _registers(0x40011000, f"USART1: {USART}"),
        _registers(0x40011400, f"USART6: {USART}"),
        _registers(0x40012000, "ADC1: SR CR1 CR2 SMPR1 SMPR2"),
        _registers(0x40012000, "ADC1: SQR1 SQR2 SQR3", 0x2C),
        _registers(0x40012000, "ADC1: DR", 0x4C),
        _registers(0x40012300, "ADC: CSR CCR"),
        _registers(0x40020000, f"GPIOA: {GPIO}"),
        _registers(0x40020400, f"GPIOB: {GPIO}"),
        _registers(0x40020800, f"GPIOC: {GPIO}"),
        _registers(0x40023800, "RCC: CR PLLCFGR CFGR CIR"),
        _registers(0x40023800, "RCC: AHB1ENR AHB2ENR AHB3ENR - APB1ENR APB2ENR", 0x30),
        _registers(0x40023C00, "FLASH: ACR"),
        _registers(0x50060800, "RNG: CR SR DR"),
        _registers(0xE000E010, "SYST: CSR RVR CVR"),
        _registers(0xE000E100, "NVIC: ISER0 ISER1 ISER2"),
        _registers(0xE000ED08, "SCB: VTOR"),
        _registers(0xE000ED88, "SCB: CPACR"),
    )
    for name, address in row
}
NAMES = {address: name for name, address in ADDRESSES.items()}
CLOCKED = {  # part: register and bit without which it has no clock
    "GPIOA": ("RCC_AHB1ENR", 0),
    "GPIOB": ("RCC_AHB1ENR", 1),
    "GPIOC": ("RCC_AHB1ENR", 2),
    "RNG": ("RCC_AHB2ENR", 6),
    "TIM4": ("RCC_APB1ENR", 2),
    "USART3": ("RCC_APB1ENR", 18),
    "USART1": ("RCC_APB2ENR", 4),
    "USART6": ("RCC_APB2ENR", 5),
    "ADC1": ("RCC_APB2ENR", 8),
    "ADC": ("RCC_APB2ENR", 8),
}
AT_RESET = {"RCC_CR": 0x83, "RCC_PLLCFGR": 0x24003010, "GPIOA_MODER": 0xA8000000, "GPIOB_MODER": 0x280}
HSI, HSE, PLL = 0, 16, 24  # bits of RCC_CR that switch a clock on; the next one tells that it is ready
FEED = 0xAAAA  # IWDG_KR


class ChipError(AssertionError):
    """The program did what the manual forbids, or did not come where it was to come."""


class Chip:
    """The chip from its reset on.

    Args:
        image: the program that is flashed.
        crystal: it swings when it is switched on.
        pll: it locks.
        numbers: what the noise generator gives; it repeats the last for ever.
        noise_fault: the generator tells a fault of its seed until it is switched off and on.

    Attributes:
        registers: what was written last, by the manual's names.
        writes: name and value of each write, in order.
        reads: of registers, so far.
        analog: what the converter measures, by channel; None: it never ends.
        sent: bytes written to the radio's transmitter.
    """

    def __init__(
        self,
        image: Image,
        *,
        crystal: bool = True,
        pll: bool = True,
        numbers: tuple[int, ...] = (11, 22, 33),
        noise_fault: bool = False,
    ) -> None:
        self.image, self.crystal, self.pll = image, crystal, pll
        self.numbers, self.noise_fault = list(numbers), noise_fault
        self.registers = dict.fromkeys(ADDRESSES, 0) | AT_RESET
        self.writes: list[tuple[str, int]] = []
        self.reads = 0
        self.analog: dict[int, int] | None = None
        self.sent = bytearray()
        self.transmits = True  # a byte leaves at once
        self._fault = ""
        self._simulator = Uc(u.UC_ARCH_ARM, u.UC_MODE_THUMB | u.UC_MODE_MCLASS)
        simulator = self._simulator
        simulator.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M4)
        simulator.ctl_exits_enabled(True)
        simulator.ctl_set_exits([image.symbols["port_clock_ms"], RETURN])
        simulator.mem_map(FLASH, 1 << 20, u.UC_PROT_READ | u.UC_PROT_EXEC)
        simulator.mem_map(RAM, 128 << 10)
        simulator.mem_map(FACTORY, 0x1000, u.UC_PROT_READ)
        for begin, size in (PERIPHERALS, NOISE, SYSTEM):
            simulator.mmio_map(begin, size, self._read, begin, self._write, begin)
        simulator.hook_add(u.UC_HOOK_BLOCK, self._count)
        self._block, self._turns = 0, 0
        with image.path.open("rb") as file:
            elf: Any = ELFFile(file)
            for segment in elf.iter_segments("PT_LOAD"):
                simulator.mem_write(segment["p_paddr"], segment.data())

    # --- running ---

    def boot(self) -> None:
        """From the reset to where main asks for the time first.

        Raises:
            ChipError: it does not come there.
        """
        stack, start = struct.unpack("<II", self._simulator.mem_read(FLASH, 8))
        self._simulator.reg_write(UC_ARM_REG_SP, stack)
        self._run(start, self.image.symbols["port_clock_ms"])

    def call(self, function: str, *arguments: int) -> int:
        """A function of the port; what it returns.

        Raises:
            ChipError: it does not return.
        """
        for register, value in zip((UC_ARM_REG_R0, UC_ARM_REG_R1, UC_ARM_REG_R2), arguments, strict=False):
            self._simulator.reg_write(register, value)
        self._simulator.reg_write(UC_ARM_REG_LR, RETURN | 1)
        self._run(self.image.symbols[function], RETURN)
        result: int = self._simulator.reg_read(UC_ARM_REG_R0)
        return result

    def interrupt(self, number: int) -> None:
        """An interrupt, by its entry in the table that the processor reads.

        Raises:
            ChipError: it is not enabled, or has no handler.
        """
        if not self.registers[f"NVIC_ISER{number // 32}"] >> number % 32 & 1:
            raise ChipError(f"interrupt {number} is not enabled")
        (handler,) = struct.unpack("<I", self.memory(self.registers["SCB_VTOR"] + 4 * (16 + number), 4))
        self._simulator.reg_write(UC_ARM_REG_LR, RETURN | 1)
        self._run(handler, RETURN)

    def memory(self, address: int, size: int) -> bytes:
        """Bytes of flash or RAM."""
        return bytes(self._simulator.mem_read(address, size))

    def place(self, data: bytes) -> int:
        """Bytes where the program has nothing; their address."""
        self._simulator.mem_write(RAM + 0x1F000, data)
        return RAM + 0x1F000

    def set_reference(self, counts: int) -> None:
        """What the factory has written."""
        self._simulator.mem_write(REFERENCE, counts.to_bytes(2, "little"))

    def _run(self, begin: int, end: int) -> None:
        self._simulator.emu_start(begin | 1, 0)
        pc = self._simulator.reg_read(UC_ARM_REG_PC)
        if self._fault:
            raise ChipError(self._fault)
        if pc != end:
            raise ChipError(f"stopped at {pc:#010x}, expected {end:#010x}")

    def _count(self, _: object, address: int, *__: object) -> None:
        """A block of code begins: one that is executed again and again, and reads no register, never ends."""
        self._turns = self._turns + 1 if address == self._block else 0
        self._block = address
        if self._turns > ENDLESS:
            self._refuse("loops for ever")

    # --- registers ---

    def bit(self, register: str, number: int) -> bool:
        """A bit of a register."""
        return bool(self.registers[register] >> number & 1)

    def field(self, register: str, low: int, width: int) -> int:
        """Some bits of a register."""
        return self.registers[register] >> low & (1 << width) - 1

    def _refuse(self, reason: str) -> None:
        self._fault = self._fault or reason
        self._simulator.emu_stop()

    def _name(self, address: int, size: int) -> str:
        name = NAMES.get(address, "")
        if not name or size != 4:
            self._refuse(f"{size} bytes at {address:#010x}, where there is no register")
        part = name.partition("_")[0]
        if part in CLOCKED and not self.bit(*CLOCKED[part]):
            self._refuse(f"{name}: the part has no clock")
        return name

    def _is_ready(self, clock: int) -> bool:
        if not self.bit("RCC_CR", clock):
            return False
        source = HSE if self.bit("RCC_PLLCFGR", 22) else HSI
        return {HSI: True, HSE: self.crystal, PLL: self.pll and (clock == PLL and self._is_ready(source))}[
            clock
        ]

    def processor_mhz(self) -> float:
        """The processor's clock: crystal of the Feather, internal oscillator, or the PLL behind either."""
        return self.pll_mhz() / (2 * self.field("RCC_PLLCFGR", 16, 2) + 2) if self.runs_by_pll() else 16.0

    def runs_by_pll(self) -> bool:
        """The PLL gives the processor's clock."""
        return self.field("RCC_CFGR", 0, 2) == 2 and self._is_ready(PLL)

    def pll_mhz(self) -> float:
        """The PLL's own frequency."""
        source = 12.0 if self.bit("RCC_PLLCFGR", 22) else 16.0
        return source / self.field("RCC_PLLCFGR", 0, 6) * self.field("RCC_PLLCFGR", 6, 9)

    def _read(self, _: object, offset: int, size: int, base: int) -> int:
        name = self._name(base + offset, size)
        self.reads += 1
        self._turns = 0
        value = self.registers.get(name, 0)
        if name == "RCC_CR":
            for clock in (HSI, HSE, PLL):
                value = value & ~(2 << clock) | self._is_ready(clock) << clock + 1
        elif name == "RCC_CFGR":
            value = value & ~0xC | (8 if self.runs_by_pll() else 0)
        elif name == "RNG_SR":
            sound = self.bit("RNG_CR", 2) and self.runs_by_pll()  # by the PLL's clock of 48 MHz
            value = 0x45 if self.noise_fault else int(sound)
        elif name == "RNG_DR":
            value = self.numbers.pop(0) if len(self.numbers) > 1 else self.numbers[0]
        elif name == "ADC1_SR":
            value = 2 * (self.analog is not None and self.bit("ADC1_CR2", 30))
        elif name == "ADC1_DR" and self.analog is not None:
            value = self.analog[self.field("ADC1_SQR3", 0, 5)]
            self.registers["ADC1_CR2"] &= ~(1 << 30)
        elif name.startswith("USART") and name.endswith("_DR"):
            self.registers[f"{name[:6]}_SR"] &= ~0x2F  # read behind the status, it clears all of these
        return value

    def _write(self, _: object, offset: int, size: int, value: int, base: int) -> None:
        name = self._name(base + offset, size)
        if name == "RCC_PLLCFGR" and self.bit("RCC_CR", PLL):
            self._refuse("the PLL is set while it is on")
        if name == "RCC_CFGR" and value & 3 == 2 and self.field("FLASH_ACR", 0, 3) < 5:
            self._refuse("the flash is too slow for 168 MHz")
        if name in ("IWDG_PR", "IWDG_RLR") and self.registers["IWDG_KR"] != 0x5555:
            self._refuse(f"{name} is locked")
        if name == "RNG_CR" and not value:
            self.noise_fault = False
        if name.startswith("NVIC"):  # a zero changes nothing
            value |= self.registers[name]
        self.writes.append((name, value))
        self.registers[name] = value
        if name.endswith("_BSRR"):
            output = f"{name[:5]}_ODR"
            self.registers[output] = self.registers[output] & ~(value >> 16) | value & 0xFFFF
        if name == "USART3_DR":
            self.sent.append(value & 0xFF)
            self.registers["USART3_SR"] |= 0x80 if self.transmits else 0
            self.registers["USART3_SR"] &= 0xFFFF if self.transmits else ~0x80
