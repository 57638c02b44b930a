"""Maps for tests, as files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

Ring = Sequence[tuple[Any, Any]]  # x and y, as GeoJSON writes them


def box(west: float, south: float, east: float, north: float) -> list[tuple[float, float]]:
    """A rectangle's ring."""
    return [(west, south), (east, south), (east, north), (west, north), (west, south)]


def polygon(name: str, *rings: Ring, **properties: object) -> dict[str, Any]:
    """A polygon as a feature."""
    return _feature(name, "Polygon", [list(ring) for ring in rings], properties)


def line(name: str, *places: tuple[float, float]) -> dict[str, Any]:
    """A street as a feature."""
    return _feature(name, "LineString", places, {})


def mark(name: str, x: float, y: float) -> dict[str, Any]:
    """A point as a feature."""
    return _feature(name, "Point", (x, y), {})


def collection(name: str, *parts: dict[str, Any]) -> dict[str, Any]:
    """The geometries of features, or geometries, as one feature."""
    geometries = [part.get("geometry", part) for part in parts]
    geometry = {"type": "GeometryCollection", "geometries": geometries}
    return {"type": "Feature", "properties": {"name": name}, "geometry": geometry}


def _feature(name: str, kind: str, coordinates: object, properties: dict[str, object]) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"name": name, **properties}, "geometry": geometry}


def write(folder: Path, *features: dict[str, Any], name: str = "map.geojson", **members: Any) -> str:
    """A map's file; in metres unless `members` say something else. Its path."""
    content = {"type": "FeatureCollection", "units": "metres", **members, "features": features}
    path = folder / name
    path.write_text(json.dumps({key: value for key, value in content.items() if value is not None}))
    return str(path)
