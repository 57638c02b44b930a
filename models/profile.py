"""The Canine Motion Simulator: a profile of acceleration, yaw rate and pitch drives the motion (D.6, B.2)."""

from __future__ import annotations

from models.kit.declaration import SX, Boolean, Integer, Parameter, State
from models.kit.geometry import COUNT_MAX, all_of, clip, counted, where, wrap
from models.kit.timing import lasted
from models.kit.units import DEG
from models.pack import PackMotion
from models.plant import Plant

SEGMENTS = 12
TOP_SPEED = 50.0  # m/s, what the estimators accept


class Segments(Plant):
    """Motion by segments of constant acceleration, yaw rate and pitch; after the last the speed is held."""

    # D.6.1: speed up for 3 s, turn right and slow down for 1 s, go on uphill for 15 s. By these numbers it
    # goes on at 2 m/s, the default; the text says 3 m/s, which PROFILES["simulator_fast"] has
    duration = Parameter(
        "s", "how long each segment lasts", start=(3, 1, 15) + (0,) * 9, size=SEGMENTS, min=0
    )
    acceleration_profile = Parameter(
        "m/s2", "acceleration in each segment", start=(1, -1) + (0,) * 10, size=SEGMENTS
    )
    yaw_rate_profile = Parameter(
        "rad/s", "yaw rate in each segment", start=(0, 90 * DEG) + (0,) * 10, size=SEGMENTS
    )
    pitch_profile = Parameter(
        "rad", "pitch of the ground in each segment", start=(0, 0, 10 * DEG) + (0,) * 9, size=SEGMENTS,
        min=-1, max=1,
    )  # fmt: skip
    start_speed = Parameter("m/s", "speed at the start", start=0, min=0, max=TOP_SPEED)

    tick = State(Integer, "ticks since the start", max=COUNT_MAX)

    def initialize(m) -> None:
        """Stand, or move, at the start of the first segment."""
        m._place()
        m.velocity = m.past_velocity = m.start_speed
        m.incline = m.pitch_profile[0]

    def move(m) -> None:
        """The motion's integrals over one tick (eq. D.9-D.11), at its mean speed and its middle heading."""
        acceleration = m._now(m.acceleration_profile, 0)
        turn = m._now(m.yaw_rate_profile, 0) * m.sample_time
        m.velocity = clip(m.velocity + acceleration * m.sample_time, 0.0, TOP_SPEED)  # eq. D.9
        m._step(m.body_heading + 0.5 * turn + m.side_slip)
        m.body_heading = wrap(m.body_heading + turn)  # eq. D.10
        m.incline = m._now(m.pitch_profile, m.incline)
        m.tick = counted(m.tick)

    def _now(m, profile: SX, after: SX | float) -> SX:
        """The value in the segment that this tick is in, and `after` the last one."""
        value, end = after, 0
        for i in range(SEGMENTS):
            begin, end = end, end + m.duration[i]
            inside = all_of(lasted(m.tick, begin, m.sample_time), lasted(m.tick, end, m.sample_time) == 0)
            value = where(inside, profile[i], value)
        return value


class Profile(PackMotion, Segments):
    """The Canine Motion Simulator: a profile drives the motion, whatever is commanded."""

    source = "Miller 2010, D.6, eq. B.5, D.9-D.11; tests: B.2; motion of the pack: B.4, D.5"

    shaking = Parameter(  # D.6 has none
        Boolean, "the pack shakes with the stride; off: it moves as the animal's centre", start=0
    )


def _walk(*turns: float) -> dict[str, float]:
    """A walk of four legs of 7 s at 1.5 m/s, with these turns between them [deg], of a second each."""
    rows = [(1.0, 1.5, 0.0), (7.0, 0.0, 0.0)]
    for turn in turns:
        rows += [(1.0, 0.0, turn * DEG), (7.0, 0.0, 0.0)]
    rows.append((1.0, -1.5, 0.0))
    rows += [(0.0, 0.0, 0.0)] * (SEGMENTS - len(rows))
    names = ("duration", "acceleration_profile", "yaw_rate_profile")
    return {f"pitch_profile[{i + 1}]": 0.0 for i in range(SEGMENTS)} | {
        f"{name}[{i + 1}]": row[column] for column, name in enumerate(names) for i, row in enumerate(rows)
    }


# Parameters by the test's name. The text gives the order of the directions (B.2), and a U-turn after 16 to
# 18 s (B.5); speed and lengths of the legs are ours.
PROFILES: dict[str, dict[str, float]] = {
    "simulator": {},
    "simulator_fast": {"acceleration_profile[2]": 0.0},  # 3 m/s: it does not slow down in the turn
    "l": _walk(90, 180, -90),  # north, east, back west, south
    "box": {"start_heading": 90 * DEG} | _walk(-90, -90, -90),  # east, north, west, south
}
