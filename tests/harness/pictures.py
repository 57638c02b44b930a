"""What a picture shows: its size, and the points of its lines."""

from __future__ import annotations

import struct

import numpy as np
from matplotlib.axes import Axes


def size(png: bytes) -> tuple[int, int]:
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    return struct.unpack(">II", png[16:24])


def line(axes: Axes, label: str) -> np.ndarray:
    """(n, 2): the data of the one line with this label."""
    [curve] = [line for line in axes.lines if line.get_label() == label]
    return np.asarray(curve.get_xydata())
