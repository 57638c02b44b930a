"""Faults of signals: a block on a link that passes its signal on, and disturbs it for a time.

There is one for each type. Put between an output and the inputs that it feeds, it becomes C, an FMU and
lanes of a batch as every other block does, so that a fault is the same wherever a trial runs.
"""

from __future__ import annotations

import enum
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from models.kit import casadi as ca
from models.kit.block import Block, triggered
from models.kit.declaration import (
    SX,
    Boolean,
    Input,
    Integer,
    Output,
    Parameter,
    Real,
    State,
    Stream,
    Type,
)
from models.kit.geometry import COUNT_MAX, all_of, counted, element, where
from models.kit.link import Link
from models.kit.random import MAX_SEED, normal, uniform

LONGEST_DELAY = 50  # ticks
MAX_FAULTS = 64  # each draws from a substream of its own
FIRST_SUBSTREAM = 128  # behind those of plants and sensors, which have the same seed
AnyLink = TypeVar("AnyLink", bound=Link)


class Kind(enum.IntEnum):
    """What can happen to a signal."""

    OFF = 0
    STUCK = 1
    OFFSET = 2
    SCALE = 3
    NOISE = 4
    DELAY = 5
    DROPOUTS = 6
    JUMP = 7
    NAN = 8


class Fault(Block):
    """A signal on its way, disturbed on the ticks of a window."""

    source = "ours"
    transparent = True

    kind = Parameter(Kind, "what happens to the signal", start=Kind.OFF)
    first = Parameter(Integer, "tick on which it begins", start=COUNT_MAX, min=0, max=COUNT_MAX)
    after = Parameter(Integer, "first tick on which it is over", start=COUNT_MAX, min=0, max=COUNT_MAX)
    value = Parameter(Real, "offset, factor, deviation of the noise, share that is lost, or jump", start=0)
    delay = Parameter(Integer, "ticks by which a delayed signal is late", start=1, min=1, max=LONGEST_DELAY)
    seed = Parameter(Integer, "trial number: selects the random stream", start=1, min=0, max=MAX_SEED)
    number = Parameter(Integer, "of the fault: selects its substream", start=0, min=0, max=MAX_FAULTS - 1)

    tick = State(Integer, "ticks since the start", max=COUNT_MAX)
    stream = Stream("noise and drop-outs", substream=FIRST_SUBSTREAM, number="number")

    signal: SX
    disturbed: SX
    held: SX
    past: SX

    def pass_on(m) -> None:
        """Without a fault nothing changes."""
        m.disturbed = m.signal

    @triggered(
        lambda m: all_of(m.tick >= m.first, m.tick < m.after), "from `first` to before `after`", seldom=True
    )
    def disturb(m) -> None:
        """Disturb the signal."""
        m.disturbed = m._disturbed()

    @triggered(lambda m: m.kind == Kind.DELAY, "`kind` is DELAY", seldom=True)
    def store(m) -> None:
        """Keep what a delayed signal was; before the start it was as on the first tick."""
        shifted = ca.vertcat(m.signal, m.past[:-1])
        m.past = ca.vertcat(*(where(m.tick > 0, shifted[i], m.signal) for i in range(LONGEST_DELAY)))

    def remember(m) -> None:
        """Keep what was passed on, and count the tick."""
        m.held = m.disturbed
        m.tick = counted(m.tick)

    def _disturbed(m) -> SX:
        """What the kinds that suit all types make of the signal; the others leave it as it is."""
        chance, m.stream = uniform(m.stream)
        kept = where(m.tick > 0, m.held, m.signal)
        late = where(m.tick > 0, element(m.past, m.delay - 1), m.signal)
        changed = {
            Kind.OFF: 0,
            Kind.STUCK: kept,
            Kind.DROPOUTS: where(chance < m.value, m._in_place_of_lost(kept), m.signal),
            Kind.DELAY: late,
        }
        return m._choose(changed, m.signal)

    def _choose(m, changed: dict[Kind, SX | float], otherwise: SX) -> SX:
        for kind, value in changed.items():
            otherwise = where(m.kind == kind, value, otherwise)
        return otherwise

    def _in_place_of_lost(m, kept: SX) -> SX:
        """What arrives where a sample is lost: the last one that did."""
        return kept


class RealFault(Fault):
    """A fault of a Real signal, of any unit."""

    signal = Input(Real, "the signal", start=0)
    disturbed = Output(Real, "what arrives of it")
    held = State(Real, "what arrived a tick ago")
    past = State(Real, "the signal 1, 2, ... ticks ago", size=LONGEST_DELAY)

    def _disturbed(m) -> SX:
        passed = super()._disturbed()
        draw, m.stream = normal(m.stream)
        left = (m.after - m.tick) / (m.after - m.first)  # 1 as the window begins, 0 when it is over
        changed = {
            Kind.OFFSET: m.signal + m.value,
            Kind.SCALE: m.signal * m.value,
            Kind.NOISE: m.signal + m.value * draw,
            Kind.JUMP: m.signal + m.value * left,
            Kind.NAN: ca.sqrt(-1 - ca.fabs(m.signal)),  # C has no literal for it
        }
        return m._choose(changed, passed)


class IntegerFault(Fault):
    """A fault of an Integer signal, such as a command."""

    signal = Input(Integer, "the signal", start=0, min=-COUNT_MAX, max=COUNT_MAX)
    disturbed = Output(Integer, "what arrives of it")
    held = State(Integer, "what arrived a tick ago")
    past = State(Integer, "the signal 1, 2, ... ticks ago", size=LONGEST_DELAY)


class BooleanFault(Fault):
    """A fault of a Boolean signal; where a sample drops out, it is false."""

    signal = Input(Boolean, "the signal", start=0)
    disturbed = Output(Boolean, "what arrives of it")
    held = State(Boolean, "what arrived a tick ago")
    past = State(Boolean, "the signal 1, 2, ... ticks ago", size=LONGEST_DELAY)

    def _in_place_of_lost(m, kept: SX) -> SX:
        return 0


FAULTS: dict[Type, type[Fault]] = {
    Type.REAL: RealFault,
    Type.INTEGER: IntegerFault,
    Type.BOOLEAN: BooleanFault,
}


@dataclass(frozen=True)
class FaultyLink:
    """Where a fault sits: on all links of an output (`Link.signal`), or on the one to `target`."""

    type: Type
    source: str
    source_variable: str
    target: str = ""
    target_variable: str = ""

    def holds(self, link: Link) -> bool:
        """Does the fault act on this link?"""
        end = (self.target, self.target_variable)
        return (self.source, self.source_variable) == (link.source, link.signal) and (
            not self.target or end == (link.target, link.target_variable)
        )


@dataclass(frozen=True)
class Placed:
    """A fault's block in a system: which fault, by its place in the list, and the type of its signal."""

    fault: int
    type: Type


def disturb(
    links: Sequence[AnyLink], faults: Sequence[FaultyLink]
) -> tuple[tuple[AnyLink, ...], dict[str, Placed]]:
    """Put blocks into links: of two faults on a link, the one listed later acts on what the other gives.

    A value is converted on its way to the first of them.

    Returns:
        the links with the blocks between, and the blocks by component: `fault_1` and so on, names that the
        system does not have.
    """
    taken = {end for link in links for end in (link.source, link.target)}
    unused = (name for i in itertools.count(1) if (name := f"fault_{i}") not in taken)
    feeders = list(links)  # what feeds the target of each link by now
    added: list[AnyLink] = []
    placed: dict[str, Placed] = {}
    for number, fault in enumerate(faults):
        names: dict[AnyLink, str] = {}  # by what feeds a block
        for i, link in enumerate(links):
            if fault.holds(link):
                inward = replace(feeders[i], target="", target_variable="signal")
                if inward not in names:
                    names[inward] = name = next(unused)
                    placed[name] = Placed(number, fault.type)
                    added.append(replace(inward, target=name))
                feeders[i] = type(link)(names[inward], "disturbed", link.target, link.target_variable)
    return (*feeders, *added), placed
