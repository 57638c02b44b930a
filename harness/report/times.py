"""Times as pages show them; `canine.clock` of canine.js writes the same."""

from __future__ import annotations

import math


def clock(seconds: float) -> str:
    """A time as pages show it: minutes and seconds, 3:07.50; from an hour on 1:02:03.90."""
    hundredths = math.floor(100 * seconds + 0.5)
    minutes, rest = divmod(hundredths, 6000)
    hours = minutes if minutes < 60 else f"{minutes // 60}:{minutes % 60:02}"
    return f"{hours}:{rest / 100:05.2f}"
