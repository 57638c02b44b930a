"""Does a foreign FMU fit a role: error texts, mapping files, and the system with it in place."""

from pathlib import Path

import pytest

from harness.cosim.fmu import describe
from harness.cosim.loop import Simulation
from harness.cosim.rename import Rename
from harness.cosim.roles import (
    MISSION,
    Adapter,
    Fit,
    RoleError,
    find_role,
    fit,
    read_adapter,
    replace_component,
)
from harness.cosim.ssp import FmuComponent, FmuSystem, ScaledLink, StartValue
from models.errors import UsageError
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

DOG = [V("command", "input", "Integer"), V("north", unit="m"), V("east", unit="m"), V("speed", unit="m/s")]
EXPECTED = (
    'expected a name, or { name = "...", factor = 1.0, offset = 0.0 } with finite numbers, factor not 0'
)
HEADING = V("heading", unit="rad")


def fitted(tmp_path: Path, variables: list[V], toml: str = "", version: int = 2) -> Fit:
    path = tiny_fmu(tmp_path / "dog.fmu", variables, version=version, depends=False)
    if toml:
        path.with_suffix(".toml").write_text(toml)
    role = find_role("plant")
    return fit(describe(path), role, read_adapter(path, role))


@pytest.mark.parametrize("version", [2, 3])
def test_a_dog_with_the_four_outputs_fits(tmp_path: Path, version: int) -> None:
    fit = fitted(tmp_path, [*DOG, HEADING], version=version)
    assert fit.problems == ()
    assert set(fit.outputs) == {"north", "east", "speed", "heading"}
    assert fit.notes == (
        "plant dog.fmu: has no output acceleration, pitch, roll, yaw_rate, slip, slip_acceleration; "
        "taken as zero",
    )


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            V("speed", unit="km/h"),
            'output "speed" has unit "km/h", the plant role needs "m/s"; '
            "map it in dog.toml (factor = 0.2777777777777778) or export it in m/s",
        ),
        (
            V("speed", unit="kg"),
            'output "speed" has unit "kg", the plant role needs "m/s"; no factor makes one of the other',
        ),
        (
            V("speed", type="Integer"),
            'output "speed" is Integer, the plant role needs Real; export it as Real',
        ),
        (
            V("speed", "local", unit="m/s"),
            '"speed" has causality local; the plant role needs output, export it as such',
        ),
        (
            V("sped", unit="m/s"),
            'has no output "speed" (Real, m/s), which the plant role needs; did you mean "sped"?; '
            "map it in dog.toml or export it",
        ),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, change: V, text: str) -> None:
    fit = fitted(tmp_path, [*DOG[:-1], change, HEADING])
    assert fit.problems == (f"plant dog.fmu: {text}",)


def test_an_enumeration_serves_as_the_command(tmp_path: Path) -> None:
    fit = fitted(tmp_path, [V("command", "input", "Enumeration"), *DOG[1:], HEADING])
    assert fit.problems == ()
    assert fit.inputs == {"command": Rename("command")}


def test_a_mapping_file_renames_and_converts(tmp_path: Path) -> None:
    toml = '[outputs]\nspeed = { name = "v", factor = 0.2777777777777778 }\nheading = "course"\n[inputs]\ncommand = "cmd"'  # noqa: E501
    variables = [V("cmd", "input", "Integer"), *DOG[1:3], V("v", unit="km/h"), V("course", unit="rad")]
    fit = fitted(tmp_path, variables, toml)
    assert fit.problems == ()
    assert fit.outputs["speed"] == Rename("v", 0.2777777777777778, 0.0, mapped=True)
    assert fit.inputs == {"command": Rename("cmd", mapped=True)}


def test_one_output_may_serve_for_two(tmp_path: Path) -> None:
    fit = fitted(tmp_path, [*DOG, V("a", unit="m")], '[outputs]\nnorth = "a"\neast = "a"')
    assert fit.outputs["north"] == fit.outputs["east"] == Rename("a", mapped=True)
    assert 'plant dog.fmu: north and east are both its output "a"' in fit.notes


@pytest.mark.parametrize(
    ("toml", "note"),
    [
        (
            '[outputs]\nspeed = { name = "v", factor = 3.6 }',
            'output "v" is mapped with factor 3.6; from "km/h" to "m/s" it is 0.277778',
        ),
        (
            '[outputs]\nspeed = { name = "v", factor = -0.28 }',
            'output "v" is mapped with factor -0.28; from "km/h" to "m/s" it is 0.277778',
        ),
        (
            '[parameters]\nstart_heading = { name = "psi0", factor = 0.0174533 }',
            'parameter "psi0" is mapped with factor 0.0174533; from "rad" to "deg" it is 57.2958',
        ),
        ('[outputs]\nspeed = { name = "v", factor = 0.2778 }', ""),
        # another way round, or from another zero
        ('[outputs]\nspeed = { name = "v", factor = -0.277778, offset = 1 }', ""),
    ],
)
def test_a_factor_that_contradicts_the_units_is_noted(tmp_path: Path, toml: str, note: str) -> None:
    variables = [*DOG[:3], V("v", unit="km/h"), HEADING, V("psi0", "parameter", unit="deg")]
    mapping = toml if "speed" in toml else f'[outputs]\nspeed = {{ name = "v", factor = 0.2777778 }}\n{toml}'
    fit = fitted(tmp_path, variables, mapping)
    assert fit.problems == ()
    assert [n for n in fit.notes if "factor" in n] == ([f"plant dog.fmu: {note}"] if note else [])


@pytest.mark.parametrize(
    ("toml", "text"),
    [
        ("[output]", 'dog.toml: unknown key "output"; expected the tables [outputs], [inputs], [parameters]'),
        (
            '[outputs]\nsped = "v"',
            'dog.toml: [outputs] the plant role has no "sped"; did you mean "speed"?',
        ),
        (
            "[outputs]\nspeed = 3",
            f'dog.toml: "speed" is 3; {EXPECTED}',
        ),
        ("[outputs]\nspeed = { factor = nan }", f"dog.toml: \"speed\" is {{'factor': nan}}; {EXPECTED}"),
        ("[outputs]\nspeed = { offset = -inf }", f"dog.toml: \"speed\" is {{'offset': -inf}}; {EXPECTED}"),
        ("[outputs]\nspeed = { factor = 0 }", f"dog.toml: \"speed\" is {{'factor': 0}}; {EXPECTED}"),
        (
            f"[outputs]\nspeed = {{ factor = 1{'0' * 400} }}",
            f"dog.toml: \"speed\" is {{'factor': 1{'0' * 400}}}; {EXPECTED}",
        ),
    ],
)
def test_a_wrong_mapping_file_is_refused(tmp_path: Path, toml: str, text: str) -> None:
    with pytest.raises(RoleError) as caught:
        fitted(tmp_path, [*DOG, HEADING], toml)
    assert str(caught.value) == text


def test_it_takes_the_place_of_the_plant(tmp_path: Path) -> None:
    # given a dog at 36 km/h that takes no command, in a system whose sensors want speed and acceleration
    dog = tiny_fmu(tmp_path / "dog.fmu", [V("v", unit="km/h")], depends=False, start="v[0] = 36;")
    dog.with_suffix(".toml").write_text('[outputs]\nspeed = { name = "v", factor = 0.2777777777777778 }')
    sensors = [V("speed", "input", unit="m/s"), V("acceleration", "input", start="5"), V("y", type="Integer")]
    other = tiny_fmu(tmp_path / "sensors.fmu", sensors)
    members = {"plant": FmuComponent("plant", Path("own.fmu")), "sensors": FmuComponent("sensors", other)}
    links = (
        ScaledLink("plant", "speed", "sensors", "speed"),
        ScaledLink("plant", "acceleration", "sensors", "acceleration"),
        ScaledLink("sensors", "y", "plant", "command"),
    )
    # when
    role = find_role("plant")
    system, fit = replace_component(
        FmuSystem("toy", members, links), "plant", describe(dog), read_adapter(dog, role)
    )
    rows = []
    with Simulation(system) as simulation:
        simulation.run(duration=0, record=lambda t, v: rows.append(v["sensors"].tolist()))
    # then the sensors see 10 m/s, the acceleration that it lacks is zero, and it is told nothing
    assert system.links == (
        ScaledLink("plant", "v", "sensors", "speed", 0.2777777777777778, 0.0, output="speed"),
    )
    assert system.components["sensors"].values == {"acceleration": StartValue(0.0)}
    assert rows == [[[10.0, 0.0, 0.0]]]
    assert fit.notes == (
        "plant dog.fmu: has no output acceleration; taken as zero",
        "plant dog.fmu: has no input command; does not receive the role's values of it",
    )


@pytest.mark.parametrize(
    ("link", "text"),
    [
        (
            ScaledLink("plant", "speed", "sensors", "speed", 1 / 3.6, settled=True),
            r"link plant\.speed -> sensors\.speed: the package converts \(\* 0\.277778\) what its",
        ),
        (
            ScaledLink("controller", "command", "plant", "command", table=((1, 2),), settled=True),
            r"link controller\.command -> plant\.command: the package converts \(1 as 2\) what its own plant",
        ),
        (
            ScaledLink("plant", "v_kmh", "sensors", "speed", settled=True),
            r'link plant\.v_kmh -> sensors\.speed: the plant role has no output "v_kmh"',
        ),
    ],
)
def test_what_a_package_makes_of_its_own_plant_is_not_done_to_another(
    link: ScaledLink, text: str, tmp_path: Path
) -> None:
    # given a package, and another dog in m/s
    dog = tiny_fmu(tmp_path / "dog.fmu", [V("command", "input", "Integer"), V("speed", unit="m/s")])
    system = FmuSystem(
        "toy", {n: FmuComponent(n, Path("own.fmu")) for n in (link.source, link.target)}, (link,)
    )
    with pytest.raises(RoleError, match=text):
        replace_component(system, "plant", describe(dog), Adapter(tmp_path / "dog.toml"))


def test_what_only_a_packages_own_plant_is_told_is_noted(tmp_path: Path) -> None:
    dog = tiny_fmu(tmp_path / "dog.fmu", [V("command", "input", "Integer")])
    members = {name: FmuComponent(name, Path("own.fmu")) for name in ("wind", "plant")}
    system = FmuSystem("toy", members, (ScaledLink("wind", "force", "plant", "push", settled=True),))
    swapped, fit = replace_component(system, "plant", describe(dog), Adapter(tmp_path / "dog.toml"))
    assert swapped.links == ()
    assert fit.notes == ("plant dog.fmu: does not receive push, which the package gives",)


def test_the_page_tells_what_each_role_gives_and_takes() -> None:
    page = (Path(__file__).parents[3] / "harness" / "README.md").read_text()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines()]
    told = {row[0]: row[1:] for row in rows if len(row) == 4}
    for name in ("plant", "estimator", "controller"):
        role = find_role(name)
        needed = {n: v for n, v in role.needs.items() if n not in role.optional}
        for cell, variables in zip(
            told[f"`{name}`"],
            (needed, {n: role.needs[n] for n in role.optional}, {n: role.inputs[n] for n in role.usual}),
            strict=True,
        ):
            assert sorted(cell.split(", ")) == sorted(
                f"`{n}`" + f" {v.unit}" * (v.unit not in ("", "1")) for n, v in variables.items()
            ) or (not variables and cell == "")


def test_an_unknown_role_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(UsageError, match=r'there is no role "plnt"; did you mean "plant"\?'):
        find_role("plnt")


PARAMETERS = [V("start_heading", "parameter", unit="deg"), V("seed", "parameter")]


def test_a_parameter_in_another_unit_is_refused_by_name(tmp_path: Path) -> None:
    fit = fitted(tmp_path, [*DOG, HEADING, *PARAMETERS])
    assert fit.problems == (
        'plant dog.fmu: parameter "start_heading" has unit "deg", the plant role needs "rad"; '
        "map it in dog.toml (factor = 57.29577951308232) or export it in rad",
    )


def test_a_mapping_file_converts_a_parameter(tmp_path: Path) -> None:
    toml = "[parameters]\nstart_heading = { factor = 57.29577951308232 }"
    fit = fitted(tmp_path, [*DOG, HEADING, *PARAMETERS], toml)
    assert fit.problems == ()
    assert fit.parameters == {
        "start_heading": Rename("start_heading", 57.29577951308232, 0.0, mapped=True),
        "seed": Rename("seed"),
    }


def test_a_mapped_parameter_must_be_there(tmp_path: Path) -> None:
    fit = fitted(tmp_path, [*DOG, HEADING, *PARAMETERS[1:]], '[parameters]\nstart_heading = "psi"')
    assert fit.problems == ('plant dog.fmu: has no parameter "psi", which dog.toml names',)


def test_the_parameters_of_the_roles_are_declared_by_our_blocks() -> None:
    for name, parameters in MISSION.items():
        assert {n.partition("[")[0] for n in find_role(name).parameters} == parameters
