"""Reads the fixes of a solution that RTKLIB computed (`.pos`).

Source: RTKLIB 2.4.2 manual, app. B.1. Lines that begin with % are the header; its last line names the
columns, and the first of them the time system. A line: date and time (or week and time of week), latitude,
longitude [deg], height [m], Q, ns, sdn, sde, sdu [m], sdne, sdeu, sdun, age, ratio, and, where the solution
has velocities, vn, ve, vu [m/s], sdvn, sdve, sdvu. Q is 1 for an ambiguity-fixed solution, 2 for a float one,
3 for SBAS, 4 for DGPS, 5 for a single one, 6 for PPP: all of them are fixes.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from datetime import datetime
from pathlib import Path

import numpy as np

from harness.recording.recording import WEEK_S, FixStream, RecordingError, as_number, read_file
from harness.recording.velocity import with_differences

GPS_EPOCH = datetime(1980, 1, 6)  # without a time zone, as GPS time
LEAP_S, LEAP_WEEK = 18, 1930  # s that GPS time is ahead of UTC, since this GPS week: 2017-01-01
QUALITIES = {1: "fixed", 2: "float", 3: "SBAS", 4: "DGPS", 5: "single", 6: "PPP"}
NEEDED = ("latitude(deg)", "longitude(deg)", "height(m)", "Q", "sdn(m)", "sde(m)")
VELOCITY = ("vn(m/s)", "ve(m/s)", "sdvn", "sdve")


def read_pos(path: Path) -> FixStream:
    """The fixes of a solution.

    Without velocities in the file, a fix's velocity is the difference from the fix before it, with the
    accuracy of two positions whose errors are independent.

    Raises:
        RecordingError: it is not such a file, of another format, in UTC before 2017, or has no fix.
    """
    lines = read_file(path).decode("ascii", errors="replace").splitlines()
    names = next((line.lstrip("% ").split() for line in reversed(lines) if line.startswith("%")), [])
    system = names[0] if names else ""
    missing = [name for name in NEEDED if name not in names]
    if system not in ("GPST", "UTC") or missing:
        raise RecordingError(
            f"{path}: got columns {' '.join(names)[:80] or 'without names'}, expected GPST or UTC, "
            f"{', '.join(NEEDED)}; let RTKLIB write latitude and longitude in deg, GPS time, and the header"
        )
    column = {name: i for i, name in enumerate(names[1:])}
    has_velocity = all(name in column for name in VELOCITY)
    dropped: Counter[str] = Counter()
    qualities: Counter[str] = Counter()
    rows = []
    for line in lines:
        if line.startswith("%") or not line.strip():
            continue
        fields = [field for field in re.split(r"[,;\s]+", line.strip()) if field]
        try:
            week, t = _week_and_time(fields[0], fields[1])
            if system == "UTC":
                if week < LEAP_WEEK:
                    raise RecordingError(
                        f"{path}: got a solution in UTC of {fields[0]}, expected one since 2017, when "
                        f"GPS time became {LEAP_S} s ahead; let RTKLIB write GPS time"
                    )
                t += LEAP_S
            value = dict(zip(column, map(as_number, fields[2:]), strict=False))
            quality = QUALITIES.get(int(value["Q"]))
            north, east = (value["vn(m/s)"], value["ve(m/s)"]) if has_velocity else (0.0, 0.0)
            s_acc = math.hypot(value["sdvn"], value["sdve"]) if has_velocity else 0.0
            row = (
                t, math.radians(value["latitude(deg)"]), math.radians(value["longitude(deg)"]),
                value["height(m)"], north, east, math.hypot(value["sdn(m)"], value["sde(m)"]), s_acc,
            )  # fmt: skip
        except (ValueError, KeyError, IndexError, OverflowError):
            dropped["lines of the solution that cannot be read"] += 1
            continue
        if quality is None:
            dropped["epochs without a solution"] += 1
        elif not all(map(math.isfinite, row)) or abs(row[1]) > math.pi / 2 or abs(row[2]) > math.tau:
            dropped["fixes out of range"] += 1
        else:
            qualities[quality] += 1
            rows.append(row)
    if not rows:
        raise RecordingError(
            f"{path}: got no fix in {len(lines)} lines, expected lines of time, latitude, longitude, height, "
            "Q; is it the solution of a recording under open sky?"
        )
    table = np.array(rows)
    if not has_velocity:
        table, slow = with_differences(table)
        dropped["fixes without one before them to take a velocity from"] += slow
    return FixStream(path.name, table, np.arange(len(table)), dropped, kinds=qualities)


def _week_and_time(day: str, time: str) -> tuple[int, float]:
    """GPS week and time of week [s] of a date and a time, or of a week and a time of week."""
    if "/" not in day:
        return int(day), as_number(time)
    year, month, date = (int(part) for part in day.split("/"))
    hour, minute, second = time.split(":")
    whole = datetime(year, month, date, int(hour), int(minute)) - GPS_EPOCH
    week, of_week = divmod(whole.total_seconds(), WEEK_S)
    return int(week), of_week + as_number(second)
