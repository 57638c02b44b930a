"""Faults of a scenario in a trial: what reads a signal gets it disturbed, and what gives it does not."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from harness.cosim.fmu import Access
from harness.cosim.loop import Array, Simulation
from harness.cosim.ssp import ScaledLink
from harness.cosim.stepping import Order
from harness.log.geodesy import TangentPlane
from harness.log.log import Log, read_log
from harness.onboard import IN_FIRMWARE
from harness.replay.source import open_source
from harness.trial import plots, trial
from harness.trial.disturbances import disturbances
from harness.trial.faults import resolve_faults
from harness.trial.lone_faults import Case, fitting
from harness.trial.plan import Interface, interface_of_fmu, interfaces_of_system
from harness.trial.prepare import prepared
from harness.trial.request import Changes, Request, build_missing, requested
from harness.trial.scenario import FAULTS, Disturbance, Scenario, ScenarioError, Setting, load
from models.kit.declaration import Type, Variable
from models.system import SYSTEMS
from tests.harness.cosim.descriptions import fmu as describing
from tests.harness.cosim.descriptions import quantity
from tests.harness.cosim.tiny_fmu import V, tiny_fmu
from tests.harness.trial.test_trial import dog

SHORT = replace(load("two_waypoint"), duration=2.0)
FROM, UNTIL = 0.8, 1.2  # s
WINDOW = slice(20, 30)  # ticks
SIGNALS = {  # one of each type, which changes meanwhile, and what reads it
    "sensors.heading_meas": "estimator.heading_meas",
    "controller.command": "plant.command",
    "sensors.gps_fix": "estimator.gps_fix",
}
VALUES = {"offset": 5.0, "scale": 2.0, "noise": 3.0, "delay": 0.2, "dropouts": 0.9, "jump": 10.0}
EVERY = [
    (signal, kind)
    for signal, types in zip(SIGNALS, ("Real", "Integer", "Boolean"), strict=True)
    for kind, what in FAULTS.items()
    if types in {t.value for t in what.types}
]


def with_faults(*faults: Disturbance, scenario: Scenario = SHORT) -> Scenario:
    return replace(scenario, faults=faults)


def fault(signal: str, kind: str, at: float = FROM, until: float | None = UNTIL) -> Disturbance:
    return Disturbance(signal, kind, at, until, VALUES.get(kind))


def flown(scenario: Scenario, folder: Path, **options: Any) -> Log:
    request = Request(scenario, **options)
    build_missing(request)
    with prepared(request) as ready:
        trial.run(request, ready, folder)
    return read_log(folder / "trial.mcap")


def rows(scenario: Scenario) -> dict[str, Array]:
    """The signals of a trial by address, without log and pictures."""
    request = Request(scenario)
    build_missing(request)
    parts: list[dict[str, Array]] = []
    with prepared(request) as ready, Simulation(ready.system, ready.plan.values) as simulation:
        simulation.run(
            ready.plan.events,
            duration=scenario.duration,
            record=lambda _, values: parts.append({n: v.copy() for n, v in values.items()}),
        )
        return {
            f"{name}.{quantity.name}": np.concatenate([part[name][:, i] for part in parts])
            for name in simulation.components
            for i, quantity in enumerate(simulation.columns(name))
        }


@pytest.mark.parametrize(("signal", "kind"), EVERY)
def test_every_kind_changes_what_arrives_and_not_what_is_given(signal: str, kind: str) -> None:
    # given a command that changes while the fault acts
    order = Setting("controller.override", "STOP", 0.88, 1.04)
    scenario = with_faults(fault(signal, kind), scenario=replace(SHORT, sets=(order,)))
    # when
    signals = rows(scenario)
    # then
    same = signals[signal] == signals[SIGNALS[signal]]
    assert not same[WINDOW].all()
    assert same[: WINDOW.start].all()
    assert same[WINDOW.stop :].all()


@pytest.mark.parametrize("order", ["sequential", "jacobi"])
def test_both_loops_give_the_same_rows_and_a_fault_adds_no_delay(order: Order, tmp_path: Path) -> None:
    # given faults of a plant's signal and of another's, the last of which never acts
    faults = [fault("plant.speed", "noise"), fault("sensors.gps_north", "stuck")]
    scenario = with_faults(*faults, fault("estimator.north", "offset", at=1.9, until=1.9))
    # when
    native = flown(scenario, tmp_path / "c", order=order)
    python = flown(scenario, tmp_path / "python", order=order, loop="python")
    plain = flown(SHORT, tmp_path / "plain", order=order)
    # then
    assert (tmp_path / "c" / "trial.mcap").read_bytes() == (tmp_path / "python" / "trial.mcap").read_bytes()
    assert native["plant.north"].tolist() == python["plant.north"].tolist()
    before = native.time < FROM - 1e-9
    for channel in plain.channels:
        for name in channel.names:
            signal = f"{channel.component}.{name}"
            assert native[signal][before].tolist() == plain[signal][before].tolist(), signal
    assert not np.array_equal(native["sensors.speed"], plain["sensors.speed"])


def test_a_trial_without_faults_has_no_block_for_them(tmp_path: Path) -> None:
    with prepared(Request(SHORT)) as ready:
        assert [name for name in ready.system.components if "fault" in name] == []


def test_nan_arrives_and_is_skipped_and_the_trial_goes_on(tmp_path: Path) -> None:
    log = flown(with_faults(fault("sensors.pitch_meas", "nan")), tmp_path)
    assert np.isnan(log["estimator.pitch_meas"]).tolist() == [20 <= k < 30 for k in range(51)]
    assert np.isfinite(log["sensors.pitch_meas"]).all()
    assert np.isfinite(log["estimator.north"]).all()


def test_one_link_is_disturbed_and_the_others_are_not() -> None:
    log = rows(with_faults(fault("controller.command -> plant.command", "off", 0.2)))
    assert (log["plant.command"][10:20] == 0).all()
    assert np.array_equal(log["command_module.command"], log["controller.command"])
    assert (log["controller.command"][10:20] != 0).any()


def test_angles_are_in_degrees() -> None:
    log = rows(with_faults(fault("sensors.heading_meas", "offset")))
    off = (log["estimator.heading_meas"] - log["sensors.heading_meas"])[WINDOW]
    assert off == pytest.approx(np.full(10, np.radians(5.0)), abs=1e-12)


def test_a_lost_radio_is_link_ok_false() -> None:
    log = rows(with_faults(Disturbance("radio", "lost", FROM, UNTIL)))
    assert log["controller.link_ok"].tolist() == [float(not 20 <= k < 30) for k in range(51)]


def test_a_log_with_faults_runs_again_to_the_same_bytes(tmp_path: Path) -> None:
    # given
    flown(with_faults(fault("sensors.gps_east", "noise"), fault("radio", "lost")), tmp_path / "first")
    log = tmp_path / "first" / "trial.mcap"
    # when
    with requested(str(log), Changes()) as request, prepared(request) as ready:
        summary = trial.run(request, ready, tmp_path / "again")
    # then
    assert (tmp_path / "again" / "trial.mcap").read_bytes() == log.read_bytes()
    assert [f["kind"] for f in summary["faults"]] == ["noise", "lost"]
    assert not {"fault_1", "fault_2"} & {c.component for c in read_log(log).channels}


def test_a_fault_shows_as_a_band_under_its_words(tmp_path: Path) -> None:
    scenario = with_faults(fault("sensors.gps_east", "jump"), fault("sensors.gps_north", "off", 1.6, None))
    log = flown(scenario, tmp_path)
    assert disturbances(log) == {
        "jump of 10 m in sensors.gps_east": [(0.8, 1.2)], "off of sensors.gps_north": [(1.6, 2.0)]
    }  # fmt: skip


def resolved(fault: Disturbance, inside: tuple[str, ...] = ()) -> Any:
    system = SYSTEMS["full"]
    return resolve_faults(with_faults(fault), interfaces_of_system(system), system.links, 0.04, inside=inside)


@pytest.mark.parametrize(
    ("signal", "kind", "text"),
    [
        ("sensor.gps_north", "off", 'no component "sensor"; did you mean "sensors"'),
        ("sensors.gps_nort", "off", 'has no output "gps_nort"; did you mean "gps_north"'),
        ("controller.override", "off", "it is an input: disturb the output that feeds it"),
        ("sensors.accel_z", "off", "it feeds nothing here"),
        ("sensors.gps_fix", "offset", "expected one of off, stuck, delay, dropouts"),
        (
            "sensors.gps_north -> plant.command",
            "off",
            "its links are sensors.gps_north -> estimator.gps_north",
        ),
        ("wire", "lost", 'what is lost is the "radio"'),
    ],
)
def test_a_fault_of_what_is_not_there_is_refused(signal: str, kind: str, text: str) -> None:
    with pytest.raises(ScenarioError, match=text):
        resolved(fault(signal, kind))


@pytest.mark.parametrize(
    ("type", "limits", "text"),
    [
        (np.int64, None, "from -9.223372037e+18 up to 9.223372037e+18"),
        (np.uint32, None, "from 0 up to 4294967295"),
        (np.int64, (0.0, 2.0**31), "from 0 up to 2147483648"),
        (np.int64, (-(2.0**31), 2.0**31 - 1), ""),
        (np.int32, None, ""),
        (np.uint16, None, ""),
    ],
)
def test_a_fault_of_an_integer_that_its_block_cannot_hold_is_refused(
    type: npt.DTypeLike, limits: tuple[float, float] | None, text: str
) -> None:
    low, high = limits or (None, None)
    count = replace(quantity("n", type=Type.INTEGER, access=Access("Any", type)), min=low, max=high)
    interfaces = {"a": interface_of_fmu("a", describing("a", count)), "b": Interface("b", {}, {}, "b b.fmu")}
    scenario, links = with_faults(fault("a.n", "stuck")), (ScaledLink("a", "n", "b", "n"),)
    if not text:
        assert len(resolve_faults(scenario, interfaces, links, 0.04).links) == 1
        return
    with pytest.raises(ScenarioError) as caught:
        resolve_faults(scenario, interfaces, links, 0.04)
    assert str(caught.value) == (
        f"two_waypoint: [[fault]] 1: a.n is a whole number {text}; a fault is of an Integer from -2147483648 "
        "up to 2147483647: export it as an Int32, or with such a min and max"
    )


@pytest.mark.parametrize("value", [0.01, 2.1])
def test_a_delay_is_of_one_to_fifty_ticks(value: float) -> None:
    with pytest.raises(ScenarioError, match=r"expected a delay from 0\.04 to 2 s"):
        resolved(Disturbance("sensors.gps_north", "delay", 1, 2, value))


@pytest.mark.parametrize(
    ("signal", "instead"),
    [
        ("estimator.north", "a signal of the sensors or the plant"),
        ("sensors.gps_north -> estimator.gps_north", "sensors.gps_north"),
        ("controller.command", "controller.command -> plant.command"),
    ],
)
def test_a_link_in_the_firmware_is_refused_on_board(signal: str, instead: str) -> None:
    resolved(fault(signal, "off"))
    with pytest.raises(ScenarioError, match=f'lies in the firmware on board; disturb "{instead}"'):
        resolved(fault(signal, "off"), IN_FIRMWARE)


def test_on_board_what_no_link_takes_is_read_by_the_instruments() -> None:
    assert len(resolved(fault("sensors.accel_z", "off"), IN_FIRMWARE).links) == 1


def test_a_fault_that_makes_an_fmu_give_nan_ends_the_trial_by_name(tmp_path: Path) -> None:
    faults = (
        fault("plant.heading", "off"),
        fault("plant.speed", "nan"),
        Disturbance("plant.north", "nan", 1.9),
    )
    with pytest.raises(trial.EndedByFaultError, match="sensors") as caught:
        flown(with_faults(*faults), tmp_path)
    # and a note tells whose nan that may be
    notes = [note for note in caught.value.summary["notes"] if "answer" in note]
    assert notes == [
        "[[fault]] 2, nan of plant.speed, acts from 0.8 s on: who is given nan may answer with it"
    ]


def test_the_instruments_read_disturbed_signals() -> None:
    # given
    scenario = with_faults(fault("sensors.gps_north", "offset", 0.0, 9.0))
    with prepared(Request(scenario)) as ready, Simulation(ready.system, ready.plan.values) as simulation:
        # when
        simulation.run(duration=0.4)
        signals: dict[str, list[float]] = {}
        for names, values in simulation.outputs("sensors"):
            for name, value in zip(names, values, strict=True):
                signals.setdefault(name, []).append(float(value))
    # then what comes later holds
    true, disturbed = signals["gps_north"]
    assert disturbed == pytest.approx(true + 5)


def test_picture_map_and_replay_have_the_fixes_that_arrived(tmp_path: Path) -> None:
    # given a receiver that is 5 m too far north
    log = flown(with_faults(fault("sensors.gps_north", "offset", 0.0, 9.0)), tmp_path)
    fixes = log["sensors.gps_fix"] > 0
    north = log["sensors.gps_north"][fixes]
    # then
    (dots,) = [line for line in plots.trial_figure(log).axes[0].lines if line.get_label() == "GPS fix"]
    assert np.asarray(dots.get_ydata()) == pytest.approx(north + 5)
    with (tmp_path / "trial.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        shown = [fix.latitude for *_, fix in reader.iter_decoded_messages(["/map/gps"])]
    plane = TangentPlane(*map(math.radians, log.origin))
    assert shown == pytest.approx([plane.place(x + 5, 0.0)[0] for x in north], abs=1e-9)
    # and estimators are replayed with the fault, and judged against what the receiver gave
    source = open_source(tmp_path / "trial.mcap")
    signals = source.signals([])
    assert signals.gps_north[signals.gps_fix] == pytest.approx(north + 5)
    assert signals.reference_north[signals.reference_fix] == pytest.approx(north)
    assert source.notes == ("the trial's faults of gps_north are in the signals, not in the reference",)


def test_on_board_the_later_of_two_faults_acts_on_what_the_other_gives() -> None:
    # given two faults of what no link takes, and one of what the estimator takes too
    for signal in ("sensors.accel_z", "sensors.accel_x"):
        request = Request(with_faults(*[fault(signal, "offset", 0.0, 9.0)] * 2), onboard="host")
        build_missing(request)
        # when
        with prepared(request) as ready, Simulation(ready.system, ready.plan.values) as simulation:
            simulation.run(duration=0.4)
            name = signal.partition(".")[2]
            given = [
                values[names.index(name)] for names, values in simulation.outputs("sensors") if name in names
            ]
            # then the instruments read both
            true, *disturbed = map(float, given)
        assert disturbed == pytest.approx([true + 5, true + 10])


def test_a_fault_of_a_foreign_plants_mapped_output_is_in_the_roles_unit(tmp_path: Path) -> None:
    # given a dog in a worker, whose km/h a mapping makes m/s
    plant = dog(tmp_path)
    request = Request(with_faults(fault("plant.speed", "offset")), swaps={"plant": plant})
    # when
    with prepared(request) as ready:
        trial.run(request, ready, tmp_path / "out")
    # then 5 m/s are added to 5 m/s for a while
    log = read_log(tmp_path / "out" / "trial.mcap")
    assert log["plant.speed"][19:] == pytest.approx(np.full(32, 5.0))
    expected = [10.0 if 20 <= k < 30 else 5.0 for k in range(19, 51)]
    assert log["sensors.speed"][19:].tolist() == pytest.approx(expected)


MAPPED = [
    V("cmd", "input", "Integer"),
    V("psi", unit="deg"),
    V("zero"),
    *(V(n) for n in ("north", "east", "speed")),
]


def mapped(folder: Path) -> Path:
    """A dog whose command and heading have other names, and whose pitch and roll are one output."""
    path = tiny_fmu(folder / "dog.fmu", MAPPED, "v[1] = 90; v[3] += h * (v[0] == 1);", depends=False)
    path.with_suffix(".toml").write_text(
        '[outputs]\npitch = "zero"\nroll = "zero"\n'
        'heading = { name = "psi", factor = 0.017453292519943295 }\n[inputs]\ncommand = "cmd"\n'
    )
    return path


def test_a_fault_of_an_output_leaves_others_that_the_same_variable_gives(tmp_path: Path) -> None:
    faults = (fault("plant.pitch", "offset", 0.4), fault("plant.heading -> sensors.heading", "offset", 0.4))
    log = flown(with_faults(*faults), tmp_path / "out", swaps={"plant": mapped(tmp_path)})
    off = [np.radians(5.0) if 10 <= k < 30 else 0.0 for k in range(51)]
    assert log["sensors.pitch"].tolist() == pytest.approx(off)
    assert not log["sensors.roll"].any()
    # and of a heading that is mapped, 5 deg are 5 deg
    assert (log["sensors.heading"] - log["plant.heading"])[2:] == pytest.approx(np.array(off[2:]))


def test_a_link_to_a_mapped_input_is_disturbed_by_the_roles_name(tmp_path: Path) -> None:
    # given a dog that calls its command otherwise
    order = Setting("controller.override", "FORWARD", 0.0)
    scenario = with_faults(
        fault("controller.command -> plant.command", "off", 0.4), scenario=replace(SHORT, sets=(order,))
    )
    # when
    log = flown(scenario, tmp_path / "out", swaps={"plant": mapped(tmp_path)})
    # then it does not hear it for a while, and the tables of faults have that, too
    heard = log["plant.command"]
    assert (heard[10:30] == 0).all()
    assert (heard[31:] == 1).all()
    case = Case((fault("controller.command -> plant.command", "off"),))
    assert fitting(Request(SHORT, swaps={"plant": tmp_path / "dog.fmu"}), [case]) == [case]


DEGREES = [  # what a package gives in degrees its reader takes in rad; another one of it, as it is
    ScaledLink("vane", "psi", "boat", "heading", np.radians(1.0), settled=True),
    ScaledLink("vane", "psi", "boat", "shown", settled=True),
    ScaledLink("vane", "warmth", "boat", "kelvin", -1.0, 273.15, settled=True),
]


def of_package(signal: str, kind: str, value: float) -> Any:
    variables = {name: Variable(Type.REAL, name) for name in ("psi", "warmth", "heading", "shown", "kelvin")}
    vane = Interface("vane", {}, {}, "vane", outputs={n: variables[n] for n in ("psi", "warmth")})
    boat = Interface("boat", {}, {n: variables[n] for n in ("heading", "shown", "kelvin")}, "boat")
    scenario = with_faults(Disturbance(signal, kind, 0.4, 0.8, value))
    return resolve_faults(scenario, {"vane": vane, "boat": boat}, DEGREES, 0.04)


@pytest.mark.parametrize(
    ("signal", "kind", "value", "expected"),
    [
        ("vane.psi -> boat.heading", "offset", 20.0, np.radians(20.0)),
        ("vane.psi -> boat.heading", "scale", 20.0, 20.0),
        ("vane.psi -> boat.shown", "jump", 20.0, 20.0),
        ("vane.psi", "scale", 2.0, 2.0),
        ("vane.warmth", "offset", 3.0, -3.0),
        ("vane.warmth", "noise", 3.0, 3.0),
        ("vane.warmth", "dropouts", 0.5, 0.5),
    ],
)
def test_a_value_is_in_the_unit_of_the_signal_whatever_a_package_makes_of_it(
    signal: str, kind: str, value: float, expected: float
) -> None:
    assert of_package(signal, kind, value).values[0]["value"] == expected


@pytest.mark.parametrize(
    ("signal", "kind", "text"),
    [
        (
            "vane.psi",
            "offset",
            r"convert it differently; disturb one: vane\.psi -> boat\.heading, vane\.psi -> boat\.shown",
        ),
        ("vane.warmth", "scale", r'link "vane\.warmth -> boat\.kelvin" adds 273\.15 on the way'),
    ],
)
def test_a_value_that_conversions_leave_unclear_is_refused(signal: str, kind: str, text: str) -> None:
    with pytest.raises(ScenarioError, match=text):
        of_package(signal, kind, 2.0)
