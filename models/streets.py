"""Streets that hold the dog, and poles that draw it: what it sees in the structured trials (4.2.1).

The maps of those trials are lost, and the text has no law for them. The laws here are the smallest that do
what it tells: a wall cancels the drift (4.2.3), a dog that stops beyond a narrow crossing faces a wall
(4.2.2.2), and a decoy may move it off its course (4.2.3). All their numbers are ours.
"""

from __future__ import annotations

from models.canine import Behaviour
from models.commands import Command
from models.kit import casadi as ca
from models.kit.block import before, triggered
from models.kit.declaration import SX, Integer, Parameter, State, Stream
from models.kit.geometry import all_of, any_of, at_most, clip, element, where, wrap
from models.kit.random import uniform
from models.kit.timing import ticks_until
from models.kit.units import DEG
from models.pack import PackMotion

MAX_STREETS, MAX_POLES = 16, 8
TOUCH = 1e-6  # m: an animal so near to a wall touches it


class Streets(Behaviour):
    """Streets: an animal that is in one stays in it, and at a crossing goes into the one into which it looks.

    A street is what lies within its half-width of a line between two ends. The animal changes to another
    that it is in, if that one's direction, either way, is within a cone about its heading. A street that
    goes on ahead is better than one that ends here, and of two that do the one nearer to its heading; it
    changes to a better one alone. Where its own ends it looks a little farther than the cone. It turns
    towards its street's direction at a rate in proportion to the deviation. A wall takes what of the
    velocity goes through it; an animal that leans on a wall goes along it, as fast as that part of its
    cruise speed. RECALL takes it home straight, walls or not, as in the open (5.3.2). Outside of all streets
    it is free until it comes into one.
    """

    street_count = Parameter(
        Integer, "streets, 0 for an open field", start=0, min=0, max=MAX_STREETS, structural=True
    )
    street_north = Parameter(
        "m", "one end of each street's middle", start=0, size=MAX_STREETS, min=-1e5, max=1e5
    )
    street_east = Parameter(
        "m", "one end of each street's middle", start=0, size=MAX_STREETS, min=-1e5, max=1e5,
        beside="street_north",
    )  # fmt: skip
    street_end_north = Parameter("m", "its other end", start=0, size=MAX_STREETS, min=-1e5, max=1e5)
    street_end_east = Parameter(
        "m", "its other end", start=0, size=MAX_STREETS, min=-1e5, max=1e5, beside="street_end_north"
    )
    street_half_width = Parameter("m", "its half-width", start=1, size=MAX_STREETS, min=0.1, max=1e3)
    street_cone = Parameter(
        "rad",
        "the animal looks into a street within this of its heading",
        start=45 * DEG,
        min=0,
        max=90 * DEG,
    )
    street_lag = Parameter(
        "rad",
        "where its own street ends it looks farther by this: it may not have turned to its direction yet",
        start=20 * DEG,
        min=0,
        max=90 * DEG,
    )
    street_gain = Parameter(
        "Hz", "rate of turn towards a street's direction, per deviation from it", start=2, min=0, max=25
    )
    street_turn_rate = Parameter("rad/s", "that rate at most", start=60 * DEG, min=0)

    street = State(Integer, "the street that it is in, 0 for none", min=0, max=MAX_STREETS)
    next_street = State(Integer, "the street that it will be in", min=0, max=MAX_STREETS)
    origin_north = State("m", "one end of the street that it is in")
    origin_east = State("m", "one end of the street that it is in")
    way_north = State("m", "that street from end to end; (0, 0) for none")
    way_east = State("m", "that street from end to end; (0, 0) for none")
    half_width = State("m", "its half-width")
    out_north = State(
        "1", "outwards through the wall that it touches, a unit long; (0, 0) if it touches none"
    )
    out_east = State("1", "outwards through the wall that it touches, a unit long; (0, 0) if it touches none")
    wall_slip = State("rad", "course along the wall, less the course that it would take without")

    @triggered(lambda m: m.street_count > 0, "there are streets")
    def initialize_streets(m) -> None:
        """Is the start in a street?"""
        m._look(0, 0)
        m._enter()

    @before("move")
    @triggered(
        lambda m: all_of(
            m.street > 0,
            m.obeyed != Command.RECALL,
            any_of(m.obeyed == Command.FORWARD, m.velocity > 0),
        ),
        "it is in a street; FORWARD is obeyed, or it moves, but not home",
    )
    def follow(m) -> None:
        """Turn towards the street's direction, either way."""
        ahead = m.way_north * ca.cos(m.body_heading) + m.way_east * ca.sin(m.body_heading)
        sense = where(ahead < 0, -1, 1)
        m._turn_to(sense * m.way_north, sense * m.way_east, m.street_gain, m.street_turn_rate)

    @triggered(lambda m: m.street_count > 0, "there are streets")
    def keep_in(m) -> None:
        """Stay in the street, slide along its wall; see into which street it looks."""
        held = all_of(m.street > 0, m.obeyed != Command.RECALL)
        north, east, straight, goes_on = m._beside(m.origin_north, m.origin_east, m.way_north, m.way_east)
        distance = ca.sqrt(north * north + east * east)
        touches = all_of(held, distance > m.half_width - TOUCH)
        m.out_north, m.out_east = where(touches, north / distance, 0), where(touches, east / distance, 0)
        outside = all_of(touches, distance > m.half_width)
        back = where(outside, distance - m.half_width, 0)
        m.position_north = m.position_north - back * m.out_north
        m.position_east = m.position_east - back * m.out_east
        course = m.body_heading + m._slip()
        kept = ca.fabs(m.out_north * ca.sin(course) - m.out_east * ca.cos(course))
        most = m._top_speed() * ca.cos(m.wall_slip)
        m.velocity = at_most(where(outside, m.velocity * kept, m.velocity), most)
        m._look(straight, goes_on)

    @triggered(
        lambda m: all_of(m.street_count > 0, m.next_street != m.street),
        "it looks into another street",
        seldom=True,
    )
    def enter(m) -> None:
        """Change to the street."""
        m._enter()

    def _move(m, acceleration: SX, top_speed: SX, turn_rate: SX) -> None:
        """The kinematics of one tick; the course of an animal that leans on a wall is along it."""
        course = m.body_heading + turn_rate * m.sample_time + m.side_slip
        north, east = ca.cos(course), ca.sin(course)
        leans = all_of(m.out_north * north + m.out_east * east > 0, m.obeyed != Command.RECALL)
        side = where(m.out_north * east < m.out_east * north, -1, 1)
        along = ca.atan2(side * m.out_north, -side * m.out_east)
        m.wall_slip = where(leans, wrap(along - course), 0)
        super()._move(acceleration, top_speed, turn_rate)

    def _look(m, own_straight: SX | float, own_goes_on: SX | float) -> None:
        """Choose among the streets that it is in: those that go on before those that end; the straightest.

        It leaves its own for a better one alone, which is within the cone; where its own ends, within the
        lag more.

        Args:
            own_straight, own_goes_on: of the street that it is in, as `_beside` returns.
        """
        within, beyond = m.street_cone, at_most(m.street_cone + m.street_lag, 90 * DEG)
        cone = where(own_goes_on, ca.cos(within) ** 2, ca.cos(beyond) ** 2)
        least = where(m.street > 0, cone, -1)  # of cos^2 of the deviation
        best, chosen = where(m.street > 0, own_straight + own_goes_on, -1), m.street
        for i in range(MAX_STREETS):
            north, east, straight, goes_on = m._beside(*m._origin(i), *m._way(i))
            is_in = north * north + east * east <= m.street_half_width[i] ** 2
            merit = straight + goes_on
            better = all_of(i < m.street_count, is_in, straight > least, merit > best)
            best, chosen = where(better, merit, best), where(better, i + 1, chosen)
        m.next_street = where(m.obeyed == Command.RECALL, 0, chosen)

    def _enter(m) -> None:
        """Keep what is asked of a street on each tick of the one that the animal will be in."""
        m.street = m.next_street
        places = [(*m._origin(i), *m._way(i), m.street_half_width[i]) for i in range(MAX_STREETS)]
        columns = [ca.vertcat(0, *column) for column in zip(*places, strict=True)]
        values = [element(column, m.street) for column in columns]
        m.origin_north, m.origin_east, m.way_north, m.way_east, m.half_width = values

    def _origin(m, i: int) -> tuple[SX, SX]:
        """One end of a street."""
        return m.street_north[i], m.street_east[i]

    def _way(m, i: int) -> tuple[SX, SX]:
        """A street from that end to the other."""
        return m.street_end_north[i] - m.street_north[i], m.street_end_east[i] - m.street_east[i]

    def _beside(m, origin_north: SX, origin_east: SX, way_north: SX, way_east: SX) -> tuple[SX, SX, SX, SX]:
        """The animal's place from the nearest one in a street's middle, and how it looks along the street.

        Returns:
            North and east [m]; cos^2 of the deviation from the street's direction, either way; and whether
            the street goes on ahead of it.
        """
        square = way_north * way_north + way_east * way_east
        per_square = where(square > 0, 1 / square, 0)  # a street of no length is a round place
        north, east = m.position_north - origin_north, m.position_east - origin_east
        share = (north * way_north + east * way_east) * per_square
        nearest = clip(share, 0, 1)
        ahead = way_north * ca.cos(m.body_heading) + way_east * ca.sin(m.body_heading)
        goes_on = where(ahead < 0, share > 0, share < 1)
        return north - nearest * way_north, east - nearest * way_east, ahead * ahead * per_square, goes_on

    def _turn_to(m, north: SX, east: SX, gain: SX, limit: SX) -> None:
        """Turn for a tick towards a direction, in proportion to the deviation from it; (0, 0) is none."""
        ahead, aside = ca.cos(m.body_heading), ca.sin(m.body_heading)
        deviation = ca.atan2(east * ahead - north * aside, north * ahead + east * aside)
        rate = clip(gain * deviation, -limit, limit)
        m.body_heading = wrap(m.body_heading + rate * m.sample_time)

    def _slip(m) -> SX:
        """Course less heading: the slip that it takes, and the turn of its course by a wall."""
        return m.side_slip + m.wall_slip


class Poles(Streets):
    """Poles: a running animal may fancy one that it sees, the goal or a decoy, and head for it.

    It looks up when it sets out, and every so often while it fancies none. By chance it fancies one of those
    within a range and a cone about its heading, each as likely as the others. It turns towards it at a rate
    in proportion to the deviation, until it obeys another command than FORWARD or no longer sees it.
    """

    pole_count = Parameter(Integer, "poles, 0 for none", start=0, min=0, max=MAX_POLES, structural=True)
    pole_north = Parameter("m", "where each pole stands", start=0, size=MAX_POLES, min=-1e5, max=1e5)
    pole_east = Parameter(
        "m", "where each pole stands", start=0, size=MAX_POLES, min=-1e5, max=1e5, beside="pole_north"
    )
    pole_range = Parameter("m", "the animal sees a pole up to here", start=25, min=0, max=1e5)
    pole_cone = Parameter("rad", "and within this of its heading", start=30 * DEG, min=0, max=90 * DEG)
    pole_chance = Parameter(
        "1", "probability that it fancies one when it looks up and sees any", start=0.5, min=0, max=1
    )
    pole_look_time = Parameter("s", "time between looking up", start=2, min=0.04, max=1e3)
    pole_gain = Parameter("Hz", "rate of turn towards a pole, per deviation", start=1, min=0, max=25)
    pole_turn_rate = Parameter("rad/s", "that rate at most", start=30 * DEG, min=0)

    fancied = State(Integer, "the pole that it fancies, 0 for none", min=0, max=MAX_POLES)
    fancied_north = State("m", "where that pole stands")
    fancied_east = State("m", "where that pole stands")
    unlooked = State(Integer, "ticks until it looks up")
    fancy_stream = Stream("the poles that the animal fancies", substream=14)

    @before("move")
    @triggered(
        lambda m: all_of(m.pole_count > 0, m.obeyed == Command.FORWARD, m.fancied == 0, m.unlooked <= 0),
        "there are poles, FORWARD is obeyed, none is fancied, the last look is long ago",
        seldom=True,
    )
    def look_up(m) -> None:
        """Fancy one of the poles that it sees, by chance."""
        draw, m.fancy_stream = uniform(m.fancy_stream)
        seen = [all_of(i < m.pole_count, m._sees(m.pole_north[i], m.pole_east[i])) for i in range(MAX_POLES)]
        number = sum(seen, start=ca.SX(0))
        # below `pole_chance` a draw is as likely in each of as many equal parts of it as poles are seen
        part = ca.floor(draw / m.pole_chance * number)
        before_it = ca.SX(0)
        fancied, north, east = ca.SX(0), m.fancied_north, m.fancied_east
        for i, sees in enumerate(seen):
            chosen = all_of(sees, draw < m.pole_chance, before_it == part)
            fancied = where(chosen, i + 1, fancied)
            north, east = where(chosen, m.pole_north[i], north), where(chosen, m.pole_east[i], east)
            before_it = before_it + sees
        m.fancied, m.fancied_north, m.fancied_east = fancied, north, east
        m.unlooked = ticks_until(m.pole_look_time, m.sample_time)

    @before("move")
    @triggered(lambda m: m.pole_count > 0, "there are poles")
    def head_for(m) -> None:
        """Turn towards the pole that it fancies, while it sees it."""
        runs = m.obeyed == Command.FORWARD
        m.unlooked = where(runs, m.unlooked - (m.unlooked > 0), 0)
        sees = all_of(m.fancied > 0, runs, m._sees(m.fancied_north, m.fancied_east))
        m.fancied = where(sees, m.fancied, 0)
        north, east = m.fancied_north - m.position_north, m.fancied_east - m.position_east
        m._turn_to(where(sees, north, 0), where(sees, east, 0), m.pole_gain, m.pole_turn_rate)

    def _sees(m, north: SX, east: SX) -> SX:
        """Is a place within the range and the cone, and not where the animal is?"""
        away_north, away_east = north - m.position_north, east - m.position_east
        square = away_north * away_north + away_east * away_east
        ahead = away_north * ca.cos(m.body_heading) + away_east * ca.sin(m.body_heading)
        within = ahead * ahead >= ca.cos(m.pole_cone) ** 2 * square
        return all_of(square <= m.pole_range**2, ahead > 0, within)


class CanineInStreets(PackMotion, Poles):
    """The guided dog among streets that hold it and poles that it may fancy."""

    source = "ours, after Miller 2010, 4.2.1 to 4.2.3; the dog: as canine"

    @before("slide")
    @triggered(
        lambda m: all_of(ca.logic_not(m._slips()), any_of(m.slip_brake != 0, m.slip_force != 0)),
        "there was slip, and is none",
        seldom=True,
    )
    def leave_wall(m) -> None:
        """The acceleration by slip ends with it."""
        m.slip_brake = m.slip_force = 0

    def _slips(m) -> SX:
        """The course turns along a wall, too."""
        return any_of(m._slip_is_set(), m.wall_slip != 0, m.past_slip != 0)
