"""Nested systems: components by their full names, links through boundaries, exactly."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.cosim.ssp import ScaledLink, StartValue
from tests.harness.cosim.ssp.packages import (
    bind,
    binding,
    component,
    connection,
    fmu,
    linear,
    package,
    parameters,
    read,
    refusal,
    ssd,
    system,
)  # fmt: skip
from tests.harness.cosim.tiny_fmu import V

FMU = fmu(V("u", "input"), V("w", "input"), V("k", "parameter"), V("y"))
PORTS = ("u input Real", "w input Real", "k parameter Real", "y output Real")


def made(path: Path, root: str, *names: str, valid: bool = True) -> Path:
    files = {f"resources/{name}.fmu": FMU for name in names}
    return package(path / "toy.ssp", ssd(root, valid=valid), files)


def part(name: str) -> str:
    return component(name, *PORTS, source="resources/a.fmu")


def test_a_link_through_three_boundaries_is_composed_exactly(tmp_path: Path) -> None:
    # given a.y out of "left" and, two levels down, into "right.deep": times 0.1 plus 0.3, times 10, minus 3
    left = system("left", part("a"), ports="out output", links=connection("a.y", "out", linear(0.1, 0.3)))
    deep = system("deep", part("b"), ports="in input", links=connection("in", "b.u"))
    right = system("right", deep, ports="in input", links=connection("in", "deep.in", linear(1, -3)))
    root = system("root", left, right, links=connection("left.out", "right.in", linear(10)))
    # when
    toy = read(made(tmp_path, root, "a"))
    # then in floats 0.1 * 10 and 0.3 * 10 - 3 would do as well, 0.1 * 3 * 10 - 3 would not
    assert list(toy.components) == ["left.a", "right.deep.b"]
    assert toy.links == (ScaledLink("left.a", "y", "right.deep.b", "u", settled=True),)
    assert not toy.links[0].converts


def test_thirds_of_a_factor_are_rounded_once(tmp_path: Path) -> None:
    # given 0.1 and 0.7 and 0.3 one after the other: 0.021, where floats make 0.020999999999999998
    links = connection("in", "b.u", linear(0.3))
    inner = system("inner", part("b"), ports="in input", links=links)
    outer = system("outer", inner, ports="in input", links=connection("in", "inner.in", linear(0.7)))
    root = system("root", part("a"), outer, links=connection("a.y", "outer.in", linear(0.1)))
    assert 0.1 * 0.7 * 0.3 != 0.021
    assert read(made(tmp_path, root, "a")).links[0].factor == 0.021


def test_an_output_reaches_several_systems_and_passes_through_one(tmp_path: Path) -> None:
    # given "through", which hands its input on and to a component of its own
    through = system(
        "through", part("c"), ports="in input, out output",
        links=connection("in", "c.u") + connection("in", "out", linear(2)),
    )  # fmt: skip
    links = connection("a.y", "through.in") + connection("through.out", "b.u") + connection("a.y", "b.w")
    # when
    toy = read(made(tmp_path, system("root", part("a"), part("b"), through, links=links), "a"))
    # then in the order of the connections
    assert [(str(k), k.factor) for k in toy.links] == [
        ("a.y -> through.c.u", 1.0), ("a.y -> b.u", 2.0), ("a.y -> b.w", 1.0)
    ]  # fmt: skip


def test_start_and_end_may_be_exchanged(tmp_path: Path) -> None:
    # given connections that start at what takes the value: the kinds of the connectors tell
    inner = system("inner", part("b"), ports="in input, out output",
                   links=connection("b.u", "in") + connection("out", "b.y"))  # fmt: skip
    links = connection("inner.in", "a.y", linear(4)) + connection("a.u", "inner.out")
    toy = read(made(tmp_path, system("root", part("a"), inner, links=links), "a"))
    assert [(str(k), k.factor) for k in toy.links] == [("inner.b.y -> a.u", 1.0), ("a.y -> inner.b.u", 4.0)]


def test_a_value_at_a_systems_connector_goes_where_its_connections_lead(tmp_path: Path) -> None:
    # given an input and a parameter of the root, bound there, that lead down with factors
    inner = system("inner", part("b"), ports="in input, gain parameter",
                   links=connection("in", "b.u", linear(2, 1)) + connection("gain", "b.k"))  # fmt: skip
    root = system("root", inner, part("a"), ports="x input, g parameter",
                  bindings=bind(binding(parameters(x="Real 3", g="Real 0.5"))),
                  links=connection("x", "inner.in", linear(10)) + connection("g", "inner.gain", linear(4))
                  + connection("g", "a.k") + connection("g", "a.u"))  # fmt: skip
    # when
    toy = read(made(tmp_path, root, "a"))
    # then 2 * (10 * 3) + 1 = 61, 4 * 0.5 = 2; a parameter may set an input
    assert toy.components["inner.b"].values == {"u": StartValue(61.0), "k": StartValue(2.0)}
    assert toy.components["a"].values == {"k": StartValue(0.5), "u": StartValue(0.5)}
    assert toy.links == ()


@pytest.mark.parametrize(
    ("root", "text"),
    [
        (
            system("root", system("a", part("b.c")), system("a.b", part("c"))),
            'component "a.b.c" and component "a.b.c" have the same full name; give each its own',
        ),
        (
            system("root", part("a"), system("s", part("b"), ports="in input"),
                   links=connection("a.y", "s.in") + connection("a.y", "s.in")),
            "s.in is fed twice: by a.y and a.y",
        ),
        (
            system("root", system("s", ports="in input, out output", links=connection("in", "out")),
                   links=connection("s.out", "s.in")),
            "connections go round without a component: s.in -> s.out",
        ),
        (
            system("root", part("a"), system("s", part("b"), ports="p parameter"),
                   links=connection("a.y", "s.p")),
            "a connection ends at the parameter s.p; bind its value instead",
        ),
        (
            system("root", system("s", part("b"), ports="in input", links=connection("in", "b.y"))),
            'a connection ends at s.b.y, whose kind is "output"; expected "input"',
        ),
        (
            system("root", part("a"), system("s", part("b")), links=connection("a.y", "s.b.u")),
            'a connection names component "s.b", which does not exist; known: a, s',
        ),
        (
            system("root", part("a"), system("s", part("b"), ports="in input"),
                   links=connection("a.y", "s.inn")),
            'a connection names connector "inn", which system "s" lacks; did you mean "in"?',
        ),
        (
            system("root", system("s", system("t", part("b"), component("b", "u input", source="resources/a.fmu")))),  # noqa: E501
            'system "s.t" has two elements named "b"',
        ),
        (
            system("root", part("a"), system("s", part("b"), ports="in input Real",
                                             links=connection("in", "b.u", linear(1e200))),
                   links=connection("a.y", "s.in", linear(1e200))),
            "connection a.y -> s.b.u: its factor leaves the range of a double",
        ),
        (
            system("root", part("a"), system("s", part("b"), ports="in input",
                                             links=connection("in", "b.u", linear(1e-200))),
                   links=connection("a.y", "s.in", linear(1e-200))),
            "connection a.y -> s.b.u: its factor leaves the range of a double",
        ),
    ],
)  # fmt: skip
def test_refuses_by_name(tmp_path: Path, root: str, text: str) -> None:
    assert refusal(made(tmp_path, root, "a")) == text
