"""Lines of generated C: none longer than a page is wide, and the same C."""

from __future__ import annotations

import re

import pytest

from codegen.blocks.layout import COLUMNS, fit
from models.kit.block import Block
from models.system import BLOCKS
from tests.codegen.compiled import generated


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.title())
def test_no_line_of_a_blocks_c_is_wider_than_a_page(block: type[Block]) -> None:
    for precision in block.precisions:
        for name, text in generated(block, precision).items():
            wide = [line for line in text.splitlines() if len(line) > COLUMNS]
            assert not wide, (name, precision)


def words(text: str) -> str:
    """The text without its white space and the stars of comments' lines."""
    return "".join(re.sub(r"^ *\*(?= )", "", text, flags=re.MULTILINE).split())


LONG = {
    "condition": "    if (" + " && ".join(f"(some_field_{i} > 0.0f)" for i in range(8)) + ") {\n",
    "declaration": "    const float t0 = " + " + ".join(f"(some_field_{i} * t{i})" for i in range(8)) + ";\n",
    "comment": "/* " + "word " * 40 + "*/\n",
    "comment behind code": "        float x; /* " + "word " * 40 + "*/\n",
    "chain": "    m->out.y = "
    + " : ".join(f"(key == KEY_{i}) ? VALUE_{i}" for i in range(6))
    + " : OTHER;\n",
}


@pytest.mark.parametrize("kind", LONG)
def test_a_long_line_is_broken_and_loses_nothing(kind: str) -> None:
    text = fit(LONG[kind])
    assert max(map(len, text.splitlines())) <= COLUMNS
    assert words(text) == words(LONG[kind])


def test_short_lines_stay_as_they_are() -> None:
    text = "/* a */\nint f(void)\n{\n    return 1;\n}\n"
    assert fit(text) == text


def test_a_condition_goes_on_below_what_is_inside_its_parenthesis() -> None:
    first, second = fit(LONG["condition"]).splitlines()
    assert first.endswith(" &&")
    assert second.startswith(" " * len("    if (") + "(some_field_")


def test_each_choice_of_a_chain_has_a_line() -> None:
    lines = fit(LONG["chain"]).splitlines()
    assert lines[0] == "    m->out.y ="
    assert lines[1] == "        (key == KEY_0) ? VALUE_0"
    assert lines[2] == "        : (key == KEY_1) ? VALUE_1"
    assert lines[-1] == "        : OTHER;"
    assert len(lines) == 8


def test_lines_of_a_long_comment_begin_with_a_star() -> None:
    lines = fit(LONG["comment"]).splitlines()
    assert len(lines) > 1
    assert all(line.startswith(" * word") for line in lines[1:])
    assert (
        fit(LONG["comment behind code"])
        .splitlines()[1]
        .startswith(" " * len("        float x; /") + "* word")
    )
