"""The processors that firmware is made for."""

from __future__ import annotations

from dataclasses import dataclass

from models.errors import UsageError, nearest


@dataclass(frozen=True)
class Target:
    """A processor that firmware is made for.

    Attributes:
        folder: of its own sources in `onboard/`.
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
    pvt: bool = False
    addressed: bool = False
    banked: bool = False


TARGETS: dict[str, Target] = {
    t.name: t
    for t in (
        Target("host", "host", "any 32- or 64-bit processor with a POSIX system", 48_000, 4_000),
        Target("cortex-m4f", "cortex_m4f", "ARM Cortex-M4F", 48_000, 4_000, pvt=True),
        Target(
            *("rabbit4000", "rabbit4000", "Rabbit 4000 (RCM4100), 58.98 MHz", 90_000, 4_000),
            addressed=True,
            banked=True,
        ),
    )
}

SIMULATED = tuple(name for name in TARGETS if name != "host")


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
