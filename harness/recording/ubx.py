"""Finds the fixes in the byte stream of a u-blox receiver."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pyubx2 import UBX_PROTOCOL, UBXReader, calc_checksum

from harness.recording.recording import FixStream, RecordingError

NAV_PVT, NAV_POSLLH, NAV_VELNED = b"\x01\x07", b"\x01\x02", b"\x01\x12"
MAX_H_ACC_M = 100.0  # m; NAV-POSLLH has no fix flag, and without a fix its accuracy is far worse


def read_ubx(path: Path) -> FixStream:
    """The valid fixes in a stream: of NAV-PVT, or else of NAV-POSLLH with NAV-VELNED.

    Raises:
        RecordingError: it has none.
    """
    pvt: list[tuple[float, ...]] = []
    pairs: list[tuple[float, ...]] = []
    errors, posllh = 0, None
    with path.open("rb") as stream:
        for frame, _ in UBXReader(stream, protfilter=UBX_PROTOCOL, parsing=False):
            kind, end = frame[2:4], stream.tell()
            if calc_checksum(frame[2:-2]) != frame[-2:]:
                errors += 1
            elif kind in (NAV_PVT, NAV_POSLLH, NAV_VELNED):
                m: Any = UBXReader.parse(frame)
                if kind == NAV_PVT and m.gnssFixOk and m.fixType in (2, 3, 4):
                    pvt.append((end, *_position(m), m.velN / 1e3, m.velE / 1e3, m.hAcc / 1e3, m.sAcc / 1e3))
                elif kind == NAV_POSLLH:
                    posllh = m if m.hAcc / 1e3 < MAX_H_ACC_M else None
                elif kind == NAV_VELNED and posllh is not None and posllh.iTOW == m.iTOW:
                    velocity = m.velN / 1e2, m.velE / 1e2
                    pairs.append((end, *_position(posllh), *velocity, posllh.hAcc / 1e3, m.sAcc / 1e2))
    rows = np.array(pvt or pairs)
    if not len(rows):
        raise RecordingError(
            f"{path}: got no fixes, expected NAV-PVT or NAV-POSLLH with NAV-VELNED; "
            "enable them in the receiver and record under open sky"
        )
    dropped = {"UBX frames with a wrong checksum": errors} if errors else {}
    return FixStream(path.name, rows[:, 1:], rows[:, 0].astype(np.int64), dropped)


def _position(m: Any) -> tuple[float, float, float, float]:
    return m.iTOW / 1e3, np.radians(m.lat), np.radians(m.lon), m.height / 1e3
