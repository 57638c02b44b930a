"""A trial: the files that it leaves, what ends it, and what its log holds."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.cosim.loop import Simulation, Stop
from harness.cosim.ssp import FmuComponent, FmuSystem, StartValue
from harness.log.log import read_log
from harness.onboard import stand_in
from harness.trial import instances, trial
from harness.trial.contents import VERSIONED, attachments, metadata
from harness.trial.instances import open_onboard
from harness.trial.plan import Plan
from harness.trial.prepare import Prepared, prepared
from harness.trial.request import Request, build_missing
from harness.trial.scenario import Scenario, ScenarioError, load
from models.commands import ENDS
from models.errors import UsageError
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

SHORT = replace(load("two_waypoint"), duration=2.0)
TRUE_STATE = Scenario("straight", system="cts", waypoints=((25.0, 0.0),), duration=2.0)
# a dog that runs north at 18 km/h = 5 m/s, told 10 times the command; its own `speed` is something else
DOG = [V("cmd", "input", "Integer"), *(V(n, unit=u) for n, u in (("north", "m"), ("east", "m")))]
DOG += [V("heading", unit="rad"), V("v", unit="km/h"), V("speed", unit="m")]
MOVES = "v[4] = 18; v[5] = -1; v[1] += 5 * h;"
MAPPING = """[outputs]
speed = { name = "v", factor = 0.2777777777777778 }
[inputs]
command = { name = "cmd", factor = 10, offset = 1 }"""


def dog(folder: Path) -> Path:
    path = tiny_fmu(folder / "dog.fmu", DOG, MOVES, depends=False)
    path.with_suffix(".toml").write_text(MAPPING)
    return path


def run(request: Request, out: Path, **options: Any) -> dict[str, Any]:
    build_missing(request)
    with prepared(request) as ready:
        return trial.run(request, ready, out, **options)


def test_a_trial_leaves_log_summary_page_and_picture(tmp_path: Path) -> None:
    # given a file of an earlier trial, and one of the user's
    (tmp_path / "trial.png").write_bytes(b"of an earlier trial")
    (tmp_path / "notes.txt").write_text("mine")
    # when
    times: list[float] = []
    summary = run(Request(SHORT), tmp_path, progress=times.append)
    # then
    assert {p.name for p in tmp_path.iterdir()} == {
        "notes.txt", "summary.json", "trial.html", "trial.mcap", "trial.png"
    }  # fmt: skip
    assert (tmp_path / "trial.png").read_bytes().startswith(b"\x89PNG")
    assert (summary["outcome"], summary["ticks"], summary["time_s"]) == ("timeout", 51, 2.0)
    assert summary["real_time_factor"] > 1
    assert times[-1] == pytest.approx(2.0, abs=1.0)


def test_a_fault_leaves_the_log_up_to_it_and_no_file_of_an_earlier_trial(tmp_path: Path) -> None:
    # given a whole trial, and one that ends in its second second
    run(Request(SHORT), tmp_path)

    def fail(time: float) -> None:
        if time > 0.9:
            raise UsageError("enough")

    # when
    with pytest.raises(UsageError, match="enough"):
        run(Request(SHORT), tmp_path, progress=fail)
    # then
    assert [p.name for p in tmp_path.iterdir()] == ["trial.mcap"]
    log = read_log(tmp_path / "trial.mcap")
    assert log.broken == "enough"
    assert 0.9 < log.time[-1] < 2.0


def test_a_system_without_a_plant_has_a_summary_and_no_picture(tmp_path: Path) -> None:
    # given a package with one component, not a plant
    (tmp_path / "toy").mkdir()
    tiny_fmu(tmp_path / "toy" / "toy.fmu", [V("x", unit="m")], "v[0] += h;")
    (tmp_path / "toy" / "SystemStructure.ssd").write_text(
        '<?xml version="1.0"?><SystemStructureDescription version="1.0" name="toy" '
        'xmlns="http://ssp-standard.org/SSP1/SystemStructureDescription"><System name="toy"><Elements>'
        '<Component name="tank" source="toy.fmu"/></Elements></System></SystemStructureDescription>'
    )
    scenario = replace(SHORT, name="toy", system="toy", folder=tmp_path)
    # when
    summary = run(Request(scenario), tmp_path / "out")
    # then
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"summary.json", "trial.html", "trial.mcap"}
    assert (summary["outcome"], summary["position_error_m"]) == ("timeout", None)


def test_the_status_of_a_controller_ends_a_trial(tmp_path: Path) -> None:
    build_missing(Request(TRUE_STATE))
    with prepared(Request(TRUE_STATE)) as ready, Simulation(ready.system, ready.plan.values) as simulation:
        assert trial.stop_of(simulation) == Stop("controller", "status", ENDS)
        simulation.fmus = {n: fmu for n, fmu in simulation.fmus.items() if n != "controller"}
        assert trial.stop_of(simulation) is None


def test_a_swapped_component_is_logged_by_the_roles_names_and_units(tmp_path: Path) -> None:
    # when
    request = Request(TRUE_STATE, swaps={"plant": dog(tmp_path)})
    run(request, tmp_path / "out")
    # then v in km/h is the role's speed in m/s, and the FMU's own speed is marked
    log = read_log(tmp_path / "out" / "trial.mcap")
    (plant,) = [channel for channel in log.channels if channel.component == "plant"]
    assert dict(zip(plant.names, plant.units, strict=True)) == {
        "command": "", "north": "m", "east": "m", "heading": "rad", "speed": "m/s", "speed (FMU)": "m"
    }  # fmt: skip
    assert np.unique(log["plant.speed"][1:]).tolist() == [5.0]
    assert np.unique(log["plant.speed (FMU)"][1:]).tolist() == [-1.0]
    # and it is told what the controller says
    assert log["plant.command"].tolist() == log["command_module.command"].tolist()
    assert log["plant.command"].any()


def test_a_log_holds_what_it_takes_to_run_the_trial_again(tmp_path: Path) -> None:
    # given
    request = Request(replace(TRUE_STATE, seed=4), "jacobi", swaps={"plant": dog(tmp_path)})
    build_missing(request)
    # when
    with prepared(request) as ready:
        records, files = metadata(request, ready), attachments(request, ready)
    # then
    assert records["scenario"] == {"name": "straight", "seed": "4", "toml": request.scenario.text()}
    assert records["run"] == {"order": "jacobi", "fmi": "2"}
    assert records["swaps"] == {"plant": "plant.fmu"}
    assert records["roles"]["controller"] == "cmec"
    assert float(records["parameters"]["controller.waypoint_north[1]"]) == 25.0
    assert set(records["versions"]) == set(VERSIONED)
    assert files == {
        "system.ssp": request.ssp.read_bytes(),
        "plant.fmu": (tmp_path / "dog.fmu").read_bytes(),
        "plant.toml": MAPPING.encode(),
    }


def test_a_plant_made_elsewhere_is_stepped_last(tmp_path: Path) -> None:
    for swaps, plants in (({}, []), ({"plant": dog(tmp_path)}, ["plant"])):
        with prepared(Request(TRUE_STATE, swaps=swaps)) as ready:
            assert ready.plants == plants


def test_values_of_the_scenario_win_over_those_that_the_package_binds() -> None:
    bound = {"a": StartValue(1.0), "b": StartValue(2.0)}
    system = FmuSystem("toy", {"plant": FmuComponent("plant", Path("toy.fmu"), values=bound)}, ())
    ready = Prepared(system, {}, {}, Plan({"plant": {"b": 3.0}, "telemetry": {"c": 4.0}}, (), ()), {}, ())
    assert ready.values == {"plant": {"a": 1.0, "b": 3.0}, "telemetry": {"c": 4.0}}


def test_a_package_that_does_not_exist_is_named(tmp_path: Path) -> None:
    request = Request(replace(SHORT, system="toy.ssp", folder=tmp_path))
    with (
        pytest.raises(ScenarioError, match=f'two_waypoint: there is no package "{tmp_path}/toy.ssp"'),
        prepared(request),
    ):
        pass


def test_a_processor_is_closed_if_the_onboard_computer_cannot_be_made(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # given a processor, and an onboard computer that refuses it
    class Processor:
        closed = False

        def close(self) -> None:
            self.closed = True

    def refuse(*arguments: Any, **options: Any) -> stand_in.Onboard:
        raise UsageError("refused")

    processor = Processor()
    monkeypatch.setattr(instances, "Onboard", refuse)
    request = Request(SHORT, onboard="host")
    build_missing(request)
    # when
    with prepared(request) as ready, pytest.raises(UsageError, match="refused"):
        open_onboard(request, ready, lambda target, values, navigation: processor)  # type: ignore
    # then
    assert processor.closed
