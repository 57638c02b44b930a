"""Latitude and longitude to metres north and east of an origin, on board."""

from __future__ import annotations

import math

from models.earth import ECCENTRICITY_SQUARED, SEMI_MAJOR_AXIS
from models.kit import casadi as ca
from models.kit.block import Block, triggered
from models.kit.declaration import SX, Boolean, Input, Integer, Output, Parameter, State
from models.kit.geometry import any_of, where

ANGLE = 1e-7 * math.pi / 180  # rad in a unit of 1e-7 deg
QUARTER, HALF = 900_000_000, 1_800_000_000  # units in 90 and 180 deg


class LocalPlane(Block):
    """Local plane: positions from a GPS receiver to the plane that touches the earth at an origin."""

    source = "WGS 84, the earth of GPS; its two radii of curvature at the origin's latitude"
    precisions = ("double", "float")

    latitude = Input(Integer, "in 1e-7 deg", min=-QUARTER, max=QUARTER)
    longitude = Input(Integer, "in 1e-7 deg, east positive", min=-HALF, max=HALF)
    settle = Input(Boolean, "make this position the origin", start=0)

    north = Output("m", "of the origin")
    east = Output("m", "of the origin")

    least_parallel = Parameter("m", "least radius of a parallel, in force near the poles", start=1e3, min=1)

    settled = State(Boolean, "there is an origin")
    origin_latitude = State(Integer, "in 1e-7 deg")
    origin_longitude = State(Integer, "in 1e-7 deg")
    north_scale = State("m", "metres in 1e-7 deg of latitude")
    east_scale = State("m", "metres in 1e-7 deg of longitude")

    @triggered("settle")
    def begin(m) -> None:
        """Make this position the origin; its meridian and parallel give the scales."""
        latitude = m.latitude * ANGLE
        flattening = 1 - ECCENTRICITY_SQUARED * ca.sin(latitude) ** 2
        normal = SEMI_MAJOR_AXIS / ca.sqrt(flattening)
        parallel = normal * ca.cos(latitude)
        m.north_scale = ANGLE * (normal * (1 - ECCENTRICITY_SQUARED) / flattening)
        m.east_scale = ANGLE * where(parallel > m.least_parallel, parallel, m.least_parallel)
        m.origin_latitude, m.origin_longitude = m.latitude, m.longitude
        m.settled = 1

    def project(m) -> None:
        """Scale the differences: in whole units float32 holds them exactly within 180 km."""
        m.north = (m.latitude - m.origin_latitude) * m.north_scale
        m.east = m._eastward() * m.east_scale

    def _eastward(m) -> SX:
        """Longitude from the origin's, the short way round; no difference leaves 32 bits."""
        apart = 0.5 * m.longitude - 0.5 * m.origin_longitude  # as Reals: coarse, yet far from the limit
        onward, back = apart < -QUARTER, apart > QUARTER  # across the date line, to the east and to the west
        turn = where(onward, HALF, where(back, -HALF, 0))
        longitude, origin = m.longitude + turn, m.origin_longitude - turn
        return where(any_of(onward, back), longitude - origin, m.longitude - m.origin_longitude)
