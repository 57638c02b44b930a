"""What is in a recording: `canine check RECORDING`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from harness.recording.agreement import (
    Offset,
    gravity,
    pushing_offset,
    swerving_offset,
    turning_offset,
)
from harness.recording.attitude import Array
from harness.recording.find import Parts, find_parts, recordings_below
from harness.recording.holes import Hole, holes_of_fixes, holes_of_imu
from harness.recording.recording import FixStream, Recording, RecordingError, SampleStream
from harness.terminal import new_table, print_table

OFFSETS = {
    "turning": ("yaw rate against rate of course", turning_offset),
    "swerving": ("force sideways against speed times rate of course", swerving_offset),
    "pushing": ("force forward against rate of speed", pushing_offset),
}
LISTED = 5  # holes that are printed


def check(path: Path) -> dict[str, Any]:
    """Look at a recording: JSON with `fixes`, `imu`, `clocks`, `mounting`, `offset`, `warnings`, `problem`.

    `problem` says why it cannot be replayed; "" if it can. What could not be looked at is null.

    Raises:
        RecordingError: the path holds no recording of a known kind.
    """
    parts = find_parts(path)
    fixes, samples = _in_order(parts)
    recording, clocks, problem = _joined(parts)
    result: dict[str, Any] = {
        "recording": parts.name,
        "messages": dict(parts.messages),
        "fixes": _fixes(fixes) if fixes else None,
        "imu": _imu(samples) if samples else None,
        "clocks": clocks,
        "mounting": None,
        "offset": None,
        "warnings": [],
        "problem": problem,
    }
    if samples:
        felt = gravity(samples.specific_force, parts.mounting)
        result["mounting"] = {"source": parts.mounting_source, **vars(felt)}
        result["warnings"] += [felt.warning] * bool(felt.warning and not recording)
    if recording:
        offsets = {name: by(recording) for name, (_, by) in OFFSETS.items()}
        result["offset"] = {name: vars(offset) for name, offset in offsets.items()}
        result["warnings"] += recording.doubts
        result["overlap_s"] = float(min(recording.fixes.t[-1], recording.imu_t[-1]))
    return result


def check_all(path: Path) -> list[dict[str, Any]]:
    """Look at a recording, or at every one below a folder.

    Raises:
        RecordingError: there is none.
    """
    paths = recordings_below(path)
    results = []
    for recording in paths:
        try:
            results.append(check(recording))
        except RecordingError as reason:
            if len(paths) == 1:
                raise
            results.append({"recording": recording.name, "problem": str(reason)})
    return results


def raise_problems(path: Path, results: Sequence[Mapping[str, Any]]) -> None:
    """Raise what keeps recordings from a replay.

    Raises:
        RecordingError: there is something.
    """
    problems = [result for result in results if result["problem"]]
    if problems and len(results) == 1:
        raise RecordingError(problems[0]["problem"])
    if problems:
        names = ", ".join(result["recording"] for result in problems)
        raise RecordingError(
            f"{path}: {len(problems)} of {len(results)} recordings cannot be replayed: {names}"
        )


def _in_order(parts: Parts) -> tuple[FixStream | None, SampleStream | None]:
    """The streams without what is late, repeated or out of range, counted; None for one that has nothing."""
    fixes, samples = parts.fixes, parts.samples
    with suppress(RecordingError):
        tied = parts.tied()
        fixes, samples = tied.fixes, tied.samples
    ordered_fixes = ordered_samples = None
    with suppress(RecordingError):
        ordered_fixes = fixes.in_order() if isinstance(fixes, FixStream) else None
    with suppress(RecordingError):
        ordered_samples = samples.in_order() if isinstance(samples, SampleStream) else None
    return ordered_fixes, ordered_samples


def _joined(parts: Parts) -> tuple[Recording | None, str | None, str]:
    """The recording, what ties its clocks, and why there is none."""
    try:
        return parts.join(), parts.tied().source, ""
    except RecordingError as reason:
        return None, None, str(reason)


def _fixes(fixes: FixStream) -> dict[str, Any]:
    h_acc, s_acc = fixes.rows[:, 6], fixes.rows[:, 7]
    speed = np.hypot(fixes.rows[:, 4], fixes.rows[:, 5])
    return {
        **_pace(fixes.file, fixes.rows[:, 0], holes_of_fixes, fixes.dropped),
        "kinds": dict(fixes.kinds),
        "h_acc_m": float(np.median(h_acc)),
        "s_acc_m_s": float(np.median(s_acc)),
        "speed_m_s": {"median": float(np.median(speed)), "max": float(speed.max())},
    }


def _imu(samples: SampleStream) -> dict[str, Any]:
    if not samples.in_ticks:
        return _pace(samples.file, samples.clock, holes_of_imu, samples.dropped)
    untimed = dict.fromkeys(("duration_s", "rate_hz", "interval_s", "holes"))
    return {"file": samples.file, "n": len(samples.clock), **untimed, "dropped": dict(samples.dropped)}


def _pace(
    file: str, clock: Array, find_holes: Callable[[Array], list[Hole]], dropped: Mapping[str, int]
) -> dict[str, Any]:
    """How many there are of what has this ascending clock (n,) [s], how often, and where some are missing."""
    holes = [(start, end - start) for start, end in find_holes(clock)]
    steps = np.diff(clock)
    steps = steps[steps > 0]
    pace: dict[str, Any] = {
        "file": file,
        "n": len(clock),
        "duration_s": float(np.ptp(clock)) if len(clock) else 0.0,
    }
    pace |= {"rate_hz": None, "interval_s": None, "holes": [], "dropped": dict(dropped)}
    if len(steps):
        least, median, most = (float(value) for value in np.percentile(steps, (5, 50, 95)))
        regular = float(steps.sum()) - sum(length for _, length in holes)
        pace["rate_hz"] = (len(steps) - len(holes)) / regular
        pace["interval_s"] = {"p5": least, "median": median, "p95": most}
        pace["holes"] = [{"start_s": start - float(clock[0]), "length_s": length} for start, length in holes]
    return pace


def show_all(results: Sequence[Mapping[str, Any]], console: Console) -> None:
    """Print what was found: of one recording all of it, of several a table."""
    if len(results) == 1:
        show(results[0], console)
        return
    table = new_table()
    table.add_column("recording")
    for heading in ("fixes", "fixes [Hz]", "IMU [Hz]", "holes", "dropped", "both [s]", "warnings"):
        table.add_column(heading, justify="right")
    for result in results:
        parts = [result.get(part) for part in ("fixes", "imu")]
        rates = [f"{part['rate_hz']:.4g}" if part and part["rate_hz"] else "-" for part in parts]
        table.add_row(
            result["recording"],
            str(parts[0]["n"]) if parts[0] else "0",
            *rates,
            str(sum(len(part["holes"] or ()) for part in parts if part)),
            str(sum(sum(part["dropped"].values()) for part in parts if part)),
            "-" if result["problem"] else f"{result['overlap_s']:.1f}",
            str(len(result.get("warnings", ()))),
        )
    print_table(table, console)
    for result in results:
        lines = [f"warning: {warning}" for warning in result.get("warnings", ())]
        lines += [result["problem"]] * bool(result["problem"])
        for line in lines:
            console.print(f"{result['recording']}: {line}", soft_wrap=True, markup=False, highlight=False)


def show(result: Mapping[str, Any], console: Console) -> None:
    """Print what was found."""
    lines = [("", result["recording"])]
    if result["messages"]:
        lines.append(("messages", counts(result["messages"])))
    for name in ("fixes", "imu"):
        lines += _lines(name, result[name]) if result[name] else [(name, "none")]
    if result["clocks"]:
        lines.append(("clocks", f"tied by the {result['clocks']}"))
    if felt := result["mounting"]:
        sits = f"roll {felt['roll_deg']:.1f}, pitch {felt['pitch_deg']:.1f} deg; yaw cannot be told"
        lines += [
            ("mounting", felt["source"]),
            (
                "",
                f"gravity {felt['force']:.2f} m/s2, {felt['off_deg']:.1f} deg off straight up in these axes",
            ),
            ("", f"by gravity: {sits}"),
        ]
    for number, (name, offset) in enumerate((result["offset"] or {}).items()):
        lines.append(("" if number else "offset", f"{OFFSETS[name][0]}: {_offset(Offset(**offset))}"))
    lines += [("warning", warning) for warning in result["warnings"]]
    fate = (
        f"no: {result['problem']}" if result["problem"] else f"{result['overlap_s']:.1f} s with both sensors"
    )
    lines.append(("replay", fate))
    for label, text in lines:
        console.print(f"{label:10}{text}", soft_wrap=True, markup=False, highlight=False)


def _lines(name: str, part: Mapping[str, Any]) -> list[tuple[str, str]]:
    rate = "" if part["rate_hz"] is None else f", {part['rate_hz']:.4g} Hz"
    if interval := part["interval_s"]:
        rate += f", one every {1e3 * interval['p5']:.0f} to {1e3 * interval['p95']:.0f} ms (p5 to p95)"
    if part["duration_s"] is None:
        dropped = ("", f"dropped: {counts(part['dropped'])}")
        return [(name, f"{part['file']}: {part['n']}, on a clock of unknown ticks"), dropped]
    lines = [(name, f"{part['file']}: {part['n']} in {part['duration_s']:.1f} s{rate}")]
    if "kinds" in part:
        speed = part["speed_m_s"]
        lines += [
            ("", f"kinds: {counts(part['kinds'])}"),
            ("", f"accuracy {part['h_acc_m']:.2f} m and {part['s_acc_m_s']:.2f} m/s (median)"),
            ("", f"speed {speed['median']:.2f} m/s (median), at most {speed['max']:.2f} m/s"),
        ]
    holes = [f"{hole['length_s']:.2f} s at {hole['start_s']:.2f} s" for hole in part["holes"][:LISTED]]
    if len(part["holes"]) > LISTED:
        holes.append(f"and {len(part['holes']) - LISTED} more")
    return [*lines, ("", f"holes: {', '.join(holes) or 'none'}"), ("", f"dropped: {counts(part['dropped'])}")]


def counts(of: Mapping[str, int]) -> str:
    """Counts by name, in one line."""
    return ", ".join(f"{name} {count}" for name, count in of.items() if count) or "none"


def _offset(offset: Offset) -> str:
    if offset.seconds is None:
        return f"cannot be told: {offset.reason}"
    return (
        f"{offset.seconds:+.2f} s (correlation {offset.correlation:.2f} over {offset.pairs} pairs of fixes)"
    )
