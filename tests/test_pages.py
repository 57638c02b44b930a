"""The pages: their links lead somewhere, and the files that they name are there."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from codegen.firmware.bundle import COSTS

PROJECT = Path(__file__).resolve().parents[1]
FLOORS = ("models", "codegen", "fmus", "harness")
PAGES = sorted(
    [*PROJECT.glob("*.md"), *(page for floor in FLOORS for page in (PROJECT / floor).rglob("*.md"))]
)
FILES = [
    f"/{path.relative_to(PROJECT)}" for floor in (*FLOORS, "tests") for path in (PROJECT / floor).rglob("*.*")
]
MADE = {  # by commands, by generators, or by users
    "block_fmu.h", "day.json", "dog.toml", "fit.json", "fit.toml", "fixes.h", "matrix.json", "mine.toml",
    "models.h", "mrg32k3a.h", "my.toml", "navigation.h", "outages.json", "pil.json",
    "recommendation.json", "recording.toml", "route.toml", "routes.json", "seeds.csv", "summary.json",
    "tune.json", "tune.toml", "units.json",
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


def test_pages_state_the_ticks_and_the_worst_tick_of_the_trials_on_board() -> None:
    # given what the default program was measured to cost on each processor
    costs = json.loads(COSTS.read_text())
    rabbit, cortex = costs["rabbit4000"]["four_state"], costs["cortex-m4f"]["four_state"]
    worst = max(rabbit[kind]["worst_ms_by_wait_states"][0] for kind in ("with_fix", "without_fix"))
    # then README and the page of results say the same
    readme = " ".join((PROJECT / "README.md").read_text().split())
    page = " ".join((PROJECT / "harness" / "results" / "onboard.md").read_text().split())
    assert f"The worst tick takes {worst:.1f} of 40 ms on the Rabbit." in readme
    for text in (readme, page):
        assert f"{rabbit['ticks']:,} ticks on the Rabbit 4000" in text
        assert f"{cortex['ticks']:,} on the Cortex-M4F" in text
