"""Damaged recordings: no error but ours, and no other table without a count that says why."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from harness.replay.comparison import CONFIGURATIONS, HELD, MEAN, compare
from harness.replay.replay import replay, statistics
from harness.replay.source import open_source
from harness.replay.windows import Outages
from models.errors import CanineError
from tests.harness.replay import walks
from tests.harness.replay.walks import Files

PROJECT = Path(__file__).resolve().parents[3]
WALK = Path(os.environ.get("CANINE_DATA", PROJECT.parent / "shared" / "data")) / "walk_ublox_imu"

MADE = walks.files()
NAMES = (HELD, MEAN, *CONFIGURATIONS["four_state"])
NOISE_M, NOISE_RATIO = (
    1.0,
    0.1,
)  # what lost fixes and samples may change; what went wrong before was 7 to 200 m


@dataclass(frozen=True)
class Damage:
    """Bytes of one file that were overwritten by `new`; `lost` more are gone.

    `at` is the place as a part of the file's size.
    """

    file: str
    at: float
    new: bytes
    lost: int = 0

    def of(self, files: Files) -> Files:
        data = files[self.file]
        at = int(self.at * len(data))
        return files | {self.file: data[:at] + self.new + data[at + len(self.new) + self.lost :]}


@dataclass(frozen=True)
class Judged:
    """What a replay of a recording gave."""

    outages: Outages
    means: dict[str, float]  # configuration -> position error [m]
    dropped: dict[str, int]


def judge(folder: Path, length: float, every: float) -> Judged:
    source = open_source(folder)
    chosen = source.outages(length, every)
    result = statistics(replay(source, compare("four_state"), chosen).outages)
    means = {name: c["position_error_m"]["mean"] for name, c in result["configurations"].items()}
    return Judged(chosen, means, dict(source.dropped))


def judge_or_refuse(folder: Path, length: float, every: float) -> Judged | None:
    """None for a recording that is refused; any other error but ours fails the test."""
    try:
        return judge(folder, length, every)
    except CanineError as error:
        message = str(error)
    assert "\n" not in message
    return None


def require_same(got: Judged, whole: Judged) -> None:
    """The same table within its noise, or a count that says why not."""
    assert np.isfinite(list(got.means.values())).all()
    if len(got.outages.windows) < len(whole.outages.windows):
        assert got.outages.left_out or got.dropped or got.outages.reach != whole.outages.reach
        return  # errors differ from outage to outage
    for name in NAMES:
        noise = NOISE_M + NOISE_RATIO * whole.means[name]
        assert abs(got.means[name] - whole.means[name]) < noise, (name, got, whole)


def is_still_numbers(files: Files) -> bool:
    """All lines of the IMU but the first and the last are seven finite numbers."""
    try:
        lines = [list(map(float, line.split(b","))) for line in files["imu.csv"].split(b"\n")[1:-1]]
    except ValueError:
        return False
    return all(len(line) == 7 and np.isfinite(line).all() for line in lines)


def pieces() -> st.SearchStrategy[bytes]:
    """What damage writes: noise, and what readers look for."""
    known = [
        b"\xb5\x62",
        b"\xb5\x62\x01\x07\xff\x1f",
        b"$GN\xff\r\n",
        b"nan",
        b"inf,",
        b"1e999",
        b"\n",
        b",",
        b"\0",
    ]
    return st.one_of(st.binary(max_size=6), st.sampled_from(known))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Judged:
    return judge(walks.write(tmp_path_factory.mktemp("whole"), MADE), 5, 10)


@given(
    st.lists(
        st.builds(
            Damage,
            st.sampled_from(sorted(MADE)),
            st.floats(0, 0.999),
            pieces(),
            st.sampled_from([0, 0, 0, 7]),
        ),
        min_size=1,
        max_size=3,
    )
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_recording_is_refused_counted_or_judged_as_the_whole_one(
    tmp_path: Path, whole: Judged, damages: list[Damage]
) -> None:
    files = MADE
    for damage in damages:
        files = damage.of(files)
    got = judge_or_refuse(walks.write(tmp_path / "damaged", files), 5, 10)
    if got is None:
        return
    assert np.isfinite(list(got.means.values())).all()
    changed = {damage.file for damage in damages}
    # a number that became another number cannot be told from a measurement
    if "imu.csv" not in changed or not is_still_numbers(files):
        require_same(got, whole)


@pytest.fixture(scope="module")
def real() -> Judged:
    if not any(WALK.glob("*.ubx")):
        pytest.skip(f"no recording in {WALK}; set CANINE_DATA to the folder of walk_ublox_imu")
    return judge(WALK, 10, 40)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("pattern", "flips"), [("*.ubx", 20), ("imu*.csv", 20), ("*.ubx.tag", 3), ("imu*.csv.tag", 3)]
)
def test_the_walk_with_bytes_flipped_is_refused_counted_or_judged_as_it_was(
    tmp_path: Path, real: Judged, pattern: str, flips: int, seed: int
) -> None:
    # given the walk with some bytes of one file flipped: of the stream those of fixes, of the table so that
    # they are no digits
    for path in (p for glob in ("*.ubx*", "imu*") for p in WALK.glob(glob)):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    [path] = tmp_path.glob(pattern)
    draw, data = np.random.default_rng(seed), bytearray(path.read_bytes())
    if pattern == "*.ubx":
        fixes = [match.start() for match in re.finditer(rb"\xb5\x62\x01\x07\x5c\x00", data)]
        places = draw.choice(fixes, flips, replace=False) + draw.integers(0, 100, flips)
    else:
        places = draw.integers(0, len(data), flips)
    for at in places:
        data[at] ^= 0x80 if pattern == "imu*.csv" else int(draw.integers(1, 256))
    path.write_bytes(data)
    # when it is replayed
    got = judge_or_refuse(tmp_path, 10, 40)
    if got is None:
        return
    # then what was lost is counted, and the table is the same within its noise
    if not pattern.endswith(".tag"):
        assert flips - 5 <= sum(got.dropped.values()) <= flips
    require_same(got, real)
