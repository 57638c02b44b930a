"""Nothing that a file of a recording holds raises anything but a CanineError."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.recording.check import check
from harness.recording.described import read_description
from harness.recording.esf import read_esf
from harness.recording.imu_csv import read_imu_csv
from harness.recording.pos import read_pos
from harness.recording.ubx import read_ubx
from harness.recording.xsens import read_xsens
from models.errors import CanineError
from tests.harness.recording import made_up
from tests.harness.recording.test_described import EXAMPLE
from tests.harness.recording.test_ways_in import MTDATA, POS_HEADER, POS_VELOCITY, Z_UP, pos_lines

SHORT = made_up.stream(Z_UP)[:6000]
IMU_LINE = b"0.01,0.02,1.0,0.1,0.2,0.3,5000\n"
READERS: dict[str, tuple[Callable[[Path], object], bytes]] = {
    "ubx": (read_ubx, SHORT),
    "esf": (read_esf, SHORT),
    "xsens": (lambda path: read_xsens(path, 100.0), 4 * MTDATA),
    "pos": (read_pos, "\n".join([POS_HEADER + POS_VELOCITY, *pos_lines(velocities=True)[:5]]).encode()),
    "imu csv": (read_imu_csv, 5 * IMU_LINE),
    "recording.toml": (read_description, EXAMPLE.encode()),
}


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_reader_raises_nothing_but_errors_of_ours(name: str, data: st.DataObject) -> None:
    read, good = READERS[name]
    # given a good file with some bytes changed, put in and cut out
    content = bytearray(good)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content)))
        content[at : at + data.draw(st.integers(0, 9))] = data.draw(st.binary(max_size=9))
    with TemporaryDirectory() as folder:
        path = Path(folder, "file.ubx")
        path.write_bytes(content)
        # when it is read, then that goes well, or is refused in one line
        refused = ""
        try:
            read(path)
        except CanineError as reason:
            refused = str(reason)
        assert "\n" not in refused


@settings(max_examples=30, deadline=None)
@given(content=st.binary(max_size=200))
def test_bytes_put_into_a_stream_cost_at_most_the_fix_they_split(content: bytes) -> None:
    # given a stream of fixes and samples with any bytes put into its middle
    with TemporaryDirectory() as folder:
        path = Path(folder, "file.ubx")
        path.write_bytes(SHORT)
        count = check(path)["fixes"]["n"]
        path.write_bytes(SHORT[:3000] + content + SHORT[3000:])
        # when it is checked
        result = check(path)
        # then the fixes before and behind them are there
        assert count - 1 <= result["fixes"]["n"] <= count
        assert "\n" not in result["problem"]
