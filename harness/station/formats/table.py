"""CSV: a header with latitude and longitude, in deg; `kind` is waypoint (if it is absent), home or fence."""

from __future__ import annotations

import csv
import io

from harness.files import in_words
from harness.onboard.radio import Position
from harness.station.draft import (
    DIGITS,
    FENCE,
    HOME,
    WAYPOINT,
    Draft,
    MissionFileError,
    opened,
    pair,
    place_of,
    sole,
)
from models.errors import printable

MAX_ROWS = 1000  # of a mission
LATITUDES, LONGITUDES = ("latitude", "lat"), ("longitude", "lon", "lng", "long")


def read(data: bytes) -> Draft:
    """The mission in such a file.

    Raises:
        MissionFileError: it holds none, or several.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        line = data.count(b"\n", 0, reason.start) + 1
        raise MissionFileError(f"line {line}: is not UTF-8; save the file as UTF-8") from None
    header = text.partition("\n")[0]
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=max(",;\t", key=header.count))
    places: dict[str, list[Position]] = {HOME: [], WAYPOINT: [], FENCE: []}
    notes: list[str] = []
    try:
        names = [name.strip().lower() for name in next(rows, [])]
        latitude, longitude = _column(names, LATITUDES), _column(names, LONGITUDES)
        kind = names.index("kind") if "kind" in names else None
        others = [name for i, name in enumerate(names) if i not in (latitude, longitude, kind)]
        notes = [f"columns left out: {printable(', '.join(others))}"] if others else []
        for count, row in enumerate(rows):
            if count == MAX_ROWS:
                raise MissionFileError(f"has more than {MAX_ROWS} rows; is it the right file?")
            if not any(cell.strip() for cell in row):
                continue
            where = f"line {rows.line_num}"
            if len(row) != len(names):
                raise MissionFileError(f"{where}: has {len(row)} columns, expected {len(names)} as line 1")
            word = (row[kind].strip().lower() if kind is not None else "") or WAYPOINT
            if word not in places:
                raise MissionFileError(
                    f'{where}: kind is "{printable(word)}", expected one of {", ".join(places)}'
                )
            places[word].append(place_of(where, row[latitude].strip(), row[longitude].strip()))
    except csv.Error as reason:
        raise MissionFileError(f"line {rows.line_num}: is no CSV ({printable(reason)})") from None
    return Draft(sole(places[HOME]), tuple(places[WAYPOINT]), opened(places[FENCE]), tuple(notes))


def _column(names: list[str], spellings: tuple[str, ...]) -> int:
    columns = [i for i, name in enumerate(names) if name in spellings]
    if len(columns) != 1:
        listed = printable(in_words(", ".join(names)))
        raise MissionFileError(
            f'line 1: the header is "{listed}", expected one column {" or ".join(spellings)}, as in '
            '"kind,latitude,longitude"'
        )
    return columns[0]


def write(draft: Draft, name: str) -> bytes:
    """A mission of this name as such a file."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["kind", "latitude", "longitude"])
    home = (draft.home,) if draft.home else ()
    for kind, positions in ((HOME, home), (WAYPOINT, draft.waypoints), (FENCE, draft.fence)):
        for position in positions:
            table.writerow([kind, *(f"{degrees:.{DIGITS}f}" for degrees in pair(position))])
    return text.getvalue().encode()
