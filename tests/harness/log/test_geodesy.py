"""Metres on the tangent plane agree with the tables of WGS 84."""

from __future__ import annotations

import math

import numpy as np
import pytest

from harness.log.geodesy import TangentPlane


@pytest.mark.parametrize(
    ("latitude", "north_km", "east_km"),
    [(0, 110.574, 111.320), (30, 110.852, 96.486), (60, 111.412, 55.800), (-30, 110.852, 96.486)],
)
def test_a_degree_is_as_long_as_the_tables_say(latitude: float, north_km: float, east_km: float) -> None:
    plane = TangentPlane(math.radians(latitude), 0.5)
    north, east = plane.to_plane(plane.latitude + math.radians(1), plane.longitude + math.radians(1))
    assert (north, east) == pytest.approx((north_km * 1000, east_km * 1000), abs=1)


def test_height_lengthens_both() -> None:
    # at 40 deg and 1580 m, a radian is longer by 1580 m northwards and by 1580 m * cos(40 deg) eastwards
    low, high = (TangentPlane(math.radians(40), 0, height).radii for height in (0, 1580))
    assert np.subtract(high, low) == pytest.approx([1580, 1210.350], abs=1e-3)


def test_there_and_back() -> None:
    plane = TangentPlane(0.7, -1.8, 300)
    north, east = np.array([0.0, 25.0, -1e3]), np.array([0.0, -3.0, 2e3])
    latitude, longitude = plane.from_plane(north, east)
    assert (latitude[0], longitude[0]) == (0.7, -1.8)
    again = plane.to_plane(latitude, longitude)
    np.testing.assert_allclose(again, (north, east), atol=1e-8)
