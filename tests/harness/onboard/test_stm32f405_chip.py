"""The STM32F405's port on the chip of ST's manual: clock, pins, lines, watchdog, noise, converter."""

from __future__ import annotations

import itertools

import pytest

from codegen.firmware.bundle import bundle
from codegen.firmware.cortex_m4f import board_image
from codegen.firmware.image import Image
from codegen.firmware.targets import TARGETS
from tests.harness.onboard.chip import FEED, Chip, ChipError

INPUT, OUTPUT, FUNCTION, ANALOG = range(4)
# by the Feather's wiring: port, pin, mode, alternate function (DS8626, table 9)
PINS = {
    "radio, TX": ("B", 10, FUNCTION, 7),
    "radio, RX": ("B", 11, FUNCTION, 7),
    "inertial unit, RX": ("B", 7, FUNCTION, 7),
    "receiver, RX": ("C", 7, FUNCTION, 8),
    "tone": ("B", 8, FUNCTION, 2),
    "left": ("C", 3, OUTPUT, None),
    "right": ("C", 2, OUTPUT, None),
    "lamp": ("C", 1, OUTPUT, None),
    "battery": ("A", 3, ANALOG, None),
}
LAMP, RIGHT, LEFT = 1 << 1, 1 << 2, 1 << 3
RADIO, IMU, GPS = 39, 37, 71  # interrupts of USART3, USART1, USART6
RX_INTERRUPT, TX_INTERRUPT = 5, 7  # USART_CR1
RECEIVED, FREE = 0x20, 0x80  # USART_SR
OVERRUN, NOISE, FRAMING = 8, 4, 2


@pytest.fixture(scope="module")
def image() -> Image:
    """The program that is flashed."""
    return board_image(TARGETS["stm32f405"], bundle(TARGETS["stm32f405"]))


@pytest.fixture
def chip(image: Image) -> Chip:
    """The chip, behind the start of its program."""
    chip = Chip(image)
    chip.boot()
    return chip


# --- clock ---


@pytest.mark.parametrize("crystal", [True, False], ids=["crystal", "no crystal"])
@pytest.mark.parametrize("left_on", [False, True], ids=["reset", "bootloader"])
def test_the_clock_is_168_mhz_by_the_crystal_or_else_by_the_internal_oscillator(
    crystal: bool, left_on: bool, image: Image
) -> None:
    # given a chip after a reset, or one whose bootloader has left the PLL on
    chip = Chip(image, crystal=crystal)
    if left_on:
        chip.registers |= {"RCC_CR": 0x01000083, "RCC_CFGR": 2, "FLASH_ACR": 5}
    # when it starts
    chip.boot()
    # then the PLL gives its clock, within the PLL's limits, and 48 MHz for the noise
    assert chip.runs_by_pll()
    assert chip.processor_mhz() == 168
    assert chip.pll_mhz() / chip.field("RCC_PLLCFGR", 24, 4) == 48
    assert chip.bit("RCC_PLLCFGR", 22) == crystal
    assert chip.registers["RCC_PLLCFGR"] & 0xF0BC8000 == 0x24003010 & 0xF0BC8000  # reserved bits
    # and the buses have a quarter and a half of it: at most 42 and 84 MHz
    assert (chip.field("RCC_CFGR", 4, 4), chip.field("RCC_CFGR", 10, 3), chip.field("RCC_CFGR", 13, 3)) == (
        0,
        5,
        4,
    )
    # and the lamp tells whose clock it is
    assert chip.registers["GPIOC_ODR"] == (0 if crystal else LAMP)
    # and all waits end within 0.17 s, at 1 us a read at most
    assert chip.reads < (1000 if crystal else 140_000)
    # and time is counted in ms, by interrupts
    assert chip.registers["SYST_RVR"] == 168_000 - 1
    assert chip.registers["SYST_CSR"] == 7


def test_without_the_pll_the_vest_stays_silent_and_waits_for_the_watchdog(image: Image) -> None:
    # given a chip whose PLL never locks
    chip = Chip(image, pll=False)
    # when it starts, then it never comes to its first tick
    with pytest.raises(ChipError, match="loops for ever"):
        chip.boot()
    # and nothing sounds or vibrates, and the watchdog runs and starves
    assert chip.registers["TIM4_CCR3"] == 0
    assert chip.registers["GPIOC_ODR"] & (LEFT | RIGHT) == 0
    assert [value for name, value in chip.writes if name == "IWDG_KR"] == [0xCCCC, 0x5555, FEED]
    assert chip.reads < 170_000 + 8 * 2 * 10_000


# --- pins and interrupts ---


def test_each_pin_of_the_wiring_has_its_task_and_the_others_are_left_alone(chip: Chip) -> None:
    for name, (port, pin, mode, function) in PINS.items():
        assert chip.field(f"GPIO{port}_MODER", 2 * pin, 2) == mode, name
        if function is not None:
            half, place = ("AFRL", pin) if pin < 8 else ("AFRH", pin - 8)
            assert chip.field(f"GPIO{port}_{half}", 4 * place, 4) == function, name
        # lines that hear are quiet when nothing is wired
        assert chip.field(f"GPIO{port}_PUPDR", 2 * pin, 2) == name.endswith("RX"), name
    for port, at_reset in (("A", 0xA8000000), ("B", 0x280), ("C", 0)):
        used = sum(3 << 2 * pin for p, pin, _, _ in PINS.values() if p == port)
        assert chip.registers[f"GPIO{port}_MODER"] & ~used == at_reset & ~used


def test_outputs_are_low_before_they_are_outputs(chip: Chip) -> None:
    names = [name for name, _ in chip.writes]
    assert chip.writes[names.index("GPIOC_BSRR")][1] == (LAMP | LEFT | RIGHT) << 16
    assert names.index("GPIOC_BSRR") < names.index("GPIOC_MODER")
    modes = [i for i, name in enumerate(names) if name == "GPIOB_MODER"]
    tone = next(i for i in modes if chip.writes[i][1] >> 16 & 3 == FUNCTION)
    assert names.index("TIM4_CCR3") < names.index("TIM4_CCER") < tone


def test_the_watchdog_is_the_first_that_is_started_and_ends_a_hang_within_half_a_second(chip: Chip) -> None:
    assert [name for name, _ in chip.writes if name[:3] not in ("SCB",)][:6] == [
        *("IWDG_KR", "IWDG_KR", "IWDG_PR", "IWDG_RLR", "IWDG_KR", "RCC_AHB1ENR")
    ]
    # the slow oscillator has 17 to 47 kHz (DS8626, table 35); the prescaler is 4 * 2^PR
    clocks = 4 * 2 ** chip.registers["IWDG_PR"] * chip.registers["IWDG_RLR"]
    assert clocks / 17e3 < 0.5
    assert clocks / 47e3 > 4 * 0.04  # four ticks


def test_only_a_tick_feeds_the_watchdog(chip: Chip) -> None:
    # given a chip at work
    chip.writes.clear()
    chip.numbers = [1, 2, 3]
    # when all but the tick's last step is called
    chip.registers["USART3_SR"] = FREE
    for interrupt in (RADIO, IMU, GPS):
        chip.interrupt(interrupt)
    for function in ("SysTick_Handler", "port_battery_mv", "port_temperature", "port_session"):
        chip.call(function)
    chip.call("port_send", chip.place(b"abc"), 3)
    # then it is not fed
    assert not any(name.startswith("IWDG") for name, _ in chip.writes)
    # when that step comes, then it is
    chip.call("port_command_module", 0, 0, 0)
    assert [value for name, value in chip.writes if name == "IWDG_KR"] == [FEED]


# --- lines ---


def test_the_lines_have_their_bit_rates(chip: Chip) -> None:
    for usart, clock, baud in (("USART3", 42e6, 57_600), ("USART6", 84e6, 38_400), ("USART1", 84e6, 115_200)):
        assert clock / chip.registers[f"{usart}_BRR"] == pytest.approx(baud, rel=1e-3)
        # on, 16 samples a bit, 8 bits, no parity, one stop bit
        assert chip.field(f"{usart}_CR1", 8, 8) == 0x20
        assert chip.bit(f"{usart}_CR1", RX_INTERRUPT)
        assert chip.bit(f"{usart}_CR1", 2)
        assert (chip.registers[f"{usart}_CR2"], chip.registers[f"{usart}_CR3"]) == (0, 0)
        assert chip.bit(f"{usart}_CR1", 3) == (usart == "USART3")  # only the radio sends


@pytest.mark.parametrize(
    ("source", "usart", "interrupt"), [(0, "USART6", GPS), (1, "USART1", IMU), (2, "USART3", RADIO)]
)
def test_bytes_of_each_line_come_to_its_source_and_errors_do_no_harm(
    source: int, usart: str, interrupt: int, chip: Chip
) -> None:
    # given bytes by interrupt, with every error of the line, of which an overrun alone brings no byte
    for i, error in enumerate((0, OVERRUN, NOISE, FRAMING, OVERRUN | NOISE | FRAMING)):
        chip.registers |= {f"{usart}_SR": RECEIVED | FREE | error, f"{usart}_DR": 0x40 + i}
        chip.interrupt(interrupt)
        # then each is fetched, which ends the interrupt
        assert chip.registers[f"{usart}_SR"] & 0x2F == 0
    # and the source has them
    pointer = chip.place(bytes(4))
    assert chip.call("port_receive", source, pointer) == 5
    assert chip.memory(int.from_bytes(chip.memory(pointer, 4), "little"), 5) == b"@ABCD"
    # and the others have nothing
    assert [chip.call("port_receive", other, pointer) for other in range(3) if other != source] == [0, 0]
    # when an overrun comes by itself, then it ends, too
    chip.registers[f"{usart}_SR"] = OVERRUN | FREE
    chip.interrupt(interrupt)
    assert chip.registers[f"{usart}_SR"] & 0x2F == 0


def test_a_frame_leaves_byte_by_byte_by_interrupts_which_end_with_it(chip: Chip) -> None:
    # given a transmitter that is free for one byte at a time
    chip.transmits = False
    chip.registers["USART3_SR"] = FREE
    # when a frame is sent
    chip.call("port_send", chip.place(b"frame"), 5)
    # then its first byte leaves, and the others with an interrupt each
    for i in range(1, 6):
        assert bytes(chip.sent) == b"frame"[:i]
        assert chip.bit("USART3_CR1", TX_INTERRUPT)
        chip.registers["USART3_SR"] |= FREE
        chip.interrupt(RADIO)
    # and behind the last no interrupt is asked for
    assert bytes(chip.sent) == b"frame"
    assert not chip.bit("USART3_CR1", TX_INTERRUPT)
    # and a frame that does not find room is not sent in part
    chip.registers["USART3_SR"] = 0
    chip.call("port_send", chip.place(bytes(200)), 200)
    chip.call("port_send", chip.place(b"x" * 60), 60)
    chip.registers["USART3_SR"] = FREE
    chip.transmits = True
    chip.interrupt(RADIO)
    assert bytes(chip.sent) == b"frame" + bytes(200)


# --- tone and vibrators ---


@pytest.mark.parametrize("tone", [1, 20, 1281, 1282, 1500, 3500, 9500, 20_000, 65_535])
def test_a_tone_is_a_square_wave_of_its_frequency(tone: int, chip: Chip) -> None:
    # when a tone is played
    chip.call("port_command_module", tone, 0, 0)
    # then channel 3 of the timer is on, in PWM mode 1, and high for half of the period
    assert chip.field("TIM4_CCMR2", 4, 3) == 6
    assert chip.bit("TIM4_CCER", 8)
    assert chip.bit("TIM4_CR1", 0)
    prescaler, reload, compare = (chip.registers[f"TIM4_{name}"] for name in ("PSC", "ARR", "CCR3"))
    assert max(prescaler, reload, compare) <= 0xFFFF
    assert 84e6 / (prescaler + 1) / (reload + 1) == pytest.approx(tone, rel=1e-3)
    assert compare / (reload + 1) == pytest.approx(0.5, abs=1e-3)
    # and the prescaler is taken over at once
    names = [name for name, _ in chip.writes]
    assert names.index("TIM4_PSC") < names.index("TIM4_EGR")
    assert chip.registers["TIM4_EGR"] == 1
    # when it ends, then the output is low for ever
    chip.call("port_command_module", 0, 0, 0)
    assert chip.registers["TIM4_CCR3"] == 0


def test_a_tone_that_goes_on_is_not_begun_anew(chip: Chip) -> None:
    chip.call("port_command_module", 1500, 0, 0)
    chip.writes.clear()
    chip.call("port_command_module", 1500, 0, 0)
    assert chip.writes == [("IWDG_KR", FEED)]


def test_each_vibrator_has_its_pin(chip: Chip) -> None:
    for left, right in itertools.product((0, 1), repeat=2):
        chip.call("port_command_module", 0, left, right)
        assert chip.registers["GPIOC_ODR"] & (LEFT | RIGHT) == left * LEFT | right * RIGHT


# --- session ---


@pytest.mark.parametrize(
    ("numbers", "session"),
    [
        ((11, 22, 33), 22),  # the first is not used
        ((11, 11, 22, 33), 33),  # a number that repeats the one before is none: two more are drawn
    ],
)
def test_a_session_is_noise_that_does_not_repeat_itself(
    numbers: tuple[int, ...], session: int, chip: Chip
) -> None:
    chip.numbers = list(numbers)
    assert chip.call("port_session") == session


def test_a_generator_with_a_fault_is_started_anew(chip: Chip) -> None:
    chip.noise_fault, chip.numbers = True, [0, 11, 22]
    assert chip.call("port_session") == 22


def test_a_generator_that_repeats_itself_for_ever_gives_no_session(chip: Chip) -> None:
    chip.numbers = [7]
    chip.writes.clear()
    with pytest.raises(ChipError, match="loops for ever"):
        chip.call("port_session")
    assert not any(name.startswith("IWDG") for name, _ in chip.writes)


# --- battery ---


def battery(chip: Chip) -> int:
    """What is told when battery and reference were measured twice."""
    return [chip.call("port_battery_mv") for _ in range(6)][-1]


@pytest.mark.parametrize(
    ("reference", "counts", "mv"),
    [
        # the reference as in the factory: the supply has 3300 mV; 2 * 2300 / 4095 * 3300 = 3706.9
        (1500, 2300, 3706),
        # an empty battery, whose supply falls to 3300 * 1500 / 1600 = 3093 mV; 2 * 2300 / 4095 * it = 3474.4
        (1600, 2300, 3474),
        # such a supply cannot be: nothing is told
        (700, 2300, 0),
        (0, 2300, 0),
    ],
)
def test_the_battery_is_measured_against_the_reference(
    reference: int, counts: int, mv: int, chip: Chip
) -> None:
    # given what the converter finds at the divider, and at the reference
    chip.set_reference(1500)
    chip.analog = {3: counts, 17: reference}
    # then the first reading is none yet, and the next ones are the battery's
    assert chip.call("port_battery_mv") == 0
    assert battery(chip) == mv
    # and the converter is on, at 21 MHz (36 at most), its reference too, sampling for as long as it can
    assert chip.bit("ADC1_CR2", 0)
    assert chip.field("ADC_CCR", 16, 2) == 1
    assert chip.bit("ADC_CCR", 23)
    assert (chip.field("ADC1_SMPR2", 9, 3), chip.field("ADC1_SMPR1", 21, 3)) == (7, 7)


def test_a_converter_that_never_ends_tells_no_battery(chip: Chip) -> None:
    assert battery(chip) == 0
    assert chip.call("port_temperature") & 0xFFFF == 0x8000  # PORT_NO_TEMPERATURE
