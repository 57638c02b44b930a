"""Components of a trial that are not stepped for a while."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from harness.cosim.alone import Alone, outputs_of
from harness.cosim.loop import Simulation
from harness.cosim.stepping import Order
from harness.log.log import Log, read_log
from harness.onboard import IN_FIRMWARE
from harness.trial import trial
from harness.trial.disturbances import disturbances
from harness.trial.faults import resolve_faults
from harness.trial.plan import interfaces_of_system
from harness.trial.prepare import prepared
from harness.trial.request import Changes, Request, build_missing, requested
from harness.trial.scenario import Disturbance, Scenario, ScenarioError, Setting, load, parse
from models.system import SYSTEMS
from tests.harness.trial.test_rates import SCENARIO as STRAIGHT
from tests.harness.trial.test_rates import leader

ORDERS: tuple[Order, ...] = get_args(Order)
FROM, UNTIL = 0.8, 1.2  # s: ticks 20 to 29
ORDER = Setting("controller.override", "STOP", 0.88, 1.04)  # commands change meanwhile
SHORT = replace(load("two_waypoint"), duration=2.0, sets=(ORDER,))


def stalled(*components: str, scenario: Scenario = SHORT) -> Scenario:
    return replace(scenario, faults=tuple(Disturbance(c, "stall", FROM, UNTIL) for c in components))


def flown(scenario: Scenario, folder: Path, **options: Any) -> Log:
    request = Request(scenario, **options)
    build_missing(request)
    with prepared(request) as ready:
        trial.run(request, ready, folder)
    return read_log(folder / trial.LOG)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Log:
    """The trial in which nothing stalls."""
    return flown(SHORT, tmp_path_factory.mktemp("plain"))


def outputs(log: Log, component: str) -> np.ndarray[Any, Any]:
    """What a component gave, (ticks, outputs)."""
    names = SYSTEMS["full"].components[component].flat_names("output")
    return np.array([log[f"{component}.{name}"] for name in names]).T


@pytest.mark.parametrize("component", SYSTEMS["full"].components)
def test_every_component_holds_its_outputs_for_ten_ticks(component: str, plain: Log, tmp_path: Path) -> None:
    # given outputs that change within these ticks
    log = flown(stalled(component), tmp_path)
    held, else_, first = outputs(log, component), outputs(plain, component), 19
    if component == "plant":  # what it gives on tick 20 is the end of the step of tick 19
        first = 20
    assert not (else_[first : first + 11] == else_[first]).all()
    # then they are held, and go on
    assert held[: first + 1].tolist() == else_[: first + 1].tolist()
    assert (held[first : first + 11] == held[first]).all()
    assert not (held[first : first + 14] == held[first]).all()


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_estimator_goes_on_as_if_there_had_been_no_gap(fmi: int, tmp_path: Path) -> None:
    # given the signals of a trial in which it stalls for ten ticks
    request = Request(stalled("estimator"), fmi=fmi)
    log = flown(request.scenario, tmp_path, fmi=fmi)
    taken = np.delete(np.arange(51), np.arange(20, 30))
    with prepared(request) as ready:
        fmu = ready.system.components["estimator"].fmu
        # when one alone gets those of the other ticks
        with Alone("estimator", fmu, 0.04) as alone:
            alone.instance.initialize(ready.plan.values["estimator"])
            rows = np.zeros((41, len(alone.layout.block)), np.uint8)
            alone.run({n: log[f"estimator.{n}"][taken] for n in ready.fmus["estimator"].inputs}, rows)
            expected = outputs_of(alone.layout, "estimator", rows)
    # then it answers the same bits
    for name, values in expected.items():
        assert log[f"estimator.{name}"][taken].tobytes() == values.tobytes(), name


@pytest.mark.parametrize("order", ORDERS)
def test_both_loops_give_the_same_log(order: Order, tmp_path: Path) -> None:
    scenario = stalled("estimator", "plant", "controller")
    for loop in ("native", "python"):
        flown(scenario, tmp_path / loop, order=order, loop=loop)
    logs = [(tmp_path / loop / trial.LOG).read_bytes() for loop in ("native", "python")]
    assert logs[0] == logs[1]


def test_a_log_with_a_stall_runs_again_and_shows_it_as_a_band(tmp_path: Path) -> None:
    # given
    log = flown(stalled("sensors"), tmp_path / "first")
    # when
    with requested(str(tmp_path / "first" / trial.LOG), Changes()) as request, prepared(request) as ready:
        trial.run(request, ready, tmp_path / "again")
    # then
    first, again = (tmp_path / name / trial.LOG for name in ("first", "again"))
    assert first.read_bytes() == again.read_bytes()
    assert disturbances(log)["stall of sensors"] == [(0.8, 1.2)]
    summary = json.loads((tmp_path / "again" / trial.SUMMARY).read_text())
    expected = {"signal": "sensors", "kind": "stall", "at": 0.8, "until": 1.2, "value": None}
    assert summary["faults"] == [expected]


def test_a_stall_is_written_and_read_as_other_faults_are() -> None:
    text = 'waypoints = [[20.0, 0.0]]\n[[fault]]\nsignal = "estimator"\nkind = "stall"\nat = 10\n'
    scenario = parse(text, "my.toml")
    assert scenario.faults == (Disturbance("estimator", "stall", 10.0),)
    assert parse(scenario.text(), "text") == scenario
    with pytest.raises(ScenarioError, match='the kind "stall" takes none'):
        parse(f"{text}value = 1\n", "my.toml")


def test_on_board_the_sensors_and_the_plant_can_stall(tmp_path: Path) -> None:
    # given firmware that measures what the sensors hold, and a dog that stays where it was
    log = flown(replace(stalled("sensors", "plant"), sets=()), tmp_path, onboard="host")
    # then
    assert len(set(log["sensors.heading_meas"][19:30])) == 1
    assert len(set(log["plant.north"][20:31])) == 1
    assert len(set(log["plant.north"][30:41])) > 5


def resolved(signal: str, kind: str = "stall", inside: tuple[str, ...] = ()) -> Any:
    system, scenario = SYSTEMS["full"], replace(SHORT, faults=(Disturbance(signal, kind, 1.0),))
    return resolve_faults(scenario, interfaces_of_system(system), system.links, 0.04, inside=inside)


@pytest.mark.parametrize(
    ("signal", "kind", "text"),
    [
        ("estimater", "stall", 'expected a component; did you mean "estimator"'),
        ("estimator.north", "stall", 'expected a component; did you mean "estimator"'),
        ("radio", "stall", "expected a component; known: command_module, controller"),
        (
            "estimator",
            "off",
            'has no output ""; name one, such as "estimator.north", or state kind = "stall"',
        ),
    ],
)
def test_a_stall_is_of_a_component_and_of_nothing_else(signal: str, kind: str, text: str) -> None:
    with pytest.raises(ScenarioError, match=text):
        resolved(signal, kind)


@pytest.mark.parametrize("component", ["estimator", "controller", "command_module"])
def test_what_is_in_the_firmware_does_not_stall_alone(component: str) -> None:
    assert resolved(component).stalls == {component: ((25, 2_000_000_000),)}
    with pytest.raises(ScenarioError, match=f"{component} is in the firmware on board"):
        resolved(component, inside=IN_FIRMWARE)


def test_nor_do_the_programs_own_components() -> None:
    request = Request(stalled("supervisor"), onboard="host")
    with pytest.raises(ScenarioError, match="supervisor"), prepared(request):
        pass


def test_a_stall_between_the_steps_of_a_slow_component_is_noted(tmp_path: Path) -> None:
    # given a controller that makes a step every 0.2 s, on ticks 20, 25 and so on
    faults = (Disturbance("controller", "stall", 0.84, 1.0), Disturbance("controller", "stall", 0.84, 1.04))
    controller = leader(tmp_path, version=2, step=0.2)
    request = Request(replace(STRAIGHT, faults=faults), swaps={"controller": controller})
    # when
    with prepared(request) as ready, Simulation(ready.system, ready.plan.values) as simulation:
        # then one of the two leaves out the step of tick 25
        assert [note for note in ready.notes if "stall" in note] == [
            "straight: a stall of controller from 0.84 to 1 s never acts: "
            "no step of it, one every 0.2 s, begins then"
        ]
        assert simulation.wiring.stalls == {"controller": ((25, 30),)}
