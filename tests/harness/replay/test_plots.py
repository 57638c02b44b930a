"""The picture of a replay."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.replay import plots
from tests.harness.pictures import line, size


def test_a_replay_shows_estimates_and_shades_outages(tmp_path: Path) -> None:
    # given a receiver that goes east at 1 m/s and an estimate that stays, during one outage of two
    time = np.arange(10.0)
    at = np.array([2.0, 3.0, 4.0])
    estimates = [("EKF", at, np.zeros(3), np.full(3, 2.0))]
    args = ((time, np.zeros(10), time), estimates, [(2.0, 4.0), (7.0, 9.0)], "a drive")
    paths, errors = plots.replay_figure(*args).axes
    # then its error grows by a metre a second
    assert line(errors, "EKF").tolist() == [[2, 0], [3, 1], [4, 2]]
    assert line(paths, "EKF").tolist() == [[2, 0]] * 3
    assert line(paths, "outage").tolist() == [[2, 0], [3, 0], [4, 0]]
    assert [(p.get_x(), p.get_width()) for p in errors.patches] == [(2.0, 2.0), (7.0, 2.0)]  # type: ignore[attr-defined]
    plots.replay_picture(tmp_path / "replay.png", *args)
    assert size((tmp_path / "replay.png").read_bytes()) == (2100, 960)
