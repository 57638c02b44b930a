"""Trials and sweeps with another estimator in the estimator's place."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fmus.folder import build_folder
from harness import Scenario, run_sweep, run_trial
from harness.cosim.roles import find_role
from harness.log.log import read_log
from harness.trial.scenario import parse
from models.errors import UsageError
from models.sensors import Sensors
from models.system import ESTIMATORS, SYSTEMS, find_system
from tests.harness.command import canine


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes longer than the trials."""
    monkeypatch.setattr("harness.trial.trial.trial_png", lambda log: b"")


def test_an_estimator_named_for_a_trial_is_run_logged_and_run_again_from_the_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # when the seven-state estimator runs, which takes the magnetometer that four_state does not
    chosen = ("--estimator", "seven_state", "--set", "seven_state.max_age=20")
    first = canine(capsys, "run", "two_waypoint", *chosen, "--out", tmp_path / "first")
    again = canine(capsys, "run", tmp_path / "first" / "trial.mcap", "--out", tmp_path / "again")
    # then
    assert (first[0], first[2], again[0], again[2]) == (0, "", 0, "")
    logs = [tmp_path / name / "trial.mcap" for name in ("first", "again")]
    assert logs[0].read_bytes() == logs[1].read_bytes()
    log = read_log(logs[0])
    assert log.metadata["roles"]["estimator"] == "seven_state"
    assert log.metadata["parameters"]["estimator.max_age"] == "20.0"
    assert log.metadata["swaps"] == {}
    assert (log["estimator.mag_x"] == log["sensors.mag_x"]).all()
    assert abs(log["estimator.mag_x"]).max() > 0


def test_an_estimators_fmu_from_a_file_is_fed_what_the_same_estimator_by_name_is(tmp_path: Path) -> None:
    # given an FMU that takes signals which the package of the default estimator does not link
    by_name = run_trial("two_waypoint", estimator="seven_state", out=tmp_path / "name")
    path = build_folder() / "fmi3" / "seven_state.fmu"
    # when
    by_path = run_trial("two_waypoint", estimator=path, out=tmp_path / "path")
    # then
    for signal in ("heading", "north_sd", "mag_x", "gyro_z"):
        name = f"estimator.{signal}"
        assert (by_name.log[name] == by_path.log[name]).all(), name
    assert by_path.log.metadata["swaps"] == {"estimator": "estimator.fmu"}


def test_a_log_of_one_estimator_is_run_again_with_another(tmp_path: Path) -> None:
    # given
    four = run_trial("two_waypoint", out=tmp_path / "four")
    direct = run_trial("two_waypoint", estimator="six_state", out=tmp_path / "direct")
    # when
    again = run_trial(four.log_path, estimator="six_state", out=tmp_path / "again")
    # then
    assert (again.log["estimator.north"] == direct.log["estimator.north"]).all()
    assert not (again.log["estimator.north"][:200] == four.log["estimator.north"][:200]).all()


def test_trials_of_a_sweep_with_another_estimator_end_as_single_trials_do(tmp_path: Path) -> None:
    # given an estimator with which the loop over lanes is so large that a compiler doubts it
    sweep = run_sweep(
        "two_waypoint", thresholds="30:30", trials=3, seed=3, system="full", estimator="canine_tracker",
        out=tmp_path / "sweep",
    )  # fmt: skip
    trials = [
        run_trial(
            "two_waypoint", seed=seed, estimator="canine_tracker",
            parameters={"cmec.moving_deviation": 30}, out=tmp_path / str(seed),
        )
        for seed in (3, 4, 5)
    ]  # fmt: skip
    # then
    successes = [trial for trial in trials if trial.outcome == "success"]
    assert sweep.rows[0]["successes"] == len(successes)
    mean = sum(trial.time_s for trial in successes) / len(successes)
    assert sweep.rows[0]["mean_time_s"] == pytest.approx(mean, abs=1e-3)
    assert json.loads(sweep.recommendation_path.read_text())["system"] == "full_canine_tracker"


def test_a_sweeps_folder_bears_the_name_of_its_estimator() -> None:
    from harness.sweep.sweep import default_folder, plan_sweep  # noqa: PLC0415

    plain, six = (plan_sweep("three", system="full", estimator=name) for name in (None, "six_state"))
    assert default_folder(plain) == Path("out/sweep-three-full")
    assert default_folder(six) == Path("out/sweep-three-full-six_state")
    assert plain.identity["system"] == "full"
    assert plain.fingerprint != six.fingerprint


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--estimator", "six_stat"], 'or the name of one of ours; did you mean "six_state"?'),
        (["--estimator", "six.fmu"], 'there is no FMU "six.fmu"'),
        (
            ["--estimator", "canine_ahrs"],
            '"canine_ahrs" is no estimator, it gives one its attitude; expected one of four_state, '
            "six_state, seven_state, two_bias, canine_tracker, in trials and on board with --ahrs, in "
            "replays with --attitude own",
        ),
        (
            ["--estimator", "six_state", "--set", "four_state.fuzzy=false"],
            'no block or component "four_state"; the estimator is six_state: set "six_state.name", or run '
            "with --estimator four_state",
        ),
        (["--estimator", "six_state", "--set", "six_state.max_agee=2"], 'did you mean "max_age"?'),
    ],
)
def test_an_estimator_that_cannot_be_had_is_refused_with_a_hint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    status, _, errors = canine(capsys, "run", "two_waypoint", *arguments, "--out", tmp_path / "out")
    assert status == 2
    assert message in errors
    assert not (tmp_path / "out").exists()


def test_an_estimator_for_a_system_without_one_is_refused(tmp_path: Path) -> None:
    scenario = Scenario(name="true", system="cts", waypoints=[(25.0, 0.0)])
    with pytest.raises(UsageError, match='estimator six_state: the system "cts" has no estimator'):
        run_trial(scenario, estimator="six_state", out=tmp_path)
    with pytest.raises(UsageError, match="sweep with system full"):
        run_sweep("two", estimator="six_state", out=tmp_path)
    with pytest.raises(UsageError, match='estimator is "six_state", and the system "cts" takes none of ours'):
        parse('system = "cts"\nestimator = "six_state"\nwaypoints = [[25, 0]]', "true.toml")


def test_a_scenario_states_its_estimator_only_where_it_is_another_than_the_default() -> None:
    scenario = parse('estimator = "two_bias"\nwaypoints = [[25, 0]]', "two.toml")
    assert 'estimator = "two_bias"' in scenario.text()
    assert parse(scenario.text(), "again") == scenario
    assert "estimator" not in Scenario(waypoints=[(25.0, 0.0)]).text()


def test_our_ahrs_stands_between_sensors_and_estimator(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # when
    status, _, errors = canine(
        capsys, "run", "two_waypoint", "--ahrs", "--estimator", "two_bias", "--out", tmp_path / "first"
    )
    again = run_trial(tmp_path / "first" / "trial.mcap", out=tmp_path / "again")
    # then the estimator takes its angles, and not those of the sensors
    assert (status, errors) == (0, "")
    log = again.log
    assert (log["estimator.heading_meas"] == log["ahrs.heading_meas"]).all()
    assert not (log["ahrs.heading_meas"] == log["sensors.heading_meas"]).all()
    assert log.metadata["roles"]["ahrs"] == "canine_ahrs"
    assert again.log_path.read_bytes() == (tmp_path / "first" / "trial.mcap").read_bytes()
    # and its parameters are set by its name
    with pytest.raises(UsageError, match='canine_ahrs has no parameter "no_such"'):
        run_trial("two_waypoint", ahrs=True, parameters={"canine_ahrs.no_such": 1}, out=tmp_path / "bad")
    with pytest.raises(UsageError, match="canine_ahrs"):
        run_trial("two_waypoint", parameters={"canine_ahrs.no_such": 1}, out=tmp_path / "bad")


def test_an_estimators_fmu_from_a_file_takes_the_angles_of_our_ahrs(tmp_path: Path) -> None:
    by_name = run_trial("two_waypoint", estimator="seven_state", ahrs=True, out=tmp_path / "name")
    path = build_folder() / "fmi2" / "seven_state.fmu"
    by_path = run_trial("two_waypoint", estimator=path, ahrs=True, out=tmp_path / "path")
    for signal in ("roll_meas", "pitch_meas", "north", "heading"):
        name = f"estimator.{signal}"
        assert (by_name.log[name] == by_path.log[name]).all(), name


def test_an_ahrs_needs_our_sensors(tmp_path: Path) -> None:
    scenario = Scenario(name="true", system="cts", waypoints=[(25.0, 0.0)])
    with pytest.raises(UsageError, match='ahrs: the system "cts" lacks our sensors'):
        run_trial(scenario, ahrs=True, out=tmp_path)
    with pytest.raises(UsageError, match="ahrs: the system cts has no sensors; sweep with system full"):
        run_sweep("two", ahrs=True, out=tmp_path)


def test_the_role_of_an_estimator_offers_all_that_the_sensors_give() -> None:
    assert set(find_role("estimator").inputs) == set(Sensors.flat_names("output")) | {"heading_meas_sd"}


@pytest.mark.parametrize("whole", ["full", "full_ahrs"])
@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_input_of_an_estimator_is_fed_by_name(name: str, whole: str) -> None:
    system = find_system(whole, name)
    sources = {link.target_variable: link.source for link in system.links if link.target == "estimator"}
    own = {"heading_meas_sd"} if whole == "full" else set()  # the sensors state none: it has a start value
    assert set(sources) == set(ESTIMATORS[name].flat_names("input")) - own
    angles = {"roll_meas", "pitch_meas", "heading_meas"} & set(sources)
    assert {sources[angle] for angle in angles} <= {"ahrs" if whole == "full_ahrs" else "sensors"}
    assert system is SYSTEMS[whole] or system.name == f"{whole}_{name}"
