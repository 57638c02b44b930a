"""Times as pages show them; `canine.clock` of canine.js writes the same."""

from __future__ import annotations

import math


def clock(seconds: float) -> str:
    """A time as pages show it: minutes and seconds, 3:07.50; from an hour on 1:02:03."""
    hundredths = math.floor(100 * seconds + 0.5)
    minutes, rest = divmod(hundredths, 6000)
    if minutes < 60:
        return f"{minutes}:{rest / 100:05.2f}"
    return f"{minutes // 60}:{minutes % 60:02}:{rest // 100:02}"
