"""What came of the outages of a replay, and which of them do not overlap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Self

from harness.log.channel import Array

COLUMNS = ("position_error_m", "velocity_error_m_s")  # the second is the speed's; outages.json has this name


class Estimate(NamedTuple):
    """What a configuration estimates, (ticks,) each: m, m, m/s."""

    north: Array
    east: Array
    speed: Array

    @classmethod
    def of(cls, run: Mapping[str, Array], ticks: slice) -> Self:
        """That of some ticks of a run."""
        return cls(*(run[name][ticks].copy() for name in cls._fields))


@dataclass(frozen=True, eq=False)
class Outage:
    """One simulated outage, with each configuration's error at the last withheld fix."""

    start: float  # s
    end: float  # s
    path_m: float  # length of the path during the outage
    errors: dict[str, tuple[float, float]]  # configuration -> position [m], velocity [m/s]
    estimates: dict[str, Estimate]  # configuration -> during the outage, up to that fix
    time: Array  # s, of the estimates
    standing: bool = False  # the animal stood still at its end


@dataclass(frozen=True, eq=False)
class Replayed:
    """The outages of a replay that were judged, and what was not.

    Attributes:
        outages: each with the errors of the same configurations.
        left_out: cause -> number of outages that were not judged, those of the choice among them.
        notes: on configurations that were not valid, and on what FMUs printed.
        verdicts: of FMUs that went wrong, configuration -> how; they are not among the errors of outages.
        with_fixes: each configuration's estimate with all fixes, from the start to the last outage.
    """

    outages: list[Outage]
    left_out: dict[str, int]
    notes: Sequence[str]
    verdicts: dict[str, str] = field(default_factory=dict)
    with_fixes: Mapping[str, Estimate] = field(default_factory=dict)


def disjoint(outages: Sequence[Outage]) -> list[Outage]:
    """The outages, in the order of time, without those that overlap an earlier one."""
    separate: list[Outage] = []
    for outage in outages:
        if not separate or outage.start >= separate[-1].end:
            separate.append(outage)
    return separate
