"""Parameter bindings: names, precedence, prefixes, mappings, and where sets may lie."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import pytest

from harness.cosim.ssp import SspError, StartValue
from tests.harness.cosim.ssp.packages import (
    Files,
    bind,
    binding,
    check,
    component,
    connection,
    entry,
    enumerations,
    fmu,
    linear,
    mapping,
    package,
    parameters,
    read,
    refusal,
    ssd,
    system,
    table,
    units,
)  # fmt: skip
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

FMU = fmu(
    V("k", "parameter", unit="m"), V("n", "parameter", "Integer"), V("b", "parameter", "Boolean"),
    V("e", "parameter", "Enumeration"), V("sub.k", "parameter"), V("u", "input"), V("y"),
    V("s", "parameter", "String"),
)  # fmt: skip
PORTS = ("k parameter Real m", "u input Real")


def values(path: Path) -> dict[str, dict[str, float]]:
    return {n: {k: v.value for k, v in c.values.items()} for n, c in read(path).components.items()}


def made(path: Path, root: str, **files: str) -> Path:
    return package(
        path / "toy.ssp",
        ssd(root, units("m", "km")),
        {"resources/a.fmu": FMU, "resources/b.fmu": FMU}
        | {name.replace("__", "."): content for name, content in files.items()},
    )


def alone(path: Path, bindings: str, **files: str) -> Path:
    """One component with these bindings."""
    return made(path, system("root", component("a", *PORTS, bindings=bindings)), **files)


def test_later_bindings_win_and_outer_ones_over_inner(tmp_path: Path) -> None:
    # given k bound to 1 and then 2 in the component, b.k to 3 in the system around it, s.b.k to 4 at the root
    own = bind(binding(parameters(k="Real 1", n="Integer 1")), binding(parameters(k="Real 2")))
    inner = bind(binding(parameters(b__k="Real 3", b__n="Integer 3", b__u="Real 3")))
    outer = bind(
        binding(parameters(s__b__k="Real 4", s__b__u="Real 4")), binding(parameters(s__b__u="Real 5"))
    )
    members = component("a", *PORTS, bindings=own), component("b", *PORTS, bindings=own)
    root = system("root", members[0], system("s", members[1], bindings=inner), bindings=outer)
    # then
    assert values(made(tmp_path, root)) == {"a": {"k": 2, "n": 1}, "s.b": {"k": 4, "n": 3, "u": 5}}


def test_a_prefix_makes_the_set_of_a_component_one_of_its_system(tmp_path: Path) -> None:
    # given one set that is bound at the root with the prefix "s.b.", and "" for the root's own connector
    root = system(
        "root", system("s", component("b", *PORTS)), component("a", *PORTS), ports="k parameter",
        links=connection("k", "a.k"),
        bindings=bind(binding(source="set.ssv", more='prefix="s.b."'), binding(source="set.ssv")),
    )  # fmt: skip
    assert values(made(tmp_path, root, set__ssv=parameters(k="Real 7"))) == {"a": {"k": 7}, "s.b": {"k": 7}}


def test_names_with_dots_mean_all_that_they_can(tmp_path: Path) -> None:
    # given "s.sub.k": the parameter sub.k of component s, and k of component sub in a system... of one name
    inner = component("sub", "k parameter Real", source="resources/b.fmu")
    root = system("root", component("s", source="resources/a.fmu"), system("s.x", inner),
                  bindings=bind(binding(parameters(s__sub__k="Real 1", s__x__sub__k="Real 2"))))  # fmt: skip
    assert values(made(tmp_path, root)) == {"s": {"sub.k": 1}, "s.x.sub": {"k": 2}}
    # and where both are there, both get it
    root = system("root", component("s", source="resources/a.fmu"),
                  component("s.sub", source="resources/b.fmu"),
                  bindings=bind(binding(parameters(s__sub__k="Real 3"))))  # fmt: skip
    assert values(made(tmp_path, root)) == {"s": {"sub.k": 3}, "s.sub": {"k": 3}}


def test_names_that_belong_to_nothing_are_noted(tmp_path: Path) -> None:
    # given a set that is larger than what it is bound to, and a mapping of what it lacks
    own = bind(binding(parameters(k="Real 1", q="Real 1", r="String x")))
    mapped = bind(binding(parameters(a__k="Real 2"), mapping(entry("a.k", "a.k"), entry("z", "a.n"))))
    made_of = read(made(tmp_path, system("root", component("a", *PORTS, bindings=own), bindings=mapped)))
    assert made_of.components["a"].values == {"k": StartValue(2.0)}
    assert made_of.notes == (
        'component "a": parameter binding: 2 names belong to nothing and are not set: q, r',
        "the system: parameter mapping: 1 names belong to nothing and are not set: z",
    )


def test_values_of_every_type(tmp_path: Path) -> None:
    # given an FMU whose enumeration has LEFT 4; connectors say nothing of it
    every = parameters(k="Real -2.5e-3 m", n="Integer -7", b="Boolean true", e="Enumeration LEFT")
    path = alone(
        tmp_path,
        bind(binding(every.replace("</ssv:Parameters>", "</ssv:Parameters>" + units("m", prefix="ssv")))),
    )
    assert values(path) == {"a": {"k": -2.5e-3, "n": -7, "b": 1, "e": 4}}
    assert read(path).components["a"].values["k"] == StartValue(-2.5e-3, "m")
    # and the types that SSP 2.0 added
    newer = parameters(version="2.0", k="Float32 0.5", n="UInt8 200")
    text = ssd(system("root", component("a", "k parameter Float64 m", "n parameter Int32", bindings=bind(binding(newer)))),  # noqa: E501
               version="2.0")  # fmt: skip
    path = package(tmp_path / "toy.ssp", text, {"resources/a.fmu": FMU})
    assert values(path) == {"a": {"k": 0.5, "n": 200}}


def test_a_mapping_renames_transforms_and_converts(tmp_path: Path) -> None:
    # given a set in km and degrees of choice, mapped to metres
    stated = parameters(
        units("km", prefix="ssv") + enumerations("ssv", G={"PORT": 1, "STARBOARD": 2}),
        length="Real 1.5 km", gain="Real 3", count="Integer 2", off="Boolean false",
        side="Enumeration PORT G", other="Real 99",
    )  # fmt: skip
    entries = (
        entry("length", "k", linear(2, 1)),  # 2 * 1500 + 1
        entry("gain", "u", linear(0.1, 0.2)),  # 0.5, where floats make 0.5000000000000001 of 3 * 0.1 + 0.2
        entry("count", "n", table("Integer", _2=-5)),
        entry("off", "b", table("Boolean", false="true")),
        entry("side", "e", table("Enumeration", PORT="LEFT")),
        entry("gain", "sub.k"),  # one value may go to several names
    )
    path = alone(tmp_path, bind(binding(stated, mapping(*entries))))
    # then what no entry names is not set
    assert values(path) == {"a": {"k": 3001, "u": 0.5, "n": -5, "b": 1, "e": 4, "sub.k": 3}}
    assert read(path).components["a"].values["k"].unit == "m"


def test_a_conversion_and_its_transformation_are_rounded_once(tmp_path: Path) -> None:
    # given 0.1 km, 100 m, of which 0.007 are taken; floats make 0.7000000000000001 of it
    stated = parameters(units("km", prefix="ssv"), length="Real 0.1 km")
    scaled = entry("length", "k", linear(0.007))
    assert 0.1 * 1000 * 0.007 != 0.7
    assert values(alone(tmp_path, bind(binding(stated, mapping(scaled))))) == {"a": {"k": 0.7}}


def test_a_mapping_may_keep_units_from_being_converted(tmp_path: Path) -> None:
    stated = parameters(units("km", prefix="ssv"), length="Real 1.5 km")
    kept = entry("length", "k", linear(1000), 'suppressUnitConversion="true"')
    path = alone(tmp_path, bind(binding(stated, mapping(kept))))
    # then what was 1.5 km is 1500 of the FMU's unit, and no other unit is left to be refused
    assert read(path).components["a"].values == {"k": StartValue(1500, "m")}


@pytest.mark.parametrize("number", ["1_000", "\u0661\u0662", "1e3_0"])
@pytest.mark.parametrize("type", ["Real", "Integer"])
def test_what_only_python_takes_as_a_number_is_refused(tmp_path: Path, type: str, number: str) -> None:
    stated = parameters(k=f"{type} {number}")
    path = alone(tmp_path, bind(binding(stated)))
    with pytest.raises(SspError, match=rf'has value="{re.escape(number)}"; expected a .*number'):
        read(path)


def test_an_integer_mapping_takes_the_numbers_of_the_sets_own_enumeration(tmp_path: Path) -> None:
    stated = parameters(enumerations("ssv", G={"PORT": 1}), side="Enumeration PORT G")
    turned = entry("side", "n", table("Integer", _1=8))
    assert values(alone(tmp_path, bind(binding(stated, mapping(turned))))) == {"a": {"n": 8}}


def test_sets_and_mappings_lie_beside_the_structure_or_inside_an_fmu(tmp_path: Path) -> None:
    # given a set in resources/, and a mapping that the FMU brings itself
    beside = '<ssd:ParameterMapping source="resources/map.ssm" sourceBase="SSD"/>'
    within = '<ssd:ParameterMapping source="extra/own.ssm" sourceBase="component"/>'
    set_, one, two = parameters(q="Real 6"), mapping(entry("q", "k")), mapping(entry("q", "n", linear(2)))
    check("ParameterValues", set_)
    check("ParameterMapping", one)
    a = tiny_fmu(tmp_path / "a.fmu", [V("k", "parameter"), V("n", "parameter"), V("y")])
    with zipfile.ZipFile(a, "a") as archive:
        archive.writestr("extra/own.ssm", two)
        archive.writestr("own.ssv", set_)
    bindings = bind(
        binding(source="resources/set.ssv", mapped=beside),
        binding(source="own.ssv", mapped=within, more='sourceBase="component"'),
    )
    text = ssd(system("root", component("a", bindings=bindings)))
    files: Files = {"resources/a.fmu": a, "resources/set.ssv": set_, "resources/map.ssm": one}
    path = package(tmp_path / "toy.ssp", text, files)
    # then
    assert values(path) == {"a": {"k": 6, "n": 12}}
    assert set(read(path).files) == {"SystemStructure.ssd", *files}


SET = parameters(k="Real 1")
HERE = 'component "a": parameter binding'


@pytest.mark.parametrize(
    ("bindings", "text"),
    [
        (binding(parameters(k="Real x")), 'Real has value="x"; expected a number'),
        (binding(parameters(k="Real inf")), 'Real has value="inf"; expected a finite number'),
        (binding(parameters(n="Integer 1.5")), 'Integer has value="1.5"; expected a whole number'),
        (binding(parameters(b="Boolean yes")), 'Boolean has value="yes"; expected true or false'),
        (binding(parameters(e="Enumeration LEF")),
         'parameter "e" is "LEF", which its enumeration lacks; did you mean "LEFT"?'),
        (binding(parameters(e="Enumeration 3")),
         'parameter "e" is "3", which its enumeration lacks; known: LEFT, NONE, RIGHT'),
        (binding(parameters(e="Enumeration --5")),
         'parameter "e" is "--5", which its enumeration lacks; known: LEFT, NONE, RIGHT'),
        (binding(parameters(n=f"Integer {2**53 + 1}")),
         f'{HERE}: parameter "n" is {2**53 + 1}, which no double holds'),
        (binding(parameters(n="Enumeration LEFT")),
         'parameter "n" is "LEFT" of an enumeration that nobody defines; '
         "name the enumeration and define it in Enumerations"),
        (binding(parameters(s="String x")),
         'parameter "s" holds a String; expected Real, Integer, Boolean or Enumeration'),
        (binding(SET.replace('"1.0"', '"3.0"')),
         f'{HERE}: its content is of SSP version "3.0"; expected "1.0" or "2.0"'),
        (binding(mapping()),
         f"{HERE}: its content is {{http://ssp-standard.org/SSP1/SystemStructureParameterMapping}}ParameterMapping; "  # noqa: E501
         "expected an SSP 1.0 or 2.0 ParameterSet"),
        (binding(SET, source="set.ssv"),
         f'{HERE} has source "set.ssv" and content of its own; expected one of both'),
        (binding(), f"{HERE} has no source and holds 0 sets or mappings; expected one"),
        (binding(source="no.ssv"), f'{HERE} has source "no.ssv", which is not in the package'),
        (binding(source="no.ssv", more='sourceBase="component"'),
         f'{HERE} has source "no.ssv", which is not in a.fmu'),
        (binding(source="../set.ssv", more='sourceBase="component"'),
         f'{HERE} has source "../set.ssv", which is not in a.fmu'),
        (binding(source="/etc/hostname", more='sourceBase="component"'),
         f'{HERE} has source "/etc/hostname", which is not in a.fmu'),
        (binding(source="set.ssv", more='sourceBase="FMU"'),
         f'{HERE} has sourceBase "FMU"; expected SSD or component'),
        (binding(SET, more='type="text/csv"'),
         f'{HERE} has type "text/csv"; expected "application/x-ssp-parameter-set"'),
        (binding(SET.replace("</ssv:Parameters>", '<ssv:Parameter name="k"><ssv:Real value="2"/></ssv:Parameter></ssv:Parameters>')),  # noqa: E501
         f'{HERE}: parameter "k" is there twice'),
        (binding(SET.replace('<ssv:Real value="1"/>', "")),
         f'{HERE}: parameter "k" holds nothing; expected one typed value'),
        (binding(SET.replace("</ssv:Parameter>", '<ssc:Dimension size="2"/></ssv:Parameter>')),
         f'{HERE}: parameter "k" is an array, which is not supported'),
        (binding(SET, mapping(entry("k", "n"), entry("k", "n"))),
         'mapping of "k" to "n": another entry maps to it; expected one'),
        (binding(SET, mapping(entry("k", "k", table("Integer", _1=2)))),
         'mapping of "k" to "k": its IntegerMappingTransformation is for Integer or Enumeration, '
         'parameter "k" is Real'),
        (binding(parameters(k="Real 1e300"), mapping(entry("k", "k", linear(1e300)))),
         'parameter "k" leaves the range of a double on its way'),
        (binding(parameters(units("kg", prefix="ssv"), q="Real 1 kg"), mapping(entry("q", "k"))),
         'mapping of "q" to "k": unit "kg" cannot become "m"; '
         'define both, or state suppressUnitConversion="true"'),
    ],
)  # fmt: skip
def test_refuses_by_name(tmp_path: Path, bindings: str, text: str) -> None:
    root = system("root", component("a", *PORTS, bindings=bind(bindings)))
    path = package(tmp_path / "toy.ssp", ssd(root, units("m"), valid=False), {"resources/a.fmu": FMU})
    assert refusal(path) == text


def test_a_system_has_no_file_for_a_source_to_lie_in(tmp_path: Path) -> None:
    bindings = bind(binding(source="set.ssv", more='sourceBase="component"'))
    text = (
        'the system: parameter binding has sourceBase "component"; expected SSD, for it belongs to a system'
    )
    assert refusal(made(tmp_path, system("root", component("a"), bindings=bindings))) == text


def test_a_value_in_another_unit_than_its_connector_is_refused(tmp_path: Path) -> None:
    stated = parameters(units("km", prefix="ssv"), x="Real 1 km")
    root = system("root", component("a", *PORTS), ports="x parameter Real m", links=connection("x", "a.k"),
                  bindings=bind(binding(stated)))  # fmt: skip
    assert refusal(made(tmp_path, root)) == (
        'parameter "x" is given in "km", connector x is in "m"; give it in that unit, or map it'
    )
