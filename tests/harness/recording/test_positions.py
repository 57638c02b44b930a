"""Positions in time as the truth of trials: cut where they jump, smoothed, and put on the ticks."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest

from harness.log.channel import Channel
from harness.log.writer import LogWriter
from harness.recording.positions import CORNER, FASTEST, Piece, pieces, read_positions, stretches
from harness.recording.recording import RecordingError
from models.kit.timing import TICK
from tests.harness.replay import logs

PROJECT = Path(__file__).resolve().parents[3]
HERDING = Path(os.environ.get("CANINE_DATA", PROJECT.parent / "shared" / "data")) / "herding_dog" / "dog.csv"


def walked(seconds: float, frequency: float = 0.1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, north, east at 10 Hz of a walk to the north that swings by 2 m to the east."""
    time = np.arange(round(seconds * 10) + 1) / 10
    return time, 1.2 * time, 2 * np.sin(2 * math.pi * frequency * time)


def write(file: Path, *columns: np.ndarray, header: str = "event,t_s,x_m,y_m") -> Path:
    rows = "\n".join(",".join(f"{value:.6f}" for value in row) for row in zip(*columns, strict=True))
    file.write_text(f"{header}\n{rows}\n")
    return file


def test_a_walk_at_ten_hertz_is_put_on_the_ticks() -> None:
    [piece] = pieces(*walked(20))
    # given 20 s and a tick of 0.04 s, both ends included
    ticks = TICK * np.arange(501)
    assert piece.seconds == pytest.approx(20.04)
    # then it is where it was: straight lines are kept, and of a swing all but (0.1 Hz/corner)^4
    assert piece.north == pytest.approx(1.2 * ticks, abs=1e-6)
    inner = slice(25, -25)
    assert piece.east[inner] == pytest.approx(2 * np.sin(0.2 * math.pi * ticks)[inner], abs=1e-3)


def test_smoothing_takes_half_of_a_wave_at_its_corner_away() -> None:
    time, north, east = walked(60, CORNER)
    [piece] = pieces(time, north, 0.1 * east)
    assert np.ptp(piece.east[200:-200]) == pytest.approx(0.2, rel=0.05)


def test_jitter_of_a_tag_does_not_become_acceleration() -> None:
    # given a walk with 2 cm of jitter, whose second differences at 10 Hz have a deviation of 4.9 m/s2
    time, north, east = walked(60)
    jitter = np.random.default_rng(1).normal(0, 0.02, (2, len(time)))
    [piece] = pieces(time, north + jitter[0], east + jitter[1])
    assert np.std(np.diff(piece.north, 2) / TICK**2) < 1.0
    assert np.abs(piece.north - 1.2 * TICK * np.arange(len(piece.north))).max() < 0.06


@pytest.mark.parametrize("joint", ["a jump", "a gap", "time going back", "time standing still"])
def test_positions_are_cut_where_they_do_not_belong_together(joint: str) -> None:
    # given two walks of 20 s each, one behind the other
    time, north, east = walked(20)
    later = {"a gap": 30.0, "time going back": 0.0, "time standing still": 20.0}.get(joint, 20.1)
    away = 1.2 * later + (FASTEST * 0.1 + 0.1 if joint == "a jump" else 0.0)
    whole = pieces(
        np.concatenate([time, time + later]),
        np.concatenate([north, north + away]),
        np.concatenate([east] * 2),
    )
    assert [piece.seconds for piece in whole] == pytest.approx([20.04, 20.04])
    assert whole[1].north[0] == pytest.approx(away, abs=1e-6)


def test_what_an_animal_can_run_is_no_joint() -> None:
    time, north, east = walked(20)
    assert len(pieces(time, np.where(time > 10, north + 0.99 * FASTEST * 0.1 - 0.12, north), east)) == 1


def test_stretches_follow_each_other_from_their_own_starts() -> None:
    # given a piece of 65 s and one of 20 s
    ticks = np.arange(1625, dtype=np.float64)
    whole = [Piece(5 + 0.05 * ticks, 0.01 * ticks), Piece(np.zeros(500), np.zeros(500))]
    first, second = stretches(whole, 30)
    # then two of 30 s fit into the first, and begin at (0, 0)
    assert len(first.north) == len(second.east) == 750
    for stretch in (first, second):
        assert stretch.north == pytest.approx(0.05 * np.arange(750))
        assert stretch.east == pytest.approx(0.01 * np.arange(750))


def test_a_table_is_read_by_its_columns(tmp_path: Path) -> None:
    time, north, east = walked(20)
    file = write(tmp_path / "dog.csv", 0 * time, time, east, north)
    [piece] = read_positions(file)
    assert piece.north[-1] == pytest.approx(24)


def test_pieces_that_are_too_short_are_left_out(tmp_path: Path) -> None:
    time, north, east = walked(20)
    file = write(tmp_path / "dog.csv", 0 * time, time, east + np.where(time > 14, 100, 0), north)
    assert [piece.seconds for piece in read_positions(file)] == pytest.approx([14.04])
    with pytest.raises(
        RecordingError, match=r"longest piece without a jump lasts 14 s; expected more than 15 s"
    ):
        read_positions(file, shortest=15)


def test_the_path_of_a_trial_is_the_true_one_in_its_log(tmp_path: Path) -> None:
    truth = Channel("plant", "canine", ("north", "east"), ("m", "m"), ("Real", "Real"), ("", ""))
    rows = np.column_stack([np.arange(500) * 0.05, np.arange(500) * 0.01])
    with LogWriter(tmp_path / "trial.mcap", [truth], origin=(0, 0), metadata={}, attachments={}) as log:
        for begin in range(0, 500, 25):
            log.write_rows(
                TICK * np.arange(begin, begin + 25, dtype=np.float64), {"plant": rows[begin : begin + 25]}
            )
    [piece] = read_positions(tmp_path / "trial.mcap")
    assert piece.north.tobytes() == rows[:, 0].tobytes()
    assert piece.east.tobytes() == rows[:, 1].tobytes()


def test_a_log_without_a_plant_is_refused(tmp_path: Path) -> None:
    logs.write(tmp_path / "trial.mcap", logs.walk())
    with pytest.raises(RecordingError, match=r"got no plant.north, expected the log of a trial with a plant"):
        read_positions(tmp_path / "trial.mcap")


def test_a_table_without_the_columns_is_refused(tmp_path: Path) -> None:
    time, north, east = walked(20)
    file = write(tmp_path / "dog.csv", time, time, east, north, header="event,t_s,x,y_m")
    with pytest.raises(RecordingError, match='no column "x_m" for east'):
        read_positions(file)


def test_the_herding_dog_runs_in_pieces_as_its_page_says() -> None:
    """Of 856 s in 8 events; the median speed is 1.25 m/s, the 95th percentile 3.2, before it is smoothed."""
    if not HERDING.exists():
        pytest.skip(f"no {HERDING}; set CANINE_DATA to the folder of herding_dog")
    whole = read_positions(HERDING)
    assert 750 < sum(piece.seconds for piece in whole) < 856

    def speed(piece: Piece) -> np.ndarray:
        return np.hypot(np.diff(piece.north), np.diff(piece.east)) / TICK

    speeds = np.concatenate([speed(piece) for piece in whole])
    assert np.percentile(speeds, [50, 95]) == pytest.approx([1.25, 3.2], rel=0.1)
    assert speeds.max() < 7
