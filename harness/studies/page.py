"""The page results/tracking.md: every study with its tables as the command prints them, and its pictures."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from codegen.templating import environment
from harness.drawing import png_of
from harness.files import write_whole
from harness.replay.comparison import HELD
from harness.studies.consistency import OWN
from harness.studies.motion import DOG
from harness.studies.outage import OURS
from harness.studies.outage_pictures import DETECTION
from harness.studies.published import FUZZY, INERTIAL, NO_PITCH, OUTAGE, PITCH
from harness.studies.study import Options, find_study, run_study
from models.readings import CAP, FLOORS

RESULTS = Path(__file__).parents[1] / "results"
PAGE = "tracking.md"
TEMPLATES = environment(Path(__file__).parent / "templates")
SCREEN_DPI = 96  # pictures for a page, not for print
WALK = "walk_ublox_imu"  # the recording that the page's words are about
REFLECTED = "built_up"  # the set in which fixes are reflected
WIDTH = 170  # characters: the widest table
PICTURES = (
    "pitch", "outage", "outage_detection", "heading", "tuning", "recording", "consistency", "observability",
    "limit_cycle", "motion",
)  # fmt: skip


def write(
    recording: Path | None = None,
    unit: Path | None = None,
    path: Path | None = None,
    folder: Path = RESULTS,
    seeds: int | None = None,
) -> None:
    """Write the page and its pictures.

    Args:
        recording: for the study of that name; without one the page keeps to simulated motion.
        unit: folder of the samples of a unit that a dog wore, for the study `motion`.
        path: a csv of the positions of a live animal, for the study `outage`.
        seeds: of each study; by default the study's own number.

    Raises:
        UsageError, RecordingError: the recording cannot be judged.
        FileError: the files cannot be written.
    """
    studies = ["leading", "motion", "pitch", "outage", "heading", "tuning", "consistency"]
    options = {name: Options(seeds=seeds) for name in studies}
    options["motion"] = Options(seeds=seeds, recording=unit)
    options |= {name: Options() for name in ("observability", "steady", "limit_cycle")}
    if recording is not None:
        options["recording"] = Options(recording=recording)
    results = {name: run_study(name, chosen) for name, chosen in options.items()}
    along = None if path is None else run_study("outage", Options(seeds=seeds, recording=path))
    folder.mkdir(parents=True, exist_ok=True)
    for name, result in results.items():
        for title, figure in find_study(name).draw(result).items():
            if title in PICTURES:
                write_whole(folder / f"tracking_{title}.png", png_of(figure, SCREEN_DPI))
    write_whole(folder / PAGE, page(results, along).encode())


def page(results: Mapping[str, Mapping[str, Any]], along: Mapping[str, Any] | None = None) -> str:
    """The page's text, from the results by study, and those of the study `outage` along an animal's path."""
    outage = results["outage"]
    detection = {name: gaits[DETECTION]["configurations"] for name, gaits in outage["sets"].items()}
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
        held=[
            {"set": name, "gait": gait, **_held(values)}
            for name, gaits in outage["sets"].items()
            for gait, values in gaits.items()
        ],
        fuzzy_by_chance=_fuzzy_by_chance(outage["sets"].get("dissertation", {})),
        tuning={answer["second"]: answer for answer in results["tuning"]["questions"]},
        consistent=_consistent(results["consistency"]["worlds"]),
        leading={
            (row["estimator"], row["attitude"]): _percent(row["share"]) for row in results["leading"]["rows"]
        },
        dog=_beside_the_dog(results["motion"]["gaits"]),
        floors={**FLOORS, **CAP},
        path=None if along is None else _along(along),
        percent=_percent,
        walk=results.get("recording", {}).get("recording") == WALK,
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


def _beside_the_dog(gaits: Mapping[str, Mapping[str, Any]]) -> dict[str, Any] | None:
    """The figures of the set `measured` and of the real dog, by gait; None without a dog."""
    if not all(DOG in of for of in gaits.values()):
        return None
    return {gait: {"ours": of["measured"], "dog": of[DOG]} for gait, of in gaits.items()}


def _along(outage: Mapping[str, Any]) -> dict[str, Any]:
    """The results along the path of a live animal: trials, errors by set, the whole table."""
    return {
        "seeds": outage["seeds"],
        "held": [
            {"set": name, **_held(values)}
            for name, gaits in outage["sets"].items()
            for values in gaits.values()
        ],
        "table": printed("outage", outage),
    }


def _range(values: Iterable[float]) -> str:
    ordered = sorted(values)
    return f"{ordered[0]:.1f} to {ordered[-1]:.1f}"


def _percent(value: float) -> str:
    return f"{100 * value:.0f} %"


def _held(values: Mapping[str, Any]) -> dict[str, Any]:
    """Mean position errors [m] of the speed held, of the text's best filter, of ours; the p of its test."""
    mean = {title: row["position_error_m"]["mean"] for title, row in values["configurations"].items()}
    best = min((NO_PITCH, PITCH, FUZZY), key=mean.__getitem__)
    (test,) = (t for t in values["paired_t_tests"] if (t["first"], t["second"]) == (HELD, OURS))
    return {"held": mean[HELD], "best": mean[best], "ours": mean[OURS], "p": test["position_error_m"]["p"]}


def _fuzzy_by_chance(gaits: Mapping[str, Any]) -> float | None:
    """The share of studies of the text's size that find fuzzy better in position, significantly."""
    tests = gaits[DETECTION]["unpaired_t_tests"]["position_error_m"] if gaits else {}
    return float(tests["significantly"]["share"]) if "significantly" in tests else None


def _consistent(worlds: Mapping[str, Any]) -> dict[str, Any]:
    """The filter in its own world; what our own's stated deviations hold, and all NEES, in the others."""
    own = worlds[OWN]["four_state, sigma 0.2"]
    others = {world: rows for world, rows in worlds.items() if world != OWN}
    shares = {
        f"{what}_{place}": [rows[OURS][f"{what}_within"][place]["share"] for rows in others.values()]
        for what in ("position", "speed")
        for place in (0, 1)
    }
    nees = [
        row["nees"] / row["states"]
        for world, rows in others.items()
        for title, row in rows.items()
        if world != "ideal" and title not in ("seven_state", OURS)
    ]
    ours = {world: rows[OURS] for world, rows in others.items()}
    return {
        "nis": own["nis"] / own["nis_expected"],
        "nis_bounds": [bound / own["nis_expected"] for bound in own["nis_bounds"]],
        "nees": own["nees"] / own["states"],
        "nees_bounds": [bound / own["states"] for bound in own["nees_bounds"]],
        "within": {key: f"{100 * min(part):.0f} to {100 * max(part):.0f} %" for key, part in shares.items()},
        "least": {
            key: list(others)[min(range(len(part)), key=part.__getitem__)] for key, part in shares.items()
        },
        "nees_elsewhere": f"{min(nees):.0f} to {max(nees):.0f}",
        "nees_ours": _range(r["nees"] / r["states"] for world, r in ours.items() if world != REFLECTED),
        "nees_reflected": f"{ours[REFLECTED]['nees'] / ours[REFLECTED]['states']:.1f}",
        "bias_ours": _range(row["bias_error_per_sd"] for row in ours.values()),
    }
