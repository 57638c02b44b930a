"""The page results/tracking.md: every study with its tables as the command prints them, and its pictures."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from codegen.templating import environment
from harness.drawing import png_of
from harness.files import write_whole
from harness.studies.published import FUZZY, INERTIAL, NO_PITCH, OUTAGE, PITCH
from harness.studies.study import Options, find_study, run_study

RESULTS = Path(__file__).parents[1] / "results"
PAGE = "tracking.md"
TEMPLATES = environment(Path(__file__).parent / "templates")
SCREEN_DPI = 96  # pictures for a page, not for print
WIDTH = 170  # characters: the widest table
PICTURES = (
    "pitch", "outage", "outage_detection", "heading", "tuning", "recording", "consistency", "observability",
    "limit_cycle", "motion",
)  # fmt: skip


def write(
    recording: Path | None = None,
    unit: Path | None = None,
    folder: Path = RESULTS,
    seeds: int | None = None,
) -> None:
    """Write the page and its pictures.

    Args:
        recording: for the study of that name; without one the page keeps to simulated motion.
        unit: folder of the samples of a unit that a dog wore, for the study `motion`.
        seeds: of each study; by default the study's own number.

    Raises:
        UsageError, RecordingError: the recording cannot be judged.
        FileError: the files cannot be written.
    """
    studies = ["motion", "pitch", "outage", "heading", "tuning", "consistency"]
    options = {name: Options(seeds=seeds) for name in studies}
    options["motion"] = Options(seeds=seeds, recording=unit)
    options |= {name: Options() for name in ("observability", "steady", "limit_cycle")}
    if recording is not None:
        options["recording"] = Options(recording=recording)
    results = {name: run_study(name, chosen) for name, chosen in options.items()}
    folder.mkdir(parents=True, exist_ok=True)
    for name, result in results.items():
        for title, figure in find_study(name).draw(result).items():
            if title in PICTURES:
                write_whole(folder / f"tracking_{title}.png", png_of(figure, SCREEN_DPI))
    write_whole(folder / PAGE, page(results).encode())


def page(results: Mapping[str, Mapping[str, Any]]) -> str:
    """The page's text, from the results by study."""
    outage = results["outage"]
    detection = {name: gaits["detection"]["configurations"] for name, gaits in outage["sets"].items()}
    ours = {
        name: {title: _mean_errors(configurations[title]) for title in (INERTIAL, NO_PITCH, PITCH, FUZZY)}
        for name, configurations in detection.items()
    }
    return TEMPLATES.get_template("tracking.md.jinja").render(
        tables={name: printed(name, result) for name, result in results.items() if name != "outage"},
        outages={
            name: printed("outage", {**outage, "sets": {name: gaits}})
            for name, gaits in outage["sets"].items()
        },
        ours=ours,
        text={title: f"{values.position:g} / {values.speed:g}" for title, values in OUTAGE.items()},
        seeds=outage["seeds"],
    )


def printed(name: str, result: Mapping[str, Any]) -> str:
    """What the study's command prints, without colours."""
    console = Console(file=io.StringIO(), width=WIDTH, color_system=None, legacy_windows=False)
    with console.capture() as capture:
        find_study(name).show(result, console)
    return "\n".join(line.rstrip() for line in capture.get().strip("\n").splitlines())


def _mean_errors(configuration: Mapping[str, Any]) -> str:
    """Mean errors of position [m] and speed [m/s]."""
    position, speed = (configuration[column]["mean"] for column in ("position_error_m", "speed_error_m_s"))
    return f"{position:.1f} / {speed:.1f}"
