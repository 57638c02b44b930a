"""The watchdogs on board: they notice that IMU or operator are silent, or an override is not renewed."""

from __future__ import annotations

from models.kit.block import Block
from models.kit.declaration import Boolean, Input, Integer, Output, Parameter, State
from models.kit.geometry import LONGEST, SHORT_COUNT_MAX, all_of, counted, where
from models.kit.timing import TICK, ticks_within


class Watchdog(Block):
    """Watchdog: detects a silent IMU, a silent operator and an old override, and times the telemetry."""

    source = "ours: the text does not treat failures (2.3 and 2.4 describe the links)"
    precisions = ("double", "float")

    sampled = Input(Boolean, "a sample of the IMU arrived on this tick", start=0)
    heard = Input(Boolean, "a message of the operator arrived on this tick", start=0)
    overridden = Input(Boolean, "an override of the operator's arrived on this tick", start=0)
    valid = Input(Boolean, "the estimator's last fix is recent enough", start=0)

    imu_ok = Output(Boolean, "the IMU's samples arrive")
    link_ok = Output(Boolean, "the operator's messages arrive")
    override_ok = Output(Boolean, "the last override is recent enough to hold")
    estimate_ok = Output(Boolean, "the estimate may be trusted")
    report = Output(Boolean, "telemetry is due on this tick")

    imu_timeout = Parameter("s", "longest time without a sample of the IMU", start=0.2, min=TICK, max=LONGEST)
    link_timeout = Parameter(
        "s", "longest time without a message of the operator", start=2, min=TICK, max=LONGEST
    )
    override_timeout = Parameter(
        "s",
        "longest time for which an override other than STOP holds, unless it is renewed",
        start=1,
        min=TICK,
        max=LONGEST,
    )
    report_period = Parameter("s", "time between two reports by telemetry", start=0.2, min=TICK, max=10)

    imu_limit = State(Integer, "imu_timeout in ticks", min=0, max=SHORT_COUNT_MAX)
    link_limit = State(Integer, "link_timeout in ticks", min=0, max=SHORT_COUNT_MAX)
    override_limit = State(Integer, "override_timeout in ticks", min=0, max=SHORT_COUNT_MAX)
    report_ticks = State(Integer, "report_period in ticks", min=0, max=SHORT_COUNT_MAX)
    imu_age = State(Integer, "ticks since the last sample", start=SHORT_COUNT_MAX, min=0, max=SHORT_COUNT_MAX)
    link_age = State(
        Integer, "ticks since the last message", start=SHORT_COUNT_MAX, min=0, max=SHORT_COUNT_MAX
    )
    override_age = State(
        Integer, "ticks since the last override", start=SHORT_COUNT_MAX, min=0, max=SHORT_COUNT_MAX
    )
    report_age = State(
        Integer, "ticks since the last report", start=SHORT_COUNT_MAX, min=0, max=SHORT_COUNT_MAX
    )

    def initialize(m) -> None:
        """Turn the times into whole ticks, so that every tick compares counts alone."""
        m.imu_limit = ticks_within(m.imu_timeout, m.sample_time)
        m.link_limit = ticks_within(m.link_timeout, m.sample_time)
        m.override_limit = ticks_within(m.override_timeout, m.sample_time)
        m.report_ticks = ticks_within(m.report_period, m.sample_time)

    def watch(m) -> None:
        """Count the ticks since each last arrival, and compare them with their limits."""
        m.imu_age = where(m.sampled, 0, counted(m.imu_age, most=SHORT_COUNT_MAX))
        m.link_age = where(m.heard, 0, counted(m.link_age, most=SHORT_COUNT_MAX))
        m.override_age = where(m.overridden, 0, counted(m.override_age, most=SHORT_COUNT_MAX))
        m.imu_ok, m.link_ok = m.imu_age <= m.imu_limit, m.link_age <= m.link_limit
        m.override_ok = m.override_age <= m.override_limit
        m.estimate_ok = all_of(m.valid, m.imu_ok)
        m.report_age = counted(m.report_age, most=SHORT_COUNT_MAX)
        m.report = m.report_age >= m.report_ticks
        m.report_age = where(m.report, 0, m.report_age)
