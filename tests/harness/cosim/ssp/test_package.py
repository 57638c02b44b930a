"""Where the files of a package may lie: variants, folders, unpacked FMUs; versions and experiments."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from harness.cosim.fmu import describe
from harness.cosim.loop import Simulation
from harness.cosim.ssp import SspError, open_ssp
from tests.harness.cosim.ssp.packages import (
    component,
    connection,
    fmu,
    package,
    read,
    refusal,
    ssd,
    system,
)  # fmt: skip
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

FMU = fmu(V("u", "input"), V("y"))
ONE = system("root", component("a", "u input", "y output"))
TWO = system("root", component("a", "y output"), component("b", "u input", source="resources/a.fmu"),
             links=connection("a.y", "b.u"))  # fmt: skip


def experiment(start: object = None, stop: object = None) -> str:
    text = "".join(f' {n}Time="{v}"' for n, v in (("start", start), ("stop", stop)) if v is not None)
    return f"<ssd:DefaultExperiment{text}/>"


@pytest.fixture
def variants(tmp_path: Path) -> Path:
    """A package whose default has one component and whose variant has two."""
    return package(tmp_path / "toy.ssp", ssd(ONE), {"Two.ssd": ssd(TWO), "resources/a.fmu": FMU})


def test_a_variant_is_found_by_its_path(variants: Path) -> None:
    assert list(read(variants).components) == ["a"]
    with open_ssp(variants / "Two.ssd") as two:
        assert list(two.components) == ["a", "b"]
        # and a log that holds these files has the variant in the default's place
        assert two.files["SystemStructure.ssd"].read_text() == ssd(TWO)


def test_a_variant_of_an_unpacked_package(variants: Path, tmp_path: Path) -> None:
    folder = tmp_path / "toy"
    with zipfile.ZipFile(variants) as archive:
        archive.extractall(folder)
    assert list(read(folder).components) == ["a"]
    assert list(read(folder / "SystemStructure.ssd").components) == ["a"]
    assert list(read(folder / "Two.ssd").components) == ["a", "b"]


def test_a_variant_that_is_not_there_is_told_with_those_that_are(variants: Path, tmp_path: Path) -> None:
    with pytest.raises(SspError) as caught, open_ssp(variants / "Three.ssd"):
        pass
    has = f"it has SystemStructure.ssd, Two.ssd: run {variants}/SystemStructure.ssd"
    assert str(caught.value) == f"{variants}: has no Three.ssd; {has}"
    with zipfile.ZipFile(tmp_path / "only.ssp", "w") as archive:
        archive.writestr("B.ssd", ssd(ONE))
        archive.writestr("A.ssd", ssd(ONE))
    with pytest.raises(SspError) as caught, open_ssp(tmp_path / "only.ssp"):
        pass
    assert str(caught.value).endswith(
        f"has no SystemStructure.ssd; it has A.ssd, B.ssd: run {tmp_path}/only.ssp/A.ssd"
    )


def test_resources_lie_in_folders_and_have_names_as_in_addresses(tmp_path: Path) -> None:
    # given an FMU deep in the package, whose name has a blank and a percent sign
    part = component("a", "y output", source="resources/my%20models/./100%25.fmu")
    path = package(tmp_path / "toy.ssp", ssd(system("r", part)), {"resources/my models/100%.fmu": FMU})
    made = read(path)
    assert made.components["a"].fmu.name == "100%.fmu"
    assert set(made.files) == {"SystemStructure.ssd", "resources/my models/100%.fmu"}


@pytest.mark.parametrize("source", ["resources/a", "resources/a/", "resources/b/../a"])
def test_an_fmu_may_be_unpacked_in_the_package(tmp_path: Path, source: str) -> None:
    # given an FMU whose files are those of the package
    made = tiny_fmu(tmp_path / "a.fmu", [V("u", "input"), V("y")], "v[1] = 2 * v[0] + 1;")
    with zipfile.ZipFile(made) as archive:
        files = {
            f"resources/a/{n}": archive.read(n).decode("latin-1").encode("latin-1")
            for n in archive.namelist()
        }
    path = tmp_path / "toy.ssp"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", ssd(system("r", component("a", "y output", source=source))))
        for name, content in files.items():
            archive.writestr(name, content)
    # then it runs, and all its files belong to the package
    rows = []
    with open_ssp(path) as toy:
        assert set(toy.files) == {"SystemStructure.ssd", *files}
        assert describe(toy.components["a"].fmu).outputs.keys() == {"y"}
        with Simulation(toy, {"a": {"u": 3.0}}) as simulation:
            simulation.run(duration=0.08, record=lambda times, values: rows.append(values["a"].tolist()))
    assert rows == [[[3.0, 7.0]] * 3]


def test_a_link_out_of_the_package_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "toy"
    (folder / "a").mkdir(parents=True)
    (folder / "SystemStructure.ssd").write_text(ssd(system("r", component("a", source="a"))))
    (folder / "a" / "modelDescription.xml").write_bytes(FMU)
    (folder / "a" / "secret").symlink_to(tmp_path)
    assert refusal(folder) == 'component "a": a/secret is a link out of the package'
    # and one that leads to itself is none
    (folder / "a" / "secret").unlink()
    (folder / "a" / "loop").symlink_to(folder / "a" / "loop")
    assert list(read(folder).components) == ["a"]


def test_ssp_2_is_read(tmp_path: Path) -> None:
    # given what SSP 2.0 added and says nothing about how a system runs: meta data, signatures, types
    part = component("a", "u input Float64", "y output Float32").replace(
        "</ssd:Component>",
        '<ssc:MetaData kind="general" type="text/plain"/><ssc:Signature role="authenticity" type="x"/></ssd:Component>',  # noqa: E501
    )
    made = read(
        package(tmp_path / "toy.ssp", ssd(system("r", part), version="2.0"), {"resources/a.fmu": FMU})
    )
    assert made.components["a"].connectors["u"].type == "Real"


@pytest.mark.parametrize(
    ("stated", "start", "stop"),
    [
        ((), 0.0, None),
        ((None, 5), 0.0, 5.0),
        ((-2.5, 7.5), -2.5, 7.5),
        ((1e6, None), 1e6, None),
    ],
)
def test_the_experiment_says_when_fmus_begin(
    tmp_path: Path, stated: tuple[float | None, ...], start: float, stop: float | None
) -> None:
    made = read(package(tmp_path / "toy.ssp", ssd(ONE, experiment(*stated)), {"resources/a.fmu": FMU}))
    assert (made.start_time, made.stop_time) == (start, stop)


@pytest.mark.parametrize(
    ("structure", "text"),
    [
        (ssd(ONE, version="1.1"), 'the root is of SSP version "1.1"; expected "1.0" or "2.0"'),
        (ssd(ONE).replace("SSP1/SystemStructureDescription", "SSP3/SystemStructureDescription"),
         "the root is {http://ssp-standard.org/SSP3/SystemStructureDescription}SystemStructureDescription; "
         "expected an SSP 1.0 or 2.0 SystemStructureDescription"),
        (ssd("", valid=False), "has no System"),
        (ssd(ONE, ONE, valid=False), 'SystemStructureDescription "toy" holds two System; expected one'),
        (ssd(ONE, experiment("soon"), valid=False),
         'DefaultExperiment has startTime="soon"; expected a number'),
        (ssd(ONE, experiment(3, 3)), "the experiment starts at 3 s and stops at 3 s"),
        (ssd(ONE, experiment(2e6)), "the experiment starts at 2e+06 s; expected -1e+06 to 1e+06 s"),
        (ssd(system("r", component("a", source="http://x/a.fmu"))),
         'component "a" has source "http://x/a.fmu"; expected a path inside the package'),
        (ssd(system("r", component("a", source="%2e%2e/a.fmu"))),
         'component "a" has source "%2e%2e/a.fmu"; expected a path inside the package'),
        (ssd(system("r", component("a", source="resources"))),
         'component "a" has source "resources", which is not in the package'),
        (ssd(system("r", component("a", source="#other", more='type="application/x-ssp-definition"'))),
         'component "a" has type "application/x-ssp-definition"; expected "application/x-fmu-sharedlibrary"'),
        (ssd(system("r", '<ssd:Component name="a"/>'), valid=False),
         'a Component lacks its attribute "source"'),
        (ssd(system("r", component("a", "y whole"), component("b")), valid=False),
         'component "a": connector "y" has kind "whole"; known: calculatedParameter, constant, inout, input, '
         "local, output, parameter, structuralParameter, unspecified"),
        (ssd(system("r", component("a", "y output", "y output")), valid=False),
         'component "a" has two connectors "y"'),
        (ssd(TWO.replace('endConnector="u"', 'endConnector="u" endIndices="1"'), version="2.0"),
         "connection a.y -> b.u has endIndices; elements of arrays are not supported"),
        (ssd(TWO.replace('kind="input">', 'kind="input"><ssc:Real/><ssc:Dimension size="3"/>'), version="2.0"),  # noqa: E501
         "connection a.y -> b.u: b.u is of type array; expected Real, Integer, Boolean or Enumeration"),
        (ssd(TWO.replace('kind="input"', 'kind="inout"')),
         'a connection ends at b.u, whose kind is "inout"; expected "input"'),
        (ssd(TWO.replace('kind="output"', 'kind="local"'), version="2.0"),
         'a connection starts at a.y, whose kind is "local"; expected "output"'),
        (ssd(ONE.replace("<ssd:Elements>", '<ssd:SignalDictionaries><ssd:SignalDictionary name="bus" source="b.ssb"/>'  # noqa: E501
             "</ssd:SignalDictionaries><ssd:Elements>"), valid=False),
         'System "root" holds a SignalDictionaries, which is not supported'),
    ],
)  # fmt: skip
def test_refuses_by_name(tmp_path: Path, structure: str, text: str) -> None:
    assert (
        refusal(package(tmp_path / "toy.ssp", structure, {"resources/a.fmu": FMU, "resources/b.fmu": FMU}))
        == text
    )
