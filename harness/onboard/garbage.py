"""Garbage: bytes on their way to the firmware that arrive as others."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass

STREAMS = ("gps", "imu", "radio")  # of bytes that the firmware receives


@dataclass(frozen=True)
class Garbage:
    """A share of a stream's bytes is replaced by chance, from the tick `first` to before `after`.

    Attributes:
        seed, number: of the trial and of the fault; they decide the draws.
    """

    stream: str
    share: float
    first: int
    after: float
    seed: int
    number: int


class Garbler:
    """Replaces bytes of streams; each fault draws from a generator of its own."""

    def __init__(self, faults: Sequence[Garbage]) -> None:
        self._faults = [(fault, random.Random(f"{fault.seed} {fault.number}")) for fault in faults]

    def __call__(self, stream: str, tick: int, sent: bytes) -> bytes:
        """What arrives of the bytes that are sent on a tick."""
        arrived = sent
        for fault, draws in self._faults:
            if fault.stream == stream and fault.first <= tick < fault.after:
                arrived = bytes(
                    draws.randrange(256) if draws.random() < fault.share else byte for byte in arrived
                )
        return arrived
