"""Notes on what a vest refused in a trial with firmware on board."""

from typing import Any, cast

import pytest

from codegen.firmware.telemetry import Flag
from harness.trial.vest_notes import radio_notes


@pytest.mark.parametrize(
    ("told", "notes"),
    [
        ({}, []),
        (
            {"link_forged": 3.0, "link_replayed": 2.0},
            [
                "the vest refused 3 forged frames by radio",
                "the vest refused 2 frames that came before, or too late by radio",
            ],
        ),
        (
            {"flags": float(Flag.LINK_OK | Flag.INSECURE)},
            ["INSECURE: the vest verifies no frames; whoever has such a radio can command it"],
        ),
    ],
)
def test_rule_11_notes_tell_what_the_vest_has_refused_by_radio(
    told: dict[str, float], notes: list[str]
) -> None:
    values = {"link_forged": 0.0, "link_replayed": 0.0, "flags": float(Flag.LINK_OK)} | told
    log: Any = {f"telemetry.{name}": [0.0, value] for name, value in values.items()}
    assert radio_notes(log) == notes
    assert radio_notes(cast("Any", {})) == []
