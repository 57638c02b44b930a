"""The reader of an MT's log takes the samples that the parser on board takes."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.recording.xsens import DATA, HEADER, find_samples
from tests.codegen.firmware.onboard_drivers import Driver, library
from tests.harness.recording.made_up import mtdata

LENGTH = 55  # bytes of a frame
frames = st.builds(
    lambda value, counter: mtdata(np.full(3, value), np.zeros(3), counter),
    st.floats(-20, 20, width=32),
    st.integers(0, 3),
)
pieces = st.one_of(
    frames,
    st.binary(max_size=20),
    st.just(b"\xfa\xff\x32\x32"),  # a false header
    st.builds(lambda frame, at: frame[:at] + b"\xfa" + frame[at + 1 :], frames, st.integers(0, LENGTH - 1)),
    st.builds(lambda frame, size: frame[:size], frames, st.integers(0, LENGTH - 1)),
)


@pytest.fixture(scope="module")
def drivers(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The onboard drivers as a library."""
    return library(tmp_path_factory.mktemp("onboard"))


@settings(max_examples=200, deadline=None)
@given(stream=st.lists(pieces, max_size=12).map(b"".join))
def test_a_damaged_stream_has_the_samples_that_are_found_on_board(
    drivers: ctypes.CDLL, stream: bytes
) -> None:
    # given frames, noise, false headers, damaged and cut frames, read on board until nothing is held
    mt = Driver(drivers, "mt", False)
    on_board = [mt.frame for _ in mt.receive(stream)] + [mt.frame for _ in mt.idle()]
    # when the reader of logs finds the frames, and passes over those whose counter has not moved
    ends, _ = find_samples(stream)
    found = [stream[end - LENGTH : end] for end in ends]
    counters = [frame[HEADER + DATA - 2 : HEADER + DATA] for frame in found]
    fresh = [f for i, f in enumerate(found) if i == 0 or counters[i] != counters[i - 1]]
    # then both have the same
    assert fresh == on_board
