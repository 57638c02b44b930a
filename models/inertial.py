"""What the blocks share that take inertial samples: a sensor that repeats its sample is silent (rule 6)."""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import ClassVar

from models.kit.block import Block
from models.kit.declaration import SX, Integer, Parameter, State
from models.kit.geometry import SHORT_COUNT_MAX, all_of, counted, where


class Inertial(Block):
    """Base of the blocks that take inertial samples.

    The noise of a real sensor never repeats. A simulated one without noise does, and one of few digits may:
    the check is off unless `frozen_samples` is set.

    Attributes:
        sensed: inputs that a live sensor never repeats, all of them together.
    """

    sensed: ClassVar[tuple[str, ...]]

    frozen_samples = Parameter(
        Integer,
        "samples in a row that may be bad or repeat the one before; then the sensor counts as silent",
        start=SHORT_COUNT_MAX,
        min=1,
        max=SHORT_COUNT_MAX,
    )

    silence = State(Integer, "samples in a row that told nothing new", min=0, max=SHORT_COUNT_MAX)
    sample_sum = State("1", "sum of what was sensed in the last one in range")

    def _take(m, *names: str) -> SX:
        """Are these inputs in range, and the sensor not silent? The sum repeats if all values do."""
        in_range = m.within(*names)
        total = where(in_range, reduce(add, (getattr(m, name) for name in m.sensed)), m.sample_sum)
        m.silence = where(total == m.sample_sum, counted(m.silence, most=SHORT_COUNT_MAX), 0)
        m.sample_sum = total
        return all_of(in_range, m._alive())

    def _alive(m) -> SX:
        """Is the sensor not silent?"""
        return m.silence <= m.frozen_samples
