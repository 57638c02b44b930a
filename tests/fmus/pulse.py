"""A small block that has everything an FMU must carry: types, a table, a triggered update, draws, vectors."""

from __future__ import annotations

import enum
from collections.abc import Iterator

import casadi as ca

from models.kit.block import Block, Row, table, triggered
from models.kit.declaration import Boolean, Input, Integer, Output, Parameter, State, Stream
from models.kit.random import uniform


class Phase(enum.IntEnum):
    """What the pulse does."""

    REST = 0
    BEAT = 1


class Pulse(Block):
    """Grows with its input, jumps at random when told to, and beats."""

    source = "none"
    push = Input("m/s", 'how hard; "<&%s>" survives every file format', min=-5, max=5)
    kick = Input(Boolean, "jump now", start=0)
    seed = Parameter(Integer, "random stream", start=1, min=0)
    gain = Parameter("1", "of the push", start=2.0, min=0, max=10)
    offset = Parameter("m", "latched offsets", size=3, start=(0.5, 0.25, 0.125), latched=True)
    position = State("m", "where it is")
    ticks = State(Integer, "ticks in its phase")
    phase = State(Phase, "its phase")
    noise = Stream("jumps", substream=2)
    place = Output("m", "where it is")
    beating = Output(Boolean, "it beats")
    shown = Output(Phase, "its phase")
    steady = Output("m", "depends on no input")

    def advance(m: Pulse) -> None:
        m.position = m.position + m.gain * m.push * 0.04
        m.ticks = m.ticks + 1

    @triggered("kick")
    def jump(m: Pulse) -> None:
        value, m.noise = uniform(m.noise)
        m.position = m.position + ca.if_else(value > 0.5, value, -value * m.position)

    @table("phase")
    def decide(m: Pulse) -> Iterator[Row]:
        yield Row(Phase.REST, ca.logic_and(ca.fabs(m.position) > 1, m.ticks > 3), Phase.BEAT, {"ticks": 0})
        yield Row(Phase.BEAT, m.ticks * 0.04 > 0.1, Phase.REST, {"ticks": 0, "position": m.position * 0.5})

    def answer(m: Pulse) -> None:
        m.place = m.position + m.offset[1]
        m.beating = m.phase == Phase.BEAT
        m.shown = m.phase
        m.steady = m.offset[0] + m.offset[2]


class Slide(Block):
    """A plant: its outputs are those of the end of the step."""

    moore = True

    push = Input("m/s", "how hard", start=0)
    begin = Parameter("m", "where it starts", start=0)
    other = Parameter("m", "of no effect at the start", start=0)
    position = State("m", "where it is")
    place = Output("m", "where it is")

    def initialize(m: Slide) -> None:
        m.position = m.begin

    def advance(m: Slide) -> None:
        m.position = m.position + 0.04 * m.push + m.other

    def output(m: Slide) -> None:
        m.place = m.position


class Scale(Block):
    """Comes in both precisions."""

    precisions = ("double", "float")

    value = Input("m", "what is scaled")
    factor = Parameter("1", "by what", start=1.0, min=-10, max=10)
    scaled = Output("m", "the product")

    def answer(m: Scale) -> None:
        m.scaled = m.factor * m.value
