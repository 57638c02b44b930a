"""Units and tables on connections: converted as they are declared, or refused by name; never quietly."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.cosim.ssp import FmuSystem, ScaledLink
from tests.harness.cosim.ssp.packages import (
    Files,
    component,
    connection,
    enumerations,
    fmu,
    linear,
    package,
    read,
    refusal,
    ssd,
    system,
    table,
    units,
)  # fmt: skip
from tests.harness.cosim.tiny_fmu import V

AS_IT_IS = 'suppressUnitConversion="true"'
PLAIN = fmu(V("u", "input"), V("y"))
CHOICE = fmu(V("u", "input", "Enumeration"), V("y", type="Enumeration"))
WHOLE = fmu(V("u", "input", "Integer"), V("y", type="Integer"))
BOOLEAN = fmu(V("u", "input", "Boolean"), V("y", type="Boolean"))


def toy(path: Path, a: str, b: str, link: str, *more: str, of: bytes = PLAIN) -> Path:
    """a.y to b.u, with these types: `Real m`, or "" where the SSD says nothing."""
    members = component("a", f"y output {a}"), component("b", f"u input {b}")
    text = ssd(system("root", *members, links=link), *more)
    return package(path / "toy.ssp", text, {"resources/a.fmu": of, "resources/b.fmu": of})


def converted(system: FmuSystem) -> tuple[float, float]:
    (link,) = system.links
    assert link.settled
    return link.factor, link.offset


@pytest.mark.parametrize(
    ("types", "link", "expected", "notes"),
    [
        (("Real km", "Real m"), connection("a.y", "b.u"), (1000.0, 0.0),
         ['connection a.y -> b.u: "km" is converted to "m", times 1000']),
        (("Real m", "Real mm"), connection("a.y", "b.u"), (1000.0, 0.0),
         ['connection a.y -> b.u: "m" is converted to "mm", times 1000']),
        (("Real degC", "Real K"), connection("a.y", "b.u"), (1.0, 273.15),
         ['connection a.y -> b.u: "degC" is converted to "K", times 1 plus 273.15']),
        (("Real m", "Real m"), connection("a.y", "b.u"), (1.0, 0.0), []),
        (("Real m", ""), connection("a.y", "b.u"), (1.0, 0.0), []),
        # the linear transformation follows the conversion: 2 * (1000 y) + 5
        (("Real km", "Real m"), connection("a.y", "b.u", linear(2, 5)), (2000.0, 5.0),
         ['connection a.y -> b.u: "km" is converted to "m", times 1000, in addition to its LinearTransformation']),  # noqa: E501
        (("Real km", "Real m"), connection("a.y", "b.u", linear(1000), AS_IT_IS), (1000.0, 0.0), []),
        (("Real km", "Real m"), connection("a.y", "b.u", "", AS_IT_IS), (1.0, 0.0),
         ['connection a.y -> b.u: "km" is taken as "m" as it is (suppressUnitConversion)']),
        (("Real kg", "Real m"), connection("a.y", "b.u", linear(3), AS_IT_IS), (3.0, 0.0), []),
    ],
)  # fmt: skip
def test_units_are_converted_as_the_package_defines_them(
    tmp_path: Path, types: tuple[str, str], link: str, expected: tuple[float, float], notes: list[str]
) -> None:
    made = read(toy(tmp_path, *types, link, units("m", "km", "mm", "K", "degC", "kg")))
    assert converted(made) == expected
    assert list(made.notes) == notes


def test_where_the_package_is_silent_the_fmus_units_count(tmp_path: Path) -> None:
    # given FMUs that declare km/h and m/s, and an SSD without units
    files = {
        "resources/a.fmu": fmu(V("y", unit="km/h")),
        "resources/b.fmu": fmu(V("u", "input", unit="m/s")),
    }
    members = component("a", "y output Real"), component("b", "u input")
    path = package(tmp_path / "toy.ssp", ssd(system("r", *members, links=connection("a.y", "b.u"))), files)
    # then 1 km/h is 0.2777777777777778 m/s
    made = read(path)
    assert converted(made) == (0.2777777777777778, 0.0)
    assert made.notes == ('connection a.y -> b.u: "km/h" is converted to "m/s", times 0.277778',)


@pytest.mark.parametrize("bad", ['factor="0"', 'factor="nan"', 'offset="INF"'])
def test_a_unit_of_an_fmu_that_makes_no_sense_is_refused(tmp_path: Path, bad: str) -> None:
    wrong = fmu(V("y", unit="km/h")).replace(b'factor="0.2777777777777778"', bad.encode())
    files: Files = {"resources/a.fmu": wrong, "resources/b.fmu": fmu(V("u", "input", unit="m/s"))}
    members = component("a", "y output Real"), component("b", "u input")
    path = package(tmp_path / "toy.ssp", ssd(system("r", *members, links=connection("a.y", "b.u"))), files)
    assert refusal(path).startswith('connection a.y -> b.u: unit "km/h" cannot become "m/s": no factor makes')


def test_a_unit_is_carried_through_boundaries_that_declare_none(tmp_path: Path) -> None:
    # given km out, a boundary without a unit, one in mm, and m at the end
    inner = system("inner", component("b", "u input Real m"), ports="in input Real mm",
                   links=connection("in", "b.u"))  # fmt: skip
    outer = system("outer", inner, ports="in input", links=connection("in", "inner.in"))
    root = system("r", component("a", "y output Real km"), outer, links=connection("a.y", "outer.in"))
    files = {"resources/a.fmu": PLAIN, "resources/b.fmu": PLAIN}
    made = read(package(tmp_path / "toy.ssp", ssd(root, units("m", "km", "mm")), files))
    # then the whole is km to m, exactly
    assert converted(made) == (1000.0, 0.0)
    assert [note.partition(":")[0] for note in made.notes] == [
        "connection outer.in -> outer.inner.in", "connection outer.inner.in -> outer.inner.b.u"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("types", "link", "more", "expected"),
    [
        (("Boolean", "Boolean"), table("Boolean", true="false", false="true"), "", {(0, 1), (1, 0)}),
        (("Boolean", "Boolean"), table("Boolean", true="0"), "", {(1, 0)}),
        (("Integer", "Integer"), table("Integer", _3=-7, _4=4), "", {(3, -7)}),
        (("Enumeration E", "Enumeration F"), table("Integer", _4=1, _5=2),
         enumerations(E={"NONE": 0, "LEFT": 4, "RIGHT": 5}, F={"A": 1, "B": 2}), {(4, 1), (5, 2)}),
        # by names: LEFT becomes B, RIGHT A; NONE stays NONE, which has another number there
        (("Enumeration E", "Enumeration F"), table("Enumeration", LEFT="B", RIGHT="A"),
         enumerations(E={"NONE": 0, "LEFT": 4, "RIGHT": 5}, F={"A": 1, "B": 2, "NONE": 9}),
         {(4, 2), (5, 1), (0, 9)}),
    ],
)  # fmt: skip
def test_tables_replace_numbers(
    tmp_path: Path, types: tuple[str, str], link: str, more: str, expected: set[tuple[int, int]]
) -> None:
    of = {"B": BOOLEAN, "I": WHOLE, "E": CHOICE}[types[0][0]]
    (made,) = read(toy(tmp_path, *types, connection("a.y", "b.u", link), more, of=of)).links
    assert set(made.table) == expected
    assert (made.factor, made.offset) == (1.0, 0.0)


def test_an_enumeration_that_the_package_does_not_name_is_the_fmus(tmp_path: Path) -> None:
    # given an FMU whose E is NONE 0, LEFT 4, RIGHT 5
    swapped = table("Enumeration", LEFT="RIGHT", RIGHT="LEFT")
    path = toy(tmp_path, "", "", connection("a.y", "b.u", swapped), of=CHOICE)
    assert read(path).links == (ScaledLink("a", "y", "b", "u", 1.0, 0.0, ((4, 5), (5, 4)), settled=True),)


def test_tables_one_after_the_other_are_one(tmp_path: Path) -> None:
    # given 1 to 2, then 2 to 3 and 7 to 1: so 1 and 2 become 3, and 7 becomes 1
    inner = system("s", component("b", "u input Integer"), ports="in input Integer",
                   links=connection("in", "b.u", table("Integer", _2=3, _7=1)))  # fmt: skip
    link = connection("a.y", "s.in", table("Integer", _1=2))
    root = system("r", component("a", "y output Integer"), inner, links=link)
    files = {"resources/a.fmu": WHOLE, "resources/b.fmu": WHOLE}
    (made,) = read(package(tmp_path / "toy.ssp", ssd(root), files)).links
    assert set(made.table) == {(1, 3), (2, 3), (7, 1)}


E, F = {"NONE": 0, "LEFT": 4}, {"A": 1}
TO = "connection a.y -> b.u"


@pytest.mark.parametrize(
    ("a", "b", "link", "text"),
    [
        ("Real kg", "Real m", "", f'{TO}: unit "kg" cannot become "m": no factor makes one of the other; '
         'connect equal units, or state suppressUnitConversion="true"'),
        ("Real furlong", "Real m", "", f'{TO}: unit "furlong" cannot become "m": nobody defines "furlong"; '
         'connect equal units, or state suppressUnitConversion="true"'),
        ("Integer", "Integer", linear(2), f"{TO}: its LinearTransformation is for Real, a.y is Integer"),
        ("Real", "Real", table("Integer", _1=2),
         f"{TO}: its IntegerMappingTransformation is for Integer or Enumeration, a.y is Real"),
        ("Integer", "Boolean", table("Integer", _1=0),
         f"{TO}: its IntegerMappingTransformation is for Integer or Enumeration, b.u is Boolean"),
        ("Integer", "Integer", table("Boolean", true="false"),
         f"{TO}: its BooleanMappingTransformation is for Boolean, a.y is Integer"),
        ("Enumeration E", "Enumeration F", table("Enumeration", LEFT="A"),
         f'{TO}: the enumeration has no item "NONE"; known: A'),
        ("Enumeration E", "Enumeration F", table("Enumeration", LEFT="A", NONE="B"),
         f'{TO}: the enumeration has no item "B"; known: A'),
        ("Enumeration E", "Enumeration F", table("Enumeration", RIGHT="A"),
         f'{TO}: the enumeration has no item "RIGHT"; known: LEFT, NONE'),
        ("Integer", "Integer", table("Integer", _1=2) + linear(2),
         f"{TO} holds IntegerMappingTransformation and LinearTransformation; expected one transformation"),
        ("Integer", "Integer", table("Integer", _1=2, __1=3), f'{TO}: two entries map "1"; expected one'),
        ("Integer", "Integer", table("Integer", _1="x"), 'MapEntry has target="x"; expected a whole number'),
        ("Integer", "Integer", table("Integer", _1=2**63),
         f'MapEntry has target="{2**63}"; expected a whole number'),
        ("Boolean", "Boolean", table("Boolean", yes="false"),
         'MapEntry has source="yes"; expected true or false'),
        ("String", "String", "",
         f"{TO}: a.y is of type String; expected Real, Integer, Boolean or Enumeration"),
        ("Enumeration G", "Enumeration F", table("Enumeration", LEFT="A"),
         f"{TO}: the enumeration at its start is unknown; declare it there"),
        ("Real", "Real", linear("nan"), 'LinearTransformation has factor="nan"; expected a finite number'),
        ("Real", "Real", linear(1, "x"), 'LinearTransformation has offset="x"; expected a number'),
        ("Real", "Real", linear(0), f"{TO}: a LinearTransformation with factor 0 passes nothing on"),
    ],
)  # fmt: skip
def test_refuses_by_name(tmp_path: Path, a: str, b: str, link: str, text: str) -> None:
    members = component("a", f"y output {a}"), component("b", f"u input {b}")
    root = system("root", *members, links=connection("a.y", "b.u", link))
    structure = ssd(root, enumerations(E=E, F=F), units("m", "kg"), valid=False)
    files = {"resources/a.fmu": PLAIN, "resources/b.fmu": PLAIN}
    assert refusal(package(tmp_path / "toy.ssp", structure, files)) == text


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (units("m", "m"), 'unit "m" is defined twice'),
        ('<ssd:Units><ssc:Unit name="x"/></ssd:Units>', 'unit "x" has no BaseUnit'),
        ('<ssd:Units><ssc:Unit name="x"><ssc:BaseUnit factor="0"/></ssc:Unit></ssd:Units>',
         'unit "x" has the factor 0'),
        ('<ssd:Units><ssc:Unit name="x"><ssc:BaseUnit m="1.5"/></ssc:Unit></ssd:Units>',
         'BaseUnit has m="1.5"; expected a whole number'),
        (enumerations(E={"A": 1}) + enumerations(E={"A": 1}),
         'SystemStructureDescription "toy" holds two Enumerations; expected one'),
        ('<ssd:Enumerations><ssc:Enumeration name="E"><ssc:Item name="A" value="1"/>'
         '<ssc:Item name="A" value="2"/></ssc:Enumeration></ssd:Enumerations>',
         'enumeration "E" has two items "A"'),
    ],
)  # fmt: skip
def test_bad_definitions_are_refused(tmp_path: Path, more: str, text: str) -> None:
    structure = ssd(system("root"), more, valid=False)
    assert refusal(package(tmp_path / "toy.ssp", structure)) == text
