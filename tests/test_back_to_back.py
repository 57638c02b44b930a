"""The same bits: the Python models composed by `control`, and the FMUs of both versions in the loop."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest

from harness.cosim.loop import Simulation
from harness.trial import trial
from harness.trial.prepare import prepared
from harness.trial.replacements import OURS
from harness.trial.request import Changes, build_missing, requested
from harness.trial.scenario import Scenario, load
from models.interconnect import interconnect
from models.kit.timing import TICK

CASES: dict[
    str, dict[str, Any]
] = {  # whole trials with corrections, drawn responses, failed turns, an outage; both readings
    "three_waypoint": {},
    "left_90": {
        "seed": 5,
        "parameters": {"sensors.outage_start": [6.0], "sensors.outage_end": [16.0]},
    },
    "right_45": {"reading": "literal", "seed": 3},
    "two_waypoint": {"system": "cts", "seed": 11, "parameters": {"cmec.moving_deviation": 15}},
    "downtown_three": {
        "seed": 2,
        "parameters": {
            **{"cmec.drift": 2.62, "cmec.drift_sd": 1.62, "cmec.drift_persistence": 0.8, "cmec.braking": 2.7},
            **{"cmec.response_time": 0.1, "cmec.response_sd": 0.2, "canine_in_streets.response_delay": 0.3},
        },
    },
    "right_90": {"swaps": {"controller": "quarter_turn", "plant": "differential_drive"}},
    "left_45": {"swaps": {"controller": "proportional", "plant": "differential_drive"}, "seed": 2},
}


def run_fmus(
    scenario: Scenario, fmi: int, swaps: Mapping[str, str]
) -> tuple[dict[str, np.ndarray], dict[str, dict[str, float]]]:
    """Every output by `component_variable`, (ticks,), and the parameters that were set."""
    blocks = []
    with ExitStack() as stack:
        request = stack.enter_context(requested(scenario, Changes(fmi=str(fmi), swaps=swaps)))
        build_missing(request)
        ready = stack.enter_context(prepared(request))
        simulation = stack.enter_context(Simulation(ready.system, ready.plan.values, plants=ready.plants))
        columns = {name: [q.name for q in simulation.columns(name)] for name in simulation.components}
        simulation.run(
            ready.plan.events,
            duration=scenario.duration,
            stop=trial.stop_of(simulation),
            record=lambda times, values: blocks.append({n: v.copy() for n, v in values.items()}),
        )
        rows = {name: np.vstack([block[name] for block in blocks]) for name in columns}
        outputs = {
            f"{name}_{variable}": rows[name][:, i]
            for name, names in columns.items()
            for i, variable in enumerate(names)
            if variable in simulation.fmus[name].outputs
        }
        return outputs, {n: dict(v) for n, v in ready.plan.values.items()}


@pytest.mark.parametrize("name", CASES)
def test_model_and_fmus_answer_a_whole_trial_with_the_same_bits(name: str) -> None:
    # given a trial
    changes = dict(CASES[name])
    swaps = changes.pop("swaps", {})
    scenario = replace(load(name), **changes)
    # when its FMUs run it, and then the models do, composed by control.interconnect
    fmi2, values = run_fmus(scenario, 2, swaps)
    fmi3, _ = run_fmus(scenario, 3, swaps)
    ticks = len(fmi2["plant_north"])
    system = scenario.own_system
    assert system is not None
    swapped = {role: OURS[role][block] for role, block in swaps.items()}
    system = replace(system, components=system.components | swapped)
    started = {"controller_start": 1.0, "controller_link_ok": 1.0, "controller_valid": 1.0}
    parameters = {
        n: {k: v for k, v in values.get(n, {}).items() if k in block.flat_names("parameter")}
        for n, block in system.components.items()
    }
    whole = interconnect(system, parameters)
    inputs = whole.initial_input.copy()
    for i, label in enumerate(whole.input_labels):
        inputs[i] = started.get(label, inputs[i])
    response = control.input_output_response(
        whole, np.arange(ticks) * TICK, np.tile(inputs[:, None], (1, ticks)), whole.initial_state
    )
    # then every output is the same on every tick; -0.0 counts as 0.0, which `control`'s matrices make of it
    assert ticks > 200
    assert set(fmi2) == set(whole.output_labels)
    for i, label in enumerate(whole.output_labels):
        np.testing.assert_array_equal(fmi2[label].view(np.uint64), fmi3[label].view(np.uint64), err_msg=label)
        np.testing.assert_array_equal(response.outputs[i], fmi2[label], err_msg=label)
