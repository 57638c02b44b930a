"""A small map of vectors in a .pmtiles file; tiles as the Mapbox Vector Tile Specification 2.1 has them."""

from __future__ import annotations

import gzip
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import Writer

EXTENT = 4096
LINE, POLYGON = 2, 3


class Feature(NamedTuple):
    """A line or polygon of a layer: corners in the tile, from the north-western one, and its tags."""

    kind: int
    corners: Sequence[tuple[int, int]]
    tags: Mapping[str, str]


def tile(layers: Mapping[str, Iterable[Feature]]) -> bytes:
    """A tile's bytes."""
    return b"".join(_field(3, _layer(name, list(features))) for name, features in layers.items())


def archive(content: bytes, layers: Sequence[str], zoom: int, place: tuple[int, int]) -> bytes:
    """A .pmtiles file of one tile of a zoom, compressed as `pmtiles extract` leaves them.

    Args:
        layers: that its metadata states.
        place: column and row of the tile.
    """
    file = io.BytesIO()
    untyped: Any = Writer
    writer = untyped(file)
    writer.write_tile(zxy_to_tileid(zoom, *place), gzip.compress(content))
    count = 1 << zoom
    west, east = (360 * (place[0] + side) / count - 180 for side in (0, 1))
    writer.finalize(
        {
            "tile_type": TileType.MVT, "tile_compression": Compression.GZIP,
            "min_zoom": zoom, "max_zoom": zoom, "center_zoom": zoom,
            "min_lon_e7": round(west * 1e7), "max_lon_e7": round(east * 1e7),
            "min_lat_e7": round(32.60 * 1e7), "max_lat_e7": round(32.61 * 1e7),
            "center_lon_e7": round(west * 1e7), "center_lat_e7": round(32.605 * 1e7),
        },
        {
            "vector_layers": [{"id": name} for name in layers],
            "attribution": "<a href='x'>© OpenStreetMap</a>",
        },
    )  # fmt: skip
    return file.getvalue()


def _layer(name: str, features: Sequence[Feature]) -> bytes:
    keys = list(dict.fromkeys(key for feature in features for key in feature.tags))
    values = list(dict.fromkeys(value for feature in features for value in feature.tags.values()))
    encoded = [_field(1, name.encode())]
    for feature in features:
        pairs = [n for key, value in feature.tags.items() for n in (keys.index(key), values.index(value))]
        encoded.append(
            _field(
                2, _field(2, _packed(pairs)) + _number(3, feature.kind) + _field(4, _packed(_shape(feature)))
            )
        )
    encoded += [_field(3, key.encode()) for key in keys]
    encoded += [_field(4, _field(1, value.encode())) for value in values]
    return b"".join(encoded) + _number(5, EXTENT) + _number(15, 2)


def _shape(feature: Feature) -> list[int]:
    """Move to the first corner, lines to the others, and of a polygon back."""
    at, numbers = (0, 0), []
    for corner in feature.corners:
        numbers.append([_zigzag(to - start) for start, to in zip(at, corner, strict=True)])
        at = corner
    first, *others = numbers
    lines = [n for pair in others for n in pair]
    return [
        1 | 1 << 3,
        *first,
        2 | len(others) << 3,
        *lines,
        *([7 | 1 << 3] if feature.kind == POLYGON else []),
    ]


def _zigzag(value: int) -> int:
    return 2 * value if value >= 0 else -2 * value - 1


def _varint(value: int) -> bytes:
    head = bytearray()
    while value > 127:
        head.append(value & 127 | 128)
        value >>= 7
    return bytes([*head, value])


def _packed(values: Iterable[int]) -> bytes:
    return b"".join(map(_varint, values))


def _field(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _number(number: int, value: int) -> bytes:
    return _varint(number << 3) + _varint(value)
