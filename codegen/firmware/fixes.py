"""What makes a fix, stated once: which messages of a u-blox receiver count, on board and in a replay.

From MESSAGES and RANGES come fixes.h of the firmware (templates/fixes.h.jinja) and the decisions of the
reader of recordings (harness/recording/ubx.py). Source: u-blox interface descriptions (u-blox 5 to 7, M8,
F9), class NAV.

A fix is three-dimensional, and the receiver calls it good. Two dimensions rest on an assumed height, and an
error of the height is one of the position that hAcc does not have: refused. Satellites combined with dead
reckoning in the receiver (4) are three-dimensional as well: taken, in NAV-PVT as in NAV-SOL. Dead reckoning
alone (1) and time alone (5) are no fixes. Of the bits `valid`, validTime counts: before it is set the time of
week may be that of the receiver's own clock. The date and the leap seconds (validDate, fullyResolved) and the
magnetic declination (validMag) are in no fix.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Rule(NamedTuple):
    """A byte of the payload that must have one of some values under a mask.

    Attributes:
        refused: what an epoch is counted as that fails it.
        since: length of the payload from which on the byte has this meaning; in shorter ones it is reserved.
    """

    byte: int
    mask: int
    values: tuple[int, ...]
    refused: str
    since: int = 0

    @property
    def condition(self) -> str:
        """In C."""
        value = f"payload[{self.byte}]" if self.mask == 0xFF else f"(payload[{self.byte}] & {self.mask}U)"
        choices = " || ".join(f"({value} == {v}U)" for v in self.values)
        either = [f"(length < {self.since}U)"] if self.since else []
        return f"({' || '.join([*either, choices])})" if either or len(self.values) > 1 else choices


class Message(NamedTuple):
    """A message of the class NAV: its number, the lengths of its payload, and the rules of a fix."""

    id: int
    lengths: tuple[int, ...]
    rules: tuple[Rule, ...] = ()

    @property
    def has_length(self) -> str:
        """In C, of a `length`."""
        return " || ".join(f"(length == {length}U)" for length in self.lengths)

    @property
    def versions(self) -> bool:
        """A rule depends on the length of the payload."""
        return any(rule.since for rule in self.rules)

    def refused(self, payload: bytes) -> str:
        """What an epoch with this payload is counted as; "" if it is a fix."""
        for rule in self.rules:
            if len(payload) >= rule.since and payload[rule.byte] & rule.mask not in rule.values:
                return rule.refused
        return ""


THREE_DIMENSIONAL = (3, 4)
NOT_3D = "epochs without a three-dimensional fix"
NOT_GOOD = "fixes that the receiver does not call good"

MESSAGES: dict[str, Message] = {
    "posllh": Message(0x02, (28,)),
    "sol": Message(
        0x06,
        (52,),
        (
            Rule(10, 0xFF, THREE_DIMENSIONAL, NOT_3D),  # gpsFix
            Rule(11, 0x01, (1,), NOT_GOOD),  # flags: gpsfixOK
        ),
    ),
    "pvt": Message(
        0x07,
        (84, 92),  # u-blox 7; from M8 on
        (
            Rule(20, 0xFF, THREE_DIMENSIONAL, NOT_3D),  # fixType
            Rule(21, 0x01, (1,), NOT_GOOD),  # flags: gnssFixOK
            Rule(11, 0x02, (2,), "fixes whose time the receiver marks invalid"),  # valid: validTime
            Rule(
                78, 0x01, (0,), "fixes whose position the receiver marks invalid", since=92
            ),  # flags3: invalidLlh
        ),
    ),
    "velned": Message(0x12, (36,)),
}

# The members of ubx_fix, least and greatest value: a receiver sends no others.
RANGES: dict[str, tuple[int, int]] = {
    "time_ms": (0, 604_799_999),
    "latitude": (-900_000_000, 900_000_000),  # 1e-7 deg
    "longitude": (-1_800_000_000, 1_800_000_000),
    "h_acc": (1, 2**32 - 1),  # mm; no receiver states an accuracy of 0
    "speed": (0, 515_000),  # mm/s, 1000 knots, above which no receiver may navigate
    "course": (-36_000_000, 36_000_000),  # 1e-5 deg
    "s_acc": (1, 2**32 - 1),
}
OUT_OF_RANGE = "fixes out of range"


def limits() -> list[str]:
    """RANGES in C, without those that the type alone keeps."""
    texts = []
    for name, (low, high) in RANGES.items():
        suffix = "U" if low >= 0 else ""
        if low != 0:
            texts.append(f"(fix->{name} >= {low}{suffix})")
        if high != 2**32 - 1:
            texts.append(f"(fix->{name} <= {high}{suffix})")
    return texts


def in_range(values: Mapping[str, int]) -> bool:
    """Whether the members of a ubx_fix are within RANGES."""
    return all(low <= values[name] <= high for name, (low, high) in RANGES.items())
