"""Rows as JSON: every value reads back to the same bits, in whatever batches they come."""

import json
import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.log.channel import Channel
from harness.log.rows import Rows

REALS = (
    0.0, -0.0, 0.1 + 0.2, 1 / 3, 1.0, 100.0, 1e15, 1e16, 1e17, 123456789012345680.0, 1e-4, 1e-5, 1e-7,
    5e-324, -2.2250738585072e-308, 1.7976931348623157e308, 2**53 + 0.0, math.nan, math.inf, -math.inf,
)  # fmt: skip
INTEGERS = (0.0, -0.0, 1.0, -7.0, 2**53, -(2**53), 2**53 + 2, 2**62, -(2**63), 2**63, 2**64 - 2**11)


def channel(component: str, **signals: str) -> Channel:
    """Signals as name=type."""
    names, kinds = tuple(signals), tuple(signals.values())
    return Channel(component, component, names, ("",) * len(names), kinds, ("",) * len(names))


MIXED = channel("mixed", real="Real", integer="Integer", yes="Boolean", other="Real")


def spell(rows: Rows, *ticks: tuple[float, ...]) -> list[bytes]:
    return rows.encode({"mixed": np.array(ticks, dtype=float)})


@pytest.mark.parametrize(
    ("row", "text"),
    [
        ((0.5, 3, 1, -0.0), b'{"real":0.5,"integer":3,"yes":true,"other":-0.0}'),
        ((1, -0.0, 0, 25), b'{"real":1.0,"integer":0,"yes":false,"other":25.0}'),
        ((math.nan, 2, 1, math.inf), b'{"real":"NaN","integer":2,"yes":true,"other":"Infinity"}'),
        ((-math.inf, -3, 0, 1e-7), b'{"real":"-Infinity","integer":-3,"yes":false,"other":1e-7}'),
        ((5e-324, 2**53, 2, 1e16), b'{"real":5e-324,"integer":9007199254740992,"yes":true,"other":1e+16}'),
        ((0, math.nan, math.nan, 0), b'{"real":0.0,"integer":"NaN","yes":true,"other":0.0}'),
    ],
)
def test_a_row_is_spelled_by_its_types(row: tuple[float, ...], text: bytes) -> None:
    assert spell(Rows([MIXED]), row) == [text]


def test_reals_read_back_to_the_same_bits() -> None:
    texts = spell(Rows([MIXED]), *((x, 0, 0, -x) for x in REALS))
    read = [float(json.loads(text)["real"]) for text in texts]
    assert struct.pack(f"<{len(read)}d", *read) == struct.pack(f"<{len(read)}d", *REALS)


@given(st.lists(st.floats(), min_size=1, max_size=60))
def test_drawn_reals_have_no_more_digits_than_python_gives_them(values: list[float]) -> None:
    texts = spell(Rows([MIXED]), *((x, 0, 0, 0) for x in values))
    for text, value in zip(texts, values, strict=True):
        spelled = text.split(b":")[1].partition(b",")[0].decode()
        if math.isfinite(value):
            assert struct.pack("<d", float(spelled)) == struct.pack("<d", value)
            assert digits(spelled) == digits(repr(value))
        else:
            assert spelled == json.dumps({"inf": "Infinity", "-inf": "-Infinity"}.get(repr(value), "NaN"))


def digits(text: str) -> str:
    """The significant digits of a number as text."""
    return text.partition("e")[0].replace(".", "").replace("-", "").strip("0")


def test_integers_have_all_their_digits() -> None:
    texts = spell(Rows([MIXED]), *((0, x, 0, 0) for x in INTEGERS))
    assert [json.loads(text)["integer"] for text in texts] == [int(x) for x in INTEGERS]


@pytest.mark.parametrize("batch", [1, 2, 7, 25, 60])
def test_the_texts_are_the_same_in_batches_of_any_size(batch: int) -> None:
    # given 60 ticks with values that are held, that repeat each other, that change, and that are not finite
    ticks = [(k / 3, k // 9, k % 2, math.nan if k % 5 == 0 else k / 3 if k < 30 else 4.0) for k in range(60)]
    expected = [text for tick in ticks for text in spell(Rows([MIXED]), tick)]
    # when
    rows = Rows([MIXED])
    texts = [text for i in range(0, 60, batch) for text in spell(rows, *ticks[i : i + batch])]
    # then
    assert texts == expected
    assert [json.loads(text)["integer"] for text in texts] == [k // 9 for k in range(60)]


def test_components_take_turns_within_a_tick() -> None:
    # given three components, the second without a signal
    rows = Rows([channel("a", x="Real"), channel("none"), channel("b", n="Integer", m="Integer")])
    values = {"b": np.array([[1.0, 2], [3, 4]]), "none": np.zeros((2, 0)), "a": np.array([[0.5], [1.5]])}
    assert rows.encode(values) == [
        b'{"x":0.5}',
        b"{}",
        b'{"n":1,"m":2}',
        b'{"x":1.5}',
        b"{}",
        b'{"n":3,"m":4}',
    ]


def test_names_that_json_escapes_are_escaped() -> None:
    # given names as a foreign FMU may have them
    names = ('a"b', "50 %s", "two\nlines", "},{", "größe")
    rows = Rows([channel("odd", **dict.fromkeys(names, "Real"))])
    [text] = rows.encode({"odd": np.array([[1.0, 2, 3, 4, 5]])})
    assert json.loads(text) == dict(zip(names, range(1, 6), strict=True))
