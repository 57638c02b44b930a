"""The page about the models agrees with the declarations, and its glossary with the code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from models.document import README, readme
from models.glossary import TERMS, TRAILS
from models.kit.block import Block
from models.kit.tracing import Table
from models.system import BLOCKS

ROOT = Path(__file__).parents[2]
PLACES = sorted(
    {
        *(place for terms in TERMS.values() for term in terms for place in term.places),
        *((name, path) for steps in TRAILS.values() for name, path, _ in steps),
    }
)


def test_the_page_is_up_to_date() -> None:
    assert README.read_text() == readme(), "declarations have changed: run `python -m models.document`"


@pytest.mark.parametrize(("name", "path"), PLACES)
def test_a_name_of_the_glossary_is_defined_in_its_file(name: str, path: str) -> None:
    definition = rf"^\s*(class {name}\b|def {name}\(|{name} = |{name}: )"
    assert re.search(definition, (ROOT / path).read_text(), re.MULTILINE)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.title())
def test_every_guard_has_words(block: type[Block]) -> None:
    program = block.program()
    for phase in (*program.initialize, *program.tick):
        assert (phase.guard is None) == (phase.when == ""), phase.name
        for row in phase.rows if isinstance(phase, Table) else ():
            assert row.when
