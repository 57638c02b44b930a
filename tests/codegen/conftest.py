"""Golden files with `--update`, and the blocks' C compiled by every compiler at hand, once a session."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.codegen.compiled import BUILDS, Build, Library

GOLDEN = Path(__file__).parent / "golden"


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """`golden(name, text)`: the text is that of the golden file, or the difference is shown."""

    def compare(name: str, text: str) -> None:
        path = GOLDEN / name
        if request.config.getoption("--update"):
            path.write_text(text)
        expected = path.read_text() if path.exists() else ""
        difference = difflib.unified_diff(
            expected.splitlines(), text.splitlines(), f"golden/{name}", "generated", lineterm=""
        )
        if text != expected:
            pytest.fail("\n".join([*difference, "If this is meant: pytest --update"]), pytrace=False)

    return compare


@pytest.fixture(scope="session")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Build, str], Library]:
    """`libraries(build, precision)`: all blocks of a precision as one library, compiled when first needed."""
    made: dict[tuple[Build, str], Library] = {}

    def make(build: Build, precision: str) -> Library:
        if (build, precision) not in made:
            made[build, precision] = Library(build, precision, tmp_path_factory.mktemp(build.name))
        return made[build, precision]

    return make


@pytest.fixture(params=BUILDS, ids=lambda build: build.name)
def build(request: pytest.FixtureRequest) -> Build:
    """Each compiler and set of flags in turn."""
    build: Build = request.param
    return build
