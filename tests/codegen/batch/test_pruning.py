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
    """Names without their index."""
    return {name.partition("[")[0] for name in names}


def test_how_the_pack_shakes_does_not_matter_where_the_true_state_is_known() -> None:
    # given the trial simulator, of which the outcome alone is wanted
    keep = needed(SYSTEMS["cts"], [STATUS])
    # then gait, jerks and the motion of the pack are left out, and what the animal is played
    assert not stems(keep["plant"]) & {
        "stride", "jerk", "jerk_due", "jerk_stream", "acceleration", "pitch", "roll", "yaw_rate",
        "past_heading",
    }  # fmt: skip
    assert not keep["command_module"]
    assert not stems(keep["controller"]) & {"anomaly", "anomalies", "issued", "waypoint", "mode"}
    # and not: where the animal is, what it obeys, what it drew, and what the table needs
    assert {"north", "east", "speed", "heading", "right_stream", "left_stream", "temper_stream"} <= stems(
        keep["plant"]
    )
    assert {"now", "ticks", "turns", "planned", "route_north", "base_east"} <= stems(keep["controller"])


def test_what_the_estimator_does_not_take_is_not_sensed() -> None:
    keep = needed(SYSTEMS["full"], [STATUS])
    assert {"accel_x", "pitch_meas", "heading_meas", "gps_fix", "gps_north", "gps_speed"} <= keep["sensors"]
    assert not keep["sensors"] & {"accel_y", "accel_z", "gyro_z", "mag_x", "roll_meas", "gps_course"}
    assert {"stride", "jerk", "jerk_stream", "pitch", "acceleration"} <= stems(keep["plant"])
    assert not keep["plant"] & {"roll", "yaw_rate"}
    assert not keep["estimator"] & {"north_sd", "accel_bias", "sigma_accel", "bad_samples", "bad_fixes"}


def test_a_trigger_needs_what_its_guard_reads() -> None:
    # given a jerk: it is drawn on the ticks on which a stride begins, by the speed
    keep = needed(SYSTEMS["cts"], [("plant", "jerk")])
    assert {"jerk", "jerk_due", "jerk_stream", "stride", "velocity"} <= stems(keep["plant"])
    # and the loop through the controller is closed
    assert "command" in keep["controller"]


def test_a_table_needs_its_mode_and_the_rows_that_come_first() -> None:
    keep = needed(SYSTEMS["cts"], [("controller", "issue_north")])
    assert {"now", "turns", "deviation", "distance"} <= keep["controller"]


def test_nothing_wanted_nothing_needed() -> None:
    assert needed(SYSTEMS["full"], []) == {c: frozenset() for c in SYSTEMS["full"].components}


@settings(max_examples=15, deadline=None)
@given(st.sets(st.sampled_from(ANY), max_size=4), st.sets(st.sampled_from(ANY), max_size=4))
def test_wanting_more_needs_what_each_needs(one: set[Any], other: set[Any]) -> None:
    a, b, both = (needed(SYSTEMS["cts"], wanted) for wanted in (one, other, one | other))
    assert both == {c: a[c] | b[c] for c in a}
    assert all(name in a[c] for c, name in one)
    # and what is needed needs no more
    assert needed(SYSTEMS["cts"], [(c, name) for c in a for name in a[c]]) == a


WANTED = {
    "outcome": [STATUS],
    "estimate": [("estimator", "north_sd"), ("sensors", "mag_x"), ("controller", "anomalies[2]")],
    "tone": [("command_module", "tone_hz"), ("plant", "roll"), ("sensors", "gyro_y")],
}


@pytest.fixture(scope="module")
def whole(libraries: Any) -> Library:
    """The blocks with all that they do."""
    library: Library = libraries(QUICKEST, "double")
    return library


@pytest.mark.parametrize("wanted", WANTED.values(), ids=list(WANTED))
def test_a_pruned_tick_from_any_state_keeps_its_bits(
    wanted: list[tuple[str, str]], whole: Library, tmp_path: Path
) -> None:
    # given the C of the full system's blocks with what matters, and states, inputs, parameters at random
    keep = needed(full_system(), wanted)
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
                # then what is kept is the same, and -0.0 is -0.0
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


def test_what_is_left_out_keeps_its_value() -> None:
    # given the plant's C with what the true state needs
    keep = needed(SYSTEMS["cts"], [STATUS])["plant"]
    block = SYSTEMS["cts"].components["plant"]
    text, all_of_it = (generate(block, keep=k)["canine.c"] for k in (keep, None))
    # then it neither draws jerks nor starts their stream, and still declares and initializes them
    assert "canine_shake" in all_of_it
    assert "canine_shake" not in text
    assert "mrg32k3a_substream(stream, 3U" in all_of_it
    assert "mrg32k3a_substream(stream, 3U" not in text
    assert "m->state.jerk = 0.0;" in text
