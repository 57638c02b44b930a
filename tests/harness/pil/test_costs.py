"""The firmware over a whole trial on simulated processors: the bits of this machine, at the stated cost."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from codegen.firmware.bundle import COSTS
from codegen.firmware.targets import SIMULATED, TARGETS
from codegen.toolchains import sdcc
from harness.pil import compare
from models.errors import CanineError


def measured(target: str, folder: Path) -> dict[str, Any]:
    """The costs of a target's standard trial, in which every tick is compared with this machine's."""
    if target == "rabbit4000" and os.environ.get("CI") != "true":
        try:
            sdcc.home()
        except CanineError as missing:
            pytest.skip(f"sdcc 4.5: {missing}")
    return compare.costs(target, folder)


@pytest.mark.parametrize("target", SIMULATED)
def test_whole_trial_has_the_same_bits_and_the_stated_cost(
    target: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    # when a trial of more than 60 s is run in the closed loop
    cost = measured(target, tmp_path)
    assert cost["ticks"] * compare.TICK_MS > 60_000
    assert cost["identical"]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == "success"
    # then it costs what the bundle's README says
    stated = json.loads(COSTS.read_text())
    if request.config.getoption("--update"):
        COSTS.write_text(json.dumps(stated | {target: cost}, indent=2, sort_keys=True) + "\n")
        return
    assert cost == stated.get(target), "if this is meant: pytest --update"


@pytest.mark.parametrize("target", SIMULATED)
def test_stated_cost_is_within_the_processors_memory_and_time(target: str) -> None:
    cost = json.loads(COSTS.read_text())[target]
    assert cost["code_bytes"] + cost["constants_bytes"] <= TARGETS[target].code
    assert cost["ram_bytes"] + cost["stack_bytes"] <= TARGETS[target].ram
    if target == "rabbit4000":  # of the 40 ms of a tick, without wait states
        assert cost["with_fix"]["worst_ms_by_wait_states"][0] <= 8
        assert cost["without_fix"]["worst_ms_by_wait_states"][0] <= 8
    else:
        assert cost["with_fix"]["instructions"]["worst"] <= 3000
