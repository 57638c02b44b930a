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


@pytest.mark.parametrize("latitude", [10.0, -10.0])
@pytest.mark.parametrize(("longitude", "east"), [(179.9999, 30.0), (-179.9999, -30.0), (180.0, 30.0)])
def test_longitudes_wrap_at_the_date_line_both_ways(latitude: float, longitude: float, east: float) -> None:
    plane = TangentPlane(math.radians(latitude), math.radians(longitude))
    there = plane.from_plane(0.0, east)
    # at 10 deg 30 m east are 30 / (6378137 / sqrt(1 - 0.00669438 sin2(10 deg)) cos(10 deg)) rad
    expected = longitude + math.copysign(2.73631e-4, east)
    assert math.degrees(there[1]) == pytest.approx(expected - math.copysign(360, east), abs=1e-8)
    assert plane.to_plane(*there) == pytest.approx((0.0, east), abs=1e-6)
    assert plane.place(0.0, east) == pytest.approx([math.degrees(angle) for angle in there], abs=1e-12)


@pytest.mark.parametrize("pole", [1.0, -1.0])
@pytest.mark.parametrize("longitude", [40.0, -40.0])
def test_beyond_a_pole_the_way_goes_down_the_opposite_meridian(pole: float, longitude: float) -> None:
    # given an origin 0.001 deg from a pole: a radian of latitude there is 6399594 m, 0.003 deg are 335.0819 m
    plane = TangentPlane(math.radians(pole * 89.999), math.radians(longitude))
    latitude, opposite = np.degrees(plane.from_plane(np.array([0.0, pole * 335.0819]), np.zeros(2)))
    assert latitude == pytest.approx([pole * 89.999, pole * 89.998], abs=1e-8)
    assert opposite == pytest.approx([longitude, longitude - math.copysign(180, longitude)])
