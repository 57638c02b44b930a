"""What a replay compares: estimators, their configurations and settings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmus.build import build_fmu
from fmus.folder import build_folder
from harness.cosim.fmu import FmuError
from harness.cosim.origin import is_own
from harness.recording.recording import RecordingError
from harness.replay.comparison import CONFIGURATIONS, Configuration, compare
from harness.replay.fmu import run_fmu
from harness.replay.replay import replay, report
from harness.replay.source import ReplaySource, open_source
from harness.replay.windows import Outages
from models.errors import UsageError
from models.kit.units import DEG
from models.system import ESTIMATORS
from tests.harness.command import canine
from tests.harness.cosim.tiny_fmu import V, tiny_fmu
from tests.harness.replay.logs import walk, write

WINDOW = (15.0, 18.0)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> ReplaySource:
    """A made-up walk of 20 s, with turn rates and a magnetic field that follow nothing."""
    signals = walk(20)
    rng = np.random.default_rng(3)
    ticks = len(signals["accel_x"])
    for axis in "xyz":
        signals[f"gyro_{axis}"] = rng.normal(0, 0.1, ticks)
        signals[f"mag_{axis}"] = rng.normal(2e-5, 1e-6, ticks)
    signals["gps_course"] = signals["heading_meas"] + rng.uniform(-0.4, 0.4, ticks)
    return open_source(write(tmp_path_factory.mktemp("walk") / "trial.mcap", signals))


@pytest.mark.parametrize("name", ESTIMATORS)
def test_an_estimator_in_c_has_the_bits_of_its_fmu_through_an_outage(source: ReplaySource, name: str) -> None:
    # given each configuration
    signals, ticks = source.signals([WINDOW]), 480
    path = build_fmu(ESTIMATORS[name], build_folder() / "fmi2", 2)
    for configuration in compare(name).configurations:
        # when both run
        series = configuration.run(signals, ticks)
        fmu = run_fmu(path, signals, ticks, configuration.parameters)
        # then
        assert series.keys() == fmu.keys()
        for output, values in fmu.items():
            np.testing.assert_array_equal(series[output], values, err_msg=f"{configuration.name} {output}")
        assert np.ptp(series["north"]) > 1


def test_an_fmu_made_elsewhere_is_compared_with_ours(source: ReplaySource, tmp_path: Path) -> None:
    # given ours as a stranger's, which runs in a worker
    own = build_fmu(ESTIMATORS["six_state"], build_folder() / "fmi2", 2)
    path = tmp_path / "other.fmu"
    path.write_bytes(own.read_bytes() + b"x")
    assert is_own(own)
    assert not is_own(path)
    comparison = compare(f"six_state,{own},{path}")
    # when
    (outage,) = replay(source, comparison, Outages(3, [WINDOW], {}, "")).outages
    # then
    assert list(outage.errors)[2:] == ["six_state", "six_state.fmu", "other.fmu"]
    assert outage.errors["six_state"] == outage.errors["six_state.fmu"] == outage.errors["other.fmu"]


def test_an_fmu_made_elsewhere_prints_notes_and_is_named_if_it_ends_its_process(
    source: ReplaySource, tmp_path: Path
) -> None:
    # given an estimator that takes over the fixes, and prints
    names = ("north", "east", "speed")
    variables = [*(V(name) for name in names), *(V(f"gps_{name}", "input") for name in names)]
    prints = 'extern int puts(const char *); if (t == 0) puts("hello");'
    takes = "for (int i = 0; i < 3; i++) v[i] = v[i + 3];"
    good = tiny_fmu(tmp_path / "good.fmu", variables, prints + takes)
    bad = tiny_fmu(tmp_path / "bad.fmu", variables, takes + "extern void _exit(int); if (t > 1.99) _exit(0);")
    # when it goes through two outages
    chosen = Outages(3, [WINDOW, WINDOW], {}, "")
    replayed = replay(source, compare(str(good)), chosen)
    # then one worker has run both
    assert all(outage.errors["good.fmu"][0] > 0 for outage in replayed.outages)
    assert replayed.notes == ["an FMU wrote to stdout: hello | hello"]
    # and the one that ends its process is an error
    with pytest.raises(FmuError) as caught:
        replay(source, compare(str(bad)), chosen)
    text = "estimator bad.fmu: fmi2DoStep ended the process at t = 2 s, with exit status 0"
    assert str(caught.value) == text


def test_all_estimators_stand_in_one_table_and_a_missing_magnetometer_is_said(
    source: ReplaySource, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.replay.replay.replay_picture", lambda *_, **__: b"")  # seconds to draw
    chosen, everything = Outages(3, [WINDOW], {}, ""), compare("all")
    # when
    result = report(source, everything, chosen, replay(source, everything, chosen), tmp_path / "all")
    # then every configuration of each has a row
    rows = [label for name in ESTIMATORS for label in CONFIGURATIONS.get(name, {name: {}})]
    assert list(result["configurations"]) == ["speed held", "mean speed", *rows]
    assert result["notes"] == []
    # and without a magnetometer the seven states have none, which is said
    zeros = np.zeros(len(source.signals([]).t))
    blind = replace(
        source, signals=lambda w: replace(source.signals(w), mag_x=zeros, mag_y=zeros, mag_z=zeros)
    )
    result = report(blind, everything, chosen, replay(blind, everything, chosen), tmp_path / "blind")
    assert "seven_state" not in result["configurations"]
    assert result["notes"] == ["seven_state: left out, since the recording has no magnetometer"]
    with pytest.raises(RecordingError, match="has no magnetometer, which seven_state needs"):
        replay(blind, compare("seven_state"), chosen)


def test_a_setting_holds_in_every_configuration_that_has_the_parameter() -> None:
    by_name = compare("four_state,six_state", ["six_state.sigma_heading=3", "estimator.max_age=20"])
    values = {c.name: c.parameters for c in by_name.configurations}
    assert values["six_state"] == {"sigma_heading": 3 * DEG, "max_age": 20}
    assert values["pitch"] == {"use_pitch": 1, "fuzzy": 0, "max_age": 20}
    assert compare("four_state").configurations[1] == Configuration(
        "pitch", "four_state", {"use_pitch": 1, "fuzzy": 0}
    )


def test_a_file_of_parameters_is_one_more_configuration(tmp_path: Path) -> None:
    # given what a tuning found, beside a parameter of a block that is not replayed
    path = tmp_path / "tune.toml"
    values = {"six_state.sigma_heading": 3, "six_state.max_age": 20, "cmec.moving_deviation": 37}
    path.write_text("[parameters]\n" + "".join(f'"{name}" = {value}\n' for name, value in values.items()))
    # when
    *rest, tuned = compare("four_state,six_state", parameters=[path]).configurations
    # then it stands behind the others
    assert len(rest) == len(CONFIGURATIONS["four_state"]) + 1
    assert tuned == Configuration("six_state, tune", "six_state", {"sigma_heading": 3 * DEG, "max_age": 20})
    # and a file without a word on the estimator, or with a wrong one, is refused
    with pytest.raises(UsageError, match="has no parameter of two_bias; expected"):
        compare("two_bias", parameters=[path])
    path.write_text('[parameters]\n"six_state.max_agee" = 2\n')
    with pytest.raises(UsageError, match='six_state has no parameter "max_agee"; did you mean "max_age"'):
        compare("six_state", parameters=[path])


@pytest.mark.parametrize(
    ("estimators", "setting", "message"),
    [
        ("six_stat", "", 'no estimator "six_stat"; did you mean "six_state"'),
        ("six.fmu", "", 'no FMU "six.fmu"'),
        ("six_state", "four_state.max_age=2", 'no estimator "four_state" is replayed'),
        ("six_state", "six_state.max_agee=2", 'no parameter "max_agee"; did you mean "max_age"'),
        ("six_state", "six_state.max_age=-2", "expected a number from 0"),
        ("six_state", "max_age", "expected block.name=value"),
        ("four_state", "four_state.fuzzy=true", "the configurations of four_state set it themselves"),
    ],
)
def test_what_cannot_be_compared_is_refused_with_a_hint(estimators: str, setting: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        compare(estimators, [setting] if setting else [])


@pytest.mark.parametrize("owner", ["estimator", "six"])
def test_a_parameter_of_an_fmu_cannot_be_set(tmp_path: Path, owner: str) -> None:
    (tmp_path / "six.fmu").write_bytes(b"")
    with pytest.raises(UsageError, match=r"six\.fmu is an FMU, whose parameters a replay does not set"):
        compare(str(tmp_path / "six.fmu"), [f"{owner}.gate=4"])


def test_settings_of_a_replay_are_told_from_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a replay in a folder
    log = write(tmp_path / "trial.mcap", walk(30))
    command = ("replay", log, "--outage", 5, "--estimator", "six_state,two_bias", "--out", tmp_path / "out")
    assert canine(capsys, *command)[::2] == (0, "")
    # when another takes its place
    status, text, notes = canine(capsys, *command, "--set", "six_state.max_age=20")
    # then
    assert status == 0
    assert "six_state" in text
    assert "has another replay, which this replaces (settings: , now six_state.max_age=20)" in notes


def test_all_stands_beside_names_and_paths(tmp_path: Path) -> None:
    # given a list with `all` and one of ours again
    assert compare("six_state,all").estimators == ("six_state", *(e for e in ESTIMATORS if e != "six_state"))
    assert compare("all, six_state").estimators == tuple(ESTIMATORS)
