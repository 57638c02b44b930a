"""The cost of the printed defuzzifier, the sum of eq. 3.21 over 1501 points, on the Rabbit 4000."""

from __future__ import annotations

import struct
from pathlib import Path

from codegen.firmware.rabbit4000 import program_image
from codegen.firmware.targets import find_target
from harness.onboard.processors.rabbit4000 import Machine

SOURCE = Path(__file__).with_suffix(".c")
SPEEDS = (0.0, 0.25, 1.0, 3.5, 5.0)  # m/s: stopped, half walking, walking, half running, running
LIMIT = 50_000_000  # bus accesses: 2 s


def printed_defuzzifier(speeds: tuple[float, ...] = SPEEDS) -> list[tuple[float, int, float]]:
    """Speed [m/s], clocks and process noise [m/s2] of each.

    Raises:
        CompileError: SDCC refuses it, or is missing.
        ProcessorError: the simulator cannot be started, or the program does not come back.
    """
    machine = Machine(program_image(find_target("rabbit4000"), {SOURCE.name: SOURCE.read_text()}))
    at, rows = machine.image.symbols, []
    try:
        for speed in speeds:
            machine.write(at["printed_speed"], struct.pack("<f", speed))
            before = machine.cost().clocks
            machine.run_to("pil_done", LIMIT)
            clocks = machine.cost().clocks - before
            machine.run_to("pil_wait")
            (sigma,) = struct.unpack("<f", machine.memory(at["printed_sigma"], 4))
            rows.append((speed, clocks, sigma))
    finally:
        machine.close()
    return rows


def printed_defuzzifier_clocks() -> list[tuple[float, int]]:
    """Speed [m/s] and clocks of each of SPEEDS; raises as `printed_defuzzifier`."""
    return [(speed, clocks) for speed, clocks, _ in printed_defuzzifier()]
