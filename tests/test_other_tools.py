"""Other tools run a trial's package to its rows, bit for bit: `canine export --ssp`, then their own loops.

They exchange all values, then step all FMUs, as in the order `jacobi`: after step k + 1 they have the answers
of tick k, and the plant is where it is on tick k + 1.
"""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from harness import run_trial
from harness.log.log import Log
from harness.trial.scenario import Written
from models.kit.declaration import flatten
from models.kit.timing import TICK
from models.system import SYSTEMS
from tests.conftest import MISSING
from tests.harness.command import canine

SETTINGS: dict[str, Written] = {
    "sensors.outage_start": [6.0],
    "sensors.outage_end": [9.0],
    "cmec.moving_deviation": 37,
}
OUTPUTS = [
    (component, name, variable.type.value)
    for component, block in SYSTEMS["full"].components.items()
    for name, variable in flatten(block.group("output"))
]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    """A trial with an outage, in jacobi order."""
    out = tmp_path_factory.mktemp("ours")
    return run_trial("left_90", seed=5, parameters=SETTINGS, order="jacobi", out=out).log


@pytest.mark.parametrize(("tool", "fmi"), [("ecos", 2), ("ecos", 3), ("libcosim", 2)])
def test_another_tool_runs_a_trial_to_the_same_rows(
    tool: str, fmi: int, log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if find_spec(f"{tool}py") is None:
        pytest.skip(f"{tool}py is not installed: pip has it for Linux on x86-64")
    if tool == "ecos" and "libtbb.so.12" in MISSING:
        pytest.skip(f"ecos needs libtbb.so.12: {MISSING['libtbb.so.12']}")
    # given the package of a trial, and nothing else of it
    package, job, rows = tmp_path / "trial.ssp", tmp_path / "job.json", tmp_path / "rows.npy"
    settings = [f"--set={name}={value}" for name, value in SETTINGS.items()]
    status, _, errors = canine(
        capsys, "export", "left_90", "--seed", 5, *settings, "--fmi", fmi, "--ssp", package
    )
    assert (status, errors) == (0, "")
    # when the tool runs it
    ticks = len(log.time)
    job.write_text(json.dumps({"step": TICK, "ticks": ticks, "outputs": OUTPUTS}))
    done = subprocess.run(
        [sys.executable, "-m", f"tests.peers.{tool}", package, job, rows],
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    # then every output of every tick has the same bits; libcosim shows nothing before its first step
    seen = np.load(rows)
    assert ticks > 500
    for column, (component, name, _) in enumerate(OUTPUTS):
        first = int(tool == "libcosim") if component == "plant" else 0
        at = first if component == "plant" else first + 1
        got = seen[at : at + ticks - first, column]
        expected = log[f"{component}.{name}"][first:].astype(np.float64)
        np.testing.assert_array_equal(got.view(np.uint64), expected.view(np.uint64), f"{component}.{name}")
