"""Candidates: waypoints along ways, at several spacings."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import shapely

from harness.routes.site import Place, RouteError, Site
from harness.routes.way import OPEN, Way
from models.cmec import MAX_WAYPOINTS

TINY = 1e-9  # share of a leg


@dataclass(frozen=True)
class Candidate:
    """A way with waypoints on it.

    Attributes:
        spacing: legs are split so that no part is longer, m; None for waypoints at the corners alone.
        waypoints: without the begin, with the end.
        number: which of those that are the same in words, from 1 on; 0 if there is no other one.
    """

    way: Way
    spacing: float | None
    waypoints: tuple[Place, ...]
    number: int = 0

    @property
    def label(self) -> str:
        """What it is, in words."""
        about = f"{self.way.length:.0f} m"
        about += f", {self.way.clearance:g} m clear" if self.way.kind == OPEN else " along streets"
        about += ", unsplit" if self.spacing is None else f", every {self.spacing:g} m"
        return f"{about} ({self.number})" if self.number else about


def told_apart(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The candidates, with a number in the labels that several have."""
    labels = Counter(candidate.label for candidate in candidates)
    seen: Counter[str] = Counter()
    numbered = []
    for candidate in candidates:
        label = candidate.label
        seen[label] += 1
        numbered.append(replace(candidate, number=seen[label]) if labels[label] > 1 else candidate)
    return numbered


def candidates_of(
    ways: Sequence[Way], spacings: Sequence[float | None], site: Site, least: float
) -> tuple[list[Candidate], list[str]]:
    """The candidates that a controller can follow, and notes on those left out.

    Args:
        least: d' in m: a leg must be longer, or its end is reached before it begins.

    Raises:
        RouteError: a spacing is too short, or none is left.
    """
    for spacing in spacings:
        if spacing is not None and not least < spacing < math.inf:  # nor is it a number
            raise RouteError(f"spacing {spacing:g}: expected a length of more than d', {least:g} m, or none")
    by_waypoints: dict[tuple[Place, ...], Candidate] = {}
    left_out: Counter[str] = Counter()
    for way in ways:
        corners = _apart(way, site, least)
        if corners is None:
            left_out[f"has corners within d', {least:g} m, of each other"] += len(spacings)
            continue
        for spacing in spacings:
            waypoints = _split(corners, spacing, least)
            if len(waypoints) > MAX_WAYPOINTS:
                left_out[f"needs more than {MAX_WAYPOINTS} waypoints"] += 1
            else:
                by_waypoints.setdefault(waypoints, Candidate(way, spacing, waypoints))
    notes = [
        f"{count} candidate{'s' if count > 1 else ''} left out: {'each' if count > 1 else 'it'} {why}"
        for why, count in left_out.items()
    ]
    if not by_waypoints:
        raise RouteError(f"{site.name}: no candidate is left ({'; '.join(notes)}); take a wider spacing")
    return list(by_waypoints.values()), notes


def _apart(way: Way, site: Site, least: float) -> list[Place] | None:
    """The corners of a way without those too near to the one before; None if one cannot be left out."""
    kept = [way.places[0]]
    for place, after in zip(way.places[1:], [*way.places[2:], None], strict=True):
        if math.dist(kept[-1], place) > least:
            kept.append(place)
        elif after is None:  # the end stays; a corner before it goes
            if len(kept) == 1 or site.union.intersects(shapely.LineString([kept[-2], place])):
                return None
            kept[-1] = place
        elif site.union.intersects(shapely.LineString([kept[-1], after])):
            return None
    return kept if all(math.dist(a, b) > least for a, b in itertools.pairwise(kept)) else None


def _split(corners: Sequence[Place], spacing: float | None, least: float) -> tuple[Place, ...]:
    """Waypoints at the corners but the first, and evenly between them, no nearer than `least`."""
    waypoints: list[Place] = []
    for a, b in itertools.pairwise(corners):
        length = math.dist(a, b)
        parts = 1 if spacing is None else max(1, math.ceil(length / spacing - TINY))
        while parts > 1 and length / parts <= least:
            parts -= 1
        waypoints += [
            (a[0] + (b[0] - a[0]) * k / parts, a[1] + (b[1] - a[1]) * k / parts) for k in range(1, parts + 1)
        ]
    return tuple(waypoints)
