"""The master against plain Python: orders, delays, events, stops, conversions; and the wiring's checks."""

from pathlib import Path

import numpy as np
import pytest

from harness.cosim.fmu import describe
from harness.cosim.loop import Event, Simulation, Stop
from harness.cosim.ssp import Connector, FmuComponent, FmuSystem, ScaledLink, SspError, StartValue
from harness.cosim.wiring import wire
from models.errors import ParameterError, WiringError
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

# plant: x+ = x + u, y = x. filter: y = 2 u. controller: command = u + offset, n counts.
PLANT = ([V("u", "input"), V("y"), V("zero")], "v[1] += v[0];")
FILTER = ([V("u", "input"), V("y")], "v[1] = 2 * v[0];")
CONTROLLER = (
    [V("u", "input"), V("offset", "input"), V("y"), V("n", type="Integer")],
    "v[2] = v[0] + v[1]; v[3] += 1;",
)
LINKS = (
    ScaledLink("plant", "y", "filter", "u"),
    ScaledLink("filter", "y", "controller", "u"),
    ScaledLink("controller", "y", "plant", "u"),
)


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("fmus")
    plant = tiny_fmu(folder / "plant.fmu", *PLANT, depends=False, start="v[1] = 1;")
    return {
        "plant": plant,
        "filter": tiny_fmu(folder / "filter.fmu", *FILTER, version=3),
        "controller": tiny_fmu(folder / "controller.fmu", *CONTROLLER),
    }


def system(fmus: dict[str, Path], links: tuple[ScaledLink, ...] = LINKS, **values: float) -> FmuSystem:
    given = {"controller": {name: StartValue(x) for name, x in values.items()}}
    members = {name: FmuComponent(name, path, {}, given.get(name, {})) for name, path in fmus.items()}
    return FmuSystem("toy", members, links)


def rows_of(
    description: FmuSystem, order: str = "sequential", ticks: int = 4, **run: object
) -> dict[str, list]:
    chunks = []
    with Simulation(description, {}, order) as simulation:  # type: ignore[arg-type]
        simulation.run(duration=0.04 * (ticks - 1), record=lambda t, v: chunks.append((t, v)), **run)  # type: ignore[arg-type]
        return {
            f"{name}.{column.name}": np.concatenate([v[name] for _, v in chunks])[:, i].tolist()
            for name in simulation.components
            for i, column in enumerate(simulation.columns(name))
        }


def test_sequential_only_the_plant_delays(fmus: dict[str, Path]) -> None:
    # given x0 = 1; within a tick the command is 2 x, so x+ = x + 2 x
    rows = rows_of(system(fmus))
    # then each row holds the plant's output at t_k and everybody's answer to it
    assert rows["plant.y"] == [1, 3, 9, 27]
    assert rows["filter.u"] == [1, 3, 9, 27]
    assert rows["filter.y"] == [2, 6, 18, 54]
    assert rows["controller.y"] == [2, 6, 18, 54]
    assert rows["plant.u"] == [2, 6, 18, 54]


def test_jacobi_every_link_delays_one_tick(fmus: dict[str, Path]) -> None:
    # given exchange all, then step all, in plain Python
    x, f, c = 1.0, 0.0, 0.0
    expected = []
    for _ in range(8):
        into_filter, into_controller, into_plant = x, f, c
        f, c = 2 * into_filter, into_controller
        expected.append((x, into_filter, f, into_controller, c, into_plant))
        x += into_plant
    # when
    rows = rows_of(system(fmus), "jacobi", ticks=8)
    # then
    names = ("plant.y", "filter.u", "filter.y", "controller.u", "controller.y", "plant.u")
    assert list(zip(*(rows[name] for name in names), strict=True)) == expected
    assert rows["plant.y"] == [1, 1, 1, 3, 5, 7, 13, 23]


def test_time_is_a_multiple_and_rows_come_in_whole(fmus: dict[str, Path]) -> None:
    # given 61 ticks: two batches of 25 and one of 11
    times: list[float] = []
    with Simulation(system(fmus)) as simulation:
        outcome = simulation.run(duration=2.4, record=lambda t, v: times.extend(t.tolist()))
    assert times == [k * 0.04 for k in range(61)]
    assert (outcome.ticks, outcome.time, outcome.stopped_by) == (61, 60 * 0.04, None)


def test_it_stops_with_a_row_for_the_tick_that_stops_it(fmus: dict[str, Path]) -> None:
    rows = []
    with Simulation(system(fmus)) as simulation:
        stop = Stop("controller", "n", frozenset({7}))
        outcome = simulation.run(stop=stop, record=lambda t, v: rows.extend(v["controller"][:, -1]))
    assert outcome.stopped_by == 7
    assert outcome.time == pytest.approx(6 * 0.04)
    assert rows == [1, 2, 3, 4, 5, 6, 7]


def test_events_act_from_the_first_tick_at_or_after_their_time(fmus: dict[str, Path]) -> None:
    # given 0.05 s lies between tick 1 and tick 2, 0.12 s is tick 3
    events = [Event(0.12, "controller", "offset", 0.5), Event(0.05, "controller", "offset", -1.0)]
    rows = rows_of(system(fmus), ticks=5, events=events)
    assert rows["controller.offset"] == [0, 0, -1, 0.5, 0.5]


def test_conversion_and_types_on_the_way(fmus: dict[str, Path]) -> None:
    # given y in other units: 0.5 y + 10
    links = (ScaledLink("plant", "y", "filter", "u", 0.5, 10.0), *LINKS[1:])
    rows = rows_of(system(fmus, links), ticks=2)
    assert rows["filter.u"] == [10.5, 10.5 + 21 / 2]
    assert rows["plant.y"] == [1, 22]


def test_start_values_of_the_package_hold(fmus: dict[str, Path]) -> None:
    assert rows_of(system(fmus, offset=3.0), ticks=2)["controller.y"] == [5, 15]


def test_only_free_inputs_can_be_set(fmus: dict[str, Path]) -> None:
    for variable, text in (
        ("u", "controller.u is connected; only free inputs can be set"),
        ("offste", 'controller.offste is no input; did you mean "offset"?'),
    ):
        with Simulation(system(fmus)) as simulation, pytest.raises(ParameterError) as caught:
            simulation.run([Event(0.0, "controller", variable, 1.0)])
        assert str(caught.value) == text


def test_delays_are_told(fmus: dict[str, Path]) -> None:
    descriptions = {name: describe(path) for name, path in fmus.items()}
    found = wire(system(fmus), descriptions)
    assert found.order == ("filter", "controller", "plant")
    assert found.plants == {"plant"}
    assert [ticks for _, ticks in found.delays] == [1, 0, 0]
    assert [ticks for _, ticks in wire(system(fmus), descriptions, "jacobi").delays] == [1, 1, 1]


def wrong(tmp_path: Path, links: tuple[ScaledLink, ...], **parts: list[V]) -> str:
    paths = {name: tiny_fmu(tmp_path / f"{name}.fmu", variables) for name, variables in parts.items()}
    description = FmuSystem("toy", {name: FmuComponent(name, path) for name, path in paths.items()}, links)
    with pytest.raises(WiringError) as caught:
        wire(description, {name: describe(path) for name, path in paths.items()})
    return str(caught.value)


@pytest.mark.parametrize(
    ("source", "target", "text"),
    [
        (
            V("y", unit="km/h"), V("u", "input", unit="m/s"),
            'link a.y -> b.u: the source has unit "km/h", the target "m/s"; '
            "give the connection a LinearTransformation, or export the same unit",
        ),
        (
            V("y", unit="kg"), V("u", "input", unit="m/s"),
            'link a.y -> b.u: unit "kg" cannot become "m/s"',
        ),
        (
            V("y"), V("u", "input", "Integer"),
            "link a.y -> b.u: the source is Real, the target Integer; connect equal types",
        ),
        (
            V("y"), V("v", "input"),
            'link a.y -> b.u: b.fmu: has no input "u"; known: v',
        ),
        (
            V("y", "local"), V("u", "input"),
            'link a.y -> b.u: a.fmu: has no output "y" (it is a local)',
        ),
        (
            V("y", type="String"), V("u", "input"),
            'link a.y -> b.u: a.fmu: output "y" has type String; expected one of Real, Integer, Enumeration, Boolean',  # noqa: E501
        ),
    ],
)  # fmt: skip
def test_ends_that_do_not_fit_are_refused(tmp_path: Path, source: V, target: V, text: str) -> None:
    assert wrong(tmp_path, (ScaledLink("a", "y", "b", "u"),), a=[source], b=[target]) == text


def test_a_cycle_without_a_plant_is_named(tmp_path: Path) -> None:
    both = [V("u", "input"), V("y")]
    links = (ScaledLink("a", "y", "b", "u"), ScaledLink("b", "y", "a", "u"))
    assert wrong(tmp_path, links, a=both, b=both).startswith("cycle without a delay: b -> a -> b; ")


def test_an_input_fed_twice_is_refused(tmp_path: Path) -> None:
    links = (ScaledLink("a", "y", "b", "u"), ScaledLink("a", "z", "b", "u"))
    text = wrong(tmp_path, links, a=[V("y"), V("z")], b=[V("u", "input")])
    assert text == "b.u is fed twice: by a.y -> b.u and a.z -> b.u"


def test_steps_must_agree(tmp_path: Path) -> None:
    # given steps of 0.04 s and 0.08 s that cannot be varied: the first takes no step of 0.08 s
    paths = {
        name: tiny_fmu(tmp_path / f"{name}.fmu", [V("y")], step_size=size, fixed=True)
        for name, size in (("a", 0.04), ("b", 0.08))
    }
    members = {name: FmuComponent(name, path) for name, path in paths.items()}
    with pytest.raises(WiringError) as caught:
        wire(FmuSystem("toy", members, ()), {name: describe(path) for name, path in paths.items()})
    assert str(caught.value) == (
        "a has a fixed step of 0.04 s, b of 0.08 s; "
        "all components take one step: export one of them with the other's"
    )


@pytest.mark.parametrize(
    ("connector", "text"),
    [
        (
            Connector("y", "output", "Real", "km/h"),
            'connector a.y has unit "km/h", a.fmu declares unit "m/s"; '
            "write into the package what the FMU declares",
        ),
        (
            Connector("y", "output", "Integer"),
            "connector a.y has type Integer, a.fmu declares type Real; "
            "write into the package what the FMU declares",
        ),
        (Connector("y", "output", "Real", "m/s"), ""),
        (Connector("y", "output"), ""),
        (Connector("n", "output", "Enumeration"), ""),
    ],
)
def test_what_the_package_says_of_a_variable_is_compared(
    tmp_path: Path, connector: Connector, text: str
) -> None:
    path = tiny_fmu(tmp_path / "a.fmu", [V("y", unit="m/s"), V("n", type="Integer")])
    description = FmuSystem("toy", {"a": FmuComponent("a", path, {connector.name: connector})}, ())
    if not text:
        assert wire(description, {"a": describe(path)}).step == 0.04
        return
    with pytest.raises(SspError) as caught:
        wire(description, {"a": describe(path)})
    assert str(caught.value) == text
