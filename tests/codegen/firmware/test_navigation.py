"""Any estimator on board, with the AHRS before it or without: its inputs, its C, its options."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.firmware.bundle import bundle, library, processor_in_the_loop
from codegen.firmware.navigation import DEFAULT, FIELD, Navigation
from codegen.firmware.targets import TARGETS
from harness import main
from harness.log.geodesy import TangentPlane
from harness.onboard.instruments import InertialUnit, Receiver
from harness.onboard.memory import Memory
from harness.onboard.processors import Received, host, open_processor
from models.canine_ahrs import CanineAhrs
from models.errors import DeclarationError
from models.four_state import FourState
from models.kit.declaration import Input
from models.seven_state import SevenState
from models.system import ESTIMATORS
from tests.codegen.firmware.vest import LATITUDE, LONGITUDE

RECEIVER = Receiver(TangentPlane(math.radians(LATITUDE), math.radians(LONGITUDE)), pvt=True)
# standing level, looking north-west, in a field of 2.4e-5 T north and 4.3e-5 T down
SIGNALS = {
    "accel_x": 0.25, "accel_y": -0.5, "accel_z": -9.75, "gyro_x": 0.0, "gyro_y": 0.0, "gyro_z": 0.125,
    "mag_x": 1.7e-5, "mag_y": 1.7e-5, "mag_z": 4.3e-5,
    "roll_meas": 0.05, "pitch_meas": -0.1, "heading_meas": -0.75,
    "gps_fix": 1.0, "gps_north": 0.0, "gps_east": 0.0, "gps_speed": 1.5, "gps_course": 5.25,
    "gps_h_acc": 2.0, "gps_s_acc": 0.2,
}  # fmt: skip


def memories(navigation: Navigation, ticks: int, **changed: float) -> Iterator[Memory]:
    """The program's memory after each tick with these signals, a fix on every sixth."""
    with closing(open_processor("host", None, navigation)) as processor:
        for tick in range(ticks):
            signals = SIGNALS | {"gps_fix": float(tick % 6 == 0)} | changed
            received = Received(RECEIVER.fix(0.04 * tick, signals), InertialUnit().sample(tick, signals))
            yield Memory(processor.tick(received).record, navigation)


def last(navigation: Navigation, ticks: int, **changed: float) -> Memory:
    """The program's memory after some ticks."""
    return list(memories(navigation, ticks, **changed))[-1]


@pytest.mark.parametrize("name", ESTIMATORS)
def test_each_estimator_gets_each_of_its_inputs_on_board_with_the_ahrs_before_it(name: str) -> None:
    # given the program, compiled with warnings as errors, when it has heard a fix and a sample
    navigation = Navigation(ESTIMATORS[name], CanineAhrs)
    memory = last(navigation, 1)

    # then the estimator has what the instruments measured, in SI
    own = set(ESTIMATORS[name].flat_names("input"))
    angles = {"roll_meas", "pitch_meas", "heading_meas", "heading_meas_sd"}
    for signal in own - angles - {"gps_north", "gps_east"}:
        # the receiver sends mm, mm/s and 1e-5 deg, and the inertial unit float32
        expected = SIGNALS[signal] if signal != "gps_course" else 5.25
        assert memory[f"estimator.input.{signal}"] == pytest.approx(expected, rel=1e-6, abs=1e-6)
        if signal in CanineAhrs.flat_names("input"):
            assert memory[f"ahrs.input.{signal}"] == memory[f"estimator.input.{signal}"]
    # and the attitude of the AHRS, not of the unit: by gravity alone 0.05 rad of roll, -0.026 of pitch
    for angle in angles:
        if angle in own:
            assert memory[f"estimator.input.{angle}"] == memory[f"ahrs.output.{angle}"]
    assert memory["ahrs.output.roll_meas"] == pytest.approx(math.atan2(0.5, 9.75), abs=2e-3)
    assert memory["ahrs.output.pitch_meas"] == pytest.approx(
        math.atan2(0.25, math.hypot(0.5, 9.75)), abs=2e-3
    )
    assert memory["estimator.output.valid"] == 1.0


def test_without_the_ahrs_the_attitude_is_the_inertial_units_own() -> None:
    memory = last(Navigation(SevenState), 1)
    # then angles come in rad, and the field in T: what the unit sends is in its unit of FIELD
    assert memory["estimator.input.roll_meas"] == pytest.approx(0.05, abs=1e-6)
    assert memory["estimator.input.pitch_meas"] == pytest.approx(-0.1, abs=1e-6)
    assert memory["estimator.input.mag_z"] == pytest.approx(4.3e-5, rel=1e-6)
    assert memory["imu.mag_z"] == pytest.approx(4.3e-5 / FIELD, rel=1e-6)


@pytest.mark.parametrize(("signal", "skipped"), [("gyro_y", "ahrs"), ("accel_x", "estimator")])
def test_a_sample_that_either_block_refuses_counts_as_silence(signal: str, skipped: str) -> None:
    # given four_state, which does not look at turn rates, behind the AHRS, which does
    navigation = Navigation(FourState, CanineAhrs)

    # when the inertial unit sends what is no number for longer than imu_timeout, 0.2 s
    memory = last(navigation, 10, **{signal: math.nan})

    # then the controller hears of it
    assert memory[f"{skipped}.state.bad_samples"] == 10
    assert memory["watchdog.output.imu_ok"] == 0
    assert last(navigation, 10)["watchdog.output.imu_ok"] == 1


def test_an_input_that_no_instrument_on_board_gives_is_refused_by_name() -> None:
    class Barometric(FourState):
        """An estimator that wants more."""

        pressure = Input("1", "of the air")

    with pytest.raises(
        DeclarationError, match='barometric: no instrument on board gives its input "pressure"'
    ):
        Navigation(Barometric)


def test_on_the_rabbit_all_blocks_know_their_place_and_use_no_pointer() -> None:
    assert TARGETS["rabbit4000"].addressed
    # given the C of the rabbit's blocks
    addressed = library(addressed=True)
    for member, block in DEFAULT.blocks.items():
        text = addressed[f"{block.title()}.c"]
        # then every function begins with the place, and hands over no pointer
        assert text.count(f"*const m = &vest.{member};") == len(re.findall(r"^(?:static )?void ", text, re.M))
        assert f"static void {block.title()}_" not in re.sub(r"_\w+\(void\)", "", text)


def test_blocks_that_know_their_place_give_the_same_bits() -> None:
    # given both forms of the default program, compiled for this machine
    programs = [
        host.start(TARGETS["host"], library(addressed=addressed) | processor_in_the_loop())
        for addressed in (False, True)
    ]
    # when they make 50 ticks of a turning animal
    for tick in range(50):
        signals = SIGNALS | {
            "gps_fix": float(tick % 6 == 0),
            "heading_meas": 0.1 * tick,
            "gps_speed": 0.1 * tick,
        }
        received = Received(RECEIVER.fix(0.04 * tick, signals), InertialUnit().sample(tick, signals))
        plain, addressed = (program.tick(received) for program in programs)
        # then all is the same
        assert plain == addressed
    for program in programs:
        program.close()


@pytest.mark.parametrize("target", TARGETS)
def test_the_readme_of_a_bundle_tells_its_estimator_and_how_to_make_it_anew(target: str) -> None:
    readme = bundle(TARGETS[target], None, Navigation(ESTIMATORS["six_state"], CanineAhrs))["README.md"]
    assert "Its estimator is `six_state`. Roll, pitch and heading come from `canine_ahrs`" in readme
    assert (
        f"canine firmware --target {target} --key vest.key --estimator six_state --ahrs --out DIR" in readme
    )
    assert "six_state.c, six_state.h" in readme
    assert "Its estimator is `four_state`" in bundle(TARGETS[target])["README.md"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--estimator", "six_stat"], 'there is no estimator "six_stat"; did you mean "six_state"?'),
        (["--estimator", "six_state", "--set", "four_state.max_age=3"], "the estimator is six_state"),
        (["--estimator", "six_state", "--set", "six_state.max_age=-3"], "six_state.max_age"),
        (["--set", "canine_ahrs.gain=0.1"], 'no block or component "canine_ahrs"'),
    ],
)
def test_a_wrong_estimator_or_parameter_is_refused_in_one_line(
    tmp_path: Path, capsys: Any, arguments: list[str], message: str
) -> None:
    status = main.run(
        ["firmware", "--insecure", "--target", "host", "--out", str(tmp_path / "out"), *arguments]
    )
    errors = capsys.readouterr().err
    assert status == 2
    assert message in errors
    assert errors.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_parameters_of_estimator_and_ahrs_come_from_a_scenarios_file(tmp_path: Path, capsys: Any) -> None:
    # given a file that names the estimator and sets its parameters and the AHRS's
    scenario = tmp_path / "my.toml"
    scenario.write_text(
        'system = "full_ahrs"\nestimator = "six_state"\n'
        '[parameters]\n"six_state.max_age" = 7.5\n"ahrs.declination" = -3.5\n'
    )
    # when firmware is made of it
    out = tmp_path / "out"
    assert (
        main.run(
            ["firmware", "--insecure", "--target", "host", "--parameters", str(scenario), "--out", str(out)]
        )
        == 0
    )

    # then it has both
    text = (out / "parameters.c").read_text()
    assert ".max_age = 7.5f," in text
    value = re.search(r"\.declination = (-[\d.]+)f,", text)
    assert value
    assert np.float32(value[1]) == np.float32(math.radians(-3.5))
    assert "six_state estimator;" in (out / "onboard.h").read_text()
