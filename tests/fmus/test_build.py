"""What is in an FMU: descriptions that validate, names of the declaration and no others, the same bytes."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
import threading
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest
from fmpy.validation import validate_fmu

from codegen import cache
from codegen.blocks.block_c import generate
from codegen.cache import FLOORS
from codegen.toolchains.compiler import PLATFORMS, CompileError, this_platform
from fmus.archive import is_sealed
from fmus.build import BuildError, build_all, build_fmu
from fmus.dependencies import initial_dependencies, tick_dependencies
from fmus.folder import STAMP, FmiVersion, build_folder, is_current, origin
from models.canine import Canine
from models.errors import DeclarationError
from models.kit.block import Block
from models.kit.declaration import Output, State, Type, flatten
from models.kit.units import UNITS
from models.system import System
from tests.fmus.pulse import Pulse, Slide

Fmu = Callable[[type[Block]], Path]


def test_fmpy_finds_nothing_wrong(block: type[Block], fmu: Fmu) -> None:
    assert validate_fmu(str(fmu(block))) == []


def test_the_description_holds_the_declaration_and_nothing_else(block: type[Block], fmu: Fmu) -> None:
    # given the declaration's variables and those of the model description
    description = fmpy.read_model_description(str(fmu(block)))
    described = {v.name: v for v in description.modelVariables}
    if description.fmiVersion == "3.0":
        assert described.pop("time").causality == "independent"
    declared = {n: v for k in ("input", "output", "parameter", "state") for n, v in flatten(block.group(k))}
    # then names and order are the same, and references count them
    assert list(described) == list(declared)
    assert [v.valueReference for v in described.values()] == list(range(len(declared)))
    # then unit, type, causality, range and start are those declared
    types = {Type.REAL: ("Real", "Float64"), Type.INTEGER: ("Integer", "Int32"), Type.BOOLEAN: ("Boolean",)}
    units = {u.name: u.baseUnit for u in description.unitDefinitions}
    for name, variable in declared.items():
        got = described[name]
        assert got.type in types[variable.type]
        assert got.causality == {"state": "local"}.get(variable.kind, variable.kind)
        assert (got.unit or "") == variable.unit
        assert variable.meaning in got.description
        assert all(f"{int(c)} {c.name}" in got.description for c in variable.choices or ())
        if variable.unit:
            assert {
                b: p for b in ("kg", "m", "s", "A", "rad") if (p := getattr(units[variable.unit], b))
            } == (UNITS[variable.unit])
        if variable.type is not Type.BOOLEAN:
            assert (None if got.min is None else float(got.min)) == variable.min
            assert (None if got.max is None else float(got.max)) == variable.max
        if variable.kind in ("input", "parameter"):
            index = variable.flat_names.index(name)
            start = float(got.start == "true") if variable.type is Type.BOOLEAN else float(got.start)
            assert start == variable.start[index]
    # then the step is fixed, unless a block passes on what others give at their step
    stated = description.defaultExperiment.stepSize
    assert stated is None if block.transparent else float(stated) == block.sample_time
    assert description.coSimulation.canHandleVariableCommunicationStepSize == block.transparent


def test_outputs_tell_what_they_depend_on(fmu: Fmu) -> None:
    # given which inputs reach which outputs of the small blocks, by reading them
    assert tick_dependencies(Pulse) == {
        "place": {"push", "kick"},
        "beating": {"push", "kick"},
        "shown": {"push", "kick"},
        "steady": frozenset(),
    }
    assert initial_dependencies(Slide) == {"place": {"begin"}}
    # then the description says so, an empty list for a plant
    for toy, expected in ((Pulse, {"place": ["push", "kick"], "steady": []}), (Slide, {"place": []})):
        description = fmpy.read_model_description(str(fmu(toy)))
        depends_on = {u.variable.name: [d.name for d in u.dependencies] for u in description.outputs}
        assert expected.items() <= depends_on.items()
    initial = fmpy.read_model_description(str(fmu(Slide))).initialUnknowns
    assert [(u.variable.name, [d.name for d in u.dependencies]) for u in initial] == [("place", ["begin"])]


def test_a_plant_closes_a_loop(fmu: Fmu) -> None:
    description = fmpy.read_model_description(str(fmu(Canine)))
    assert len(description.outputs) == len(Canine.flat_names("output"))
    assert all(u.dependencies == [] for u in description.outputs)


def test_two_builds_give_the_same_bytes(tmp_path: Path, fmu: Fmu, version: FmiVersion) -> None:
    again = build_fmu(Pulse, tmp_path / "elsewhere", version)
    assert again.read_bytes() == fmu(Pulse).read_bytes()


def test_a_checkout_keeps_its_fmus_and_an_installed_package_the_users_cache(tmp_path: Path) -> None:
    # given the packages as they are installed: without the files of a checkout
    for floor in ("models", "codegen", "fmus"):
        shutil.copytree(FLOORS / floor, tmp_path / "site" / floor, ignore=shutil.ignore_patterns("build"))
    script = "from fmus.folder import build_folder; print(build_folder())"
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("ZIG_GLOBAL_CACHE_DIR", None)

    # when it is asked where its FMUs are
    place = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path / "site", env=environment, check=True,
        capture_output=True, text=True,
    ).stdout.strip()  # fmt: skip

    # then they are in the user's cache, by the state of its sources; a checkout has them beside the shim
    assert Path(place).parent == tmp_path / "cache" / "guided-canine" / "fmus"
    assert build_folder() == FLOORS / "fmus" / "build"


def test_no_path_and_no_time_gets_in(fmu: Fmu) -> None:
    with zipfile.ZipFile(fmu(Pulse)) as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        for name in archive.namelist():
            content = archive.read(name)
            assert b"/tmp" not in content
            assert os.getcwd().encode() not in content


def test_what_is_up_to_date_is_not_built_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given an FMU, and no compiler from now on
    path = build_fmu(Slide, tmp_path, 2)
    written = path.stat().st_mtime_ns
    monkeypatch.setattr("fmus.build.build_library", lambda *a, **k: pytest.fail("compiled again"))
    # then it stays as it is, but a damaged one is built again
    assert build_fmu(Slide, tmp_path, 2).stat().st_mtime_ns == written
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(pytest.fail.Exception, match="compiled again"):
        build_fmu(Slide, tmp_path, 2)


def test_a_failed_build_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given an FMU, and C that does not compile
    path = build_fmu(Slide, tmp_path, 2)
    before = path.read_bytes()
    broken = generate(Slide) | {"slide.c": "int x = ;\n"}
    monkeypatch.setattr("fmus.build._generate", lambda block, precision: broken)
    # when it is built
    with pytest.raises(CompileError, match=r"(?s)slide \(FMI 2\.0, .*ziglang.*error: expected expression"):
        build_fmu(Slide, tmp_path, 2)
    # then the error names block and compiler, and the old file is whole
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["slide.fmu"]


def test_two_builds_at_once_do_not_collide(tmp_path: Path) -> None:
    failures: list[BaseException] = []

    def build() -> None:
        try:
            for version in (2, 3):
                build_fmu(Slide, tmp_path / f"fmi{version}", version)
        except BaseException as error:
            failures.append(error)

    threads = [threading.Thread(target=build) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    assert sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*.*")) == [
        "fmi2/slide.fmu", "fmi3/slide.fmu",
    ]  # fmt: skip


def test_unknown_platforms_and_precisions_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CompileError, match='platform "linux46" is not known; did you mean "linux64"'):
        build_fmu(Slide, tmp_path, 2, ["linux46"])
    with pytest.raises(DeclarationError, match="slide comes in double precision, not in float"):
        build_fmu(Slide, tmp_path, 2, precision="float")


def test_an_fmu_for_more_machines_stays_as_it_is(
    tmp_path: Path, version: FmiVersion, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given an FMU for this machine and another, and no compiler from now on
    other = "darwin64" if this_platform() != "darwin64" else "linux64"
    path = build_fmu(Slide, tmp_path, version, [this_platform(), other])
    written = path.read_bytes()
    monkeypatch.setattr("fmus.build.build_library", lambda *a, **k: pytest.fail("compiled again"))
    # when it is asked for on this machine, then both binaries are still there
    build_fmu(Slide, tmp_path, version)
    assert path.read_bytes() == written
    # but one machine more is built
    with pytest.raises(pytest.fail.Exception, match="compiled again"):
        build_fmu(Slide, tmp_path, version, [this_platform(), "win64"])


@pytest.mark.skipif(not this_platform().endswith("linux64"), reason="the two share a folder on Linux alone")
def test_a_binary_for_arm_does_not_pass_for_this_machines(tmp_path: Path) -> None:
    # given an FMU whose binaries/linux64 is for ARM, as FMI 2.0 has no other place for it
    arm = build_fmu(Slide, tmp_path, 2, ["aarch64-linux"]).read_bytes()
    # then it is built for this machine when that is asked for
    assert build_fmu(Slide, tmp_path, 2, ["linux64"]).read_bytes() != arm


@pytest.fixture
def only_slide(monkeypatch: pytest.MonkeyPatch) -> None:
    """One small block instead of all."""
    components: dict[str, type[Block]] = {"plant": Slide}
    monkeypatch.setattr("fmus.build.BLOCKS", (Slide,))
    monkeypatch.setattr("fmus.folder.BLOCKS", (Slide,))
    monkeypatch.setattr("fmus.build.SYSTEMS", {"one": System("one", components, ())})


@pytest.mark.usefixtures("only_slide")
@pytest.mark.parametrize("name", ["aarch64-linux", "aarch64-darwin", "darwin64"])
def test_what_is_built_for_another_machine_runs_here_too(tmp_path: Path, name: str) -> None:
    # when everything is built for another machine
    build_all(tmp_path, [name])
    # then this machine can load the FMUs, also those in the package
    assert is_current(tmp_path)
    for version in (2, 3):
        with zipfile.ZipFile(tmp_path / f"one.fmi{version}.ssp") as package:
            package.extractall(tmp_path / "package")
        folder = tmp_path / f"unpacked{version}"
        fmpy.extract(str(tmp_path / "package" / "resources" / "slide.fmu"), str(folder))
        ctypes.CDLL(str(library(folder, version, "slide")))
    # and the FMI 3.0 FMU has the other's binary beside it
    other = PLATFORMS[name]
    assert (tmp_path / "unpacked3" / "binaries" / other.fmi3 / f"slide{other.suffix}").is_file()


@pytest.mark.usefixtures("only_slide")
@pytest.mark.parametrize("lost", ["platform", "file"])
def test_a_folder_that_does_not_run_here_is_not_current(tmp_path: Path, lost: str) -> None:
    # given a folder that is current until one of its FMUs is for another machine alone, or gone
    build_all(tmp_path)
    assert is_current(tmp_path)
    (tmp_path / "fmi2" / "slide.fmu").unlink()
    if lost == "platform":
        build_fmu(Slide, tmp_path / "fmi2", 2, ["darwin64" if this_platform() != "darwin64" else "linux64"])
    # then it is no longer, and a build mends it
    assert not is_current(tmp_path)
    build_all(tmp_path)
    assert is_current(tmp_path)


@pytest.mark.usefixtures("only_slide")
def test_an_edit_during_the_build_leaves_the_folder_out_of_date(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given models that change while they are built
    monkeypatch.setattr("fmus.build.origin", lambda: "before")
    build_all(tmp_path, done=lambda path: monkeypatch.setattr("fmus.build.origin", lambda: "after"))
    # then what was built is of the models as they were
    assert not is_current(tmp_path)


@pytest.mark.usefixtures("only_slide")
def test_models_edited_after_their_import_leave_the_folder_out_of_date(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a process that runs other models than the files have
    monkeypatch.setattr("codegen.cache.IMPORTED_AT", 0.0)
    # then what it builds is not taken for that of the files
    build_all(tmp_path)
    assert not is_current(tmp_path)


@pytest.mark.parametrize("package", ["ziglang", "casadi", "jinja2", "fmpy", "python"])
def test_the_version_of_a_tool_decides_what_is_current(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = origin()
    if package == "python":
        monkeypatch.setattr("platform.python_version", lambda: "3.99.0")
    else:
        version = cache._version
        monkeypatch.setattr(cache, "_version", lambda name: "0.0.1" if name == package else version(name))
    assert origin() != before


@pytest.mark.parametrize("name", ["models/canine.py", "codegen/cache.py", "fmus/shim/shim.c"])
def test_each_floor_below_the_fmus_decides_what_is_current(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for floor in ("models", "codegen", "fmus"):
        leave_out = shutil.ignore_patterns("__pycache__", "build")
        shutil.copytree(FLOORS / floor, tmp_path / floor, ignore=leave_out)
    monkeypatch.setattr("codegen.cache.FLOORS", tmp_path)
    before = origin()
    content = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(content[:-2] + bytes([content[-2] ^ 1]) + content[-1:])
    assert origin() != before


def test_two_machines_in_one_folder_are_refused(tmp_path: Path) -> None:
    # FMI 2.0 has one folder for all 64-bit Linux machines
    with pytest.raises(
        BuildError, match=r"x86_64-linux, aarch64-linux: FMI 2\.0 keeps them in folders linux64, l"
    ):
        build_fmu(Slide, tmp_path, 2, ["linux64", "aarch64-linux"])


def test_a_variable_called_time_is_refused(tmp_path: Path) -> None:
    class Clock(Block):
        """Takes FMI's own name."""

        count = State("1", "ticks")
        time = Output("s", "of the day")

        def answer(m: Clock) -> None:
            m.count = m.count + 1
            m.time = m.count

    with pytest.raises(DeclarationError, match=r'clock: variable "time"; FMI 3\.0 adds its own, rename it'):
        build_fmu(Clock, tmp_path, 3)


def library(folder: Path, version: int, name: str) -> Path:
    platform = PLATFORMS[this_platform()]
    return folder / "binaries" / {2: platform.fmi2, 3: platform.fmi3}[version] / f"{name}{platform.suffix}"


def test_every_function_of_the_interface_is_exported(fmu: Fmu, tmp_path: Path, version: FmiVersion) -> None:
    # given the functions that the official header declares
    fmpy.extract(str(fmu(Slide)), str(tmp_path))
    header = (tmp_path / "sources" / f"fmi{version}Functions.h").read_text()
    words = [line.split() for line in header.splitlines() if f"FMI{version}_Export fmi" in line]
    names = [line[-1].rstrip(";") for line in words]
    assert len(names) == {2: 44, 3: 75}[version]
    # then the binary has them all
    binary = ctypes.CDLL(str(library(tmp_path, version, "slide")))
    assert [name for name in names if not hasattr(binary, name)] == []


def test_another_platform_is_built_here(tmp_path: Path, version: FmiVersion) -> None:
    # given a machine that is not this one
    name = "darwin64" if this_platform() != "darwin64" else "linux64"
    platform = PLATFORMS[name]
    # when an FMU is built for it
    with zipfile.ZipFile(build_fmu(Slide, tmp_path, version, [name])) as archive:
        folder = {2: platform.fmi2, 3: platform.fmi3}[version]
        binary = archive.read(f"binaries/{folder}/slide{platform.suffix}")
    # then its binary has that machine's format (Mach-O, 64 bits) and nothing else lies beside it
    assert binary[:4] == {"darwin64": b"\xcf\xfa\xed\xfe", "linux64": b"\x7fELF"}[name]


def test_everything_is_built_and_then_stays(tmp_path: Path) -> None:
    # when everything is built twice
    assert not is_current(tmp_path)
    reported: list[Path] = []
    paths = build_all(tmp_path, done=reported.append)
    written = {path: path.stat().st_mtime_ns for path in paths if path.suffix == ".fmu"}
    again = build_all(tmp_path)
    # then all files are there, the FMUs are left alone the second time, and the folder knows its origin
    names = {str(path.relative_to(tmp_path)) for path in paths}
    assert {"fmi2/canine.fmu", "fmi3/pedestrian.fmu", "full.fmi2.ssp", "cts.fmi3.ssp"} <= names
    assert reported == paths == again
    assert {path: path.stat().st_mtime_ns for path in written} == written
    assert is_current(tmp_path)


@pytest.mark.usefixtures("only_slide")
@pytest.mark.parametrize("name", ["fmi2/slide.fmu", "one.fmi2.ssp"])
def test_what_another_tool_has_changed_is_built_again(tmp_path: Path, name: str) -> None:
    # given a file whose comment is as it was, and whose content is not
    build_all(tmp_path)
    path = tmp_path / name
    built = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        comment, first = archive.comment, archive.namelist()[0]
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(first, "")
        archive.comment = comment
    assert not is_sealed(path)
    # when
    build_all(tmp_path)
    # then
    assert path.read_bytes() == built
    assert is_sealed(path)


@pytest.mark.usefixtures("only_slide")
def test_what_was_built_from_other_models_is_not_current(tmp_path: Path) -> None:
    build_all(tmp_path)
    stamp = tmp_path / STAMP
    stamp.write_text(stamp.read_text()[::-1])
    assert not is_current(tmp_path)


def test_fmpys_defaults_run_it(block: type[Block], fmu: Fmu) -> None:
    # given nothing but the file, as a newcomer to it would
    result = fmpy.simulate_fmu(str(fmu(block)))
    # then it runs to the end of its default experiment
    assert result["time"][-1] == pytest.approx(40.0)
