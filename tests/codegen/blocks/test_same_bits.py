"""Python model = our C (three builds) = CasADi's own C, bit for bit in double; C float = its float program.

NaN counts as equal to NaN. In single steps, -0.0 counts as equal to 0.0: CasADi computes a choice as a sum
with zero, C does not.
"""

from __future__ import annotations

import ctypes
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from models.canine import Canine
from models.cmec import Cmec
from models.command_module import CommandModule
from models.day import CanineAllDay
from models.differential_drive import DifferentialDrive
from models.four_state import FourState
from models.kit.block import Block
from models.kit.declaration import SUBSTREAMS, Type, flatten
from models.kit.model import Model
from models.kit.random import start_state
from models.local_plane import LocalPlane
from models.modes import Mode
from models.pedestrian import Pedestrian
from models.proportional import Proportional
from models.quarter_turn import QuarterTurn
from models.sensors import Sensors
from models.streets import CanineInStreets
from models.system import BLOCKS, System, full_system, trial_simulator
from tests.codegen.blocks.float32 import Lanes
from tests.codegen.compiled import (
    BUILDS,
    QUICKEST,
    Build,
    CompiledModel,
    Library,
    Record,
    compile_c,
    generated,
    get,
    put,
    random_states,
)

Libraries = Callable[[Build, str], Library]
Make = Callable[[type[Block], Mapping[str, float]], Any]
LEFT = {
    "waypoint_count": 2, "waypoint_north[1]": 35.73, "waypoint_north[2]": 35.73, "waypoint_east[2]": -35.73,
}  # fmt: skip
RIGHT = LEFT | {"waypoint_east[2]": 35.73}
# a crossing, a decoy beyond it, and a drift to the wall
CORNER = {
    "drift": 0.1, "slowing_down": 1.6, "cruise_speed_deviation": 0.1, "pole_chance": 0.9, "street_count": 2,
    "street_end_north[1]": 90, "street_half_width[1]": 2, "street_north[2]": 35, "street_end_north[2]": 35,
    "street_east[2]": -90, "street_end_east[2]": 90, "street_half_width[2]": 4, "pole_count": 2,
    "pole_north[1]": 55, "pole_north[2]": 35, "pole_east[2]": -50,
}  # fmt: skip
RESTLESS = {
    "pitch_wander": 0.07, "pitch_shift_rate": 0.2, "jolt_rate": 0.3, "slip_wander": 0.1,
    "stride_deviation": 0.1, "drift_redrawn": 1,
}  # fmt: skip
WORN = {
    "start_fatigue": 0.4, "start_habituation": 0.1, "free_vibrations": 0, "habituation_gain": 0.05,
    "left_success": 1, "right_success": 1,
}  # fmt: skip
SPREAD = {"cruise_speed_deviation": 1.49, "speeding_up_deviation": 0.67, "slowing_down_deviation": 1.31}
MAX_TICKS = 7500
REAL_CHOICES = [math.nan, math.inf, -math.inf, 0.0, 1e-300, 1e30]
each_block = pytest.mark.parametrize("block", BLOCKS, ids=lambda b: b.title())


def vector(machine: Any) -> np.ndarray[Any, Any]:
    """States and outputs."""
    return np.concatenate([machine.state, machine.output])


def run_trial(
    system: System, parameters: Mapping[str, Mapping[str, float]], make: Make
) -> Iterator[dict[str, Any]]:
    """The components once initialized, then after each tick in sequential order until the trial ends."""
    machines = {c: make(block, parameters.get(c, {})) for c, block in system.components.items()}
    yield machines
    machines["controller"]["start"] = 1
    order = system.order()
    for _ in range(MAX_TICKS):
        for component in order:
            for link in system.links:
                if link.target == component:
                    machines[component][link.target_variable] = machines[link.source][link.source_variable]
            machines[component].step()
        yield machines
        if machines["controller"]["status"] >= 2:
            break


def python(block: type[Block], parameters: Mapping[str, float]) -> Model:
    model = Model(block, parameters)
    model.initialize()
    return model


TRIALS: dict[str, tuple[System, dict[str, dict[str, float]]]] = {
    **{
        f"full-{seed}": (
            full_system(),
            {
                "controller": RIGHT if seed % 2 else LEFT,
                "plant": {"seed": seed, **(SPREAD if seed == 3 else {})},
                "sensors": {"seed": seed, "outage_start[1]": 8, "outage_end[1]": 14},
                "estimator": {"fuzzy": seed != 4},
            },
        )
        for seed in (1, 2, 3, 4)
    },
    **{
        f"cts-{seed}": (
            trial_simulator(),
            {"controller": LEFT, "plant": {"seed": seed, "start_heading_deviation": 0.17}},
        )
        for seed in (5, 6, 2147483647)
    },
    "full-restless": (  # all that the pack and the sensors can do, and do not by default
        full_system(),
        {
            "controller": LEFT,
            "plant": RESTLESS,
            "sensors": {"multipath_rate": 0.1, "attitude_lean": 0.3, "frozen_start": 5, "frozen_time": 1},
        },
    ),
    **{  # the limits of leading, one that is met in each
        f"guarded-{limit}": (
            trial_simulator(),
            {"controller": LEFT | {"guarded": 1, limit: value, "fence_recall": 1}, "plant": {"seed": 6}},
        )
        for limit, value in (("window", 4), ("leg_vibration", 5), ("fence_radius", 45), ("leg_time", 30))
    },
    "guarded-polygon": (
        trial_simulator(),
        {
            "controller": LEFT
            | {"guarded": 1, "fence_recall": 1, "fence_count": 5}
            | {f"fence_north[{k}]": x for k, x in enumerate((-15, 60, 60, 10, -15), start=1)}
            | {f"fence_east[{k}]": x for k, x in enumerate((-25, -25, 20, 14, 20), start=1)},
            "plant": {"seed": 6},
        },
    ),
    "aiming-off": (
        trial_simulator(),
        {
            "controller": LEFT
            | {"drift": 0.05, "drift_sd": 0.03, "drift_persistence": 0.8, "braking": 2.7}
            | {"response_time": 0.1, "response_sd": 0.2},
            "plant": {"seed": 6, "response_delay": 0.2, "drift_redrawn": 1},
        },
    ),
    "pedestrian": (trial_simulator(Pedestrian), {"controller": LEFT}),
    "streets": (full_system(CanineInStreets), {"controller": LEFT, "plant": CORNER}),
    "streets-restless": (full_system(CanineInStreets), {"controller": RIGHT, "plant": CORNER | RESTLESS}),
    "all-day": (  # a street so narrow that it leans on the wall and leaves it
        trial_simulator(CanineAllDay),
        {"controller": LEFT, "plant": CORNER | WORN | {"street_half_width[1]": 1}},
    ),
    "all-day-restless": (
        trial_simulator(CanineAllDay),
        {"controller": RIGHT, "plant": CORNER | RESTLESS | WORN},
    ),
    "quarter_turn": (trial_simulator(DifferentialDrive, QuarterTurn), {"controller": LEFT}),
    "proportional": (
        trial_simulator(DifferentialDrive, Proportional),
        {"controller": RIGHT, "plant": {"seed": 2, "wheel_slip_deviation": 0.01}},
    ),
    **{  # a trial that fails, by the only anomaly of a plain one
        f"{controller.title()}-fails": (
            trial_simulator(DifferentialDrive, controller),
            {"controller": LEFT | {"max_turns": 0}},
        )
        for controller in (QuarterTurn, Proportional)
    },
}


Rows = dict[str, dict[str, np.ndarray[Any, Any]]]  # component -> group -> (1 + ticks, scalars)


def recorded(name: str, make: Make) -> Rows:
    """A trial's inputs, states and outputs."""
    rows: dict[str, dict[str, list[Any]]] = {}
    for machines in run_trial(*TRIALS[name], make):
        for component, machine in machines.items():
            groups = rows.setdefault(component, {"input": [], "state": [], "output": []})
            for group, column in groups.items():
                column.append(np.array(getattr(machine, group)))
    return {c: {g: np.array(column) for g, column in groups.items()} for c, groups in rows.items()}


class Reference:
    """The trials in Python, each run once, and which triggered updates ran in them."""

    def __init__(self) -> None:
        self.known: dict[str, Rows] = {}
        self.fired: set[str] = set()

    def __call__(self, name: str) -> Rows:
        if name not in self.known:
            self.known[name] = recorded(name, self.make)
        return self.known[name]

    def make(self, block: type[Block], parameters: Mapping[str, float]) -> Model:
        """A model that records which of its triggers fire."""
        model = python(block, parameters)
        for i, phase in enumerate(block.program().tick):
            if phase.guard is not None:
                model._tick[i] = self.recording(
                    model, f"{block.title()}.{phase.name}", phase.guard, model._tick[i]
                )
        return model

    def recording(self, model: Model, name: str, guard: Any, run: Callable[[], None]) -> Callable[[], None]:
        def step() -> None:
            if name not in self.fired and guard(model.state, model.input, model.parameter, model.output):
                self.fired.add(name)
            run()

        return step


@pytest.fixture(scope="module")
def reference() -> Reference:
    return Reference()


def put_rows(block: type[Block], records: Record, group: str, rows: np.ndarray[Any, Any]) -> None:
    """Set a group of every instance: (instances, scalars)."""
    for name, column in zip(block.flat_names(group), rows.T, strict=True):
        put(block, records, name, column)


def get_rows(block: type[Block], records: Record, group: str) -> np.ndarray[Any, Any]:
    """A group of every instance: (instances, scalars)."""
    columns = [np.asarray(get(block, records, n), dtype=np.float64) for n in block.flat_names(group)]
    return np.array(columns).reshape(-1, len(records)).T


@pytest.mark.parametrize("name", TRIALS)
def test_each_tick_of_a_whole_trial_in_c_has_the_bits_of_the_python_models(
    name: str, libraries: Libraries, reference: Reference
) -> None:
    # given a trial that lasts many ticks in Python
    system, parameters = TRIALS[name]
    for component, block in system.components.items():
        rows = reference(name)[component]
        ticks = len(rows["state"]) - 1
        assert ticks > 150
        for library in (libraries(build, "double") for build in BUILDS):
            # when C is initialized, and makes each tick from where Python was before it
            records = library.records(block, 1 + ticks, parameters.get(component))
            for group in ("state", "output"):
                put_rows(block, records[1:], group, rows[group][:-1])
            put_rows(block, records[1:], "input", rows["input"][1:])
            library.step(block, records[1:])
            # then every state and every output has the same bits
            for group in ("state", "output"):
                assert get_rows(block, records, group).tobytes() == rows[group].tobytes(), (component, group)


def test_the_compared_trials_run_every_triggered_update(reference: Reference) -> None:
    # given the trials above, when their triggers are recorded
    for name in TRIALS:
        reference(name)
    # then each has fired (else they show nothing), but for those that no plain trial needs
    blocks = {block for system, _ in TRIALS.values() for block in system.components.values()}
    triggers = {f"{b.title()}.{p.name}" for b in blocks for p in b.program().tick if p.guard is not None}
    controllers = ("cmec", "quarter_turn", "proportional")
    seldom = {f"{controller}.{name}" for controller in controllers for name in ("end", "interrupt")}
    assert triggers - reference.fired == seldom | {"cmec.recall"}


@pytest.fixture(scope="session")
def casadi_c(tmp_path_factory: pytest.TempPathFactory) -> Callable[[type[Block]], Callable[[Any], Any]]:
    """`casadi_c(block)`: the compiled form, by CasADi's own C generator, of each of its functions."""
    libraries: dict[type[Block], Path] = {}

    def make(block: type[Block]) -> Callable[[Any], Any]:
        if block not in libraries:
            folder = tmp_path_factory.mktemp(f"casadi_{block.title()}")
            generator = ca.CodeGenerator(f"{block.title()}.c", {"with_header": False})
            for function in {f.name(): f for f in block.program().functions}.values():
                generator.add(function)
            generator.generate(f"{folder}/")
            flags = ("-O1", "-ffp-contract=off", "-w")
            plain = Build("casadi", QUICKEST.compiler, flags)
            libraries[block] = compile_c(
                plain, [f"{block.title()}.c"], folder, "block.so", ("-shared", "-fPIC", "-lm")
            )
        path = str(libraries[block])
        return lambda function: ca.external(function.name(), path)

    return make


@pytest.mark.parametrize("name", ["full-1", "full-3", "cts-5", "pedestrian", "quarter_turn", "proportional"])
def test_whole_trial_in_casadis_own_c_has_the_same_bits(
    name: str, casadi_c: Any, reference: Reference
) -> None:
    def make(block: type[Block], parameters: Mapping[str, float]) -> Model:
        model = Model(block, parameters, replace=casadi_c(block))
        model.initialize()
        return model

    for component, groups in recorded(name, make).items():
        for group, rows in groups.items():
            assert rows.tobytes() == reference(name)[component][group].tobytes(), (component, group)


def drawn_inputs(block: type[Block], count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Values for the inputs, from their declared ranges and from outside of them."""
    drawn: dict[str, Any] = {}
    for name, v in flatten(block.group("input")):
        if v.type is Type.BOOLEAN:
            drawn[name] = rng.integers(0, 2, count).astype(float)
        elif v.type is Type.INTEGER:
            assert v.min is not None
            assert v.max is not None
            drawn[name] = rng.integers(int(v.min) - 3, int(v.max) + 4, count).astype(float)
        else:
            inside = rng.uniform(-1e3 if v.min is None else v.min, 1e3 if v.max is None else v.max, count)
            drawn[name] = np.where(rng.random(count) < 0.3, rng.choice(REAL_CHOICES, count), inside)
    return drawn


def same(a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]) -> bool:
    return bool(np.array_equal(a, b, equal_nan=True))


@each_block
def test_steps_with_any_input_have_the_same_bits(
    block: type[Block], libraries: Libraries, casadi_c: Any
) -> None:
    # given instances of a block in Python, in CasADi's C and in our C by every compiler
    count, rng = 80, np.random.default_rng(13)
    seeds = rng.integers(2**31, size=count).tolist()
    own = [{"seed": float(seed)} if "seed" in block.flat_names("parameter") else {} for seed in seeds]
    replace = casadi_c(block)
    instances = [(python(block, p), Model(block, p, replace=replace)) for p in own]
    for _, casadi in instances:
        casadi.initialize()
    compiled = {
        build.name: (library, np.concatenate([library.records(block, 1, p) for p in own]))
        for build, library in ((build, libraries(build, "double")) for build in BUILDS)
    }
    # when all are given the same inputs, NaN, infinities and values out of range among them
    for step in range(3):
        inputs = drawn_inputs(block, count, rng)
        rows = []
        for i, pair in enumerate(instances):
            for machine in pair:
                for name, column in inputs.items():
                    machine[name] = column[i]
                machine.step()
            rows.append(vector(pair[0]))
            # then all have the same states and outputs
            assert same(vector(pair[1]), rows[-1]), ("casadi", step, i)
        for build_name, (library, records) in compiled.items():
            for name, column in inputs.items():
                put(block, records, name, column)
            library.step(block, records)
            got = np.hstack([get_rows(block, records, group) for group in ("state", "output")])
            assert same(got, np.array(rows)), (build_name, step)


@each_block
def test_a_tick_from_any_state_has_the_same_bits(block: type[Block], libraries: Libraries) -> None:
    # given states, inputs and parameters drawn at random: every mode, every row of a table
    count = 1500
    drawn = random_states(block, count, np.random.default_rng(7))
    model = Model(block)
    rows = []
    for i in range(count):
        for name, column in drawn.items():
            model[name] = column[i]
        model.output[:] = 0
        model.step()
        rows.append(vector(model))
    names = [*block.flat_names("state"), *block.flat_names("output")]
    for build in BUILDS:
        # when each makes a tick in C
        library = libraries(build, "double")
        records = library.records(block, count)
        for name, column in drawn.items():
            put(block, records, name, column)
        library.step(block, records)
        # then it ends where Python does
        for name, column in zip(names, np.array(rows).T, strict=True):
            assert same(np.asarray(get(block, records, name), dtype=np.float64), column), (build.name, name)


# not the local plane: the reference keeps integers in float32, which has no room for its 32 bits
FLOAT = [b for b in BLOCKS if "float" in b.precisions and b is not LocalPlane]


@pytest.mark.parametrize("block", FLOAT, ids=lambda b: b.title())
def test_float_c_is_the_float_program_operation_by_operation(
    block: type[Block], libraries: Libraries
) -> None:
    # given many instances at random states, in C float and as the program's instructions in float32
    count = 400
    rng = np.random.default_rng(11)
    lanes = Lanes(block, "float", count)
    compiled = [
        (library, library.records(block, count))
        for library in (libraries(build, "float") for build in BUILDS)
    ]
    drawn = random_states(block, count, rng)
    for step in range(6):
        # when both tick with the same inputs, NaN among them
        for name, column in drawn.items() if step == 0 else random_states(block, count, rng).items():
            if step == 0 or name in block.flat_names("input"):
                values_of_all = np.array(column)
                variable = dict(flatten(block.group("input"))).get(name)
                if variable is not None and variable.type is Type.REAL:
                    values_of_all[rng.random(count) < 0.02] = np.nan
                for _, records in compiled:
                    put(block, records, name, values_of_all)
                lanes[name] = values_of_all
        lanes.step()
        for build, (library, records) in zip(BUILDS, compiled, strict=True):
            library.step(block, records)
            # then they agree
            for name in [*block.flat_names("state"), *block.flat_names("output")]:
                got = np.asarray(get(block, records, name), dtype=np.float32)
                assert same(got, lanes[name]), (build.name, step, name)


def test_float_controller_and_estimator_have_the_float_programs_bits_over_a_whole_trial(
    libraries: Libraries, reference: Reference
) -> None:
    # given the sensors' outputs of a trial
    outputs = reference("full-1")["sensors"]["output"][1:]
    sensed = dict(zip(Sensors.flat_names("output"), outputs.T, strict=True))
    library = libraries(QUICKEST, "float")
    machines = [
        (FourState, library.records(FourState, 1), Lanes(FourState, "float", 1)),
        (Cmec, library.records(Cmec, 1, RIGHT), Lanes(Cmec, "float", 1, RIGHT)),
        (CommandModule, library.records(CommandModule, 1), Lanes(CommandModule, "float", 1)),
    ]
    statuses = set()
    for k in range(min(len(outputs), 400)):
        given_: dict[str, float] = {n: column[k] for n, column in sensed.items()} | {"start": 1.0}
        for block, records, lanes in machines:
            for name in block.flat_names("input"):
                if name in given_:
                    put(block, records, name, np.float32(given_[name]))
                    lanes[name] = np.float32(given_[name])
            library.step(block, records)
            lanes.step()
            for name in [*block.flat_names("state"), *block.flat_names("output")]:
                assert get(block, records, name)[0] == lanes[name][0], (k, name)
            given_ |= {n: float(lanes[n][0]) for n in block.flat_names("output")}
        statuses.add((given_["status"], given_["tone_hz"]))
    # and it was a trial, in which tones were played
    assert {(1.0, 1500.0), (1.0, 3500.0)} <= statuses


def test_blocks_streams_start_in_c_where_they_start_in_python(libraries: Libraries) -> None:
    for seed in (0, 1, 77, 2**31 - 1):
        model = CompiledModel(libraries(QUICKEST, "double"), Canine, {"seed": seed})
        undrawn = [s for s in Canine.streams() if s.name != "temper_stream"]  # drawn from at the start
        for stream in undrawn:
            state = tuple(int(model[name]) for name in stream.flat_names)
            assert state == start_state(seed, stream.substream)


def test_any_stream_starts_in_c_where_it_starts_in_python(libraries: Libraries) -> None:
    # given all substreams of some streams, and some substreams of streams from the whole range
    c = libraries(QUICKEST, "double").c
    rng = np.random.default_rng(3)
    drawn = np.column_stack([rng.integers(2**31, size=150), rng.integers(SUBSTREAMS, size=150)]).tolist()
    cases = [(seed, k) for seed in (0, 1, 2**31 - 1, drawn[0][0]) for k in range(SUBSTREAMS)] + drawn
    for seed, substream in cases:
        # when C makes their starts: that of the stream, then that of the substream from it
        stream, state = (ctypes.c_uint32 * 6)(), (ctypes.c_double * 6)()
        c.mrg32k3a_stream(ctypes.c_uint32(seed), stream)
        c.mrg32k3a_substream(stream, ctypes.c_uint32(substream), state)
        # then they are Python's
        assert tuple(stream) == start_state(seed, 0)
        assert tuple(state) == start_state(seed, substream), (seed, substream)


@pytest.mark.skipif(not (shutil.which("gcc") and shutil.which("nm")), reason="needs gcc and nm")
@pytest.mark.parametrize(
    ("block", "precision"),
    [(b, p) for b in BLOCKS for p in b.precisions],
    ids=lambda x: getattr(x, "__name__", x),
)
def test_objects_call_sqrt_floor_fabs_and_nothing_else_of_libm(
    block: type[Block], precision: Any, tmp_path: Path
) -> None:
    files = generated(block, precision)
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    plain = Build("gcc", ("gcc",), ("-std=c99", "-O0", "-ffp-contract=off"))
    compile_c(plain, [f"{block.title()}.c"], tmp_path, "block.o", ("-c",))
    symbols = subprocess.run(
        ["nm", "-u", "block.o"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    needed = {line.split()[-1] for line in symbols.stdout.splitlines()}
    suffix = "f" if precision == "float" else ""
    allowed = {f"{f}{suffix}" for f in ("sqrt", "floor", "fabs")} | {"memcpy", "memset"}
    allowed |= {"mrg32k3a_stream", "mrg32k3a_substream"}
    assert needed - {"__stack_chk_fail", "_GLOBAL_OFFSET_TABLE_"} <= allowed


def test_another_process_generates_the_same_bytes() -> None:
    # given the C of every block here, when a process with another hash seed generates it
    program = (
        f"import sys; sys.path[:0] = [{str(Path(__file__).parents[3])!r}]\n"
        "from models.system import BLOCKS; from codegen.blocks.block_c import generate\n"
        "for b in BLOCKS:\n  for p in b.precisions: print(generate(b, p))\n"
    )
    other = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONHASHSEED": "12345"},
        capture_output=True,
        text=True,
        check=True,
    )
    # then it is the same, byte for byte
    assert other.stdout.splitlines() == [str(generated(b, p)) for b in BLOCKS for p in b.precisions]


def test_random_states_contain_every_mode() -> None:
    # the ticks from any state are to pass through every row of the controller's table
    assert set(random_states(Cmec, 1500, np.random.default_rng(7))["now"]) == {int(m) for m in Mode}
