"""Models as those of the Reference-FMUs, written anew: they take places in a trial through mapping files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness import load_scenario, run_trial
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

STEPS = 40  # of Euler's method in a tick
VAN_DER_POL = """
  const double mu = v[2];
  for (int i = 0; i < 40; i++) {
    const double x0 = v[0], x1 = v[1], dt = h / 40;
    v[0] = x0 + dt * x1;
    v[1] = x1 + dt * (mu * ((1.0 - x0 * x0) * x1) - x0);
  }
"""
FEEDTHROUGH = "v[4] = v[0]; v[5] = v[1]; v[6] = v[2]; v[7] = v[3];"


def oscillation(ticks: int, mu: float) -> np.ndarray:
    """x0 and x1 of Van der Pol's equation at each tick, (ticks, 2): x0'' = mu (1 - x0^2) x0' - x0."""
    x0, x1, rows = 2.0, 0.0, []
    for _ in range(ticks):
        rows.append((x0, x1))
        for _ in range(STEPS):
            x0, x1 = x0 + 0.04 / STEPS * x1, x1 + 0.04 / STEPS * (mu * ((1.0 - x0 * x0) * x1) - x0)
    return np.array(rows)


@pytest.mark.parametrize("version", [2, 3])
def test_van_der_pol_is_a_plant_by_its_mapping(tmp_path: Path, version: int) -> None:
    # given an oscillator without inputs, whose two states are all that a plant gives
    variables = [V("x0"), V("x1"), V("mu", "parameter", start="1")]
    start = "v[0] = 2; v[1] = 0; v[2] = 1;"
    plant = tiny_fmu(tmp_path / "vdp.fmu", variables, VAN_DER_POL, version=version, start=start)
    plant.with_suffix(".toml").write_text(
        '[outputs]\nnorth = "x0"\neast = { name = "x1", factor = 2.0 }\n'
        'speed = { name = "x0", offset = 10.0 }\nheading = "x1"\n'
    )
    # when
    scenario = replace(load_scenario("two_waypoint"), duration=8.0)
    log = run_trial(scenario, plant=plant, out=tmp_path / "out").log
    # then the log has what the equation gives, bit for bit
    rows = oscillation(201, 1.0)
    np.testing.assert_array_equal(log["plant.north"], rows[:, 0])
    np.testing.assert_array_equal(log["plant.east"], 2.0 * rows[:, 1])
    np.testing.assert_array_equal(log["plant.speed"], rows[:, 0] + 10.0)


@pytest.mark.parametrize("version", [2, 3])
def test_feedthrough_is_an_estimator_by_its_mapping(tmp_path: Path, version: int) -> None:
    # given what gives on what it takes, of each type
    integer, real = ("Integer", "Real") if version == 2 else ("Int32", "Float64")
    kinds = {"continuous": real, "discrete": real, "whole": integer, "Boolean": "Boolean"}
    variables = [V(f"{name}_input", "input", kind) for name, kind in kinds.items()]
    variables += [V(f"{name}_output", type=kind) for name, kind in kinds.items()]
    fmu = tiny_fmu(tmp_path / "feedthrough.fmu", variables, FEEDTHROUGH, version=version)
    fmu.with_suffix(".toml").write_text(
        '[inputs]\ngps_north = "continuous_input"\ngps_speed = "discrete_input"\ngps_fix = "Boolean_input"\n'
        '[outputs]\nnorth = "continuous_output"\neast = "continuous_output"\n'
        'speed = "discrete_output"\nspeed_sd = "discrete_output"\n'
        'heading = "discrete_output"\nvalid = "Boolean_output"\n'
    )
    # when
    scenario = replace(load_scenario("three_waypoint"), duration=8.0)
    log = run_trial(scenario, estimator=fmu, out=tmp_path / "out").log
    # then
    np.testing.assert_array_equal(log["estimator.north"], log["sensors.gps_north"])
    np.testing.assert_array_equal(log["estimator.valid"], log["sensors.gps_fix"])
    assert np.ptp(log["estimator.north"]) > 0
