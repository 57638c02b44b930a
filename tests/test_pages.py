"""The pages: their links lead somewhere, and the files that they name are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[1]
FLOORS = ("models", "codegen", "fmus", "harness")
PAGES = sorted(
    [*PROJECT.glob("*.md"), *(page for floor in FLOORS for page in (PROJECT / floor).rglob("*.md"))]
)
FILES = [
    f"/{path.relative_to(PROJECT)}" for floor in (*FLOORS, "tests") for path in (PROJECT / floor).rglob("*.*")
]
MADE = {  # by commands, by generators, or by users
    "block_fmu.h", "dog.toml", "fit.json", "fit.toml", "fixes.h", "mine.toml", "models.h", "mrg32k3a.h",
    "my.toml", "navigation.h", "outages.json", "pil.json", "recommendation.json", "recording.toml",
    "seeds.csv", "summary.json", "tune.json", "tune.toml", "units.json",
}  # fmt: skip


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(PROJECT)))
def test_links_of_a_page_lead_to_files(page: Path) -> None:
    targets = re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text())
    assert [target for target in targets if not (page.parent / target).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(PROJECT)))
def test_files_that_a_page_names_are_there(page: Path) -> None:
    names = re.findall(r"`([\w./-]+\.(?:py|[chs]|json|toml|jinja))`", page.read_text())
    named = [
        n.removeprefix("sources/") for n in names if n.rpartition("/")[2] not in MADE
    ]  # sources/ of an FMU
    assert [name for name in named if not any(file.endswith(f"/{name}") for file in FILES)] == []
