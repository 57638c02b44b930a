"""`canine faults`: each fault alone, and what the controller did."""

import csv
import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from harness.trial import lone_faults
from harness.trial.faults import fault_fmus
from harness.trial.lone_faults import Case, fitting, shipped_cases
from harness.trial.request import Request
from harness.trial.scenario import FAULTS, Disturbance, load
from models.errors import UsageError
from models.kit.declaration import flatten
from models.system import SYSTEMS
from tests.harness.command import canine

SCENARIO = """
waypoints = [[20.0, 0.0]]
duration = 25.0
system = "cts"
[[fault]]
signal = "plant.heading -> controller.heading"
kind = "nan"
at = 1.0
until = 2.0
[[fault]]
signal = "plant.speed -> controller.speed"
kind = "offset"
value = 0.1
at = 1.0
until = 2.0
[[fault]]
signal = "controller.command -> plant.command"
kind = "off"
at = 0.5
[[fault]]
signal = "radio"
kind = "lost"
at = 3.01
until = 3.5
"""


def test_tables_of_earlier_faults_go_before_the_first_trial(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given tables of an earlier run
    (tmp_path / "four.toml").write_text(SCENARIO)
    for name in ("faults.json", "faults.csv"):
        (tmp_path / name).write_text("of an earlier run")

    # when another one ends in its first trial
    def end(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(lone_faults, "_fly", end)
    status, _, _ = canine(capsys, "faults", tmp_path / "four.toml", "--out", tmp_path)
    # then
    assert status == 130
    assert [path.name for path in tmp_path.iterdir()] == ["four.toml"]


def test_each_fault_is_flown_alone_and_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given faults of four kinds
    (tmp_path / "four.toml").write_text(SCENARIO)
    # when
    out = tmp_path / "out"
    status, text, _ = canine(capsys, "faults", tmp_path / "four.toml", "--out", out, "--json")
    # then each has a trial of its own, behind the one without
    results = json.loads(text)
    assert status == 0
    assert [len(result["faults"]) for result in results] == [0, 1, 1, 1, 1]
    assert all((out / result["folder"] / "trial.mcap").is_file() for result in results)
    # and the controller stops at once where it gets NaN or no radio, goes on, or waits in vain for the dog
    told = [(r["verdict"], r["stopped_within_ticks"], r["outcome"]) for r in results]
    assert told == [
        ("went on", None, "success"),
        ("stopped", 0, "success"),
        ("went on", None, "success"),
        ("failed", None, "timeout"),
        ("stopped", 0, "success"),
    ]
    assert [(r["first"], r["first_after_ticks"]) for r in results[:2]] == [
        (None, None), ("anomaly bad input", 0)
    ]  # fmt: skip
    # and the files tell the same
    assert json.loads((out / "faults.json").read_text()) == results
    with (out / "faults.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["verdict"] for row in rows] == [result["verdict"] for result in results]
    assert [row["fault"] for row in rows[1:3]] == [
        "nan of plant.heading -> controller.heading", "offset of 0.1 m/s in plant.speed -> controller.speed"
    ]  # fmt: skip


def test_a_fault_that_begins_while_the_dog_is_stopped_anyway_counts_from_its_beginning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given the stop before the recall, in which the radio is lost for a second
    status, text, _ = canine(capsys, "faults", "faulty", "--out", tmp_path, "--json")
    # then the stop lasts longer than without the fault, by what was noticed as it began
    assert status == 0
    lost = json.loads(text)[-1]
    assert (lost["fault"], lost["first"], lost["first_after_ticks"]) == ("lost radio", "anomaly lost link", 0)
    assert lost["verdict"] == "stopped"
    assert 0 < lost["stopped_within_ticks"] < 25


def test_an_fmu_that_a_fault_makes_go_wrong_is_a_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # given sensors that get NaN
    fault = '[[fault]]\nsignal = "plant.speed -> sensors.speed"\nkind = "nan"\nat = 1.0\n'
    (tmp_path / "nan.toml").write_text(f"waypoints = [[20.0, 0.0]]\nduration = 2.0\n{fault}")
    # when
    status, text, _ = canine(capsys, "faults", tmp_path / "nan.toml", "--out", tmp_path / "out")
    # then
    assert status == 0
    (line,) = [line for line in text.splitlines() if line.startswith("nan of plant.speed")]
    assert "failed" in line
    assert 'sensors sensors.fmu: output "' in line


def test_what_all_faults_need_is_built_though_the_first_needs_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a lost radio before a fault that is a block
    lost = '[[fault]]\nsignal = "radio"\nkind = "lost"\nat = 1.0\n'
    stuck = '[[fault]]\nsignal = "sensors.gyro_z"\nkind = "stuck"\nat = 1.0\n'
    (tmp_path / "two.toml").write_text(f"waypoints = [[20.0, 0.0]]\nduration = 2.0\n{lost}{stuck}")
    asked: list[list[Path]] = []

    def build(request: Request, done: object) -> None:
        asked.append(fault_fmus(request.scenario, tmp_path))
        raise UsageError("enough")

    monkeypatch.setattr("harness.trial.lone_faults.build_missing", build)
    # when
    canine(capsys, "faults", tmp_path / "two.toml", "--out", tmp_path / "out")
    # then
    assert tmp_path / "real_fault.fmu" in asked[0]


@pytest.mark.parametrize(("after", "text"), [(167, "command stop after 167 ticks"), (1, "after 1 tick ")])
def test_the_table_tells_what_differed_first_in_ticks(after: int, text: str) -> None:
    result = {
        **dict.fromkeys(("stopped_within_ticks", "error"), None), "from_s": 1.0, "until_s": 2.0,
        "fault": "off of sensors.gps_north", "outcome": "success", "verdict": "went on",
        "first": "command stop", "first_after_ticks": after,
    }  # fmt: skip
    printed = io.StringIO()
    lone_faults.show([result], Console(file=printed, width=200))
    assert text in printed.getvalue()


def test_a_group_of_signals_is_told_in_few_words() -> None:
    faults = [
        Disturbance(f"estimator.{n} -> controller.{n}", "offset", 1.0, 2.0, 5.0) for n in ("north", "east")
    ]
    units = {"estimator.north": "m"}
    assert (
        Case(tuple(faults)).words(units) == "offset of 5 m in estimator.north, estimator.east -> controller"
    )
    assert Case((faults[0],)).words(units) == "offset of 5 m in estimator.north -> controller.north"


@pytest.mark.parametrize(
    ("kind", "value", "unit", "words"),
    [
        ("jump", 90.0, "rad", "jump of 90 deg in dog.x"),
        ("noise", 1.5, "rad/s", "noise of 1.5 deg/s in dog.x"),
        ("offset", -0.25, "m/s2", "offset of -0.25 m/s2 in dog.x"),
        ("offset", 2.0, "1", "offset of 2 in dog.x"),
        ("scale", 2.0, "m", "scale of 2 in dog.x"),
        ("delay", 0.4, "rad", "delay of 0.4 s in dog.x"),
        ("dropouts", 0.5, "m", "dropouts of 0.5 in dog.x"),
        ("garbage", 0.3, "", "garbage of 0.3 in dog.x"),
        ("stuck", None, "m", "stuck of dog.x"),
    ],
)
def test_a_fault_is_told_in_the_unit_of_its_value(
    kind: str, value: float | None, unit: str, words: str
) -> None:
    assert Case((Disturbance("dog.x", kind, 1.0, 2.0, value),)).words({"dog.x": unit}) == words


def test_the_catalogue_knows_all_kinds_and_only_signals_that_there_are() -> None:
    cases = shipped_cases(3.0, 7.0)
    assert {fault.kind for case in cases for fault in case.faults} == set(FAULTS)
    outputs = {
        f"{component}.{name}"
        for system in SYSTEMS.values()
        for component, block in system.components.items()
        for name, _ in flatten(block.group("output"))
    }
    signals = {fault.signal.partition(" -> ")[0] for case in cases for fault in case.faults}
    worn = {c for system in SYSTEMS.values() for c in system.components} - {"plant"}
    assert signals - outputs == {"radio", "gps", "imu", *worn}


def test_what_a_system_lacks_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    # given some of the catalogue
    some = [c for c in shipped_cases(1.0, 2.0) if c.faults[0].kind in ("delay", "lost", "garbage", "stall")]
    request = Request(load("two_waypoint"))
    # then the full system has no link from the plant to the controller, and no bytes
    words = [case.words({}) for case in fitting(request, some)]
    assert "delay of 0.4 s in sensors.heading_meas" in words
    assert "lost radio" in words
    assert [text for text in words if "stall" in text] == [
        f"stall of {name}" for name in ("sensors", "estimator", "controller", "command_module")
    ]
    assert not [text for text in words if "plant.heading" in text or "garbage" in text]


def test_a_system_without_any_is_told_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(lone_faults, "CATALOGUE", ((("gps",), {"garbage": 0.5}),))
    status, _, errors = canine(capsys, "faults", "two_waypoint")
    assert status == 2
    assert "no fault of the catalogue fits; state some as [[fault]]" in errors
