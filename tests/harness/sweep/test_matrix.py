"""`canine matrix`: its options, cells by batch and by co-simulation, FMUs that spoil their own cells."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.image import imread

from harness.cosim.fmu import Fault
from harness.sweep import chunks, cosimulated, matrix, sweep
from harness.sweep.axis import SweepError
from harness.sweep.cells import Cells
from harness.sweep.chunks import Chunk, ClusterError, FmuFailure, Outcomes
from harness.sweep.cosimulated import PROBE, Cosimulated
from harness.sweep.journal import open_journal
from harness.sweep.matrix import plan_matrix
from harness.sweep.sweep import plan_sweep
from harness.trial.prepare import prepared
from harness.trial.request import Changes, build_missing, requested
from harness.trial.scenario import Disturbance, Scenario
from harness.trial.seeds import run_seeds
from models.errors import CanineError, UsageError
from tests.harness import command
from tests.harness.cosim.tiny_fmu import V, tiny_fmu
from tests.harness.sweep.test_sweep import HEADER

LEG = Scenario("leg", system="cts", waypoints=((25.0, 0.0),), duration=60.0)
DOG = [
    V("command", "input", "Integer"),
    *(V(n, unit=u) for n, u in (("north", "m"), ("east", "m"), ("heading", "rad"), ("speed", "m/s"))),
    V("seed", "parameter", "Integer"),
]
MOVES = "v[4] = (v[0] == 1 || v[0] == 3) ? 5 : 0; v[1] += (v[0] == 3 ? -1 : 1) * v[4] * h; "
CRASH = "*(volatile int *)8 = 1;"


def canine(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Exit status, standard output and error of `canine matrix`."""
    return command.canine(capsys, "matrix", *arguments)


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Dogs that run straight out and home: one that is well, and some that are not."""
    folder = tmp_path_factory.mktemp("fmus")
    steps = {
        "well": "",
        "seldom": f"if (v[5] == 3 && t > 0.99) {{ {CRASH} }}",
        "always": f"if (t > 0.99) {{ {CRASH} }}",
    }
    made = {name: tiny_fmu(folder / f"{name}.fmu", DOG, MOVES + step) for name, step in steps.items()}
    return made | {"misfit": tiny_fmu(folder / "misfit.fmu", DOG[:2], "")}


# options


def test_a_cell_for_each_controller_plant_and_scenario_with_the_same_seeds() -> None:
    planned = plan_matrix(["cmec", "quarter_turn"], ["canine", "pedestrian"], ["two", "left_90"], seed=7)
    assert len(planned.cells) == 8
    assert planned.cells[:2] == (("cmec", "canine", "two_waypoint"), ("cmec", "canine", "left_90"))
    jobs = [job for job in planned.work.cells if isinstance(job, chunks.Job)]
    assert {(job.seed, job.trials) for job in jobs} == {(7, 1000)}
    assert [(job.controller, job.plant) for job in jobs[::2]] == [
        ("cmec", "canine"),
        ("cmec", "pedestrian"),
        ("quarter_turn", "canine"),
        ("quarter_turn", "pedestrian"),
    ]
    assert {job.system for job in jobs} == {"full"}  # the scenarios' own
    # and a scenario's own seed does not part the cells
    two, three = replace(LEG, seed=5), replace(LEG, name="other", seed=9)
    assert plan_matrix(["cmec"], ["canine"], [two, three]).seed == 5


def test_a_setting_of_a_block_acts_in_the_cells_that_have_it() -> None:
    settings = ["quarter_turn.turn_deviation=50", "canine.drift=0", "controller.capture_radius=5"]
    settings.append("canine=table_5_1")
    planned = plan_matrix(["cmec", "quarter_turn"], ["canine", "pedestrian"], [LEG], settings=settings)
    values = {
        name[:2]: job.trial_types[0].flat for name, job in planned.jobs.items() if isinstance(job, chunks.Job)
    }
    assert values["quarter_turn", "canine"]["controller.turn_deviation"] == pytest.approx(np.radians(50))
    assert "controller.turn_deviation" not in values["cmec", "canine"]
    for name in ("plant.drift", "plant.cruise_speed_deviation"):
        assert [(name in own) for own in values.values()] == [True, False, True, False]
    assert {own["controller.capture_radius"] for own in values.values()} == {5.0}
    # and it replaces the scenario's under the block's name
    leg = replace(LEG, parameters={"quarter_turn.capture_radius": 6.0})
    (job,) = plan_matrix(["quarter_turn"], ["canine"], [leg], settings=settings[2:]).jobs.values()
    assert isinstance(job, chunks.Job)
    assert job.trial_types[0].flat["controller.capture_radius"] == 5
    with pytest.raises(UsageError, match='no block or component "quarter_trun"; did you mean'):
        plan_matrix(["quarter_turn"], ["canine"], [LEG], settings=["quarter_trun.turn_deviation=50"])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((["cmce"], ["canine"]), 'there is no controller "cmce".*did you mean "cmec"'),
        ((["cmec"], ["dog.fmu"]), 'there is no FMU "dog.fmu"'),
        ((["cmec", "cmec"], ["canine"]), "controllers: cmec is named twice"),
        ((["cmec"], [""]), "plants: has an empty name"),
        ((["cmec"], ["canine"], [LEG, LEG]), "scenarios: leg is named twice"),
    ],
)
def test_lists_that_do_not_fit_are_refused(arguments: tuple[list[str], ...], text: str) -> None:
    with pytest.raises(UsageError, match=text):
        plan_matrix(*arguments)
    with pytest.raises(SweepError, match="--trials 0: expected at least 1"):
        plan_matrix(["cmec"], ["canine"], [LEG], trials=0)


# cells of our own blocks


def test_a_cell_has_the_trials_of_canine_run(tmp_path: Path) -> None:
    # given a robot led by turns of 90 degrees
    scenario = replace(LEG, waypoints=((25.0, 0.0), (25.0, 25.0)), duration=120.0)
    planned = plan_matrix(["quarter_turn"], ["differential_drive"], [scenario], trials=2)
    # when
    result = matrix.run(planned, tmp_path / "matrix")
    changes = Changes(swaps={"controller": "quarter_turn", "plant": "differential_drive"})
    with requested(scenario, changes) as request:
        build_missing(request)
        one_by_one = list(run_seeds(request, range(1, 3), tmp_path / "seeds"))
    # then
    (point,) = result.table.values()
    won = [summary for summary in one_by_one if summary["outcome"] == "success"]
    assert 0 < len(won) == point.successes
    assert point.mean_time == pytest.approx(sum(summary["time_s"] for summary in won) / len(won))
    assert point.commands == sum(summary["directional_commands"] for summary in won)
    counted = {
        name: sum(s["anomalies"].get(name.upper(), 0) for s in one_by_one) for name in chunks.ANOMALIES
    }
    assert point.anomalies == counted
    assert sum(counted.values()) > 0
    assert point.timeouts == sum(summary["outcome"] == "timeout" for summary in one_by_one)


def test_cells_do_not_depend_on_each_other_and_results_have_the_columns_of_sweeps(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given
    arguments = (
        "--scenarios",
        "two",
        "--system",
        "cts",
        "--trials",
        300,
        "--set",
        "cmec.moving_deviation=23",
    )
    # when
    status, printed, _ = canine(
        capsys,
        "--controllers",
        "cmec,quarter_turn",
        "--plants",
        "differential_drive",
        *arguments,
        "--out",
        tmp_path,
    )
    swept = sweep.run(
        plan_sweep("two", thresholds="23", trials=300, plant="differential_drive"), tmp_path / "sweep"
    )[0][0]
    # then
    assert status == 0
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {
        "matrix.csv", "matrix.html", "matrix.json", "matrix.png",
    }  # fmt: skip
    header, first, second = (tmp_path / "matrix.csv").read_text().splitlines()
    assert header == f"controller,plant,scenario,{HEADER},fmu_failures,verdict"
    row = dict(zip(header.split(","), first.split(","), strict=True))
    assert (row["controller"], row["plant"], row["scenario"]) == (
        "cmec",
        "differential_drive",
        "two_waypoint",
    )
    assert int(row["successes"]) == swept.successes
    assert float(row["mean_time_s"]) == pytest.approx(swept.mean_time, abs=1e-6)
    assert second.startswith("quarter_turn,differential_drive,two_waypoint,300,")
    report = json.loads((tmp_path / "matrix.json").read_text())
    assert report["cells"][0]["successes"] == swept.successes
    (comparison,) = report["comparisons"]
    difference = report["cells"][0]["success_rate"] - report["cells"][1]["success_rate"]
    assert comparison["difference"] == pytest.approx(difference)
    assert comparison["ci_low"] < difference < comparison["ci_high"]
    assert comparison["pairs"] == 300
    assert "300 trials paired by seed" in printed
    picture = imread(tmp_path / "matrix.png")
    assert len(np.unique(picture.reshape(-1, picture.shape[-1]), axis=0)) > 50


# FMUs


def test_an_fmu_runs_by_cosimulation_as_often_as_it_is_asked_to(
    tmp_path: Path, fmus: dict[str, Path]
) -> None:
    # given a dog without chance, which runs straight out and home
    planned = plan_matrix(["cmec", "proportional"], [str(fmus["well"])], [LEG], trials=3)
    # when
    result = matrix.run(planned, tmp_path / "matrix")
    # then each trial is that of `canine run`
    with requested(LEG, Changes(swaps={"plant": fmus["well"]})) as request, prepared(request):
        (summary,) = run_seeds(request, [1], tmp_path / "seeds")
    assert summary["outcome"] == "success"
    for point in result.table.values():
        assert (point.trials, point.successes, point.timeouts, point.fmu_failures) == (3, 3, 0, ())
    point = result.table["cmec", str(fmus["well"]), "leg"]
    assert point.mean_time == pytest.approx(summary["time_s"])
    assert result.fmu_failures() == []


def test_an_anomaly_that_a_stalled_controller_holds_is_counted_once_in_either_engine(
    tmp_path: Path, fmus: dict[str, Path]
) -> None:
    # given a radio that is lost for a tick, after which the controller stalls and holds what it reported
    faults = (Disturbance("radio", "lost", 1.0, 1.04), Disturbance("controller", "stall", 1.04, 3.0))
    plants = ["canine", str(fmus["well"])]
    planned = plan_matrix(["cmec"], plants, [replace(LEG, faults=faults)], trials=2)
    # when
    result = matrix.run(planned, tmp_path / "matrix")
    # then
    assert [point.anomalies["lost_link"] for point in result.table.values()] == [2, 2]


def test_an_fmu_that_fails_spoils_its_own_trials_only(
    tmp_path: Path,
    fmus: dict[str, Path],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # given a dog that crashes in trial 3, one that always does, and one that lacks outputs
    monkeypatch.setattr(cosimulated, "MOST_FAILURES", 2)  # each costs the start of a process
    scenario = tmp_path / "leg.toml"
    scenario.write_text(LEG.text())
    plants = ["differential_drive", fmus["seldom"], fmus["always"], fmus["misfit"]]
    # when
    status, printed, errors = canine(
        capsys, "--controllers", "cmec", "--plants", ",".join(map(str, plants)), "--scenarios", scenario,
        "--trials", PROBE, "--out", tmp_path / "out",
    )  # fmt: skip
    # then the others are complete
    assert status == 1
    with (tmp_path / "out" / "matrix.csv").open(newline="") as file:
        own, seldom, always, misfit = csv.DictReader(file)
    assert (own["trials"], own["fmu_failures"], own["verdict"]) == ("25", "0", "")
    assert (seldom["trials"], seldom["successes"], seldom["fmu_failures"]) == ("25", "24", "1")
    text = "plant seldom.fmu: fmi2DoStep ended the process at t = 1 s: segmentation fault"
    assert seldom["verdict"] == f"1 of 25 trials ended by a fault (crash 1); the first: {text}"
    # and what cannot be done is given up
    assert always["trials"] == always["fmu_failures"] == "2"
    assert "(crash 2), then given up (25 asked for)" in always["verdict"]
    assert (misfit["trials"], misfit["success_rate"]) == ("0", "")
    assert 'misfit.fmu: has no output "east"' in misfit["verdict"]
    # and all are named at the end
    last = errors.splitlines()[-3:]
    for line, name in zip(last, ("seldom", "always", "misfit"), strict=True):
        assert line.startswith(f"canine: cmec, {fmus[name]}, leg: ")
    # and what does not fit is told once, before the trials
    assert errors.count('has no output "east"') == 1
    assert f'note: cmec, {fmus["misfit"]}, leg: left out; plant misfit.fmu: has no output "east"' in errors
    assert last[-1].endswith("leg: left out, as noted above")
    report = json.loads((tmp_path / "out" / "matrix.json").read_text())
    (fault,) = report["cells"][1]["fmu_failures"]
    assert (fault["seed"], fault["kind"], fault["fmu"], fault["call"]) == (
        3,
        "crash",
        "seldom.fmu",
        "fmi2DoStep",
    )
    assert "refused" in printed


def test_nothing_that_fits_is_a_fault_and_told_once(fmus: dict[str, Path]) -> None:
    notes: list[str] = []
    with pytest.raises(CanineError, match=r'^plant misfit\.fmu: has no output "east"[^\n]*$') as raised:
        plan_matrix(["cmec", "quarter_turn"], [str(fmus["misfit"])], [LEG], note=notes.append)
    assert not isinstance(raised.value, UsageError)
    assert notes == []


def test_what_keeps_cells_from_running_is_noted_once_for_all_of_them(fmus: dict[str, Path]) -> None:
    notes: list[str] = []
    misfit = str(fmus["misfit"])
    plan_matrix(["cmec", "quarter_turn"], ["canine", misfit], [LEG], note=notes.append)
    (told,) = [note for note in notes if "left out" in note]
    assert told.startswith(f"cmec, {misfit}, leg; quarter_turn, {misfit}, leg: left out; plant misfit.fmu: ")


def test_a_cell_is_given_up_by_its_first_chunk_alone(fmus: dict[str, Path], tmp_path: Path) -> None:
    # given a matrix whose second cell gave up after seven trials
    planned = plan_matrix(["cmec"], ["canine", str(fmus["well"])], [LEG], trials=100)
    fault = Fault("crash", "plant", "dog.fmu", "fmi2DoStep", 1.0)
    failure = FmuFailure(2, fault, "plant dog.fmu crashed")
    gave_up = Chunk(
        100, 107, np.zeros(7, np.uint16), np.ones((1, len(chunks.SUMS)), np.int64), (failure,), gave_up=True
    )
    # when the journal is read again
    with open_journal(tmp_path, planned.work, planned.fingerprint, planned.about) as journal:
        journal.append(gave_up)
    with open_journal(tmp_path, planned.work, planned.fingerprint, planned.about) as journal:
        (chunk,) = journal.chunks
    outcomes = Outcomes(planned.work)
    outcomes.add(chunk)
    # then its other trials are not missing, and no other trial is cut
    assert chunk.fmu_failures == (failure,)
    assert list(outcomes.missing()) == [(0, 100)]
    assert outcomes.done == 100
    assert matrix.result_of(planned, outcomes).table["cmec", str(fmus["well"]), "leg"].trials == 7


def test_a_cell_is_given_up_though_its_fifth_failure_is_in_the_probes_last_trial(
    fmus: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a dog of which the last five of the first 25 trials crash
    planned = plan_matrix(["cmec"], [str(fmus["well"])], [LEG], trials=100)
    seeds = iter(range(1, 101))
    failure = FmuFailure(0, Fault("crash", "plant", "dog.fmu", "fmi2DoStep", 1.0), "plant dog.fmu crashed")
    good = SimpleNamespace(success_tick=300, sums=lambda: np.zeros(len(chunks.SUMS), np.int64))
    monkeypatch.setattr(cosimulated, "_trial", lambda *_: failure if next(seeds) > 20 else good)
    # when
    planned.work.prepare()
    outcomes = Outcomes(planned.work)
    outcomes.add(planned.work.run(0, PROBE))
    # then its other trials do not run
    assert (outcomes.done, list(outcomes.missing())) == (100, [])


def test_the_program_of_cosimulated_trials_is_not_that_of_the_batch(fmus: dict[str, Path]) -> None:
    # given the batch and an FMU
    work = plan_matrix(["cmec"], ["canine", str(fmus["well"])], [LEG], trials=30).work
    # then a worker does not run the one with the program of the other
    native = chunks.program(has_fmus=False)
    with pytest.raises(ClusterError, match="a worker runs another version of this program"):
        chunks.run_chunk(work.part(30, 55), 30, 55, native)
    assert not work.part(0, 30).has_fmus
    assert work.has_fmus


def test_the_trials_of_fmus_begin_with_a_probe_and_are_cut_at_the_same_places(fmus: dict[str, Path]) -> None:
    # given, of the second of two cells, trials 30 to 55 are done
    planned = plan_matrix(["cmec"], ["canine", str(fmus["well"])], [LEG], trials=60)
    outcomes = Outcomes(planned.work)
    outcomes.spans.append((90, 115))
    # when
    probes, others = (list(pieces) for pieces in planned.work.rounds(outcomes, 2))
    # then
    assert probes == [(60, 60 + PROBE)]
    assert others == [(0, 60), (60, 85), (85, 90), (115, 120)]


def test_a_sweep_runs_an_fmu_at_each_point(
    tmp_path: Path, fmus: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    # given a threshold, and a dog that crashes in one trial
    scenario = tmp_path / "leg.toml"
    scenario.write_text(LEG.text())
    arguments = ("--trials", 3, "--out", tmp_path / "out", "--plant", fmus["seldom"])
    # when
    status, _, errors = command.canine(capsys, "sweep", scenario, "--thresholds", "30:60:30", *arguments)
    # then
    assert status == 1
    header, *rows = (tmp_path / "out" / "sweep.csv").read_text().splitlines()
    assert header == f"threshold_deg,{HEADER},fmu_failures,verdict"
    assert [row.split(",")[:3] for row in rows] == [["30", "3", "2"], ["60", "3", "2"]]
    assert "canine: threshold_deg 30: 1 of 3 trials ended by a fault (crash 1)" in errors
    report = json.loads((tmp_path / "out" / "recommendation.json").read_text())
    assert (report["plant"], report["trials"]) == (str(fmus["seldom"]), 3)


def test_a_truth_value_is_varied_with_an_fmu(fmus: dict[str, Path]) -> None:
    planned = plan_sweep(LEG, vary=["cmec.guarded=0:1"], plant=str(fmus["well"]), trials=1)
    assert isinstance(planned.work, Cells)
    cells = [cell for cell in planned.work.cells if isinstance(cell, Cosimulated)]
    assert [cell.scenarios[0].parameters["controller.guarded"] for cell in cells] == [False, True]


def test_a_fault_that_the_sensors_cannot_take_is_refused_with_an_fmu_too(fmus: dict[str, Path]) -> None:
    scenario = replace(LEG, system="full", faults=(Disturbance("plant.speed", "nan", 1.0),))
    with pytest.raises(UsageError, match=r"nan of plant\.speed: the sensors answer with what is not finite"):
        plan_sweep(scenario, system="full", plant=str(fmus["well"]), thresholds="30")
    with pytest.raises(UsageError, match=r"nan of plant\.speed: the sensors answer with what is not finite"):
        plan_matrix(["cmec"], [str(fmus["well"])], [scenario])


def test_h_is_swept_with_the_cmec_only() -> None:
    with pytest.raises(SweepError, match="which controller quarter_turn does not have"):
        plan_sweep("two", controller="quarter_turn")
    planned = plan_sweep("two", controller="quarter_turn", vary=["quarter_turn.turn_deviation=50:70:10"])
    assert [name for name in planned.special if "turn" in name] == [
        "quarter_turn",
        "quarter_turn.turn_deviation",
    ]
