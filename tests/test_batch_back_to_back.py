"""The native batch runner ends every trial as co-simulation of the FMUs does, bit for bit.

Trials are drawn at random, as `canine run` would be asked for them: waypoints, start, parameters, changes of
inputs. Counts of anomalies, which no FMU shows, are made here from the rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from codegen.batch.batch import Batch, Change
from harness.cosim.loop import Simulation
from harness.trial import trial
from harness.trial.faults import resolve_faults
from harness.trial.plan import Plan, interfaces_of_system, plan
from harness.trial.prepare import prepared
from harness.trial.request import Request, build_missing
from harness.trial.scenario import FAULTS, Disturbance, Scenario, Setting
from models.cmec import Cmec
from models.commands import ENDS, Status
from models.fence import MAX_CORNERS
from models.kit.declaration import Type, flatten
from models.modes import Anomaly, Mode
from models.readings import READINGS
from models.system import SYSTEMS, System

STEP = 0.04  # s
TRIALS = 50  # of each system and reading
NUMBERS = {"calibrated": 0, "literal": 1, "guarded": 2, "field": 3}  # of the readings, for the draws
STOP = ("controller.status", ENDS)
NARROW = ("controller.status", "controller.directional_commands", "plant.north", "plant.east")
DOG = {  # as users write them, angles in degrees
    "cmec.capture_radius": (4, 10),
    "cmec.stopped_speed": (0.1, 0.6),
    "cmec.moving_deviation": (8, 90),
    "cmec.stop_deviation": (8, 40),
    "cmec.stop_hold": (0, 2.5),
    "cmec.turn_timeout": (1, 5),
    "cmec.forward_timeout": (0.5, 5),
    "cmec.forward_distance": (0, 3),
    "cmec.dead_time": (0, 2),
    "cmec.turn_end_deviation": (1, 20),
    "canine.start_heading_deviation": (0, 40),
    "canine.cruise_speed": (2, 7),
    "canine.cruise_speed_deviation": (0, 1.5),
    "canine.speeding_up": (0.5, 3),
    "canine.speeding_up_deviation": (0, 0.7),
    "canine.slowing_down": (1, 4),
    "canine.slowing_down_deviation": (0, 1.3),
    "canine.right_turn_rate": (20, 80),
    "canine.left_turn_rate": (-100, -20),
    "canine.drift": (-5, 5),
    "canine.drift_deviation": (0, 3),
    "canine.left_success": (0.2, 1),
    "canine.right_success": (0.2, 1),
    "canine.response_delay": (0, 1),
    "canine.bumper_search_min": (0, 2),
    "canine.bumper_search_max": (0, 4),
    "canine.start_delay": (0, 1),
    "canine.run_stride": (1, 5),
    "canine.jerk_rate": (0, 1),
    "canine.stride_deviation": (0, 0.3),
    "canine.pitch_wander": (0, 10),
    "canine.pitch_shift_rate": (0, 0.5),
    "canine.jolt_rate": (0, 1),
    "canine.slip_lead": (0, 0.5),
    "canine.slip_wander": (0, 10),
}
AIMING = {
    "cmec.drift": (-5, 5),
    "cmec.drift_sd": (0, 3),
    "cmec.drift_persistence": (0, 1),
    "cmec.response_time": (0, 1),
    "cmec.response_sd": (0, 0.5),
    "cmec.braking": (0, 4),
}
WEARABLE = {
    "sensors.gps_period": (0.1, 1),
    "sensors.gps_wander": (0, 2),
    "sensors.gps_wander_time": (0, 90),
    "sensors.gps_position_noise": (0, 1),
    "sensors.accel_noise": (0, 3),
    "sensors.attitude_noise": (0, 2),
    "sensors.heading_noise": (0, 5),
    "sensors.mag_noise": (0, 1e-6),
    "sensors.multipath_rate": (0, 0.2),
    "sensors.attitude_lean": (0, 0.5),
    "four_state.sigma_constant": (0.01, 2),
    "four_state.gate": (2, 6),
    "four_state.max_age": (1, 15),
    "four_state.initial_bias_variance": (0.1, 2),
}
SWITCHES = {
    "cts": ("cmec.limit_stop_deviation", "cmec.count_reissue", "cmec.reset_turns", "canine.shaking"),
    "full": ("canine.shaking", "sensors.noisy", "four_state.fuzzy", "four_state.use_pitch"),
}
LIMITS = {
    "cmec.leg_vibration": (1, 10),
    "cmec.window": (1, 20),
    "cmec.progress_time": (0.1, 3),
    "cmec.departing_distance": (0, 1),
    "cmec.leg_time": (5, 60),
    "cmec.fence_width": (2, 20),
    "cmec.fence_radius": (20, 60),
}
FREE = {  # inputs that change in some trials, with what they start with and may become
    "cts": {"start": (1, (0, 1)), "override": (0, range(6)), "link_ok": (1, (0, 1)), "valid": (1, (0, 1))},
    "full": {"start": (1, (0, 1)), "override": (0, range(6)), "link_ok": (1, (0, 1))},
}  # fmt: skip


def draw_trial(system: str, reading: str, number: int) -> Scenario:
    """Any trial; two in five are short or have inputs that change."""
    rng = np.random.default_rng([number, system == "full", NUMBERS[reading]])
    ranges = DOG | (WEARABLE if system == "full" else {})
    parameters: dict[str, Any] = {n: float(rng.uniform(*r)) for n, r in ranges.items() if rng.random() < 0.3}
    parameters |= {n: bool(rng.integers(2)) for n in SWITCHES[system] if rng.random() < 0.2}
    if rng.random() < 0.3:
        parameters["cmec.max_turns"] = int(rng.integers(0, 6))
    if system == "full" and rng.random() < 0.5:
        starts = np.sort(rng.uniform(0, 40, 2))
        parameters["sensors.outage_start"] = starts.tolist()
        parameters["sensors.outage_end"] = (starts + rng.uniform(0, 20, 2)).tolist()
    if reading == "guarded" and rng.random() < 0.7:
        name = str(rng.choice(list(LIMITS)))
        parameters[name] = float(rng.uniform(*LIMITS[name]))
    if number % 3 == 0:
        aims = np.random.default_rng([number, 11])
        parameters |= {n: float(aims.uniform(*r)) for n, r in AIMING.items() if aims.random() < 0.6}
        parameters["canine.drift_redrawn"] = bool(aims.integers(2))
    changing = number % 5 == 0
    return Scenario(
        f"{system} {reading} {number}",
        system,
        reading,
        seed=int(rng.integers(2**31)),
        duration=float(rng.uniform(0, 20)) if number % 5 == 1 else 120.0,
        waypoints=tuple(map(tuple, rng.uniform(-60, 60, (rng.integers(1, 6), 2)).tolist())),
        start=(*rng.uniform(-20, 20, 2).tolist(), float(rng.uniform(-180, 180))),
        parameters=parameters,
        sets=tuple(_changes(system, rng)) if changing else (),
        fence=_polygon(np.random.default_rng([number, 7])) if reading == "guarded" and number % 2 else (),
    )


def _polygon(rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    """Corners around the origin, by their direction."""
    directions = 2 * np.pi * (np.arange(n := rng.integers(3, MAX_CORNERS + 1)) + rng.uniform(0, 0.9, n)) / n
    far = rng.uniform(25, 80, n)
    return tuple(zip((far * np.cos(directions)).tolist(), (far * np.sin(directions)).tolist(), strict=True))


def _changes(system: str, rng: np.random.Generator) -> Iterator[Setting]:
    """Some before the trial, some at once, some after its end; each may end, or not."""
    for _ in range(int(rng.integers(1, 7))):
        name = rng.choice(list(FREE[system]))
        value = int(rng.choice(FREE[system][name][1]))
        at = float(rng.uniform(0, 40) if rng.random() < 0.9 else rng.uniform(100, 200))
        until = at + float(rng.uniform(0, 10)) if rng.random() < 0.7 else None
        yield Setting(f"controller.{name}", bool(value) if name != "override" else value, at, until)


@dataclass(frozen=True)
class Trial:
    """A trial, and how co-simulation ended it.

    Attributes:
        ticks: index of the last tick.
        last: every output on it, and the counts of anomalies, by `component.variable`.
    """

    scenario: Scenario
    values: dict[str, dict[str, float]]
    changes: tuple[Change, ...]
    ticks: int
    last: dict[str, float]

    @property
    def longest(self) -> int:
        """Index of the tick with which it ends at the latest."""
        return math.floor(self.scenario.duration / STEP + 1e-9)

    def given(self, name: str) -> float | None:
        """A parameter's value, if the trial sets it."""
        component, _, variable = name.partition(".")
        return self.values[component].get(variable)


def co_simulated(scenarios: list[Scenario]) -> Iterator[Trial]:
    """Run scenarios of one system as `canine run` does."""
    request = Request(scenarios[0])
    build_missing(request)
    with prepared(request) as ready:
        for scenario in scenarios:
            resolved = ready.plan if scenario.faults else plan(scenario, ready.interfaces)
            assert scenario is not scenarios[0] or resolved == ready.plan
            with Simulation(ready.system, resolved.values) as simulation:
                yield run(scenario, resolved, simulation)


def run(scenario: Scenario, resolved: Plan, simulation: Simulation) -> Trial:
    """Run a trial whose FMUs are ready."""
    blocks: list[dict[str, Any]] = []
    outcome = simulation.run(
        resolved.events,
        duration=scenario.duration,
        stop=trial.stop_of(simulation),
        record=lambda times, values: blocks.append({n: v.copy() for n, v in values.items()}),
    )
    columns = {name: [q.name for q in simulation.columns(name)] for name in simulation.components}
    last = {
        f"{name}.{variable}": float(blocks[-1][name][-1, i])
        for name, names in columns.items()
        for i, variable in enumerate(names)
        if variable in simulation.fmus[name].outputs
    }
    rows = np.vstack([block["controller"] for block in blocks])
    mode, anomaly = (rows[:, columns["controller"].index(n)] for n in ("mode", "anomaly"))
    changes = [
        Change(math.ceil(e.time / STEP - 1e-9), e.component, e.variable, e.value) for e in resolved.events
    ]
    counts = count_anomalies(mode, anomaly)
    return Trial(scenario, resolved.values, tuple(changes), outcome.ticks - 1, last | counts)


def count_anomalies(mode: np.ndarray[Any, Any], anomaly: np.ndarray[Any, Any]) -> dict[str, float]:
    """How often each was reported since the mission began."""
    counts: dict[Anomaly, float] = {a: 0.0 for a in Anomaly if a is not Anomaly.NONE}
    before = Mode.IDLE
    for now, reported in zip(mode.astype(int), anomaly.astype(int), strict=True):
        if before == Mode.IDLE and now != Mode.IDLE:
            counts = dict.fromkeys(counts, 0.0)
        if reported:
            counts[Anomaly(reported)] += 1
        before = now
    return {f"controller.anomalies[{a}]": count for a, count in counts.items()}


@pytest.fixture(scope="module", params=["cts", "full"])
def trials(request: pytest.FixtureRequest) -> list[Trial]:
    """The trials of a system, co-simulated."""
    scenarios = [draw_trial(request.param, reading, i) for reading in READINGS for i in range(TRIALS)]
    return list(co_simulated(scenarios))


def ended_as(trials: list[Trial], ticks: Any, values: Any, observed: tuple[str, ...]) -> None:
    """Compare what a batch came to."""
    for one, tick, row in zip(trials, ticks, values, strict=True):
        expected = np.array([one.last[name] for name in observed])
        different = [
            f"{name}: {got!r}, co-simulation {want!r}"
            for name, got, want in zip(observed, row, expected, strict=True)
            if np.float64(got).tobytes() != np.float64(want).tobytes()
        ]
        assert (tick, different) == (one.ticks, []), one.scenario.text()


def test_trials_are_of_all_kinds(trials: list[Trial]) -> None:
    """Else the tests below show little."""
    ended = [int(one.last["controller.status"]) for one in trials]
    for status in (Status.RUNNING, Status.SUCCESS, Status.FAILED, Status.STOPPED):
        assert ended.count(status) >= 4
    happened = {name for one in trials for name, count in one.last.items() if "anomalies" in name and count}
    missing = {f"controller.anomalies[{a}]" for a in Anomaly if a is not Anomaly.NONE} - happened
    # no plant of ours gives NaN, and one whose true heading is known is turned before it departs
    known = {Anomaly.BAD_INPUT} | ({Anomaly.DEPARTING} if trials[0].scenario.system == "cts" else set())
    assert missing <= {f"controller.anomalies[{anomaly.value}]" for anomaly in known}
    assert sum(one.ticks > 1000 for one in trials) > 10


def test_all_outputs_at_the_end_of_any_trial_have_the_bits_of_co_simulation(trials: list[Trial]) -> None:
    # given one runner for all trials: what any of them sets is varied, everything is observed
    system = SYSTEMS[trials[0].scenario.system]
    observed = tuple(trials[0].last)
    names = {
        f"{component}.{name}": start
        for component, block in system.components.items()
        for variable in block.group("parameter")
        for name, start in zip(variable.flat_names, variable.start, strict=True)
        if name != "seed" and any(name in one.values[component] for one in trials)
    }
    assert len(names) > 40
    batch = Batch(system, tuple(names), observed, STOP)
    free = {"controller": {"start": 1.0}}
    # when trials that end at the same time at the latest, with the same changes of inputs, run side by side
    groups: dict[tuple[int, tuple[Change, ...]], list[Trial]] = {}
    for one in trials:
        groups.setdefault((one.longest, one.changes), []).append(one)
    assert max(map(len, groups.values())) > 50
    for (longest, changes), group in groups.items():
        points = np.array(
            [[start if (v := one.given(n)) is None else v for n, start in names.items()] for one in group]
        )
        seeds = np.array([one.scenario.seed for one in group])
        # every free input is a changing one, in the same order: the runner is compiled once
        first = tuple(
            Change(0, "controller", name, float(start))
            for name, (start, _) in FREE[system.name].items()
            if not any(c.tick == 0 and c.variable == name for c in changes)
        )
        every = sorted((*first, *changes), key=lambda change: change.variable)
        done = batch.run(free, points, np.arange(len(group), dtype=np.int32), seeds, longest, changes=every)
        # then each ends on the same tick, with the same bits
        ended_as(group, done.ticks, done.values, observed)


def test_the_little_that_a_sweep_observes_has_the_bits_of_co_simulation(trials: list[Trial]) -> None:
    # given a runner from which all that the outcome does not depend on is left out
    batch = Batch(SYSTEMS[trials[0].scenario.system], ("controller.moving_deviation",), NARROW, STOP)
    plain = [one for one in trials if not one.changes]
    assert len({len(one.scenario.fence) for one in plain}) > 3
    assert len(plain) > 70
    for one in plain:
        # when a trial runs, with what it sets common to the trials of a call
        h = one.given("controller.moving_deviation")
        point = np.array([[Cmec.moving_deviation.start[0] if h is None else h]])
        done = batch.run(one.values, point, np.zeros(3, np.int32), np.full(3, one.scenario.seed), one.longest)
        # then each of them ends as it does
        ended_as([one] * 3, done.ticks, done.values, NARROW)


DISTURBED = {  # signals with faults of drawn kinds: what `value` may be in the signal's unit
    "sensors.gps_north": 10.0,
    "sensors.heading_meas": 40.0,
    "estimator.north -> controller.north": 10.0,
    "sensors.gps_fix": 1.0,
    "controller.command -> plant.command": 1.0,
}


def draw_faults(number: int) -> Scenario:
    """A trial with faults in the same places as all others, but of any kinds at any time."""
    rng = np.random.default_rng(number)
    fits = {"sensors.gps_fix": Type.BOOLEAN, "controller.command -> plant.command": Type.INTEGER}
    faults = []
    for signal, most in DISTURBED.items():
        kinds = [kind for kind, what in FAULTS.items() if fits.get(signal, Type.REAL) in what.types]
        kind = str(rng.choice(kinds))
        at = float(rng.uniform(0, 15))
        value = {"delay": rng.uniform(0.04, 2), "dropouts": rng.uniform(), "scale": rng.uniform(-1, 2)}
        drawn = float(value.get(kind, most * rng.uniform())) if FAULTS[kind].means else None
        faults.append(Disturbance(signal, kind, at, at + float(rng.exponential(4)), drawn))
    waypoints = ((25.0, float(rng.uniform(-10, 10))),)
    return Scenario("faults", waypoints=waypoints, seed=number, duration=30.0, faults=tuple(faults))


def test_trials_with_any_faults_have_the_bits_of_co_simulation() -> None:
    # given trials with faults of all kinds, co-simulated
    scenarios = [draw_faults(number) for number in range(40)]
    kinds = {kind for kind, what in FAULTS.items() if what.types}  # of signals
    assert {f.kind for s in scenarios for f in s.faults} == kinds
    trials = [one for scenario in scenarios for one in co_simulated([scenario])]
    # when a runner with the same blocks in its links runs them side by side
    system = SYSTEMS["full"]
    links = resolve_faults(scenarios[0], interfaces_of_system(system), system.links, STEP).links
    observed = tuple(trials[0].last)
    set_by_faults = {
        f"{component}.{name}"
        for one in trials
        for component, values in one.values.items()
        for name in values
        if component.startswith("fault") and name != "seed"
    }
    names = [*sorted(set_by_faults), "controller.waypoint_east[1]"]
    batch = Batch(system.with_faults(links), names, observed, STOP)
    starts = {name: start_of(batch.system, name) for name in names}
    points = np.array(
        [[one.given(n) if one.given(n) is not None else starts[n] for n in names] for one in trials]
    )
    common = {c: values for c, values in trials[0].values.items() if not c.startswith("fault")}
    seeds = np.array([one.scenario.seed for one in trials])
    done = batch.run(common, points, np.arange(len(trials), dtype=np.int32), seeds, trials[0].longest)
    # then each ends on the same tick, with the same bits
    ended_as(trials, done.ticks, done.values, observed)


STALLS: list[dict[str, list[tuple[float, float | None]]]] = [
    {"estimator": [(3.0, 5.0)]},
    {"controller": [(4.0, 6.0)], "command_module": [(2.0, 3.0)]},
    {"sensors": [(0.0, 1.0), (1.04, 2.0), (8.0, 8.04)], "plant": [(0.04, 1.0), (5.0, 6.0)]},
    {
        "sensors": [(2.0, None)],
        "plant": [(3.0, 60.0)],
        "estimator": [(4.0, 30.0)],
        "controller": [(5.0, 29.96)],
    },
]


def test_trials_in_which_components_stall_have_the_bits_of_co_simulation() -> None:
    # given a runner that is compiled once, and orders while components stall and afterwards
    system, varied, starts = SYSTEMS["full"], "controller.moving_deviation", range(6)
    orders = (("STOP", 4.48, 4.8), ("LEFT", 9.0, 9.6))
    sets = tuple(Setting("controller.override", *order) for order in orders)
    plain = Scenario("stalls", waypoints=((20.0, 5.0),), duration=30.0, sets=sets)
    for stalls in STALLS:
        faults = tuple(Disturbance(c, "stall", *span) for c, spans in stalls.items() for span in spans)
        scenario = replace(plain, faults=faults)
        trials = [one for seed in starts for one in co_simulated([replace(scenario, seed=seed)])]
        # when they run side by side
        one, observed = trials[0], tuple(name for name in trials[0].last if "anomalies" not in name)
        batch = Batch(system, (varied,), observed, STOP)
        found = resolve_faults(scenario, interfaces_of_system(system), system.links, STEP).stalls
        given = (one.values, np.array([[start_of(system, varied)]]), [0] * len(trials), starts, one.longest)
        all_of_them = {c: found.get(c, ()) for c in system.components}
        done = batch.run(*given, changes=one.changes, stalls=all_of_them)
        # then each ends on the same tick, with the same bits
        ended_as(trials, done.ticks, done.values, observed)
        # and otherwise than without
        other = batch.run(*given, changes=one.changes, stalls=dict.fromkeys(system.components, ()))
        assert not np.array_equal(other.values, done.values)


def start_of(system: System, name: str) -> float:
    """The start value of a scalar parameter."""
    component, _, variable = name.partition(".")
    declared = dict(flatten(system.components[component].group("parameter")))[variable]
    return declared.start[0]
