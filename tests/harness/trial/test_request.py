"""Requests: what each kind of target asks for, and what overrides it."""

import os
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmus.archive import AlteredError, pack
from fmus.build import build_fmu
from fmus.folder import build_folder
from harness.log.channel import Channel
from harness.log.log import read_log
from harness.log.writer import LogWriter
from harness.trial import request as request_module
from harness.trial import trial
from harness.trial.prepare import prepared
from harness.trial.request import Changes, Request, build_missing, requested
from harness.trial.scenario import Scenario, ScenarioError, load
from models.differential_drive import DifferentialDrive
from models.errors import UsageError

NOTHING = Changes()


def flown(folder: Path, request: Request) -> Path:
    """The log of a trial."""
    build_missing(request)
    with prepared(request) as ready:
        trial.run(request, ready, folder)
    return folder / trial.LOG


def test_the_target_is_a_scenarios_name_its_file_or_the_scenario_itself(tmp_path: Path) -> None:
    # given one scenario in three forms
    two = load("two_waypoint")
    file = tmp_path / "two_waypoint.toml"
    file.write_text(two.text())
    # when, then
    for target in ("two_waypoint", str(file), two):
        with requested(target, NOTHING) as request:
            assert request == Request(two)
            assert request.ssp == build_folder() / "full.fmi2.ssp"


def test_a_package_asks_for_the_default_trial_with_its_own_name(tmp_path: Path) -> None:
    # given an .ssp, a folder with an .ssd, and the .ssd itself
    folder = tmp_path / "toy"
    folder.mkdir()
    (folder / "SystemStructure.ssd").write_text("")
    zipfile.ZipFile(tmp_path / "toy.ssp", "w").close()
    default = load("three_waypoint")
    for target, package in (
        (tmp_path / "toy.ssp", tmp_path / "toy.ssp"),
        (folder, folder),
        (folder / "SystemStructure.ssd", folder / "SystemStructure.ssd"),
    ):
        # when
        with requested(str(target), NOTHING) as request:
            # then
            assert request.ssp == package.resolve()
            assert request.scenario == replace(default, name="toy", system="toy.ssp")


def test_a_log_asks_for_its_trial_with_the_files_that_it_holds(tmp_path: Path) -> None:
    # given the log of a trial in jacobi order, FMI 3.0, with a controller from a file
    cmec = build_folder() / "fmi3" / "cmec.fmu"
    scenario = replace(load("two_waypoint"), duration=1.0, seed=9)
    log = flown(tmp_path / "a", Request(scenario, "jacobi", 3, {"controller": cmec}))
    # when
    with requested(str(log), NOTHING) as request:
        # then
        assert (request.scenario, request.order, request.fmi) == (scenario, "jacobi", 3)
        assert (request.log, request.broken, request.notes) == (log, "", ())
        assert request.swaps["controller"].read_bytes() == cmec.read_bytes()
        assert request.package is not None
        assert request.package.read_bytes() == (build_folder() / "full.fmi3.ssp").read_bytes()
        assert request.default_folder == tmp_path / "a-again"
        unpacked = request.package.parent
    assert not unpacked.exists()
    # and with another version of FMI our package takes the place of that in the log
    with requested(str(log), Changes(fmi="2")) as request:
        assert (request.fmi, request.ssp) == (2, build_folder() / "full.fmi2.ssp")


def test_a_log_that_is_cut_is_noted(tmp_path: Path) -> None:
    log = flown(tmp_path / "a", Request(replace(load("two_waypoint"), duration=3.0)))
    log.write_bytes(log.read_bytes()[: log.stat().st_size * 9 // 10])
    with requested(str(log), NOTHING) as request:
        assert request.notes == (f"{log}: the log is not whole, {read_log(log).broken}",)


def test_a_log_without_a_scenario_is_refused(tmp_path: Path) -> None:
    # given a log that no trial wrote
    channel = Channel("plant", "toy", ("north",), ("m",), ("Real",), ("",))
    path = tmp_path / "toy.mcap"
    with LogWriter(path, [channel], origin=(0, 0), metadata={}, attachments={}) as log:
        log.write_rows(np.zeros(1), {"plant": np.ones((1, 1))})
    # when, then
    with (
        pytest.raises(ScenarioError, match=f"{path}: has neither scenario nor package"),
        requested(str(path), NOTHING),
    ):
        pass


@pytest.mark.parametrize(
    ("record", "files", "text"),
    [
        ({"run": {"order": "Jacobi"}}, {}, 'order "Jacobi"; expected one of jacobi, sequential'),
        ({"run": {"fmi": "two\n"}}, {}, 'FMI version "two\\n"; expected one of 2, 3'),
        ({"run": {"onboard": "z80"}}, {}, 'processor "z80"; expected one of cortex-m4f, '),
        (
            {"swaps": {"plant": "/tmp/dog.fmu"}},
            {},
            'FMU of a swap "/tmp/dog.fmu"; expected one of ',
        ),
        ({"swaps": {"cat": "system.ssp"}}, {}, 'role of a swap "cat"; expected one of '),
        ({}, {"..": b""}, 'attachment ".."; expected one of '),
        ({}, {"a\0b": b""}, 'attachment "a\\x00b"; expected one of '),
    ],
)
def test_a_log_that_states_what_no_trial_could_is_refused(
    record: dict[str, dict[str, str]], files: dict[str, bytes], text: str, tmp_path: Path
) -> None:
    # given a crafted log of one tick
    path = tmp_path / "toy.mcap"
    metadata = {"scenario": {"toml": load("two_waypoint").text()}, **record}
    channel = Channel("plant", "toy", ("north",), ("m",), ("Real",), ("",))
    with LogWriter(
        path, [channel], origin=(0, 0), metadata=metadata, attachments={"system.ssp": b"", **files}
    ) as log:
        log.write_rows(np.zeros(1), {"plant": np.ones((1, 1))})
    # when, then
    with pytest.raises(ScenarioError) as caught, requested(str(path), NOTHING):
        pass
    assert str(caught.value).startswith(f"{path}: {text}")


def test_changes_override_the_target_and_keep_what_they_do_not_name(tmp_path: Path) -> None:
    # given
    dog = tmp_path / "dog.fmu"
    dog.touch()
    changes = Changes("jacobi", "3", {"plant": dog, "controller": None}, ["cmec.max_turns=3"], 5)
    # when
    with requested("two_waypoint", changes) as request:
        # then
        scenario = replace(load("two_waypoint"), seed=5, parameters={"cmec.max_turns": 3})
        assert request == Request(scenario, "jacobi", 3, {"plant": dog})


def test_a_setting_replaces_the_targets_under_either_name_of_a_swapped_block(tmp_path: Path) -> None:
    # given a parameter of a controller and a plant that are not the system's own
    written = {"quarter_turn.capture_radius": 6.0, "differential_drive.wheel_slip_deviation": 0.0}
    scenario = Scenario("my", waypoints=((20.0, 0.0),), parameters=written)
    plant = build_fmu(DifferentialDrive, tmp_path, 2).rename(tmp_path / "robot.fmu")
    settings = ["controller.capture_radius=5", "plant.wheel_slip_deviation=0.1"]
    # when
    changes = Changes(swaps={"controller": "quarter_turn", "plant": plant}, settings=settings)
    with requested(scenario, changes) as request:
        # then
        assert request.scenario.parameters == {
            "controller.capture_radius": 5, "plant.wheel_slip_deviation": 0.1
        }  # fmt: skip
    # and the system's own blocks have other names
    with requested(scenario, Changes(settings=settings)) as request:
        assert len(request.scenario.parameters) == 4


def test_a_block_of_ours_takes_a_role_by_its_name_in_the_fmi_version_of_the_trial() -> None:
    swaps = {"plant": "pedestrian", "controller": "quarter_turn"}
    with requested("two_waypoint", Changes(fmi="3", swaps=swaps)) as request:
        assert request.swaps == {role: build_folder() / f"fmi3/{name}.fmu" for role, name in swaps.items()}


def test_a_mapping_file_in_place_of_its_fmu_is_told_from_it(tmp_path: Path) -> None:
    (tmp_path / "dog.toml").write_text("[outputs]")
    text = r'dog\.toml" is no FMU; a mapping file is read beside its FMU: expected .*dog\.fmu'
    changes = Changes(swaps={"plant": tmp_path / "dog.toml"})
    with pytest.raises(UsageError, match=text), requested("left_90", changes):
        pass


def test_results_go_by_default_into_a_folder_of_scenario_and_seed() -> None:
    assert Request(Scenario("mine", seed=7)).default_folder == Path("out/mine-7")


def test_onboard_fmu_takes_the_firmware_of_a_log_out_again(tmp_path: Path) -> None:
    with requested("two_waypoint", Changes(onboard="pil:host")) as request:
        assert request.onboard == "host"
    with requested("two_waypoint", Changes(onboard="fmu")) as request:
        assert request.onboard == ""


def test_a_processor_is_not_called_from_the_loop_in_c() -> None:
    with requested("two_waypoint", Changes(loop="native")) as request:
        assert request.loop == "native"
    with requested("two_waypoint", Changes(onboard="pil:host", loop="python")) as request:
        assert (request.onboard, request.loop) == ("host", "python")
    text = "--onboard pil:host: the processor is called from Python; expected --loop python"
    changes = Changes(onboard="pil:host", loop="native")
    with pytest.raises(UsageError, match=text), requested("two_waypoint", changes):
        pass


def test_the_firmware_takes_the_place_of_the_estimator_too(tmp_path: Path) -> None:
    (tmp_path / "ekf.fmu").touch()
    changes = Changes(onboard="pil:host", swaps={"estimator": tmp_path / "ekf.fmu"})
    with (
        pytest.raises(UsageError, match="firmware is made of our own estimators; expected one of four_state"),
        requested("two_waypoint", changes),
    ):
        pass


@pytest.mark.parametrize(
    ("exists", "current", "builds"),
    [(True, True, 0), (True, False, 1), (False, True, 1), (False, False, 1)],
)
def test_our_package_is_built_if_it_is_missing_or_older_than_the_models(
    exists: bool, current: bool, builds: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given
    built: list[object] = []
    monkeypatch.setattr(request_module, "build_folder", lambda: tmp_path)
    monkeypatch.setattr(request_module, "is_current", lambda: current)
    monkeypatch.setattr("fmus.build.build_all", lambda **how: built.append(how))
    if exists:
        pack(tmp_path / "full.fmi2.ssp", {})
    # when
    build_missing(Request(load("two_waypoint")))
    # then
    assert len(built) == builds


def rewritten(path: Path, *, keep_comment: bool) -> None:
    """A tool that opens a package unpacks it, and packs the same files when it closes it."""
    with zipfile.ZipFile(path) as archive:
        files, comment = {name: archive.read(name) for name in archive.namelist()}, archive.comment
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
        archive.comment = comment if keep_comment else b""


@pytest.mark.parametrize("keep_comment", [True, False])
@pytest.mark.parametrize("what", ["full.fmi2.ssp", "fmi2/canine.fmu"])
def test_a_file_of_ours_that_another_tool_has_rewritten_is_noticed(
    what: str, keep_comment: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a package and an FMU, up to date, and a request for both
    monkeypatch.setattr(request_module, "build_folder", lambda: tmp_path)
    monkeypatch.setattr(request_module, "is_current", lambda: True)
    for name in ("full.fmi2.ssp", "fmi2/canine.fmu"):
        pack(tmp_path / name, {"a": b"1", "b": b"2"}, "stamp")
    request = Request(load("two_waypoint"), swaps={"plant": tmp_path / "fmi2" / "canine.fmu"})
    build_missing(request)
    # when one is written anew with the same date
    date = (tmp_path / what).stat()
    rewritten(tmp_path / what, keep_comment=keep_comment)
    os.utime(tmp_path / what, ns=(date.st_atime_ns, date.st_mtime_ns))
    # then
    with pytest.raises(AlteredError) as caught:
        build_missing(request)
    assert str(caught.value) == (
        f"{tmp_path / what}: is not as it was built here: another tool has written it anew, or replaced it; "
        "`canine build` builds it again; to run it as it is, copy it into another folder"
    )


def test_a_package_made_elsewhere_is_never_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmus.build.build_all", lambda done: pytest.fail("it was built"))
    build_missing(Request(Scenario("toy", system="toy.ssp", folder=tmp_path)))
    build_missing(Request(load("two_waypoint"), package=tmp_path / "system.ssp"))
