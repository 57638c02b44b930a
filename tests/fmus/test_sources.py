"""The sources in an FMU compile again as its descriptions say, and give its reference results."""

from __future__ import annotations

import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import fmpy.build
import pytest

from codegen.toolchains.compiler import FLAGS, PLATFORMS, this_platform
from fmus.folder import FmiVersion
from models.four_state import FourState
from models.kit.block import Block
from models.sensors import Sensors
from tests.conftest import MISSING
from tests.fmus.pulse import Pulse
from tests.fmus.rerun import rerun

Fmu = Callable[[type[Block]], Path]


@pytest.fixture
def sources_of(unpacked: Fmu, tmp_path: Path) -> Fmu:
    """A copy of an unpacked FMU without binaries."""

    def strip(block: type[Block]) -> Path:
        shutil.copytree(unpacked(block), tmp_path, dirs_exist_ok=True)
        shutil.rmtree(tmp_path / "binaries")
        return tmp_path

    return strip


def binary(folder: Path, version: int, block: type[Block]) -> Path:
    """Where this machine's binary belongs."""
    platform = PLATFORMS[this_platform()]
    place = {2: platform.fmi2, 3: platform.fmi3}[version]
    return folder / "binaries" / place / f"{block.title()}{platform.suffix}"


@pytest.mark.parametrize("block", [Pulse, Sensors, FourState], ids=lambda block: block.title())
def test_a_compiler_makes_the_binary_again(block: type[Block], sources_of: Fmu, version: FmiVersion) -> None:
    # given what the descriptions say; FMI 2.0 has no place for options and libraries
    folder = sources_of(block)
    options: list[str] = []
    libraries = ["-lm"]
    if version == 3:
        root = ET.parse(folder / "sources" / "buildDescription.xml").getroot()
        fileset = root.find("BuildConfiguration/SourceFileSet")
        assert fileset is not None
        assert fileset.get("compiler") == "clang"  # compilerOptions without compiler are refused by some
        options = (fileset.get("compilerOptions") or "").split()
        assert "-ffp-contract=off" in options
        libraries = [f"-l{e.get('name')}" for e in root.iterfind("BuildConfiguration/Library")]
        files = [e.attrib["name"] for e in fileset.iterfind("SourceFile")]
    else:
        root = ET.parse(folder / "modelDescription.xml").getroot()
        files = [e.attrib["name"] for e in root.iterfind("CoSimulation/SourceFiles/File")]
    assert set(files) == {path.name for path in (folder / "sources").glob("*.c")}
    # when a compiler compiles that, with all warnings: the system's, or pip's
    system = shutil.which("cc")
    compiler = [system] if system else [sys.executable, "-m", "ziglang", "cc", "-fno-sanitize=all"]
    warnings = [flag for flag in FLAGS if flag.startswith("-W")]
    output = binary(folder, version, block)
    output.parent.mkdir(parents=True)
    done = subprocess.run(
        [*compiler, "-shared", "-fPIC", *options, *warnings, *files, "-o", str(output), *libraries],
        cwd=folder / "sources", check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stderr == ""
    # then the same bits come out
    rerun(folder)


@pytest.mark.skipif("cmake" in MISSING, reason=f"no cmake: {MISSING.get('cmake')}")
def test_fmpy_makes_the_binary_again_with_cmake(sources_of: Fmu, version: FmiVersion) -> None:
    # given an FMU without binaries, when FMPy builds it by its descriptions
    folder = sources_of(FourState)
    fmpy.build.build_platform_binary(folder, cmake_options={"CMAKE_C_FLAGS:STRING": "-ffp-contract=off"})
    # then its binary is there, and gives the same bits
    assert binary(folder, version, FourState).is_file()
    rerun(folder)
