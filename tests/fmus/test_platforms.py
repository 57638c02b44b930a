"""Binaries for other machines, run in emulators of them: the bits of the reference results."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import numpy.typing as npt
import pytest

from codegen.toolchains.compiler import PLATFORMS, zig
from fmus.build import build_fmu
from fmus.folder import FmiVersion
from models.canine import Canine
from models.canine_tracker import CanineTracker
from models.cmec import Cmec
from models.kit.block import Block
from models.sensors import Sensors
from tests.fmus.rerun import assert_same_bits, experiment_of

RUNNER = Path(__file__).with_name("run_fmu.c")
KINDS = {"Real": "r", "Float64": "r", "Integer": "i", "Int32": "i", "Boolean": "b"}


@dataclass(frozen=True)
class Emulator:
    """What runs programs of a platform here: its command, what it needs, and the Debian packages of it."""

    command: tuple[str, ...]
    needs: tuple[str, ...]
    packages: str


EMULATORS = {
    "aarch64-linux": Emulator(
        ("qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"),
        ("qemu-aarch64", "/usr/aarch64-linux-gnu/lib/ld-linux-aarch64.so.1"),
        "qemu-user libc6-arm64-cross",
    ),
    # 700 MB: left to those who have it
    "win64": Emulator(("/usr/lib/wine/wine64",), ("/usr/lib/wine/wine64",), "wine64"),
}


@dataclass(frozen=True)
class Machine:
    """A platform in its emulator, and a folder that has the program for it."""

    platform: str
    emulator: Emulator
    folder: Path

    def run(self, fmu: Path, version: FmiVersion) -> dict[str, npt.NDArray[Any]]:
        """An unpacked FMU's outputs over its reference inputs, by name."""
        description, experiment = fmpy.read_model_description(str(fmu)), experiment_of(fmu)
        variables = {v.name: v for v in description.modelVariables}
        inputs, outputs = (list(t.dtype.names or ())[1:] for t in (experiment.inputs, experiment.outputs))
        groups = [
            [f"{KINDS[variables[n].type]} {variables[n].valueReference}" for n in g]
            for g in (inputs, outputs)
        ]
        values = np.array([[row[n] for n in inputs] for row in experiment.inputs], dtype=np.float64)
        rows = [" ".join(f"{bits:x}" for bits in row) for row in values.view(np.uint64)]
        job = [*(f"{len(group)} {' '.join(group)}" for group in groups), str(len(rows)), *rows]
        platform = PLATFORMS[self.platform]
        place = fmu / "binaries" / {2: platform.fmi2, 3: platform.fmi3}[version]
        library = place / f"{description.coSimulation.modelIdentifier}{platform.suffix}"
        command = [*self.emulator.command, str(self.folder / "run_fmu.exe"), str(library)]
        done = subprocess.run(
            [*command, str(version), description.guid, repr(experiment.step)],
            input="\n".join(job), capture_output=True, text=True, check=False,
            env=os.environ | {"WINEPREFIX": str(self.folder / "wine"), "WINEDEBUG": "-all"},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        bits = [[int(word, 16) for word in line.split()] for line in done.stdout.splitlines()]
        columns = np.array(bits, dtype=np.uint64).view(np.float64).T
        times = np.arange(len(bits)) * experiment.step
        return {"time": times, **dict(zip(outputs, columns, strict=True))}


@pytest.fixture(scope="module", params=EMULATORS)
def machine(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Machine:
    """An emulated machine, with the program for it that runs a binary."""
    platform: str = request.param
    emulator = EMULATORS[platform]
    if absent := [tool for tool in emulator.needs if not shutil.which(tool)]:
        pytest.skip(f"no emulator of {platform}, {', '.join(absent)}: apt install {emulator.packages}")
    folder = tmp_path_factory.mktemp(platform)
    headers = str(Path(fmpy.__file__).parent / "c-code")
    options = ["-target", PLATFORMS[platform].target, "-std=c99", "-O1", "-Wall", "-Wextra", "-I", headers]
    zig(["cc", *options, str(RUNNER), "-o", str(folder / "run_fmu.exe")], "run_fmu")
    return Machine(platform, emulator, folder)


@pytest.mark.parametrize(
    ("block", "version"),
    [(Canine, 2), (Cmec, 3), (Sensors, 3), (CanineTracker, 2)],
    ids=["canine", "cmec", "sensors", "canine_tracker"],
)
def test_a_binary_for_another_machine_gives_the_same_bits(
    block: type[Block], version: FmiVersion, machine: Machine, tmp_path: Path
) -> None:
    # given an FMU with the binary of that machine alone
    fmu = build_fmu(block, tmp_path, version, [machine.platform])
    folder = Path(fmpy.extract(str(fmu), str(tmp_path / "unpacked")))
    # when the emulator runs it over the reference inputs, then all outputs have the bits of the reference
    assert_same_bits(machine.run(folder, version), experiment_of(folder).outputs)
