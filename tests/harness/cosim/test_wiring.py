"""What is checked before anything runs: ends of links, start values, connectors, order, step."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from harness.cosim.fmu import Access, FmuDescription, Quantity, Refused
from harness.cosim.ssp import Connector, FmuComponent, FmuSystem, ScaledLink, SspError, StartValue
from harness.cosim.wiring import Delay, Rate, Wiring, find_rate, wire
from models.errors import WiringError
from models.kit.declaration import Type
from tests.harness.cosim.descriptions import fmu, quantity


def node(name: str, *, feedthrough: bool = True) -> FmuDescription:
    """One input u, one output y."""
    return fmu(name, quantity("u", "input"), quantity("y"), feedthrough=feedthrough)


def wired(
    fmus: Sequence[FmuDescription],
    *links: tuple[str, str],
    order: str = "sequential",
    plants: Sequence[str] = (),
    values: dict[str, dict[str, StartValue]] | None = None,
    connectors: dict[str, Connector] | None = None,
    factor: float = 1.0,
) -> Wiring:
    """Wire FMUs by links `a.y`, `b.u`; `values` by component, `connectors` of the first component."""
    components = {f.model: FmuComponent(f.model, f.path, {}, (values or {}).get(f.model, {})) for f in fmus}
    first = fmus[0].model
    components[first] = replace(components[first], connectors=connectors or {})
    ends = [(*source.split("."), *target.split(".")) for source, target in links]
    scaled = tuple(ScaledLink(a, y, b, u, factor) for a, y, b, u in ends)
    system = FmuSystem("toy", components, scaled)
    return wire(system, {f.model: f for f in fmus}, order, plants)  # type: ignore[arg-type]


# order and delays

LOOP = (("plant.y", "filter.u"), ("filter.y", "controller.u"), ("controller.y", "plant.u"))


def test_sources_are_stepped_before_their_targets_and_plants_last() -> None:
    nodes = [node("plant", feedthrough=False), node("controller"), node("filter")]
    wiring = wired(nodes, *LOOP)
    assert wiring.order == ("filter", "controller", "plant")
    assert wiring.plants == {"plant"}
    assert [(str(link), delay) for link, delay in wiring.delays] == [
        ("plant.y -> filter.u", Delay(1, 1)),
        ("filter.y -> controller.u", Delay(0, 0)),
        ("controller.y -> plant.u", Delay(0, 0)),
    ]


def test_jacobi_keeps_the_order_of_the_package_and_delays_every_link() -> None:
    nodes = [node("plant", feedthrough=False), node("controller"), node("filter")]
    wiring = wired(nodes, *LOOP, order="jacobi")
    assert wiring.order == ("controller", "filter", "plant")
    assert [delay for _, delay in wiring.delays] == [Delay(1, 1)] * 3


def test_a_component_that_is_named_a_plant_is_stepped_last() -> None:
    wiring = wired([node("plant"), node("controller")], ("plant.y", "controller.u"), plants=["plant"])
    assert wiring.order == ("controller", "plant")
    assert wiring.plants == {"plant"}


def test_components_without_links_keep_the_order_of_the_package() -> None:
    assert wired([node("b"), node("a"), node("c")]).order == ("b", "a", "c")


def test_a_cycle_without_a_plant_is_named() -> None:
    # given a cycle of three, and a component that feeds it
    links = [("d.y", "a.u"), ("a.y", "b.u"), ("b.y", "c.u"), ("c.y", "a.v")]
    first = fmu("a", quantity("u", "input"), quantity("v", "input"), quantity("y"))
    with pytest.raises(WiringError, match="cycle without a delay: b -> c -> a -> b; sequential"):
        wired([first, node("b"), node("c"), node("d")], *links)
    # and with the order that delays every link it runs
    assert wired([first, node("b"), node("c"), node("d")], *links, order="jacobi").order == (*"abcd",)


# ends of links


@pytest.mark.parametrize(
    ("source", "target", "text"),
    [
        (
            quantity("y", unit="km/h"), quantity("u", "input", unit="m/s"),
            'link a.y -> b.u: the source has unit "km/h", the target "m/s"; '
            "give the connection a LinearTransformation, or export the same unit",
        ),
        (
            quantity("y", unit="kg"), quantity("u", "input", unit="m/s"),
            'link a.y -> b.u: unit "kg" cannot become "m/s"',
        ),
        (
            quantity("y", unit="furlong"), quantity("u", "input", unit="m"),
            'link a.y -> b.u: the source has unit "furlong", the target "m"; '
            "give the connection a LinearTransformation, or export the same unit",
        ),
        (
            quantity("y"), quantity("u", "input", Type.INTEGER),
            "link a.y -> b.u: the source is Real, the target Integer; connect equal types",
        ),
        (
            quantity("y"), quantity("v", "input"),
            'link a.y -> b.u: b.fmu: has no input "u"; known: v',
        ),
        (
            quantity("y", "local"), quantity("u", "input"),
            'link a.y -> b.u: a.fmu: has no output "y" (it is a local)',
        ),
    ],
)  # fmt: skip
def test_ends_that_do_not_fit_are_refused(source: Quantity, target: Quantity, text: str) -> None:
    with pytest.raises(WiringError) as caught:
        wired([fmu("a", source), fmu("b", target)], ("a.y", "b.u"))
    assert str(caught.value) == text


def test_an_output_that_cannot_be_exchanged_says_why() -> None:
    name = fmu("a", refused={"y": Refused("output", "has type String; expected one of Real")})
    with pytest.raises(WiringError, match=r'^link a\.y -> b\.u: a\.fmu: output "y" has type String'):
        wired([name, node("b")], ("a.y", "b.u"))


@pytest.mark.parametrize(
    ("source", "target", "factor"),
    [("m/s", "m.s-1", 1.0), ("km/h", "m/s", 1 / 3.6), (None, "m", 1.0), ("m", None, 1.0), ("yd", "yd", 1.0)],
)
def test_equal_units_and_stated_conversions_are_accepted(
    source: str | None, target: str | None, factor: float
) -> None:
    nodes = [fmu("a", quantity("y", unit=source)), fmu("b", quantity("u", "input", unit=target))]
    assert wired(nodes, ("a.y", "b.u"), factor=factor).order == ("a", "b")


def test_an_input_that_is_fed_twice_is_refused() -> None:
    sources = fmu("a", quantity("y"), quantity("z"))
    with pytest.raises(WiringError, match=r"^b\.u is fed twice: by a\.y -> b\.u and a\.z -> b\.u$"):
        wired([sources, node("b")], ("a.y", "b.u"), ("a.z", "b.u"))


# inputs and start values


def test_inputs_that_no_link_feeds_are_free() -> None:
    last = fmu("b", quantity("u", "input"), quantity("offset", "input"), quantity("y"))
    assert wired([node("a"), last], ("a.y", "b.u")).free == {"a": ("u",), "b": ("offset",)}


def test_an_input_needs_a_source_or_a_start_value() -> None:
    alone = fmu("a", quantity("u", "input", start=None), quantity("y"))
    with pytest.raises(WiringError, match=r"^input a\.u has neither a source nor a start value; connect it$"):
        wired([alone])
    # and a value of the package is one
    assert wired([alone], values={"a": {"u": StartValue(1.0)}}).free == {"a": ("u",)}


def test_a_start_value_for_an_input_that_is_fed_is_refused() -> None:
    with pytest.raises(WiringError, match=r"^input b\.u is given a value, but is fed by a\.y -> b\.u$"):
        wired([node("a"), node("b")], ("a.y", "b.u"), values={"b": {"u": StartValue(1.0)}})


def test_a_start_value_in_another_unit_is_refused() -> None:
    speed = fmu("a", quantity("limit", "parameter", unit="m/s"))
    with pytest.raises(SspError) as caught:
        wired([speed], values={"a": {"limit": StartValue(9.0, "km/h")}})
    assert str(caught.value) == (
        'a.limit is given in "km/h", the FMU declares "m/s"; give the value in the FMU\'s unit, '
        "or map it with a ParameterMapping, which converts it"
    )
    assert wired([speed], values={"a": {"limit": StartValue(2.5, "m/s")}}).order == ("a",)


@pytest.mark.parametrize(
    ("type", "value", "got"),
    [
        (Type.INTEGER, 2.5, "2.5, the FMU declares Integer (int32)"),
        (Type.INTEGER, 3e9, "3e+09, the FMU declares Integer (int32)"),
        (Type.BOOLEAN, 2.0, "2, the FMU declares Boolean (int32)"),
    ],
)
def test_a_start_value_that_would_be_another_one_in_the_fmu_is_refused(
    type: Type, value: float, got: str
) -> None:
    whole = fmu("a", quantity("n", "parameter", type, access=Access("Integer", np.int32)))
    with pytest.raises(SspError) as caught:
        wired([whole], values={"a": {"n": StartValue(value)}})
    assert str(caught.value) == f"a.n is given {got}; give one of those"
    assert wired([whole], values={"a": {"n": StartValue(1.0)}}).order == ("a",)


def test_a_start_value_that_becomes_infinite_in_the_fmu_is_refused() -> None:
    single = fmu("a", quantity("f", "parameter", access=Access("Float32", np.float32)))
    with pytest.raises(SspError) as caught:
        wired([single], values={"a": {"f": StartValue(1e300)}})
    assert str(caught.value) == "a.f is given 1e+300, the FMU declares Real (float32); give one of those"
    assert wired([single], values={"a": {"f": StartValue(3e38)}}).order == ("a",)


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
        (Connector("unknown", "output", "Real"), ""),
    ],
)
def test_a_connector_must_declare_what_its_fmu_declares(connector: Connector, text: str) -> None:
    first = fmu("a", quantity("y", unit="m/s"), quantity("n", type=Type.INTEGER))
    if not text:
        assert wired([first], connectors={connector.name: connector}).step == 0.04
        return
    with pytest.raises(SspError) as caught:
        wired([first], connectors={connector.name: connector})
    assert str(caught.value) == text


# steps


@pytest.mark.parametrize(
    ("steps", "step"),
    [
        ([], 0.04),
        ([(0.01, False), (0.02, False)], 0.02),
        ([(0.01, True), (0.02, False)], 0.01),
        ([(0.01, True), (math.nextafter(0.01, 1), True)], 0.01),
        ([(None, True), (0.05, False)], 0.05),
        ([(0.2, True), (0.001, True)], 0.001),
        ([(0.2, True), (0.04, True), (0.001, True)], 0.04),
        ([(0.2, True), (0.04, False), (0.001, True)], 0.001),
    ],
)
def test_the_tick_is_that_of_our_blocks_or_the_shortest_fixed_step_or_else_the_longest_stated(
    steps: list[tuple[float | None, bool]], step: float
) -> None:
    fmus = [fmu(f"f{i}", quantity("y"), step=h, fixed=fixed) for i, (h, fixed) in enumerate(steps)]
    assert wired([*fmus, node("plain")]).step == step


@pytest.mark.parametrize(
    ("step", "fixed", "rate"),
    [
        (0.04, True, Rate()),
        (0.001, True, Rate(substeps=40)),
        (1e-6, True, Rate(substeps=40_000)),
        (0.04 / 3, True, Rate(substeps=3)),
        (0.2, True, Rate(every=5)),
        (0.12 * (1 + 9e-7), True, Rate(every=3)),
        (1e9, True, Rate(every=25 * 10**9)),
        (0.001, False, Rate()),
        (0.03, False, Rate()),
        (None, True, Rate()),
    ],
)
def test_only_a_fixed_step_differs_from_the_tick(step: float | None, fixed: bool, rate: Rate) -> None:
    assert find_rate("a", fmu("a", step=step, fixed=fixed), 0.04) == rate


@pytest.mark.parametrize(
    ("step", "text"),
    [
        (0.03, "0.03 s; expected a whole multiple or fraction of the tick of 0.04 s of our blocks: "
               "export it with 0.02 or 0.04 s"),
        (0.1, "0.1 s; expected a whole multiple or fraction of the tick of 0.04 s of our blocks: "
              "export it with 0.08 or 0.12 s"),
        (0.12 * (1 + 2e-6), "0.12000024 s; expected a whole multiple or fraction of the tick of 0.04 s of "
                            "our blocks: export it with 0.12 or 0.16 s"),
        (0.003, "0.003 s; expected a whole multiple or fraction of the tick of 0.04 s of our blocks: "
                "export it with 0.00285714 or 0.00307692 s"),
    ],
)  # fmt: skip
def test_a_fixed_step_that_fits_no_tick_is_refused_with_what_would(step: float, text: str) -> None:
    ours, odd = fmu("a", step=0.04, fixed=True), fmu("b", step=step, fixed=True)
    with pytest.raises(WiringError) as caught:
        wired([ours, odd])
    assert str(caught.value) == f"b b.fmu has a fixed step of {text}"


def test_without_a_block_of_ours_the_tick_is_named_by_whose_it_is() -> None:
    with pytest.raises(
        WiringError, match=r"^a a\.fmu .* of the tick of 0\.02 s of b: export it with 0\.04 or"
    ):
        wired([fmu("a", step=0.05, fixed=True), fmu("b", step=0.02, fixed=True)])


@pytest.mark.parametrize(
    ("plant", "controller", "order", "delays"),
    [
        # plant to controller: from the end of its step on; controller to plant: from its beginning on
        (0.001, 0.2, "sequential", ["1 tick", "0 to 4 ticks"]),
        (0.2, 0.04, "sequential", ["5 to 9 ticks", "none"]),
        (0.2, 0.2, "sequential", ["5 ticks", "none"]),
        (0.04, 0.08, "sequential", ["1 tick", "0 to 1 ticks"]),
        # both slow: a step begins 0, 2 or 4 ticks after one of the other
        (0.24, 0.16, "sequential", ["6 to 10 ticks", "0 to 2 ticks"]),
        (0.001, 0.2, "jacobi", ["1 tick", "5 to 9 ticks"]),
        (0.2, 0.04, "jacobi", ["5 to 9 ticks", "1 tick"]),
    ],
)
def test_a_value_that_is_held_grows_older(
    plant: float, controller: float, order: str, delays: list[str]
) -> None:
    ours = fmu("ours", step=0.04, fixed=True)
    parts = [
        fmu(name, quantity("u", "input"), quantity("y"), feedthrough=name != "plant", step=step, fixed=True)
        for name, step in (("plant", plant), ("controller", controller))
    ]
    wiring = wired([ours, *parts], ("plant.y", "controller.u"), ("controller.y", "plant.u"), order=order)
    assert [str(delay) for _, delay in wiring.delays] == delays


@pytest.mark.parametrize(
    ("type", "dtype", "replaced", "got"),
    [
        (Type.INTEGER, np.uint8, 256, "Integer (uint8)"),
        (Type.INTEGER, np.int32, -(2**31) - 1, "Integer (int32)"),
        (Type.BOOLEAN, np.int32, 2, "Boolean (int32)"),
    ],
)
def test_a_table_that_gives_what_its_target_cannot_hold_is_refused(
    type: Type, dtype: npt.DTypeLike, replaced: int, got: str
) -> None:
    access = Access("Any", dtype)
    ends = fmu("a", quantity("y", type=type, access=access)), fmu("b", quantity("u", "input", type))
    b = replace(ends[1], quantities={"u": quantity("u", "input", type, access=access)})
    parts = {"a": ends[0], "b": b}
    components = {name: FmuComponent(name, Path(f"{name}.fmu")) for name in parts}

    def wire_with(replaced: int) -> Wiring:
        link = ScaledLink("a", "y", "b", "u", table=((10**18, 1), (1, replaced)))
        return wire(FmuSystem("toy", components, (link,)), parts)

    with pytest.raises(WiringError) as caught:
        wire_with(replaced)
    assert str(caught.value) == f"link a.y -> b.u: its table gives {replaced}, the target is {got}"
    assert wire_with(0).order == ("a", "b")


def test_a_table_is_for_whole_numbers() -> None:
    parts = {"a": node("a"), "b": node("b")}
    components = {name: FmuComponent(name, Path(f"{name}.fmu")) for name in parts}
    link = ScaledLink("a", "y", "b", "u", table=((1, 2),))
    with pytest.raises(WiringError) as caught:
        wire(FmuSystem("toy", components, (link,)), parts)
    assert str(caught.value) == "link a.y -> b.u: its table replaces whole numbers, the source is Real"
