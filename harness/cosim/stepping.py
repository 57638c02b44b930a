"""How a system is stepped, for options and scenarios: the order, and for how long."""

from __future__ import annotations

from typing import Literal

Order = Literal["sequential", "jacobi"]
DURATION = 300.0  # s, after which a trial is cut
