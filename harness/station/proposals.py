"""Routes that are proposed to the operator: `canine plan`, in a process of its own.

A plan takes seconds of all cores. The station's loop keeps the vest's operator alive meanwhile, so the plan
runs beside it, at a lower priority, one at a time. It is killed when it takes too long, and dies with the
station.
"""

from __future__ import annotations

import asyncio
import math
import re
import sys
from pathlib import Path, PurePath
from typing import Any

import orjson

from codegen.scratch import Scratch
from harness.log.geodesy import TangentPlane
from harness.onboard.processors.child import tied
from harness.onboard.radio import Position
from harness.station.draft import MissionFileError, pair
from models.errors import CanineError, printable
from models.readings import ON_BOARD

MAX_BYTES = 4 * 2**20  # of a map
LONGEST_S = 300.0
TRIALS = 1024  # of each candidate that is left at the end
SHOWN = 8  # routes at most
APART = 1e-6  # deg: a plan of a map in degrees begins at its origin
ENDINGS = ("geojson", "json", "kml")
FILE_NAME = re.compile(r"\w[\w .-]{0,80}", re.ASCII)  # which every file system takes, by its bytes too


class Proposals:
    """Asks for routes, one plan at a time."""

    def __init__(self) -> None:
        self._one = asyncio.Lock()

    async def ask(self, name: str, data: bytes, begin: Position, end: Position) -> dict[str, Any]:
        """Routes from `begin` to `end` over the map in a file's bytes, in the form of README.md.

        Raises:
            MissionFileError: the map or the places cannot be used, or a plan is under way.
            CanineError: the plan failed, or took too long.
        """
        shown, ending = printable(PurePath(name).name), PurePath(name).suffix.lower().lstrip(".")
        if ending not in ENDINGS:
            raise MissionFileError(f'{shown}: the ending is "{ending}", expected one of {", ".join(ENDINGS)}')
        if self._one.locked():
            raise MissionFileError("a plan is under way; wait until it is done")
        async with self._one:
            try:
                with Scratch() as folder:
                    path = folder / (shown if FILE_NAME.fullmatch(shown) else f"map.{ending}")
                    path.write_bytes(data)
                    return _shaped(await _plan(path, shown, begin, end), shown, begin)
            except OSError as reason:
                what = f"{reason.filename}: " if reason.filename else ""
                what += reason.strerror or str(reason)
                raise CanineError(
                    f"{shown}: cannot be planned here ({printable(what)}); "
                    "make room in the folder for temporary files, or install what is missing"
                ) from None


async def _plan(path: Path, shown: str, begin: Position, end: Position) -> dict[str, Any]:
    """The content of routes.json."""
    places = [",".join(f"{degrees:.7f}" for degrees in pair(place)) for place in (begin, end)]
    command = [
        sys.executable, "-m", "harness.main", "plan", str(path), f"--from={places[0]}", f"--to={places[1]}",
        "--reading", ON_BOARD, "--trials", str(TRIALS), "--json", "--out", str(path.parent / "plan"),
    ]  # fmt: skip
    pipe = asyncio.subprocess.PIPE
    running = await asyncio.create_subprocess_exec(
        "nice", "-n", "10", *tied(command), stdin=asyncio.subprocess.DEVNULL, stdout=pipe, stderr=pipe
    )
    try:
        async with asyncio.timeout(LONGEST_S):
            printed, errors = await running.communicate()
    except TimeoutError:
        raise CanineError(
            f"{shown}: the plan took more than {LONGEST_S:g} s; cut the map, or plan before"
        ) from None
    finally:
        if running.returncode is None:
            running.kill()
            await running.wait()
    if running.returncode != 0:
        lines = [line for line in errors.decode(errors="replace").splitlines() if line.startswith("canine: ")]
        words = " ".join(lines).removeprefix("canine: ").replace(str(path), shown)
        raise MissionFileError(printable(words) or f"{shown}: the plan failed, status {running.returncode}")
    content: dict[str, Any] = orjson.loads(printed)
    return content


def _shaped(content: dict[str, Any], shown: str, begin: Position) -> dict[str, Any]:
    """What the page shows of a plan: places in deg."""
    origin = content["origin"]
    if origin is None or max(abs(a - b) for a, b in zip(origin, pair(begin), strict=True)) > APART:
        raise MissionFileError(
            f"{shown}: is in metres; the station's map is in degrees: expected such a file"
        )
    plane = TangentPlane(*map(math.radians, origin))

    def degrees(places: list[list[float]]) -> list[tuple[float, float]]:
        return [pair(Position(*plane.place(north, east))) for north, east in places]

    chosen = [
        route for route in content["routes"] if route["on_front"] or route["number"] == content["recommended"]
    ]
    return {
        "areas": [
            {"name": area["name"], "rings": [degrees(ring) for ring in area["rings"]]}
            for area in content["areas"]
        ],
        "routes": [
            {
                **{
                    key: route[key]
                    for key in ("label", "success_rate", "entry_rate", "mean_time_s", "mean_commands")
                },
                "waypoints": degrees(route["waypoints"]),
                "recommended": route["number"] == content["recommended"],
            }
            for route in chosen[:SHOWN]
        ],
        "assumes": content["assumes"],
        "notes": content["notes"],
    }
