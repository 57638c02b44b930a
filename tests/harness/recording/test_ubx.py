"""The reader of recordings and the program on board find the same frames and fixes in the same bytes."""

from __future__ import annotations

import ctypes
from itertools import product
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codegen.firmware.fixes import RANGES
from harness.recording.recording import RecordingError
from harness.recording.ubx import LENGTHS, find_frames, read_ubx
from tests.codegen.firmware.onboard_drivers import (
    FIX,
    PVT,
    Driver,
    as_dict,
    library,
    posllh,
    pvt,
    sol,
    ubx_frame,
    velned,
)

GOOD = [*(pvt(250 * k) for k in range(4)), posllh(1000), velned(1000), sol(1000), pvt(1250, length=84)]


@pytest.fixture(scope="module")
def c(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The drivers on board."""
    return library(tmp_path_factory.mktemp("onboard"))


def on_board(c: ctypes.CDLL, data: bytes) -> list[dict[str, int]]:
    """The fixes that the program on board takes."""
    driver = Driver(c, "ubx")
    return [as_dict(driver.state.fix) for event in driver.receive(data) if event == FIX]


def replayed(folder: Path, data: bytes) -> np.ndarray:
    """The rows of the fixes that a replay takes."""
    (folder / "x.ubx").write_bytes(data)
    try:
        return read_ubx(folder / "x.ubx").rows
    except RecordingError:
        return np.empty((0, 8))


def damaged(data: bytes, dice: Random) -> bytes:
    """The bytes with some of them changed, lost, repeated or put between."""
    spoiled = bytearray(data)
    for _ in range(dice.randrange(1, 6)):
        at = dice.randrange(len(spoiled))
        match dice.randrange(5):
            case 0:
                spoiled[at] ^= 1 << dice.randrange(8)
            case 1:
                del spoiled[at : at + dice.randrange(1, 12)]
            case 2:
                spoiled[at:at] = dice.randbytes(dice.randrange(1, 12))
            case 3:
                spoiled[at:at] = GOOD[dice.randrange(len(GOOD))][: dice.randrange(2, 40)]
            case _:
                spoiled[at:at] = b"\xb5\x62\x01\x07" + dice.choice((b"\xff\x1f", b"\x5c\x00", b"\x54\x00"))
    return bytes(spoiled)


@settings(deadline=None, max_examples=300)
@given(st.integers(0, 2**32))
def test_damaged_bytes_hold_the_same_frames_and_errors_for_both_readers(c: ctypes.CDLL, seed: int) -> None:
    data = damaged(b"".join(GOOD), Random(seed))
    driver = Driver(c, "ubx")
    expected = driver.frames(data)
    for _ in driver.idle():  # the end of the file: what is behind a frame that is cut off
        expected.append(driver.frame)
    frames, dropped = find_frames(data, LENGTHS)
    assert [data[f.end - len(f.payload) - 8 : f.end] for f in frames] == expected
    assert dropped["UBX frames with a wrong checksum"] == driver.state.scanner.errors


def test_a_frame_within_an_intact_one_is_its_payload_for_both_readers(c: ctypes.CDLL) -> None:
    data = ubx_frame(PVT, bytes(20) + posllh(0) + bytes(36)) + posllh(250)
    frames, _ = find_frames(data, LENGTHS)
    assert [data[f.end - len(f.payload) - 8 : f.end] for f in frames] == Driver(c, "ubx").frames(data)
    assert [len(f.payload) for f in frames] == [92, 28]


def test_every_combination_of_the_bits_of_pvt_is_a_fix_for_both_readers_or_for_none(
    c: ctypes.CDLL, tmp_path: Path
) -> None:
    # given every fixType up to 7, with each bit of the three bytes of flags, for both lengths
    combinations = list(product(range(8), range(8), range(4), (0, 1, 2, 0xFF), (84, 92)))
    stream = b"".join(
        pvt(250 * i, valid=valid, fix=fix, flags=flags, flags3=flags3, length=length)
        for i, (valid, fix, flags, flags3, length) in enumerate(combinations)
    )
    # then both take those, by hand: three-dimensional, good, its time valid, its position not invalid
    expected = [
        250 * i
        for i, (valid, fix, flags, flags3, length) in enumerate(combinations)
        if fix in (3, 4) and flags % 2 and valid & 2 and not (length == 92 and flags3 % 2)
    ]
    assert [fix["time_ms"] for fix in on_board(c, stream)] == expected
    assert np.round(1000 * replayed(tmp_path, stream)[:, 0]).astype(int).tolist() == expected


def test_every_combination_of_the_bits_of_sol_is_a_fix_for_both_readers_or_for_none(
    c: ctypes.CDLL, tmp_path: Path
) -> None:
    combinations = list(product(range(8), range(16)))
    stream = b"".join(
        posllh(250 * i) + velned(250 * i) + sol(250 * i, fix=fix, flags=flags)
        for i, (fix, flags) in enumerate(combinations)
    )
    expected = [250 * i for i, (fix, flags) in enumerate(combinations) if fix in (3, 4) and flags % 2]
    assert [fix["time_ms"] for fix in on_board(c, stream)] == expected
    assert np.round(1000 * replayed(tmp_path, stream)[:, 0]).astype(int).tolist() == expected


NAMES = {
    "latitude": "lat", "longitude": "lon", "h_acc": "hAcc",
    "speed": "gSpeed", "course": "headMot", "s_acc": "sAcc",
}  # fmt: skip
UNSIGNED = ("time_ms", "h_acc", "s_acc")
EDGES = [
    (name, value, low <= value <= high)
    for name, (low, high) in RANGES.items()
    for value in (low - 1, low, high, high + 1)
    if value in (range(2**32) if name in UNSIGNED else range(-(2**31), 2**31))  # what the messages can hold
]


@pytest.mark.parametrize(("name", "value", "taken"), EDGES)
def test_both_readers_have_the_same_ranges(
    c: ctypes.CDLL, tmp_path: Path, name: str, value: int, taken: bool
) -> None:
    frame = pvt(value) if name == "time_ms" else pvt(1000, **{NAMES[name]: value})
    assert len(on_board(c, frame)) == taken
    assert len(replayed(tmp_path, frame)) == taken


def test_the_values_of_a_fix_are_the_same_for_both_readers(c: ctypes.CDLL, tmp_path: Path) -> None:
    for stream in (pvt(5000), posllh(5000) + velned(5000) + sol(5000)):
        [fix], [row] = on_board(c, stream), replayed(tmp_path, stream)
        assert row[0] == fix["time_ms"] / 1000
        assert np.degrees(row[1:3]) * 1e7 == pytest.approx([fix["latitude"], fix["longitude"]], abs=1e-3)
        assert row[6:8] * 1000 == pytest.approx([fix["h_acc"], fix["s_acc"]])


def test_a_stream_with_solutions_needs_a_good_one_for_each_epoch(tmp_path: Path) -> None:
    stream = b"".join(
        posllh(t) + velned(t) + (sol(t, flags=int(t < 1000)) if t else b"") for t in range(0, 2000, 250)
    )
    assert (1000 * replayed(tmp_path, stream)[:, 0]).tolist() == [250, 500, 750]
