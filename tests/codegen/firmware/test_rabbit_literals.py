"""SDCC 4.5 forgets that a read of 32 bits changes HL: a program with a wrong literal for it is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from codegen.firmware.rabbit4000 import build_object, stale_literals
from codegen.firmware.targets import TARGETS
from codegen.toolchains.compiler import CompileError
from tests.codegen.firmware.test_bundle import rabbit_tools

TARGET = TARGETS["rabbit4000"]
READ = """
;stale.c:7: place.a = 0;
;\tgenPointerSet
\tld\thl, #0x0000
\tld\t(_place), hl
;stale.c:8: place.x = place.y;
;\tgenPointerGet
\tld\thl, (#(_place + 8) + 0)
;\tgenPointerSet
\tld\t(_place + 4), hl
;stale.c:9: place.b = 0;
;\tgenPointerSet
;fetchPairLong
"""


@pytest.mark.parametrize(
    ("then", "stale"),
    [
        ("\tld\t(_place + 12), hl", ["stale.c:9: place.b = 0;"]),  # it takes HL for 0
        ("\tinc\thl", ["stale.c:9: place.b = 0;"]),  # it takes HL for 1 less
        ("\tld\thl, #0x0000", []),
        ("\tld\thl, 2 (sp)", []),
        ("\tld\tde, #0x0000", []),
        ("\tbool\thl\n\tld\tl, h", []),  # makes it 0
    ],
)
def test_a_literal_behind_a_read_is_stale_unless_it_is_loaded_anew(then: str, stale: list[str]) -> None:
    assert stale_literals(READ + then + "\n") == stale


@pytest.mark.parametrize(
    ("other", "stale"), [("place.c", False), ("(i + 1)", False), ("5", True), ("-1", True)]
)
def test_a_comparison_of_variables_takes_what_was_read(other: str, stale: bool) -> None:
    line = f"stale.c:9: t3 = place.x != {other};"
    text = READ.replace("stale.c:9: place.b = 0;", line).replace(
        ";\tgenPointerSet\n;fetchPairLong", ";\tgenCmpEq\n;fetchPairLong"
    )
    assert stale_literals(text + "\tex\tde, hl\n") == ([line] if stale else [])


def test_behind_a_label_no_literal_is_stale() -> None:
    text = READ.replace(";stale.c:9", "00101$:\n;stale.c:9")
    assert stale_literals(text + "\tld\t(_place + 12), hl\n") == []


def test_c_that_sdcc_compiles_to_a_stale_literal_is_refused_with_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rabbit_tools()
    # given whole numbers stored before and behind a copy of a real, in a struct of known address
    source = """
#include <stdint.h>
struct { int32_t a, b; float x, y, z, w; } place;
void copy(void)
{
    place.a = 0;
    place.x = place.y;
    place.z = place.w;
    place.b = 0;
}
"""
    with pytest.raises(CompileError, match=r"stale\.c: SDCC .* wrong value here: .*place\.b = 0"):
        build_object("stale.c", TARGET, {"stale.c": source})
    # and if the reals come first, it is compiled
    later = source.replace("    place.a = 0;\n", "").replace("    place.b", "    place.a = 0;\n    place.b")
    assert build_object("fresh.c", TARGET, {"fresh.c": later}).is_file()
