"""What a vest refused in a trial with firmware on board, as notes: a line each."""

from __future__ import annotations

from codegen.firmware.telemetry import Flag, Refusal
from harness.log.log import Log


def refusal_notes(log: Log) -> list[str]:
    """Why the vest refused the last START of a trial on board, if it did."""
    if "telemetry.refusal" not in log:
        return []
    refusal = Refusal(int(log["telemetry.refusal"][-1]))
    return [f"the vest refused the last START: {refusal.words}"] if refusal else []


def radio_notes(log: Log) -> list[str]:
    """What the vest has told of its radio in a trial on board that a handler must know (rule 11)."""
    if "telemetry.link_forged" not in log:
        return []
    counts = {
        "forged frames": int(log["telemetry.link_forged"][-1]),
        "frames that came before, or too late": int(log["telemetry.link_replayed"][-1]),
    }
    notes = [f"the vest refused {number} {what} by radio" for what, number in counts.items() if number]
    if Flag.INSECURE in Flag(int(log["telemetry.flags"][-1])):
        notes.append("INSECURE: the vest verifies no frames; whoever has such a radio can command it")
    return notes
