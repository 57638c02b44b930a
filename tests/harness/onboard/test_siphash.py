"""SipHash-2-4 on each processor, against its authors' vectors."""

from __future__ import annotations

from contextlib import closing
from importlib import import_module

import pytest

from codegen.firmware.bundle import library, processor_in_the_loop
from codegen.firmware.targets import IN_THE_LOOP, TARGETS
from codegen.toolchains import sdcc
from codegen.toolchains.compiler import CompileError
from tests.codegen.firmware.siphash_vectors import VECTORS

PROBE = """#include "pil.h"
#include "siphash.h"
#include <string.h>
void pil_record(uint32_t *words)
{
    uint8_t bytes[64];
    for (uint8_t i = 0U; i < 64U; i++) {
        bytes[i] = i;
    }
    for (uint8_t n = 0U; n < 64U; n++) { /* the key is the first 16 bytes too */
        siphash h;
        siphash_begin(&h, bytes);
        siphash_take(&h, bytes, n / 3U);
        siphash_take(&h, &bytes[n / 3U], (uint8_t)(n - (n / 3U)));
        siphash_end(&h, (uint8_t *)&words[2U * n]);
    }
}
"""


@pytest.mark.parametrize("name", IN_THE_LOOP)
def test_siphash_gives_the_authors_vectors_on_every_processor(name: str) -> None:
    target = TARGETS[name]
    if name == "rabbit4000":
        try:
            sdcc.home()
        except CompileError as missing:
            pytest.skip(str(missing))
    # given the program with a record of tags in the place of its own
    files = library(addressed=target.addressed, banked=target.banked) | processor_in_the_loop()
    module = import_module(f"harness.onboard.processors.{target.folder}")
    processor = module.start(target, files | {"pil_record.c": PROBE})
    # when it is started
    with closing(processor):
        tags = processor.start[: 8 * len(VECTORS)]
    # then they are what the authors' program gives, for messages of 0 to 63 bytes in two pieces
    assert [tags[i : i + 8] for i in range(0, len(tags), 8)] == VECTORS
