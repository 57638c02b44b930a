"""A trial as a package: whoever runs it needs nothing else, and gets the scenario's rows."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import fmpy.ssp
import numpy as np
import pytest
from lxml import etree

from fmus.ssp import NAMESPACES
from harness.log.log import Log, read_log
from harness.trial import trial
from harness.trial.package import write_package
from harness.trial.prepare import prepared
from harness.trial.request import Changes, Request, build_missing, requested
from harness.trial.scenario import Disturbance, Scenario, Setting, Written, load
from harness.trial.seeds import run_seeds
from models.errors import UsageError
from tests.harness.cosim.tiny_fmu import V, tiny_fmu
from tests.harness.trial.test_loops import DOG, MAPPING, MOVES

SCHEMA = Path(fmpy.ssp.__file__).parent / "schema" / "SystemStructureDescription.xsd"
OUTAGE: dict[str, Written] = {
    "sensors.outage_start": [2.0],
    "sensors.outage_end": [5.0],
    "cmec.moving_deviation": 30,
}
SHORT = replace(load("two_waypoint"), duration=12.0, seed=4, origin=(47.0, 8.0))
CASES: dict[str, tuple[Scenario, Changes]] = {
    "our system, cut before its end": (replace(SHORT, parameters=OUTAGE), Changes()),
    "one waypoint, literal": (
        replace(SHORT, waypoints=((10.0, 5.0),), reading="literal", start=(1.0, 2.0, 30.0)),
        Changes(fmi="3"),
    ),
    "guarded, a fence, an AHRS": (
        replace(SHORT, reading="guarded", fence=((-40, -40), (80, -40), (80, 80))),
        Changes(ahrs=True),
    ),
    "other blocks": (
        SHORT,
        Changes(swaps={"controller": "proportional", "plant": "differential_drive"}, estimator="two_bias"),
    ),
    "true state": (replace(SHORT, system="cts"), Changes(fmi="3")),
    "faults of signals": (
        replace(
            SHORT,
            faults=(
                Disturbance("sensors.heading_meas", "offset", 2.0, 6.0, 0.3),
                Disturbance("sensors.gps_north -> estimator.gps_north", "noise", 1.0, None, 0.5),
            ),
        ),
        Changes(),
    ),
    "an order from the start on": (
        replace(SHORT, sets=(Setting("controller.override", "FORWARD", 0.0),)),
        Changes(),
    ),
}


def export(scenario: Scenario, changes: Changes, path: Path) -> Path:
    with requested(scenario, changes) as request:
        build_missing(request)
        with prepared(request) as ready:
            write_package(request, ready, path)
    return path


def run(target: Scenario | Path, changes: Changes, out: Path) -> Log:
    with (
        requested(target if isinstance(target, Scenario) else str(target), changes) as request,
        prepared(request) as ready,
    ):
        trial.run(request, ready, out)
    return read_log(out / trial.LOG)


def structure(package: Path) -> ElementTree.Element:
    """The package's SystemStructure.ssd, which is valid."""
    with zipfile.ZipFile(package) as archive:
        text = archive.read("SystemStructure.ssd")
    etree.XMLSchema(etree.parse(str(SCHEMA))).assertValid(etree.fromstring(text))
    return ElementTree.fromstring(text)


@pytest.mark.parametrize("case", CASES)
def test_a_package_runs_to_the_rows_of_its_scenario(case: str, tmp_path: Path) -> None:
    # given a trial, and its package
    scenario, changes = CASES[case]
    package = export(scenario, changes, tmp_path / "it.ssp")
    structure(package)
    # when both are run
    own, packed = run(scenario, changes, tmp_path / "own"), run(package, Changes(), tmp_path / "packed")
    # then all rows have the same bits, up to the same end
    assert packed.time.tolist() == own.time.tolist()
    for component, rows in own.values.items():
        np.testing.assert_array_equal(packed.values[component].view(np.uint64), rows.view(np.uint64))
    # and our page of it has the seed, and the origin of the map
    assert packed.metadata["scenario"]["toml"].count("seed = 4") == 1
    assert packed.origin == own.origin == (47.0, 8.0)


def test_faults_in_a_package_delay_nothing_and_give_nan_as_in_its_trial(tmp_path: Path) -> None:
    # given a trial in which all links delay a tick, with faults of which one gives NaN, and its package
    faults = (
        Disturbance("sensors.pitch_meas", "nan", 1.0, 2.0),
        Disturbance("sensors.gps_north", "offset", 1.0, 2.0, 5.0),
        Disturbance("sensors.gps_north", "noise", 1.5, 3.0, 5.0),
    )
    scenario, jacobi = replace(SHORT, duration=4.0, faults=faults), Changes("jacobi")
    package = export(scenario, jacobi, tmp_path / "it.ssp")
    # when
    own, packed = run(scenario, jacobi, tmp_path / "own"), run(package, jacobi, tmp_path / "packed")
    # then
    assert packed.values.keys() == own.values.keys()
    for component, rows in own.values.items():
        np.testing.assert_array_equal(packed.values[component].view(np.uint64), rows.view(np.uint64))
    # and a further fault of it is one more
    with requested(str(package), Changes()) as request:
        more = replace(request, scenario=replace(request.scenario, faults=faults[:1]))
        with prepared(more) as ready:
            assert list(ready.system.faults) == ["fault_1", "fault_2", "fault_3", "fault_4"]


def test_a_package_holds_a_dog_made_elsewhere_with_its_conversions(tmp_path: Path) -> None:
    # given a plant in km/h and degrees
    dog = tiny_fmu(tmp_path / "dog.fmu", DOG, MOVES, depends=False)
    dog.with_suffix(".toml").write_text(MAPPING)
    changes = Changes(swaps={"plant": dog})
    # when
    package = export(SHORT, changes, tmp_path / "it.ssp")
    own, packed = run(SHORT, changes, tmp_path / "own"), run(package, Changes(), tmp_path / "packed")
    # then its speed is converted on the way to the sensors, once
    connection = structure(package).find(
        "ssd:System/ssd:Connections/ssd:Connection[@startConnector='v']", NAMESPACES
    )
    assert connection is not None
    assert connection.get("suppressUnitConversion") == "true"
    assert [dict(child.attrib) for child in connection] == [{"factor": "0.2777777777777778", "offset": "0.0"}]
    unit = structure(package).find("ssd:Units/ssc:Unit[@name='km/h']/ssc:BaseUnit", NAMESPACES)
    assert unit is not None
    assert unit.attrib == {"m": "1", "s": "-1", "factor": "0.2777777777777778"}
    # and all others see the same
    for component in set(own.values) - {"plant"}:
        np.testing.assert_array_equal(
            packed.values[component].view(np.uint64), own.values[component].view(np.uint64)
        )


# a dog made elsewhere that, by FMI's default, depends on its command within a step; it turns to and fro
STRANGE_DOG = [
    V("cmd", "input", "Integer"), *(V(n, unit=u) for n, u in (("pos_n", "m"), ("pos_e", "m"))),
    V("psi", unit="deg"), V("v_kmh", unit="km/h"), V("psi0", "parameter", unit="deg"), V("draw", "parameter"),
]  # fmt: skip
STRANGELY_MOVES = """v[4] = v[0] == 1 ? 18 : 0; v[3] = v[5] + v[6] + 3 * sin(t);
v[1] += v[4] / 3.6 * h; v[2] += v[4] * h * sin(t) / 60;"""
STRANGE_NAMES = """[outputs]
north = "pos_n"
east = "pos_e"
speed = { name = "v_kmh", factor = 0.2777777777777778 }
heading = { name = "psi", factor = 0.017453292519943295 }
[inputs]
command = "cmd"
[parameters]
start_heading = { name = "psi0", factor = 57.29577951308232 }
seed = "draw"
"""
STRANGE_FAULTS = (
    Disturbance("plant.speed", "offset", 1.0, 2.0, 0.5),
    Disturbance("plant.heading -> sensors.heading", "noise", 1.5, 3.0, 5.0),
)


@pytest.mark.parametrize(
    ("version", "faults"), [(2, ()), (3, STRANGE_FAULTS)], ids=["FMI 2", "FMI 3, faults"]
)
def test_the_package_of_a_dog_by_other_names_runs_to_the_log_of_its_trial(
    version: int, faults: tuple[Disturbance, ...], tmp_path: Path
) -> None:
    # given a trial with such a dog, and its package
    dog = tiny_fmu(tmp_path / "dog.fmu", STRANGE_DOG, STRANGELY_MOVES, version=version)
    dog.with_suffix(".toml").write_text(STRANGE_NAMES)
    scenario = replace(SHORT, parameters={"plant.start_heading": 20}, faults=faults)
    changes = Changes(swaps={"plant": dog}, fmi=str(version))
    package = export(scenario, changes, tmp_path / "it.ssp")
    structure(package)
    # when both are run, the package also from a folder, from its log, and with another seed
    own, packed = run(scenario, changes, tmp_path / "own"), run(package, Changes(), tmp_path / "packed")
    with zipfile.ZipFile(package) as archive:
        archive.extractall(tmp_path / "folder")
    run(tmp_path / "folder", Changes(), tmp_path / "of_folder")
    again = run(tmp_path / "of_folder" / trial.LOG, Changes(), tmp_path / "again")
    reseeded = run(replace(scenario, seed=8), changes, tmp_path / "own8")
    asked = run(package, Changes(seed=8), tmp_path / "packed8")
    # then signals, units and rows are the same
    for got, expected in ((packed, own), (again, own), (asked, reseeded)):
        assert {c.component: (c.names, c.units) for c in got.channels} == {
            c.component: (c.names, c.units) for c in expected.channels
        }
        for component, rows in expected.values.items():
            np.testing.assert_array_equal(got.values[component].view(np.uint64), rows.view(np.uint64))
    # and so is the report
    summaries = [json.loads((tmp_path / name / trial.SUMMARY).read_text()) for name in ("own", "packed")]
    for key in ("outcome", "time_s", "position_error_m", "directional_commands", "anomalies"):
        assert summaries[0][key] == summaries[1][key]
    assert (tmp_path / "packed" / trial.PICTURE).exists()
    assert any("it is stepped last all the same" in note for note in summaries[1]["notes"])


def test_a_seed_that_is_asked_for_wins_over_the_packages_own(tmp_path: Path) -> None:
    # given a package with seed 4, in which the dog, the sensors and the noise of a fault draw
    scenario, changes = CASES["faults of signals"]
    package = export(scenario, changes, tmp_path / "it.ssp")
    # when it is run with seed 8, once, among several, and again from its log
    own = run(replace(scenario, seed=8), changes, tmp_path / "own")
    asked = run(package, Changes(seed=8), tmp_path / "asked")
    with requested(str(package), Changes()) as request:
        (summary,) = run_seeds(request, [8], tmp_path / "seeds")
    among = read_log(tmp_path / "seeds" / "8" / trial.LOG)
    again = run(tmp_path / "asked" / trial.LOG, Changes(), tmp_path / "again")
    back = run(tmp_path / "asked" / trial.LOG, Changes(seed=4), tmp_path / "back")
    # then it is the trial of seed 8
    assert summary["seed"] == 8
    assert not [note for note in summary["notes"] if "seed" in note]
    for log in (asked, among, again):
        for component, rows in own.values.items():
            np.testing.assert_array_equal(log.values[component].view(np.uint64), rows.view(np.uint64))
    # and the log's with seed 4 is the package's own
    for component, rows in run(package, Changes(), tmp_path / "packed").values.items():
        np.testing.assert_array_equal(back.values[component].view(np.uint64), rows.view(np.uint64))


def test_a_log_is_exported_as_its_trial(tmp_path: Path) -> None:
    scenario, changes = CASES["our system, cut before its end"]
    run(scenario, changes, tmp_path / "own")
    with requested(str(tmp_path / "own" / trial.LOG), Changes()) as request, prepared(request) as ready:
        write_package(request, ready, tmp_path / "of_log.ssp")
    assert (tmp_path / "of_log.ssp").read_bytes() == export(
        scenario, changes, tmp_path / "it.ssp"
    ).read_bytes()


def test_what_the_scenario_sets_is_bound_and_nothing_else(tmp_path: Path) -> None:
    package = export(CASES["our system, cut before its end"][0], Changes(), tmp_path / "it.ssp")
    root = structure(package)
    bound = {
        f"{component.get('name')}.{parameter.get('name')}": parameter[0].get("value")
        for component in root.iterfind("ssd:System/ssd:Elements/ssd:Component", NAMESPACES)
        for parameter in component.iterfind(".//ssv:Parameter", NAMESPACES)
    }
    # then the dog, the sensors and the controller have what the text of the scenario says, in SI
    expected = {
        "plant.seed": "4",
        "sensors.seed": "4",
        "sensors.outage_start[1]": "2.0",
        "sensors.outage_end[1]": "5.0",
        "controller.start": "true",
        "controller.waypoint_count": "1",
        "controller.waypoint_north[1]": repr(SHORT.waypoints[0][0]),
        "controller.moving_deviation": repr(np.radians(30.0).item()),
    }
    assert expected.items() <= bound.items()
    assert not {name for name in bound if name.startswith(("estimator.", "command_module."))}
    # and a tool that applies parameter sets by name finds all under one
    assert {e.get("name") for e in root.iterfind(".//ssv:ParameterSet", NAMESPACES)} == {"initialValues"}
    experiment = root.find("ssd:DefaultExperiment", NAMESPACES)
    assert experiment is not None
    assert experiment.attrib == {"startTime": "0.0", "stopTime": "12.0"}


@pytest.mark.parametrize(
    ("scenario", "file", "text"),
    [
        (
            replace(SHORT, sets=(Setting("controller.override", "STOP", 3.0, 4.5),)),
            "it.ssp",
            r"two_waypoint: \[\[set\]\] changes controller\.override at 3 s, controller\.override at 4\.5 s; "
            "a package holds values of the start alone",
        ),
        (
            replace(SHORT, faults=(Disturbance("radio", "lost", 3.0, 4.5),)),
            "it.ssp",
            r"two_waypoint: \[\[fault\]\] loses the radio from 3 s on; a package holds values of the start",
        ),
        (
            replace(SHORT, faults=(Disturbance("estimator", "stall", 3.0, 4.5),)),
            "it.ssp",
            r"two_waypoint: \[\[fault\]\] stalls estimator; a package cannot say when",
        ),
        (SHORT, "it.zip", r"--ssp .*it\.zip: expected a name that ends in \.ssp"),
    ],
)
def test_what_no_package_holds_is_refused_by_name(
    scenario: Scenario, file: str, text: str, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=text):
        export(scenario, Changes(), tmp_path / file)
    assert list(tmp_path.iterdir()) == []


def test_firmware_and_packages_are_not_exported(tmp_path: Path) -> None:
    request = Request(SHORT, log=Path("trial.mcap"))
    with prepared(request) as ready:
        with pytest.raises(UsageError, match="host led this trial; a package holds FMUs, no firmware"):
            write_package(replace(request, onboard="host"), ready, tmp_path / "it.ssp")
        of_package = replace(request, scenario=replace(SHORT, system="my.ssp"))
        with pytest.raises(UsageError, match=r"my\.ssp is a package already; expected a system of ours"):
            write_package(of_package, ready, tmp_path / "it.ssp")
