"""The processors that firmware is made for."""

from __future__ import annotations

from dataclasses import dataclass

from models.errors import UsageError, nearest


@dataclass(frozen=True)
class Target:
    """A processor that firmware is made for.

    Attributes:
        folder: of its own sources in `onboard/`.
        shared: a folder of sources that other targets have too; "" for none.
        script: of the linker, which says where code and data lie.
        same_processor_as: a target with the same processor, which runs in the loop for both; "" for none.
        code, ram: bytes that the onboard program may take.
        addressed: the functions of the blocks know where their block lies, in `vest`, and use no pointer: a
            processor without indexed loads needs less code so.
        banked: its address space has no room for the whole program: the estimator lies in a bank of its own.
        pvt: the receiver beside it is of today, which tells a fix in one message instead of three.
    """

    name: str
    folder: str
    processor: str
    code: int
    ram: int
    shared: str = ""
    script: str = ""
    same_processor_as: str = ""
    pvt: bool = False
    addressed: bool = False
    banked: bool = False


TARGETS: dict[str, Target] = {
    t.name: t
    for t in (
        Target("host", "host", "any 32- or 64-bit processor with a POSIX system", 48_000, 4_000),
        Target(
            "cortex-m4f",
            "cortex_m4f",
            "ARM Cortex-M4F",
            48_000,
            4_000,
            shared="arm",
            script="link.ld",
            pvt=True,
        ),
        Target(
            *("rabbit4000", "rabbit4000", "Rabbit 4000 (RCM4100), 58.98 MHz", 90_000, 4_000),
            addressed=True,
            banked=True,
        ),
        Target(
            *("stm32f405", "stm32f405", "STM32F405 (Adafruit Feather STM32F405), 168 MHz", 48_000, 4_000),
            shared="arm",
            script="stm32f405.ld",
            same_processor_as="cortex-m4f",
            pvt=True,
        ),
    )
}

IN_THE_LOOP = tuple(name for name, target in TARGETS.items() if not target.same_processor_as)
SIMULATED = tuple(name for name in IN_THE_LOOP if name != "host")


def find_target(name: str) -> Target:
    """A target by its name.

    Raises:
        UsageError: there is none.
    """
    if name not in TARGETS:
        raise UsageError(
            f'firmware is made for {", ".join(TARGETS)}, not for "{name}"{nearest(name, TARGETS)}'
        )
    return TARGETS[name]


def find_in_the_loop(name: str) -> Target:
    """A target that runs with the processor in the loop, by its name.

    Raises:
        UsageError: there is none, or another target with the same processor stands for it.
    """
    target = find_target(name)
    if other := target.same_processor_as:
        raise UsageError(
            f'"{name}" does not run with the processor in the loop: {other}, which does, has the same '
            f"processor and program; expected one of {', '.join(IN_THE_LOOP)}"
        )
    return target
