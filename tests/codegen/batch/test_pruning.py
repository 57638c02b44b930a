"""Which variables decide the observed ones, and that leaving the others out changes no bit of these."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen.batch.pruning import needed
from codegen.blocks.block_c import generate, write_files
from models.kit.block import Block
from models.kit.declaration import flatten
from models.system import SYSTEMS, full_system
from tests.codegen.compiled import QUICKEST, Build, Library, compile_c, get, put, random_states

STATUS = ("controller", "status")
ANY = [
    (component, name)
    for component, block in SYSTEMS["cts"].components.items()
    for kind in ("state", "output")
    for name in block.flat_names(kind)
]


def stems(names: frozenset[str]) -> set[str]:
    """The names of variables, without indices."""
    return {name.partition("[")[0] for name in names}


def test_shaking_is_not_needed_where_the_controller_sees_the_true_state() -> None:
    # given the trial simulator, of which the status is observed
    keep = needed(SYSTEMS["cts"], [STATUS])
    # then gait, jerks and the motion of the pack are left out, and the tones and vibrations of the vest
    assert not stems(keep["plant"]) & {
        "stride", "jerk", "jerk_due", "jerk_stream", "acceleration", "pitch", "roll", "yaw_rate",
        "wandered_pitch", "jolt", "jolt_stream", "shift_stream",
    }  # fmt: skip
    assert not keep["command_module"]
    assert not stems(keep["controller"]) & {"anomaly", "anomalies", "issued", "waypoint", "mode"}
    # but not: position, obedience, random draws, and the states that the table reads
    assert {"north", "east", "speed", "heading", "right_stream", "left_stream", "temper_stream"} <= stems(
        keep["plant"]
    )
    assert {"now", "ticks", "turns", "planned", "route_north", "base_east"} <= stems(keep["controller"])


def test_sensor_outputs_that_no_link_reads_are_not_needed() -> None:
    keep = needed(SYSTEMS["full"], [STATUS])
    assert {"accel_x", "pitch_meas", "heading_meas", "gps_fix", "gps_north", "gps_speed"} <= keep["sensors"]
    assert not keep["sensors"] & {"accel_y", "accel_z", "gyro_z", "mag_x", "roll_meas"}
    assert {"stride", "jerk", "jerk_stream", "pitch", "acceleration"} <= stems(keep["plant"])
    assert not keep["plant"] & {"roll", "yaw_rate"}
    assert not keep["estimator"] & {"north_sd", "accel_bias", "sigma_accel", "bad_samples", "bad_fixes"}


def test_a_triggered_update_needs_what_its_guard_reads() -> None:
    # given a jerk, which is drawn when a stride begins; that depends on the speed
    keep = needed(SYSTEMS["cts"], [("plant", "jerk")])
    assert {"jerk", "jerk_due", "jerk_stream", "stride", "velocity"} <= stems(keep["plant"])
    # and through the loop, on the command
    assert "command" in keep["controller"]


def test_a_table_needs_its_mode_and_the_guards_of_all_rows() -> None:
    keep = needed(SYSTEMS["cts"], [("controller", "issue_north")])
    assert {"now", "turns", "deviation", "distance"} <= keep["controller"]


def test_nothing_is_needed_if_nothing_is_observed() -> None:
    assert needed(SYSTEMS["full"], []) == {c: frozenset() for c in SYSTEMS["full"].components}


@settings(max_examples=15, deadline=None)
@given(st.sets(st.sampled_from(ANY), max_size=4), st.sets(st.sampled_from(ANY), max_size=4))
def test_two_sets_of_variables_need_what_each_of_them_needs(one: set[Any], other: set[Any]) -> None:
    a, b, both = (needed(SYSTEMS["cts"], observed) for observed in (one, other, one | other))
    assert both == {c: a[c] | b[c] for c in a}
    assert all(name in a[c] for c, name in one)
    # and the needed variables need no others
    assert needed(SYSTEMS["cts"], [(c, name) for c in a for name in a[c]]) == a


OBSERVED = {
    "outcome": [STATUS],
    "estimate": [("estimator", "north_sd"), ("sensors", "mag_x"), ("controller", "anomalies[2]")],
    "tone": [("command_module", "tone_hz"), ("plant", "roll"), ("sensors", "gyro_y")],
}


@pytest.fixture(scope="module")
def whole(libraries: Any) -> Library:
    """The blocks with all their states and outputs."""
    library: Library = libraries(QUICKEST, "double")
    return library


@pytest.mark.parametrize("observed", OBSERVED.values(), ids=list(OBSERVED))
def test_a_pruned_tick_from_any_state_keeps_its_bits(
    observed: list[tuple[str, str]], whole: Library, tmp_path: Path
) -> None:
    # given the C of the full system's blocks without the others, and random states, inputs and parameters
    keep = needed(full_system(), observed)
    pruned = compile_pruned(keep, tmp_path)
    rng = np.random.default_rng(5)
    for component, block in full_system().components.items():
        if not keep[component]:
            continue
        records = [whole.records(block, 1000) for _ in range(2)]
        for _ in range(2):
            for name, column in random_states(block, 1000, rng).items():
                for instances in records:
                    put(block, instances, name, column)
            # when both make some ticks, their inputs out of range now and then
            for _ in range(3):
                for name, _variable in flatten(block.group("input")):
                    column = np.array(get(block, records[0], name))
                    if column.dtype == np.float64:
                        column[rng.random(1000) < 0.05] = rng.choice([np.nan, np.inf, 1e30, 0.0])
                    for instances in records:
                        put(block, instances, name, column)
                whole.step(block, records[0])
                pruned(block, records[1])
                # then the needed variables have the same bits, the signs of zeros among them
                for name in keep[component]:
                    full, part = (np.asarray(get(block, r, name), dtype=np.float64) for r in records)
                    assert np.array_equal(full, part, equal_nan=True), f"{component}.{name}"
                    number = ~np.isnan(full)
                    assert np.array_equal(np.signbit(full)[number], np.signbit(part)[number])


def compile_pruned(keep: Any, folder: Path) -> Any:
    """The step functions of the pruned blocks: a call steps every instance."""
    blocks: dict[type[Block], str] = {
        block: component for component, block in full_system().components.items() if keep[component]
    }
    files: dict[str, str] = {}
    driver = []
    for block, component in blocks.items():
        title = block.title()
        files |= generate(block, keep=keep[component])
        driver += [
            f'#include "{title}.h"',
            f"void {title}_step_all({title} *m, int n);",
            f"void {title}_step_all({title} *m, int n) {{ for (; n > 0; n--) {{ {title}_step(m++); }} }}",
        ]
    files["driver.c"] = "\n".join(driver) + "\n"
    write_files(files, folder)
    build = Build("pruned", QUICKEST.compiler, tuple(f.replace("-O2", "-O1") for f in QUICKEST.flags))
    sources: list[str | Path] = [name for name in files if name.endswith(".c")]
    library = ctypes.CDLL(str(compile_c(build, sources, folder, "pruned.so", ("-shared", "-fPIC", "-lm"))))

    def step(block: type[Block], records: Any) -> None:
        getattr(library, f"{block.title()}_step_all")(ctypes.c_void_p(records.ctypes.data), len(records))

    return step


def test_states_that_are_not_needed_are_declared_and_initialized_but_not_computed() -> None:
    # given the plant's C for the status, with and without pruning
    keep = needed(SYSTEMS["cts"], [STATUS])["plant"]
    block = SYSTEMS["cts"].components["plant"]
    text, all_of_it = (generate(block, keep=k)["canine.c"] for k in (keep, None))
    # then the pruned C neither draws jerks nor starts their stream, and it sets the jerk to its start value
    assert "canine_shake" in all_of_it
    assert "canine_shake" not in text
    assert "mrg32k3a_substream(stream, 3U" in all_of_it
    assert "mrg32k3a_substream(stream, 3U" not in text
    assert "m->state.jerk = 0.0;" in text
