"""The pack's motion: the sets beside the text's figures, and figures of made-up recordings by hand."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from harness.recording.recording import RecordingError
from harness.report.figures import charts_of
from harness.studies import motion
from harness.studies.study import Options, run_study
from models.errors import UsageError
from models.sets import SETS

PROJECT = Path(__file__).resolve().parents[3]
DOG = Path(os.environ.get("CANINE_DATA", PROJECT.parent / "shared" / "data")) / "dog_imu"


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    return run_study("motion", Options(seeds=3))


def test_the_set_of_the_dissertation_moves_as_its_text_says(result: dict[str, Any]) -> None:
    walking, running = (result["gaits"][gait]["dissertation"] for gait in ("walking", "running"))
    # B.4: swings of 10 to 20 m/s2, 40 to 50 running, over 20 by jerks; yaw rates of 70 deg/s to either side
    assert 10 < walking["swing_m_s2"]["median"] < 20
    assert 40 < running["swing_m_s2"]["median"] < 50
    assert walking["largest_m_s2"] > 20
    # at a run the pack nods by 50 deg 2.9 times a second: through a roll of 5 deg the gyroscope about down
    # senses up to 450 deg/s * sin(5 deg) = 40 deg/s of it, in step with the yaw on one side
    for of, coupled in ((walking, 5), (running, 10)):
        assert of["yaw_rate_deg_s"]["p5"] == pytest.approx(-70, abs=coupled)
        assert of["yaw_rate_deg_s"]["p95"] == pytest.approx(70, abs=coupled)
        # D.5: a mean pitch of -8 to -9 deg; the wander of 4 deg in 2 s moves the mean of 180 s by 0.6 deg
        assert of["pitch_mean_deg"] == pytest.approx(-8.5, abs=1.5)
    # D.5: 5 to 10 deg, and 40 to 60 sprinting
    assert 5 < walking["pitch_swing_deg"]["median"] < 10
    assert 40 < running["pitch_swing_deg"]["median"] < 60


def test_the_measured_set_moves_as_the_real_dog(result: dict[str, Any]) -> None:
    """As the recording's own page has it: swings, frequencies and yaw rates."""
    walking, running = (result["gaits"][gait]["measured"] for gait in ("walking", "running"))
    assert (walking["swing_m_s2"]["median"], walking["swing_m_s2"]["p90"]) == pytest.approx((7, 18), rel=0.15)
    assert (running["swing_m_s2"]["median"], running["swing_m_s2"]["p90"]) == pytest.approx(
        (22, 36), rel=0.15
    )
    assert 3.6 <= walking["main_frequency_hz"] <= 4.0
    assert running["main_frequency_hz"] == pytest.approx(4.6, abs=0.1)
    assert walking["pitch_swing_deg"]["median"] == pytest.approx(10, abs=2)
    assert (walking["yaw_rate_deg_s"]["p5"], walking["yaw_rate_deg_s"]["p95"]) == pytest.approx(
        (-100, 100), rel=0.1
    )


def test_the_ideal_set_has_noise_and_bias_alone(result: dict[str, Any]) -> None:
    """D.14: 0.1 m/s2 and white noise of 1 m/s2, whose density at 25 Hz is 1/12.5."""
    ideal = result["gaits"]["walking"]["ideal"]
    assert ideal["mean_m_s2"] == pytest.approx(0.1, abs=4 / np.sqrt(180 * 25))
    assert np.mean(ideal["spectra"]["forward"]) == pytest.approx(1 / 12.5, rel=0.1)
    assert (ideal["pitch_mean_deg"], ideal["pitch_sd_deg"]) == (0, 0)


def test_figures_of_a_made_up_dog_are_those_by_hand(tmp_path: Path) -> None:
    # given 40 s at 105 Hz of a unit that looks back: 3 Hz of 0.5 g about 0.2 g, a pitch of 10 deg with steps
    # of 20 deg between two pieces, a yaw rate that swings by 50 deg/s
    t = np.arange(40 * 105) / 105
    ax = 0.5 * np.sin(2 * np.pi * 3.0 * t) - 0.2
    pitch = np.where(t < 20, 0.0, 20.0)
    wz = 50 * np.sin(2 * np.pi * 1.5 * t)
    for gait in motion.GAITS:
        rows = "\n".join(f"{a:.5f},{p},{w:.4f}" for a, p, w in zip(ax, pitch, wz, strict=True))
        (tmp_path / f"{gait}.csv").write_text(f"ax,AngleY,wz\n{rows}\n")
    dog = run_study("motion", Options(seeds=2, set="ideal", recording=tmp_path))["gaits"]["walking"][
        motion.DOG
    ]
    assert dog["seconds"] == pytest.approx(40)
    assert dog["main_frequency_hz"] == pytest.approx(3.0, abs=0.05)
    assert dog["swing_m_s2"]["median"] == pytest.approx(9.80665, rel=0.01)
    assert dog["mean_m_s2"] == pytest.approx(0.2 * 9.80665, rel=0.01)
    assert dog["largest_m_s2"] == pytest.approx(0.7 * 9.80665, rel=0.01)
    assert (dog["pitch_mean_deg"], dog["pitch_sd_deg"]) == pytest.approx((10, 10))
    # the joint between the pieces is no swing
    assert dog["pitch_swing_deg"] == {"median": 0, "p90": 0}
    # the 95th percentile of a sine is sin(0.45 pi)
    assert dog["yaw_rate_deg_s"]["p95"] == pytest.approx(50 * np.sin(0.45 * np.pi), rel=0.01)
    # the power of a sine, half its amplitude squared, is the area under its spectrum
    frequency, density = (np.array(dog["spectra"][n]) for n in ("frequency_hz", "yaw_rate"))
    assert np.trapezoid(density, frequency) == pytest.approx(50**2 / 2, rel=0.02)


def test_the_real_dog_reads_as_its_page_says() -> None:
    if not DOG.exists():
        pytest.skip(f"no {DOG}; set CANINE_DATA to the folder of dog_imu")
    gaits = run_study("motion", Options(seeds=2, set="ideal", recording=DOG))["gaits"]
    walking, running = (gaits[gait][motion.DOG] for gait in ("walking", "running"))
    assert (walking["swing_m_s2"]["median"], walking["swing_m_s2"]["p90"]) == pytest.approx((7, 18), rel=0.15)
    assert (running["swing_m_s2"]["median"], running["swing_m_s2"]["p90"]) == pytest.approx(
        (22, 36), rel=0.15
    )
    assert running["main_frequency_hz"] == pytest.approx(4.6, abs=0.1)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        (Options(set="mesured"), UsageError, 'there is no set "mesured"; did you mean "measured"'),
        (Options(seeds=2, set="ideal", recording=Path("nowhere")), RecordingError, r"walking\.csv"),
        (
            Options(seeds=2, set="ideal", recording=Path(__file__)),
            RecordingError,
            r"test_motion\.py: has no walking\.csv; expected the folder of a unit that a dog wore, "
            r"with walking\.csv and running\.csv",
        ),
    ],
)
def test_what_is_not_there_is_told(options: Options, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        run_study("motion", options)


def test_table_and_picture_have_every_set(result: dict[str, Any]) -> None:
    text = io.StringIO()
    motion.show(result, Console(file=text, width=200))
    assert all(text.getvalue().count(name) == 2 for name in SETS)
    assert text.getvalue().count("the text (B.4, D.5)") == 2
    (figure,) = motion.draw(result).values()
    assert all(chart["marks"] for grid in charts_of(figure) for chart in grid)
    assert len(figure.axes) == 6
    # the title stands above the panels, the legend below them
    figure.draw_without_rendering()
    legend = figure.legends[0].get_window_extent()
    assert figure.get_suptitle().startswith("Spectra")
    assert legend.y1 < min(axes.get_window_extent().y0 for axes in figure.axes)
    assert [len(axes.lines) for axes in figure.axes] == [len(SETS)] * 6
