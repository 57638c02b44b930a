"""GeoJSON: as KML; a feature's name is its property `name`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from harness.files import in_words
from harness.station.draft import FENCE, Draft, MissionFileError, pair
from harness.station.formats.shapes import Shape, labelled, of_shapes, ring
from models.errors import printable

MAX_FEATURES = 1000  # of a mission


@dataclass(frozen=True)
class Feature:
    """A feature of such a file.

    Attributes:
        where: what it is, for errors.
        geometry: with a type.
    """

    where: str
    name: object
    properties: dict[str, Any]
    geometry: dict[str, Any]


def read(data: bytes) -> Draft:
    """The mission in such a file.

    Raises:
        MissionFileError: it holds none, or several.
    """
    features = features_of(content_of(data))
    if len(features) > MAX_FEATURES:
        raise MissionFileError(f"has {len(features)} features, expected up to {MAX_FEATURES}")
    return of_shapes([_shape(feature) for feature in features])


def content_of(data: bytes) -> dict[str, Any]:
    """The object that such a file is.

    Raises:
        MissionFileError: it is none.
    """
    try:
        content = json.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError as reason:
        raise MissionFileError(f"{reason}; save it as UTF-8") from None
    except json.JSONDecodeError as reason:
        raise MissionFileError(f"line {reason.lineno}: is no JSON ({reason.msg})") from None
    except (ValueError, RecursionError) as reason:
        raise MissionFileError(f"is no JSON that can be read ({printable(reason)})") from None
    if not isinstance(content, dict):
        raise MissionFileError(f"is {in_words(content)}, expected a FeatureCollection or a Feature")
    return content


def features_of(content: dict[str, Any]) -> list[Feature]:
    """The features of a collection, or of what is a feature or a geometry itself.

    Raises:
        MissionFileError: one has no geometry.
    """
    features = content.get("features") if content.get("type") == "FeatureCollection" else [content]
    if not isinstance(features, list):
        raise MissionFileError(f"features is {in_words(features)}, expected a list")
    return [_feature(number, feature) for number, feature in enumerate(features, start=1)]


def _feature(number: int, feature: Any) -> Feature:
    where = f"feature {number}"
    properties: Any = {}
    geometry, what = feature, "is"
    if isinstance(feature, dict) and feature.get("type") == "Feature":
        geometry, properties, what = feature.get("geometry"), feature.get("properties"), "has the geometry"
    properties = properties if isinstance(properties, dict) else {}
    name = properties.get("name")
    if isinstance(name, str) and name:
        where += f" ({printable(in_words(name))})"
    if not isinstance(geometry, dict) or not isinstance(geometry.get("type"), str):
        raise MissionFileError(
            f"{where} {what} {printable(in_words(geometry))}, expected one with a type, such as Point; "
            "leave out features without a place"
        )
    return Feature(where, name, properties, geometry)


def _shape(feature: Feature) -> Shape:
    where, kind = feature.where, feature.geometry["type"]
    places = feature.geometry.get("coordinates", [])
    if kind == "Point":
        places = [places]
    elif kind == "Polygon":
        if not isinstance(places, list) or len(places) != 1:
            raise MissionFileError(f"{where}: the polygon is {in_words(places)}, expected one ring")
        (places,) = places
    if not isinstance(places, list):
        raise MissionFileError(f"{where}: coordinates is {in_words(places)}, expected a list")
    return Shape(where, feature.name, kind, places)


def write(draft: Draft, name: str) -> bytes:
    """A mission of this name as such a file."""

    def feature(label: str, kind: str, coordinates: object) -> dict[str, Any]:
        geometry = {"type": kind, "coordinates": coordinates}
        return {"type": "Feature", "properties": {"name": label}, "geometry": geometry}

    features = [feature(label, "Point", pair(position)[::-1]) for label, position in labelled(draft)]
    if draft.fence:
        features.append(feature(FENCE, "Polygon", [ring(draft.fence)]))
    content = {"type": "FeatureCollection", "name": name, "features": features}
    return (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()
