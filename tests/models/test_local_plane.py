"""The plane on board against WGS 84 computed here, in double and float32; the date line; no overflow."""

from __future__ import annotations

import math
import random
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen.blocks.block_c import generate, write_files
from harness.log.geodesy import TangentPlane
from models.kit.model import Model
from models.local_plane import HALF, QUARTER, LocalPlane

A, F = 6_378_137.0, 1 / 298.257_223_563  # WGS 84: semi-major axis, flattening
E2 = F * (2 - F)
UNIT = math.radians(1e-7)
LATITUDES = [0.0, 32.6, -45.0, 70.0]  # deg
# 5 km off in all directions, and nearer
OFFSETS = [(n, e) for n in (-5000.0, -700.0, 0.0, 60.0, 5000.0) for e in (-5000.0, 0.0, 130.0, 5000.0)]

latitudes, longitudes = st.integers(-QUARTER, QUARTER), st.integers(-HALF, HALF)


def ecef(latitude: float, longitude: float) -> np.ndarray[Any, Any]:
    """Position on the ellipsoid in the frame that turns with the earth, m; angles in rad."""
    normal = A / math.sqrt(1 - E2 * math.sin(latitude) ** 2)
    axis = normal * math.cos(latitude)
    return np.array(
        [axis * math.cos(longitude), axis * math.sin(longitude), normal * (1 - E2) * math.sin(latitude)]
    )


def tangent(origin: tuple[float, float], place: tuple[float, float]) -> tuple[float, float]:
    """North and east, m, in the plane that touches the ellipsoid at the origin; angles in rad."""
    latitude, longitude = origin
    chord = ecef(*place) - ecef(*origin)
    north = (
        -math.sin(latitude) * math.cos(longitude),
        -math.sin(latitude) * math.sin(longitude),
        math.cos(latitude),
    )
    east = (-math.sin(longitude), math.cos(longitude), 0.0)
    return float(np.dot(chord, north)), float(np.dot(chord, east))


def units(angle: float) -> int:
    """rad in 1e-7 deg."""
    return round(angle / UNIT)


def around(origin: TangentPlane) -> list[tuple[int, int]]:
    """The places at OFFSETS."""
    angles = [origin.from_plane(*offset) for offset in OFFSETS]
    return [(units(latitude), units(longitude)) for latitude, longitude in angles]


def settled(native: Any, precision: str, latitude: int, longitude: int) -> Any:
    """The block with its origin at a place."""
    plane = native(LocalPlane, precision)
    plane.run(latitude=latitude, longitude=longitude, settle=1)
    plane["settle"] = 0
    return plane


def positions(plane: Any, places: list[tuple[int, int]]) -> np.ndarray[Any, Any]:
    """(places, 2): north, east."""
    outputs = plane.run(
        latitude=np.array([p[0] for p in places]), longitude=np.array([p[1] for p in places]), settle=0
    )
    return np.column_stack([outputs["north"], outputs["east"]])


@pytest.mark.parametrize("latitude", LATITUDES)
def test_double_is_the_tangent_plane_of_wgs_84(native: Any, latitude: float) -> None:
    # given an origin, and places up to 5 km around it in whole units
    origin = units(math.radians(latitude)), -854_900_000
    reference = TangentPlane(origin[0] * UNIT, origin[1] * UNIT)
    places = around(reference)
    # when
    got = positions(settled(native, "double", *origin), places)
    # then the radii are the other implementation's, to rounding: (1 - e2) and ANGLE have 12 digits
    expected = [reference.to_plane(n * UNIT, e * UNIT) for n, e in places]
    np.testing.assert_allclose(got, expected, atol=1e-6)
    # and the plane is that of the earth in three dimensions: what is left out is the meridians' convergence,
    # to second order -e^2 tan/2R in north and n e tan/R in east, the change of the radii (e2 n^2 sin2/R),
    # and the third order, n e^2/R^2
    slope, radius = math.tan(math.radians(latitude)), A
    for (north, east), place in zip(got, places, strict=True):
        true_north, true_east = tangent(
            (origin[0] * UNIT, origin[1] * UNIT), (place[0] * UNIT, place[1] * UNIT)
        )
        rest = E2 * 1.5 * (north**2 + abs(north * east) * abs(slope)) / (2 * radius) + 2e-2
        assert true_north - north == pytest.approx(east**2 * slope / (2 * radius), abs=rest)
        assert true_east - east == pytest.approx(-north * east * slope / radius, abs=rest)


@pytest.mark.parametrize("latitude", LATITUDES)
def test_float32_loses_no_more_than_a_centimetre_in_5_km(native: Any, latitude: float) -> None:
    # given
    origin = units(math.radians(latitude)), -854_900_000
    reference = TangentPlane(origin[0] * UNIT, origin[1] * UNIT)
    places = around(reference)
    # when
    got = positions(settled(native, "float", *origin), places)
    # then: a unit is 1.1 cm, and the scales have 24 bits, 5 km * 2^-24 = 0.3 mm, a few roundings each;
    # the cosine of a latitude rounded to 32 units (6e-8 rad) is off by tan(70 deg) times that: 0.8 mm
    expected = positions(settled(native, "double", *origin), places)
    np.testing.assert_allclose(got, expected, atol=3e-3)


def test_float32_tells_neighbouring_units_apart_within_180_km(native: Any) -> None:
    # given places 1.6 deg north of the origin, a unit apart: their float32 latitudes are 32 units apart
    plane = settled(native, "float", 326_000_000, 0)
    places = [(342_000_000 + k, 0) for k in range(5)]
    # when
    north = positions(plane, places)[:, 0]
    # then each is farther north by the unit's 1.1 cm, as far as a float32 near 177 km tells (1/64 m)
    assert np.all(np.abs(np.diff(north) - 0.0111) <= 1 / 64)
    assert north[-1] - north[0] == pytest.approx(4 * 0.0111, abs=1 / 64)


@pytest.mark.parametrize("precision", ["double", "float"])
def test_the_first_fix_becomes_the_origin_and_remains_it(native: Any, precision: str) -> None:
    # given no origin, and a first fix that settles it
    plane = native(LocalPlane, precision)
    first = plane.run(latitude=-123_456_789, longitude=987_654_321, settle=1)
    # then it is the origin
    assert (first["north"][-1], first["east"][-1]) == (0, 0)
    assert (first["settled"][-1], first["origin_latitude"][-1]) == (1, -123_456_789)
    # and others leave it there
    later = plane.run(latitude=-123_456_000, longitude=987_650_000, settle=0)
    assert (later["origin_latitude"][-1], later["origin_longitude"][-1]) == (-123_456_789, 987_654_321)
    # 789 units of 1.11 cm north; 4321 units west, of 1.113 cm cos(12.3 deg)
    assert later["north"][-1] == pytest.approx(8.73, abs=0.02)
    assert later["east"][-1] == pytest.approx(-4321 * 0.011132 * math.cos(math.radians(12.3457)), abs=0.05)


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("east_of_it", [True, False])
def test_the_date_line_is_crossed_the_short_way(native: Any, precision: str, east_of_it: bool) -> None:
    # given an origin on the equator 100 units to one side of the date line, and a place as far on the other
    side = 1 if east_of_it else -1
    plane = settled(native, precision, 0, -side * (HALF - 100))
    # when
    north, east = positions(plane, [(0, side * (HALF - 100))])[0]
    # then it is 200 units away: A * 200e-7 deg = 2.226 m, to the west of an origin east of the line
    assert north == 0
    assert east == pytest.approx(-side * A * 200 * UNIT, abs=1e-5)


@pytest.mark.parametrize("precision", ["double", "float"])
def test_longitudes_of_plus_and_minus_180_deg_are_the_same(native: Any, precision: str) -> None:
    plane = settled(native, precision, 0, HALF)
    assert positions(plane, [(0, -HALF)])[0].tolist() == [0, 0]


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("pole", [QUARTER, -QUARTER])
def test_positions_at_the_poles_are_finite(native: Any, precision: str, pole: int) -> None:
    # given an origin at a pole, where the parallel is a point
    plane = settled(native, precision, pole, 0)
    # when
    places = positions(plane, [(pole, longitude) for longitude in (-HALF, -1, 1, HALF)])
    # then east is that of a parallel of 1 km: half round it is pi * 1 km
    assert np.all(np.isfinite(places))
    assert places[:, 0].tolist() == [0] * 4
    expected = [1e3 * math.pi, 1e3 * UNIT, 1e3 * UNIT, 1e3 * math.pi]
    np.testing.assert_allclose(np.abs(places[:, 1]), expected, rtol=1e-6)
    # north has the meridian's radius there, a / sqrt(1 - e2): 111.694 km in a degree
    south = positions(plane, [(pole - int(math.copysign(10_000_000, pole)), 0)])[0, 0]
    assert abs(south) == pytest.approx(111_694, abs=1)


@given(latitudes, longitudes, longitudes)
def test_east_is_the_short_way_for_any_two_longitudes(latitude: int, origin: int, longitude: int) -> None:
    # given an origin and a place on its parallel, anywhere
    model = Model(LocalPlane)
    model.initialize()
    model["latitude"], model["longitude"], model["settle"] = latitude, origin, 1
    model.step()
    model["longitude"], model["settle"] = longitude, 0
    # when
    model.step()
    # then: Python's whole numbers, which know no overflow
    apart = (longitude - origin + HALF) % (2 * HALF) - HALF
    got = round(model["east"] / model["east_scale"])
    assert got == apart or (abs(apart) == HALF and abs(got) == HALF)


DRIVER = """#include "local_plane.h"

#include <math.h>
#include <stdio.h>

int main(void)
{
    local_plane m;
    long origin[2], place[2];

    while (scanf("%ld %ld %ld %ld", &origin[0], &origin[1], &place[0], &place[1]) == 4) {
        local_plane_defaults(&m);
        local_plane_initialize(&m);
        m.in.latitude = (int32_t)origin[0];
        m.in.longitude = (int32_t)origin[1];
        m.in.settle = true;
        local_plane_step(&m);
        m.in.latitude = (int32_t)place[0];
        m.in.longitude = (int32_t)place[1];
        m.in.settle = false;
        local_plane_step(&m);
        printf("%ld %d\\n", lround((double)m.out.east / (double)m.state.east_scale), isfinite(m.out.north));
    }
    return 0;
}
"""


@pytest.mark.skipif(not shutil.which("gcc"), reason="no gcc")
@pytest.mark.parametrize("precision", ["double", "float"])
def test_no_difference_of_positions_overflows_32_bits(tmp_path: Path, precision: Any) -> None:
    # given C that ends at the first signed overflow or conversion out of range, and places at every edge
    files = generate(LocalPlane, precision) | {"main.c": DRIVER}
    write_files(files, tmp_path)
    sanitize = "signed-integer-overflow,float-cast-overflow"
    built = subprocess.run(
        ["gcc", "-std=c99", "-O1", f"-fsanitize={sanitize}", f"-fno-sanitize-recover={sanitize}",
         "-ffp-contract=off", *[n for n in files if n.endswith(".c")], "-o", "plane", "-lm"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    draw = random.Random(1)
    edges = [-HALF, -HALF + 1, -QUARTER - 1, -QUARTER, -1, 0, 1, QUARTER, QUARTER + 1, HALF - 1, HALF]
    rows = [(o, p) for o in edges for p in edges]
    rows += [(draw.randint(-HALF, HALF), draw.randint(-HALF, HALF)) for _ in range(2000)]
    rows += [  # about half the earth apart, where the way round changes
        (o, max(-HALF, min(HALF, o - int(math.copysign(HALF, o)) + draw.randint(-200, 200))))
        for o in (draw.randint(-HALF, HALF) for _ in range(1000))
    ]
    north = [draw.choice([-QUARTER, QUARTER, 0]) for _ in rows]
    typed = "\n".join(f"{a} {o} {-a} {p}" for a, (o, p) in zip(north, rows, strict=True))
    # when
    done = subprocess.run([tmp_path / "plane"], input=typed, capture_output=True, text=True, check=False)
    # then
    assert (done.returncode, done.stderr) == (0, "")
    answers = [tuple(map(int, line.split())) for line in done.stdout.splitlines()]
    assert len(answers) == len(rows)
    for (origin, place), (east, finite) in zip(rows, answers, strict=True):
        apart = (place - origin + HALF) % (2 * HALF) - HALF
        # float32 knows longitudes to 128 units: nearer than that to half the earth, either way is short
        unsure = precision == "float" and HALF - abs(apart) < 512
        assert finite
        ways = (
            {abs(east - apart), abs(abs(east) - abs(apart))}
            if unsure or abs(apart) == HALF
            else {abs(east - apart)}
        )
        assert min(ways) <= (256 if precision == "float" else 0) + (512 if unsure else 0)
