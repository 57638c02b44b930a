"""The watchdogs on board: what has not been heard of for too long is not relied on."""

from __future__ import annotations

from models.kit.block import Block
from models.kit.declaration import Boolean, Input, Integer, Output, Parameter, State
from models.kit.geometry import COUNT_MAX, counted, either, every


class Watchdog(Block):
    """Watchdog: is the IMU alive, is the operator there, is it time to report."""

    source = "ours: the text has no word of what fails (2.3, 2.4 have the links)"
    precisions = ("double", "float")

    sampled = Input(Boolean, "the IMU's sample came on this tick", start=0)
    heard = Input(Boolean, "a message of the operator's came on this tick", start=0)
    valid = Input(Boolean, "the estimator relies on its last fix", start=0)

    imu_ok = Output(Boolean, "samples come")
    link_ok = Output(Boolean, "the operator is heard")
    estimate_ok = Output(Boolean, "the estimate may be trusted")
    report = Output(Boolean, "telemetry is due on this tick")

    imu_timeout = Parameter("s", "longest silence of the IMU", start=0.2, min=0.04, max=1e4)
    link_timeout = Parameter("s", "longest silence of the operator, who is heard", start=2, min=0.04, max=1e4)
    report_period = Parameter("s", "time between reports (telemetry)", start=0.2, min=0.04, max=10)

    imu_age = State(Integer, "ticks since the last sample", start=COUNT_MAX, max=COUNT_MAX)
    link_age = State(Integer, "ticks since the last message", start=COUNT_MAX, max=COUNT_MAX)
    report_age = State(Integer, "ticks since the last report", start=COUNT_MAX, max=COUNT_MAX)

    def watch(m) -> None:
        """Ages in whole ticks; a tenth of a tick's tolerance keeps them the same in float32."""
        tolerance = 0.1 * m.sample_time
        m.imu_age = either(m.sampled, 0, counted(m.imu_age))
        m.link_age = either(m.heard, 0, counted(m.link_age))
        m.imu_ok = m.imu_age * m.sample_time < m.imu_timeout + tolerance
        m.link_ok = m.link_age * m.sample_time < m.link_timeout + tolerance
        m.estimate_ok = every(m.valid, m.imu_ok)
        m.report_age = counted(m.report_age)
        m.report = m.report_age * m.sample_time > m.report_period - tolerance
        m.report_age = either(m.report, 0, m.report_age)
