"""Every block's FMU of both versions, built once for all tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest

from fmus.build import build_fmu
from fmus.folder import FmiVersion
from models.kit.block import Block
from models.system import BLOCKS
from tests.fmus.pulse import Pulse, Slide

Fmu = Callable[[type[Block]], Path]


@pytest.fixture(params=[Pulse, Slide, *BLOCKS], ids=lambda block: block.title())
def block(request: pytest.FixtureRequest) -> type[Block]:
    block: type[Block] = request.param
    return block


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def version(request: pytest.FixtureRequest) -> FmiVersion:
    version: FmiVersion = request.param
    return version


@pytest.fixture(scope="session")
def build_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture
def fmu(build_folder: Path, version: FmiVersion) -> Fmu:
    """The FMU of a block; built at the first call, up to date at the others."""
    return lambda block: build_fmu(block, build_folder / f"fmi{version}", version)


@pytest.fixture
def unpacked(fmu: Fmu, build_folder: Path, version: FmiVersion) -> Fmu:
    """The folder that a block's FMU is unpacked in."""

    def unpack(block: type[Block]) -> Path:
        folder = build_folder / f"unpacked{version}" / block.title()
        if not folder.exists():
            fmpy.extract(str(fmu(block)), str(folder))
        return folder

    return unpack
