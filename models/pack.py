"""The pack on the animal's back: it shakes with the stride, wanders, jerks, and slips (B.4, D.5, 6.2)."""

from __future__ import annotations

import math

from models.kit import casadi as ca
from models.kit.block import triggered
from models.kit.declaration import SX, Boolean, Integer, Parameter, State, Stream
from models.kit.geometry import all_of, any_of, clip, where, wrap
from models.kit.random import MAX_SEED, normal, normals, uniform
from models.kit.units import DEG
from models.plant import Plant

LARGEST_SLIP = 60 * DEG  # ours: an animal that moves farther off its heading turns instead


class PackMotion(Plant):
    """A plant whose pack moves on the animal's back: the part that follows the animal's own motion."""

    seed = Parameter(Integer, "trial number: selects the random streams", start=1, min=0, max=MAX_SEED)
    # motion when walking (detection mode) and when running: B.4, D.5
    shaking = Parameter(
        Boolean, "the pack shakes with the stride; off: it moves as the animal's centre", start=1
    )
    walk_stride = Parameter("Hz", "strides per second, walking", start=2.0, min=0, max=10)
    run_stride = Parameter("Hz", "strides per second, running", start=2.9, min=0, max=10)
    walk_acceleration_swing = Parameter("m/s2", "peak to peak, walking (10 to 20)", start=15, min=0)
    run_acceleration_swing = Parameter("m/s2", "peak to peak, running (40 to 50)", start=45, min=0)
    walk_pitch_swing = Parameter(
        "rad", "peak to peak, walking (5 to 10 deg)", start=7.5 * DEG, min=0, max=1.5
    )
    run_pitch_swing = Parameter("rad", "peak to peak, running (40 to 60 deg)", start=50 * DEG, min=0, max=1.5)
    pitch_mean = Parameter("rad", "mean pitch of the pack on the dog's back", start=-8.5 * DEG, min=-1, max=1)
    roll_swing = Parameter("rad", "peak to peak", start=10 * DEG, min=0, max=1.5)
    yaw_rate_swing = Parameter("rad/s", "peak to peak (70 to either side)", start=140 * DEG, min=0)
    jerk_deviation = Parameter("m/s2", "spike of a jerk of the pack, standard deviation", start=8, min=0)
    jerk_rate = Parameter("1", "probability of a jerk in a stride", start=0.3, min=0, max=1)
    # what real packs do besides: all off
    stride_deviation = Parameter(
        "1", "standard deviation of a stride's frequency, relative to its mean", start=0, min=0, max=1
    )
    swing_deviation = Parameter(
        "1", "standard deviation of a stride's swings, relative to their mean", start=0, min=0, max=2
    )
    pitch_wander = Parameter(
        "rad", "slow wander of the pitch about its mean (D.5), standard deviation", start=0, min=0, max=0.5
    )
    pitch_wander_time = Parameter("s", "correlation time of that wander", start=2, min=0, max=1e4)
    pitch_shift = Parameter(
        "rad", "where the pack comes to sit after a shift (15 to 18 deg, D.5), standard deviation",
        start=10 * DEG, min=0, max=0.5,
    )  # fmt: skip
    pitch_shift_rate = Parameter("Hz", "shifts of the pitch in a second", start=0, min=0, max=10)
    pitch_shift_time = Parameter("s", "time constant of a shift", start=0.2, min=0, max=1e3)
    jolt_peak = Parameter(
        "m/s2", "largest jolt of the pack (B.4): all have this sign; sizes are uniform", start=10
    )
    jolt_rate = Parameter("Hz", "jolts in a second of motion", start=0, min=0, max=10)
    jolt_time = Parameter(
        "s", "time constant in which a jolt fades; 0: it lasts one tick", start=0, min=0, max=10
    )
    slip_mean = Parameter("rad", "mean slip: course less heading", start=0, min=-1, max=1)
    slip_lead = Parameter(
        "s",
        "slip per yaw rate: a unit held ahead of the turning axis moves to the side",
        start=0,
        min=-5,
        max=5,
    )
    slip_wander = Parameter("rad", "slow wander of the slip, standard deviation", start=0, min=0, max=0.5)
    slip_time = Parameter("s", "time in which the slip follows, and wanders", start=0.5, min=0, max=1e3)

    stride = State("rad", "phase of the stride", min=0)
    jerk = State("m/s2", "jerk of the pack on this tick")
    jerk_due = State(Boolean, "a stride began on this tick")
    jerk_stream = Stream("jerks of the pack", substream=3)
    quickness = State("1", "frequency of this stride, relative to the mean", start=1)
    strength = State("1", "swings of this stride, relative to their mean", start=1)
    stride_stream = Stream("frequency and swings of strides", substream=11)
    wandered_pitch = State("rad", "wander of the pitch")
    settling_pitch = State("rad", "where the last shift leaves the pitch, about its mean")
    shifted_pitch = State("rad", "the pitch on its way there")
    jolt = State("m/s2", "what is left of the jolts")
    past_slip = State("rad", "slip a tick ago")
    slip_brake = State("m/s2", "longitudinal acceleration by slip")
    slip_force = State("m/s2", "lateral acceleration by slip")
    wander_stream = Stream("wander of pitch and slip", substream=5)
    shift_stream = Stream("shifts of the pitch", substream=6)
    jolt_stream = Stream("jolts of the pack", substream=7)

    @triggered(
        lambda m: any_of(m.pitch_wander > 0, m._slip_is_set()),
        "`pitch_wander` is above 0, or one of slip is not 0",
    )
    def initialize_wander(m) -> None:
        """Draw pitch and slip as they might be at any time."""
        draws, m.wander_stream = normals(m.wander_stream, 2)
        m.wandered_pitch = m.pitch_wander * draws[0]
        m.side_slip = m.past_slip = m.slip_mean + m.slip_wander * draws[1]

    @triggered("shaking")
    def swing(m) -> None:
        """Advance the stride."""
        walk, run = m._gait()
        rate = (walk * m.walk_stride + run * m.run_stride) * m.quickness
        phase = m.stride + 2 * math.pi * rate * m.sample_time
        m.jerk_due = phase >= 2 * math.pi
        m.stride = phase - where(m.jerk_due, 2 * math.pi, 0)
        m.jerk = 0

    @triggered(
        lambda m: all_of(m.shaking, m.jerk_due, any_of(m.stride_deviation > 0, m.swing_deviation > 0)),
        "`shaking`, a stride began on this tick, and one of `stride_deviation`, `swing_deviation` is above 0",
        seldom=True,
    )
    def stride_anew(m) -> None:
        """Draw the frequency and the swings of a stride anew, neither below a fifth of its mean (ours)."""
        draws, m.stride_stream = normals(m.stride_stream, 2)
        m.quickness = clip(1 + m.stride_deviation * draws[0], 0.2, 5.0)
        m.strength = clip(1 + m.swing_deviation * draws[1], 0.2, 5.0)

    @triggered(lambda m: all_of(m.shaking, m.jerk_due), "`shaking`, and a stride began on this tick")
    def shake(m) -> None:
        """By chance, once a stride, the pack hits the back: a spike, sometimes over 20 m/s2 (B.4)."""
        chance, stream = uniform(m.jerk_stream)
        size, m.jerk_stream = normal(stream)
        m.jerk = where(chance <= m.jerk_rate, m.jerk_deviation * size, 0)
        m.jerk_due = 0

    @triggered(
        lambda m: any_of(m.pitch_wander > 0, m._slip_is_set()),
        "`pitch_wander` is above 0, or one of slip is not 0",
        seldom=True,
    )
    def wander(m) -> None:
        """Wander in pitch and slip: first-order Gauss-Markov processes (ours)."""
        draws, m.wander_stream = normals(m.wander_stream, 2)
        kept = m._kept(m.pitch_wander_time)
        m.wandered_pitch = kept * m.wandered_pitch + m.pitch_wander * ca.sqrt(1 - kept * kept) * draws[0]
        kept = m._kept(m.slip_time)
        led = m.slip_mean + m.slip_lead * m._turned() / m.sample_time
        wandered = led + kept * (m.side_slip - led) + m.slip_wander * ca.sqrt(1 - kept * kept) * draws[1]
        m.side_slip = clip(wandered, -LARGEST_SLIP, LARGEST_SLIP)

    @triggered(lambda m: m._slips(), "there is slip", seldom=True)
    def slide(m) -> None:
        """Slip, and the acceleration that comes of it.

        It is the change of the velocity in the body's axes, without the rate of the speed, which stands in
        `output`, and without speed times yaw rate, which is the sensors' own.
        """
        turned = wrap(m.body_heading - m.past_heading)
        slip, past = m._slip(), m.past_slip - turned  # both in the axes of now
        ahead = m.velocity * ca.cos(slip) - m.past_velocity * ca.cos(past)
        aside = m.velocity * ca.sin(slip) - m.past_velocity * ca.sin(past)
        m.slip_brake = (ahead - (m.velocity - m.past_velocity)) / m.sample_time
        m.slip_force = (aside - m.velocity * turned) / m.sample_time
        m.past_slip = slip

    @triggered(lambda m: m.pitch_shift_rate > 0, "`pitch_shift_rate` is above 0", seldom=True)
    def shift(m) -> None:
        """By chance the pack comes to sit anew, and goes there quickly (D.5)."""
        chance, stream = uniform(m.shift_stream)
        place, m.shift_stream = normal(stream)
        shifts = chance < m.pitch_shift_rate * m.sample_time
        m.settling_pitch = where(shifts, m.pitch_shift * place, m.settling_pitch)
        kept = m._kept(m.pitch_shift_time)
        m.shifted_pitch = m.settling_pitch + kept * (m.shifted_pitch - m.settling_pitch)

    @triggered(lambda m: m.jolt_rate > 0, "`jolt_rate` is above 0", seldom=True)
    def jolt_pack(m) -> None:
        """By chance a moving pack jolts. All jolts have one sign: the bias takes them for its own (B.4)."""
        chance, stream = uniform(m.jolt_stream)
        size, m.jolt_stream = uniform(stream)
        walk, run = m._gait()
        jolts = chance < m.jolt_rate * m.sample_time * (walk + run)
        m.jolt = m._kept(m.jolt_time) * m.jolt + where(jolts, m.jolt_peak * size, 0)

    def output(m) -> None:
        """The animal's motion; acceleration, attitude and yaw rate are those of the pack on its back.

        The heading is the animal's. The gyroscope turns with the pack, which swings about it (B.4).
        """
        m._report()
        walk, run = m._gait()
        sine, cosine = ca.sin(m.stride) * m.strength, ca.cos(m.stride) * m.strength
        moving = where(m.shaking, walk + run, 0)
        forward = walk * m.walk_acceleration_swing + run * m.run_acceleration_swing
        nodding = walk * m.walk_pitch_swing + run * m.run_pitch_swing
        shaken = 0.5 * forward * cosine + (m.jerk + m.jolt)
        m.acceleration = m.acceleration + where(m.shaking, shaken, 0) + m.slip_brake
        pitch = m.pitch_mean + 0.5 * nodding * sine + (m.wandered_pitch + m.shifted_pitch)
        m.pitch = m.incline + where(m.shaking, pitch, 0)
        m.roll = moving * 0.5 * m.roll_swing * cosine
        m.yaw_rate = m.yaw_rate + moving * 0.5 * m.yaw_rate_swing * sine
        m.slip_acceleration = m.slip_force

    def _gait(m) -> tuple[SX, SX]:
        """Shares of walking and of running in the gait, by speed, with the breakpoints of eq. 3.19."""
        run = clip(m.velocity - 3.0, 0.0, 1.0)
        return clip(m.velocity / 0.5, 0.0, 1.0) * (1 - run), run

    def _slip_is_set(m) -> SX:
        """Do the parameters ask for slip?"""
        return any_of(m.slip_wander > 0, m.slip_mean != 0, m.slip_lead != 0)

    def _slips(m) -> SX:
        """Is there slip to reckon with on this tick? A plant that slips by itself says so as well."""
        return m._slip_is_set()

    def _kept(m, time: SX) -> SX:
        """What a first-order lag of this time constant keeps over a tick."""
        return time / (time + m.sample_time)
