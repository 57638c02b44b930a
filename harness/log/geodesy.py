"""Geographic positions and metres north and east of an origin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from models.earth import ECCENTRICITY_SQUARED, SEMI_MAJOR_AXIS

Position = TypeVar("Position", float, npt.NDArray[np.float64])


@dataclass(frozen=True)
class TangentPlane:
    """The plane that touches WGS 84, raised by `height` (m), at `latitude`, `longitude` (rad)."""

    latitude: float
    longitude: float
    height: float = 0.0

    @cached_property
    def radii(self) -> tuple[float, float]:
        """Metres per radian of latitude and of longitude."""
        flattening = 1 - ECCENTRICITY_SQUARED * math.sin(self.latitude) ** 2
        meridian = SEMI_MAJOR_AXIS * (1 - ECCENTRICITY_SQUARED) / flattening**1.5 + self.height
        normal = SEMI_MAJOR_AXIS / math.sqrt(flattening) + self.height
        return meridian, normal * math.cos(self.latitude)

    def to_plane(self, latitude: Position, longitude: Position) -> tuple[Position, Position]:
        """North and east in m of latitudes and longitudes in rad, the short way round, numbers or arrays."""
        meridian, parallel = self.radii
        eastward = longitude - self.longitude
        eastward = eastward - math.tau * np.round(eastward / math.tau)
        return (latitude - self.latitude) * meridian, eastward * parallel

    def from_plane(self, north: Position, east: Position) -> tuple[Position, Position]:
        """Latitude and longitude in rad of `north` and `east` in m, numbers or arrays of any shape.

        Beyond a pole the meridian goes on at the opposite longitude. Longitudes are in [-pi, pi].
        """
        meridian, parallel = self.radii
        latitude, longitude = self.latitude + north / meridian, self.longitude + east / parallel
        poles = np.round(latitude / math.pi)  # passed: 0 on the origin's side of both
        longitude = longitude + math.pi * poles
        return (
            (1 - 2 * np.abs(np.fmod(poles, 2))) * (latitude - math.pi * poles),
            longitude - math.tau * np.round(longitude / math.tau),
        )

    def place(self, north: float, east: float) -> tuple[float, float]:
        """Latitude and longitude in deg, the latter in [-180, 180), of `north` and `east` in m."""
        meridian, parallel = self.radii
        latitude = math.degrees(self.latitude + north / meridian)
        longitude = math.degrees(self.longitude + east / parallel)
        if abs(latitude) <= 90 and -180 <= longitude < 180:
            return latitude, longitude
        beyond, around = self.from_plane(north, east)
        return math.degrees(beyond), (math.degrees(around) + 180) % 360 - 180
