"""Loading FMUs, and what is said when one goes wrong."""

import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any, get_args

import fmpy
import numpy as np
import pytest

from codegen import cache
from codegen.toolchains.compiler import build_library, find_platform, this_platform
from fmus.archive import SEAL
from fmus.build import build_fmu
from fmus.folder import build_folder
from harness.cosim import origin
from harness.cosim.fmu import FmuError, FmuInstance, describe
from harness.cosim.loop import Array, Simulation
from harness.cosim.ssp import FmuComponent, FmuSystem, open_ssp
from harness.cosim.stepping import Event, Loop
from harness.cosim.wiring import wire
from models.errors import CanineError, ParameterError, WiringError
from models.kit.declaration import Type
from models.pedestrian import Pedestrian
from tests.harness.cosim.tiny_fmu import V, description, tiny_fmu

GAIN = [V("u", "input", unit="m"), V("k", "parameter", start="2"), V("y", unit="m"), V("n", type="Integer")]


def alone(path: Path) -> FmuSystem:
    return FmuSystem("alone", {"plant": FmuComponent("plant", path)}, ())


@pytest.mark.parametrize("version", [2, 3])
def test_describes_variables_units_and_dependencies(tmp_path: Path, version: int) -> None:
    # given
    path = tiny_fmu(tmp_path / "gain.fmu", GAIN, version=version, step_size=0.04, fixed=True)
    # when
    fmu = describe(path)
    # then
    assert (fmu.model, fmu.version, fmu.step, fmu.fixed, fmu.feedthrough) == (
        "tiny",
        version,
        0.04,
        True,
        True,
    )
    assert list(fmu.inputs) == ["u"]
    assert list(fmu.outputs) == ["y", "n"]
    assert fmu.parameters["k"].start == 2.0
    assert fmu.outputs["n"].type is Type.INTEGER
    unit = fmu.unit(fmu.outputs["y"])
    assert unit is not None
    assert unit.name == "m"
    assert fmu.warnings == ()


def test_an_fmu_is_validated_once_until_its_description_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given an FMU whose output has a unit that it does not define, and an empty cache
    monkeypatch.setattr(cache, "cache_folder", lambda: tmp_path / "cache")
    path = tiny_fmu(tmp_path / "odd.fmu", GAIN)
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}

    def write(description: bytes) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in (members | {"modelDescription.xml": description}).items():
                archive.writestr(name, content)

    sound = members["modelDescription.xml"]
    odd = sound.replace(b"<ModelStructure>", b'<ModelStructure oddity="1">')
    assert odd != sound
    validated = []
    read = fmpy.read_model_description

    def reading(*args: Any, **options: Any) -> Any:
        validated.append(options.get("validate", True))
        return read(*args, **options)

    monkeypatch.setattr(fmpy, "read_model_description", reading)
    # when it is described twice, mended, and described again
    write(odd)
    first, second = describe(path), describe(path)
    write(sound)
    mended = describe(path)
    # then the warning is the same from the cache, and goes with the fault
    assert "oddity" in " ".join(first.warnings)
    assert (second.warnings, mended.warnings) == (first.warnings, ())
    assert validated == [False, True, False, True]


def test_instances_of_our_own_fmus_share_a_folder_and_others_have_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given an FMU as it was built here, a copy of it, and a copy with a byte changed under the same seal
    ours = build_fmu(Pedestrian, build_folder() / "fmi2", 2)
    shutil.copy(ours, copy := tmp_path / "copy.fmu")
    content = bytearray(ours.read_bytes())
    content[-SEAL - 2] ^= 1  # of the stamp
    (changed := tmp_path / "changed.fmu").write_bytes(content)
    monkeypatch.setattr(tempfile, "tempdir", str(folders := tmp_path / "folders"))
    folders.mkdir()
    monkeypatch.setattr("harness.cosim.fmu._unpacked", {})
    # when they run, one beside the other
    with FmuInstance("a", ours), FmuInstance("b", ours), FmuInstance("c", copy):
        (shared,) = folders.iterdir()
        with FmuInstance("d", changed):
            assert len(list(folders.iterdir())) == 2
    # then that of the changed one alone has gone, and the shared one is made anew where it is lost
    assert list(folders.iterdir()) == [shared]
    shutil.rmtree(shared)
    with FmuInstance("a", ours) as again:
        again.initialize({})
        assert len(list(folders.iterdir())) == 1
    # and another one of ours has its own
    with FmuInstance("a", build_fmu(Pedestrian, build_folder() / "fmi3", 3)) as other:
        other.initialize({})
        assert len(list(folders.iterdir())) == 2


def test_an_fmu_that_is_replaced_while_it_is_loaded_runs_as_it_was_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a copy of our FMU that another process writes over once it is found to be ours
    path = tmp_path / "copy.fmu"
    shutil.copy(build_fmu(Pedestrian, build_folder() / "fmi2", 2), path)
    monkeypatch.setattr("harness.cosim.fmu._unpacked", {})

    def own_content(fmu: Path) -> bytes | None:
        content = origin.own_content(fmu)
        fmu.write_bytes(b"another")
        return content

    monkeypatch.setattr("harness.cosim.fmu.own_content", own_content)
    # then its binary and its description are those of one file
    with FmuInstance("plant", path) as instance:
        instance.initialize({})
        assert instance.description.model == "pedestrian"


def test_a_plant_is_known_by_its_model_structure(tmp_path: Path) -> None:
    assert not describe(tiny_fmu(tmp_path / "plant.fmu", GAIN, depends=False)).feedthrough


@pytest.mark.parametrize("version", [2, 3])
def test_values_go_in_and_come_out(tmp_path: Path, version: int) -> None:
    # given y = k u, and n counting the steps
    path = tiny_fmu(tmp_path / "gain.fmu", GAIN, "v[2] = v[1] * v[0]; v[3] += 1;", version=version)
    rows: list[tuple[list[float], Array]] = []
    # when it is run for 2 steps with k = 5, u = 3
    with Simulation(alone(path), {"plant": {"k": 5, "u": 3}}) as simulation:
        outcome = simulation.run(duration=0.08, record=lambda t, v: rows.append((t.tolist(), v["plant"])))
    # then there is a row at 0, 0.04 and 0.08
    ((times, values),) = rows
    assert outcome.ticks == 3
    assert times == [0.0, 0.04, 0.08]
    np.testing.assert_array_equal(values, [[3, 15, 1], [3, 15, 2], [3, 15, 3]])


def test_other_number_types_and_enumerations_are_exchanged(tmp_path: Path) -> None:
    # given
    variables = [V("f", type="Float32"), V("i", type="Int64"), V("b", type="Boolean")]
    path = tiny_fmu(tmp_path / "three.fmu", variables, start="v[0] = 0.5; v[1] = -7; v[2] = 1;", version=3)
    foreign = [V("command", "input", "Enumeration"), V("y", type="Integer")]
    two = tiny_fmu(tmp_path / "two.fmu", foreign, "v[1] = v[0];")
    rows: list[list[list[float]]] = []
    # when
    for fmu, values in ((path, {}), (two, {"plant": {"command": 4}})):
        with Simulation(alone(fmu), values) as simulation:
            simulation.run(duration=0, record=lambda t, v: rows.append(v["plant"].tolist()))
    # then
    assert rows == [[[0.5, -7.0, 1.0]], [[4.0, 4.0]]]


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("p", 300, "p {} 300, the FMU declares Integer (int8); give one of those"),
        ("p", 0.5, "p {} 0.5, the FMU declares Integer (int8); give one of those"),
        ("i", 2.0**63, "i {} 9.223372037e+18, the FMU declares Integer (int64); give one of those"),
        ("f", -1e300, "f {} -1e+300, the FMU declares Real (float32); give one of those"),
        ("b", 2, "b {} 2, the FMU declares Boolean (uint8); give one of those"),
        ("i", float("nan"), "i {} nan, the FMU declares Integer (int64); give one of those"),
    ],
)
def test_a_value_that_the_type_of_a_variable_does_not_hold_is_refused(
    numbers: Path, name: str, value: float, text: str
) -> None:
    # at the start
    with pytest.raises(ParameterError) as caught:
        Simulation(alone(numbers), {"plant": {name: value}})
    assert str(caught.value) == f"plant numbers.fmu: {text.format('is given')}"
    # and later
    with Simulation(alone(numbers)) as simulation, pytest.raises(ParameterError) as caught:
        simulation.run([Event(1.0, "plant", name, value)])
    assert str(caught.value) == f"plant.{text.format('is set to')}"


@pytest.fixture(scope="module")
def numbers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Inputs of other types than ours."""
    kinds = {"p": "Int8", "i": "Int64", "f": "Float32", "b": "Boolean"}
    variables = [V(name, "input", kind) for name, kind in kinds.items()]
    return tiny_fmu(tmp_path_factory.mktemp("numbers") / "numbers.fmu", variables, version=3)


@pytest.mark.parametrize("version", [2, 3])
def test_an_error_names_fmu_function_status_time_and_what_it_says(tmp_path: Path, version: int) -> None:
    # given an FMU that fails on the step from 0.12 s, and says why
    broken = 'if (t > 0.1) { say("the leash is too short"); return 3; }'
    path = tiny_fmu(tmp_path / "dog.fmu", GAIN, broken, version=version)
    rows: list[float] = []
    # when
    with Simulation(alone(path)) as simulation, pytest.raises(FmuError) as caught:
        simulation.run(record=lambda t, v: rows.extend(t))
    # then the error says so, and the rows up to it are kept
    assert str(caught.value) == (
        f'plant dog.fmu: fmi{version}DoStep returned error at t = 0.12 s; it says: "the leash is too short"'
    )
    assert rows == [0.0, 0.04, 0.08]


@pytest.mark.parametrize(("value", "name"), [("NAN", "nan"), ("INFINITY", "inf"), ("-INFINITY", "-inf")])
def test_an_output_that_is_no_number_is_named_with_its_time(tmp_path: Path, value: str, name: str) -> None:
    path = tiny_fmu(tmp_path / "dog.fmu", GAIN, f"v[2] = t > 0.05 ? {value} : 1e308;")
    with Simulation(alone(path)) as simulation, pytest.raises(FmuError) as caught:
        simulation.run()
    assert str(caught.value) == f'plant dog.fmu: output "y" is {name} at t = 0.08 s; expected a finite number'


def test_nothing_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given a folder for temporary files that can be looked at
    path = tiny_fmu(tmp_path / "dog.fmu", GAIN, "return 4;")
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    # when one instance fails fatally, and one cannot be made
    with pytest.raises(FmuError, match="returned fatal"), Simulation(alone(path)) as simulation:
        simulation.run()
    path.write_text("no archive")
    with pytest.raises(Exception, match="ZIP"):
        FmuInstance("plant", path)
    # then
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("xml", "text"),
    [
        ("<a>", "modelDescription.xml: malformed XML"),
        ('<fmiModelDescription fmiVersion="1.0"/>', "is FMI 1.0; expected 2.0 or 3.0"),
        (
            '<fmiModelDescription fmiVersion="2.0" modelName="m" guid="g"/>',
            "is not for co-simulation; export it as a co-simulation FMU",
        ),
    ],
)
def test_what_is_no_cosimulation_fmu_is_refused(tmp_path: Path, xml: str, text: str) -> None:
    path = tmp_path / "dog.fmu"
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("modelDescription.xml", xml)
    with pytest.raises(Exception, match=text) as caught:
        describe(path)
    assert str(caught.value).startswith(str(path))


def altered(folder: Path, old: str, new: str, version: int = 2) -> Path:
    """An FMU with a step of 0.04 s whose description says `new` for `old`."""
    made = tiny_fmu(folder / "made.fmu", GAIN, version=version, step_size=0.04, fixed=True)
    path = folder / "dog.fmu"
    with zipfile.ZipFile(made) as packed, zipfile.ZipFile(path, "w") as repacked:
        xml = packed.read("modelDescription.xml").decode()
        assert old in xml
        repacked.writestr("modelDescription.xml", xml.replace(old, new, 1))
    return path


@pytest.mark.parametrize("version", [2, 3])
def test_a_description_of_too_many_variables_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: int
) -> None:
    monkeypatch.setattr("harness.cosim.fmu.MAX_VARIABLES", 2)
    path = tiny_fmu(tmp_path / "dog.fmu", [V("a"), V("b"), V("c")], version=version)
    count = 3 if version == 2 else 4  # with the time
    with pytest.raises(FmuError, match=rf"dog\.fmu: has {count} variables; at most 2 are read"):
        describe(path)


@pytest.mark.parametrize("text", ["1e-300", "9.9e-7", "0", "-0.04", "nan", "inf", "1.1e9", "abc", ""])
@pytest.mark.parametrize("version", [2, 3])
def test_a_step_size_that_cannot_be_is_refused(tmp_path: Path, version: int, text: str) -> None:
    expected = "expected 1e-06 to 1e+09 seconds; export it with such a step"
    wished = altered(tmp_path, 'stepSize="0.04"', f'stepSize="{text}"', version)
    with pytest.raises(FmuError) as caught:
        describe(wished)
    assert str(caught.value) == f'{wished}: DefaultExperiment has stepSize="{text}"; {expected}'
    if version == 3:
        fixed = altered(tmp_path, "<CoSimulation", f'<CoSimulation fixedInternalStepSize="{text}"', 3)
        with pytest.raises(FmuError) as caught:
            describe(fixed)
        assert str(caught.value) == f'{fixed}: CoSimulation has fixedInternalStepSize="{text}"; {expected}'


def test_the_fixed_step_comes_before_the_wished_one(tmp_path: Path) -> None:
    fixed = altered(tmp_path, "<CoSimulation", '<CoSimulation fixedInternalStepSize="1e-6"', 3)
    assert describe(fixed).step == 1e-6


@pytest.mark.parametrize("reference", [-1, 2**32])
def test_a_wrong_value_reference_is_refused(tmp_path: Path, reference: int) -> None:
    path = altered(tmp_path, 'name="k" valueReference="1"', f'name="k" valueReference="{reference}"')
    with pytest.raises(FmuError) as caught:
        describe(path)
    assert str(caught.value) == (
        f'{path}: "k" has valueReference="{reference}"; '
        "expected a whole number from 0 to 4294967295; export it again"
    )


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("other", ["u", "y"])
def test_two_variables_of_one_name_are_refused(tmp_path: Path, version: int, other: str) -> None:
    path = altered(tmp_path, f'name="{other}"', 'name="k"', version)
    with pytest.raises(FmuError) as caught:
        describe(path)
    assert str(caught.value) == (
        f'{path}: has two variables "k"; give each a name of its own and export it again'
    )


@pytest.mark.parametrize(
    ("start", "text"),
    [
        ("1_000", '"k" has start="1_000"; expected a number'),
        ("\u0662", '"k" has start="\u0662"; expected a number'),
        ("300", '"k" has start="300"; expected Integer (int8)'),
        ("0.5", '"k" has start="0.5"; expected Integer (int8)'),
        ("NaN", '"k" has start="NaN"; expected Integer (int8)'),
    ],
)
def test_a_start_value_that_is_none_of_its_type_is_refused(tmp_path: Path, start: str, text: str) -> None:
    path = packed(tmp_path / "dog.fmu", V("k", "parameter", "Int8", start=start), version=3)
    with pytest.raises(FmuError) as caught:
        describe(path)
    assert str(caught.value) == f"{path}: {text}"


@pytest.mark.parametrize(("start", "value"), [("NaN", "nan"), ("1e400", "inf")])
@pytest.mark.parametrize("version", [2, 3])
def test_an_input_that_starts_with_no_finite_number_is_told_and_must_be_connected(
    tmp_path: Path, version: int, start: str, value: str
) -> None:
    path = packed(
        tmp_path / "dog.fmu", V("u", "input", start=start), V("k", "parameter", start="NaN"), version=version
    )
    fmu = describe(path)
    # then check tells of it, beside what the standard's schema may say
    assert f'input "u" has the start value {value}; connect it, or give it a finite one' in fmu.warnings
    assert not any('"k" has the start' in warning for warning in fmu.warnings)
    # and a trial does not begin with it
    with pytest.raises(WiringError) as caught:
        wire(alone(path), {"plant": fmu})
    assert str(caught.value) == (
        f"input plant.u has neither a source nor a finite start value, but {value}; connect it"
    )


def packed(path: Path, *variables: V, version: int) -> Path:
    """An FMU that can be read and not run."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description([*variables, V("y")], version))
    return path


def test_what_an_fmu_says_on_two_lines_is_one(tmp_path: Path) -> None:
    path = tiny_fmu(tmp_path / "dog.fmu", GAIN, r'say("too short:\n\tthe leash"); return 3;')
    with Simulation(alone(path)) as simulation, pytest.raises(FmuError) as caught:
        simulation.run()
    assert str(caught.value).endswith('; it says: "too short: the leash"')


def test_an_fmu_for_another_machine_is_named_as_such(tmp_path: Path) -> None:
    path = tiny_fmu(tmp_path / "dog.fmu", GAIN)
    other = tmp_path / "other.fmu"
    with zipfile.ZipFile(path) as packed, zipfile.ZipFile(other, "w") as repacked:
        repacked.writestr("modelDescription.xml", packed.read("modelDescription.xml"))
        repacked.writestr("binaries/amiga/tiny.library", b"")
    with pytest.raises(
        FmuError, match=r"plant other.fmu: .* no binary for this machine \(\w+\); it has amiga"
    ):
        FmuInstance("plant", other)


def folder_here(version: int) -> str:
    """The folder of this machine's binaries."""
    here = find_platform(this_platform())
    return here.fmi2 if version == 2 else here.fmi3


def repacked(path: Path, binaries: dict[str, bytes], into: Path) -> Path:
    """An FMU with other binaries."""
    with zipfile.ZipFile(path) as packed, zipfile.ZipFile(into, "w") as archive:
        archive.writestr("modelDescription.xml", packed.read("modelDescription.xml"))
        for name, content in binaries.items():
            archive.writestr(name, content)
    return into


def refusal(path: Path) -> str:
    """What is said when an FMU is loaded."""
    with pytest.raises(FmuError) as caught:
        FmuInstance("plant", path)
    return str(caught.value)


@pytest.mark.parametrize("version", [2, 3])
def test_a_binary_whose_name_differs_from_the_model_identifier_is_named(tmp_path: Path, version: int) -> None:
    path = tiny_fmu(tmp_path / "dog.fmu", GAIN, version=version)
    folder = folder_here(version)
    other = repacked(path, {f"binaries/{folder}/small.so": b"x"}, tmp_path / "other.fmu")
    assert refusal(other) == (
        f"plant other.fmu: cannot be instantiated: binaries/{folder} lacks tiny.so, which "
        'modelIdentifier="tiny" names; it holds small.so; give the binary that name, or export again'
    )


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("target", "kind"),
    [
        ("aarch64-linux", "an ELF library for aarch64"),
        ("win64", "a Windows library"),
        ("", "no library, or a damaged one"),
    ],
)
def test_a_binary_that_this_machine_does_not_run_is_named_by_what_it_is(
    tmp_path: Path, version: int, target: str, kind: str
) -> None:
    # given an FMU whose binary in this machine's folder was made for another, or is damaged
    path = tiny_fmu(tmp_path / "dog.fmu", GAIN, version=version)
    content = b""
    if target == "aarch64-linux":
        (tmp_path / "e.c").write_text("int e(void) { return 0; }")
        content = build_library(tmp_path, ["e.c"], tmp_path / "e.so", what="e", target=target).read_bytes()
    elif target:
        content = b"MZ" + bytes(100)
    other = repacked(path, {f"binaries/{folder_here(version)}/tiny.so": content}, tmp_path / "other.fmu")
    here = Path.cwd()
    # when, then
    start = f"plant other.fmu: cannot be instantiated: tiny.so is {kind}, this machine is "
    assert refusal(other).startswith(start)
    assert Path.cwd() == here


def test_a_binary_that_lacks_another_library_names_it(tmp_path: Path) -> None:
    # given an FMU that is linked to libleash.so
    path = tiny_fmu(tmp_path / "dog.fmu", GAIN)
    (tmp_path / "e.c").write_text("int leash(void) { return 0; }")
    (tmp_path / "f.c").write_text("int leash(void); int f(void) { return leash(); }")
    build_library(tmp_path, ["e.c"], tmp_path / "libleash.so", what="e", flags=("-fvisibility=default",))
    library = build_library(
        tmp_path, ["f.c", "libleash.so"], tmp_path / "f.so", what="f", flags=("-fvisibility=default",)
    ).read_bytes()
    other = repacked(path, {f"binaries/{folder_here(2)}/tiny.so": library}, tmp_path / "other.fmu")
    assert refusal(other) == (
        "plant other.fmu: cannot be instantiated: tiny.so needs libleash.so, which this machine lacks; "
        "install it, or export without it"
    )


def test_errors_of_an_fmu_in_a_package_name_the_package_not_a_temporary_folder(tmp_path: Path) -> None:
    # given a package whose FMU has no description
    with zipfile.ZipFile(tmp_path / "dog.fmu", "w") as packed:
        packed.writestr("modelDescription.xml", "<a>")
    ssd = """<SystemStructureDescription xmlns="http://ssp-standard.org/SSP1/SystemStructureDescription"
        version="1.0" name="toy"><System name="toy"><Elements><Component name="plant" source="dog.fmu"/>
        </Elements></System></SystemStructureDescription>"""
    package = tmp_path / "toy.ssp"
    with zipfile.ZipFile(package, "w") as archive:
        archive.writestr("SystemStructure.ssd", ssd)
        archive.write(tmp_path / "dog.fmu", "dog.fmu")
    # when
    with pytest.raises(CanineError) as caught, open_ssp(package) as system:
        describe(system.components["plant"].fmu)
    # then
    assert str(caught.value).startswith(f"{package}: dog.fmu: modelDescription.xml: malformed XML")


NOEXEC = """
mount -t tmpfs -o noexec tmpfs {folder} || exit 77
TMPDIR={folder} {python} -m harness.main check {fmu}
"""


def test_a_temporary_folder_that_runs_no_programs_is_said(tmp_path: Path) -> None:
    # given TMPDIR on a file system mounted noexec, which takes a namespace of its own
    path = tiny_fmu(tmp_path / "dog.fmu", GAIN)
    folder = tmp_path / "temporary"
    folder.mkdir()
    script = NOEXEC.format(folder=folder, python=sys.executable, fmu=path)
    if shutil.which("unshare") is None:
        pytest.skip("left out: this machine has no unshare")
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", script], capture_output=True, text=True, check=False,
        cwd=Path(__file__).parents[3],
    )  # fmt: skip
    if done.returncode == 77 or "unshare" in done.stderr:
        pytest.skip(f"left out: no file system can be mounted here: {done.stderr}")
    # then
    assert done.returncode == 1
    assert done.stderr == (
        "canine: fmu dog.fmu: cannot be instantiated: tiny.so is unpacked below a folder that is mounted "
        f"noexec, from where no program runs: {folder}; set TMPDIR to a folder elsewhere (and "
        "XDG_CACHE_HOME, if the cache lies there)\n"
    )


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("loop", get_args(Loop))
@pytest.mark.parametrize("where", ["start", "step"])
def test_a_signal_before_an_fmu_logs_is_not_lost(
    tmp_path: Path, version: int, loop: Loop, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given an FMU in which SIGINT arrives just before it calls the logger, which is Python
    dropped: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", dropped.append)
    signalled = 'extern int raise(int); raise(2); say("a");'
    code = signalled if where == "start" else f"if (t > 0.1 && t < 0.13) {{ {signalled} }}"
    step, start = ("", code) if where == "start" else (code, "")
    path = tiny_fmu(tmp_path / "dog.fmu", GAIN, step, version=version, start=start)
    ticks: list[float] = []
    # when
    with pytest.raises(KeyboardInterrupt), Simulation(alone(path), loop=loop) as simulation:
        simulation.run(record=lambda t, v: ticks.extend(t))
    # then it is raised at the end of that call, and no tick before it is lost
    assert dropped == []
    assert ticks == [tick * 0.04 for tick in range(len(ticks))]
    assert len(ticks) < 100
    assert where == "start" or len(ticks) >= 3
