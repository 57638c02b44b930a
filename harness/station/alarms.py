"""Alarms: what is wrong now, in words, by AC 25.1322's rule: warning, caution, advisory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from codegen.firmware.telemetry import Flag, Ready, Telemetry
from harness.log.events import ANOMALIES, cause_of_stop
from harness.station.conduct import Conduct
from harness.station.events import Level
from models.commands import Status
from models.modes import Anomaly

LATE_S = 0.6  # s without telemetry, of which there are five a second
SLOW_S = 1.0  # s from a frame to its answer
FEW_ISSUES = 2  # LEFT and RIGHT that are left
LITTLE_VIBRATION_DS, LITTLE_TONE_DS = 60, 200  # 0.1 s that is left
FORGED_S = 30.0  # s for which forged frames are told
BY_URGENCY = list(Level)[::-1]  # the most urgent first


@dataclass(frozen=True)
class Alarm:
    """Something that is wrong.

    Attributes:
        key: by which it is known while its words change.
        since: s.
    """

    key: str
    level: Level
    text: str
    since: float


Condition = tuple[str, Level, str]  # key, level, words


class Alarms:
    """The alarms of a conduct, and since when each is on."""

    def __init__(self) -> None:
        self._since: dict[str, float] = {}
        self._forged, self._forged_at = 0, -FORGED_S

    def at(self, now: float, conduct: Conduct, time: float) -> list[Alarm]:
        """What is wrong now, the most urgent first; `time` is that of the log, s."""
        conditions = list(_conditions(now, conduct))
        forged = conduct.quality.at(now).forged
        if forged > self._forged:
            self._forged_at = now
        self._forged = forged
        if now - self._forged_at < FORGED_S:
            conditions.append(("forged", Level.CAUTION, "somebody sends forged frames; they are not obeyed"))
        self._since = {key: self._since.get(key, time) for key, _, _ in conditions}
        alarms = [Alarm(key, level, text, self._since[key]) for key, level, text in conditions]
        return sorted(alarms, key=lambda alarm: BY_URGENCY.index(alarm.level))


def _conditions(now: float, conduct: Conduct) -> Iterator[Condition]:
    telemetry, lives = conduct.telemetry, conduct.desk.lives(now)
    running = conduct.is_under_way
    serious = Level.WARNING if running else Level.CAUTION
    if telemetry is None or not conduct.is_heard(now):
        yield ("link", serious, conduct.unheard)
    else:
        age = conduct.quality.age(now)
        if age is not None and age > LATE_S:
            yield "late", Level.CAUTION, f"no telemetry for {age:.1f} s"
        if Flag.LINK_OK not in Flag(telemetry.flags) and (lives or running):
            yield "uplink", serious, "the vest does not hear this station: it stops the animal"
        yield from _of_vest(telemetry, running, serious)
    if running and not lives:
        yield "commander", Level.WARNING, "nobody commands: the vest stops the animal"
    round_trip = conduct.quality.at(now).round_trip_s
    if round_trip is not None and round_trip > SLOW_S:
        yield "slow", Level.CAUTION, f"answers take {round_trip:.1f} s"
    if conduct.latched:
        yield "stop", Level.CAUTION, "STOP is latched"
    if conduct.holding is not None:
        yield "hold", Level.ADVISORY, f"{conduct.holding.name} is held"
    if conduct.desk.offered:
        yield "offered", Level.ADVISORY, f"operator {conduct.desk.commander} hands over the command"


def _of_vest(telemetry: Telemetry, running: bool, serious: Level) -> Iterator[Condition]:
    flags, ready = Flag(telemetry.flags), Ready(telemetry.ready)
    if telemetry.status == Status.STOPPED:
        yield "ended", Level.WARNING, f"the mission was stopped: {cause_of_stop(telemetry.last_anomaly)}"
    if telemetry.status == Status.FAILED:
        yield "ended", Level.CAUTION, f"the mission has failed: {ANOMALIES[Anomaly.TRIAL_FAILURE]}"
    if Flag.IMU_OK not in flags:
        yield "imu", serious, "the inertial unit is silent"
    elif Flag.FIXED not in flags:
        yield "fix", serious, "there has been no fix"
    elif Flag.VALID not in flags:
        yield "estimate", serious, "the estimate cannot be trusted" + ": the animal is stopped" * running
    if Ready.HEADING not in ready:
        yield "heading", serious, "courses contradict the heading"
    if Ready.AGREEMENT not in ready:
        yield "agreement", Level.CAUTION, "the last fix contradicts the estimate"
    if Flag.FIXED in flags and Ready.ACCURACY not in ready:
        yield "accuracy", Level.CAUTION, "the last fix is less accurate than the capture radius"
    if running and Ready.INSIDE not in ready:
        yield "fence", Level.WARNING, "the animal is outside the fence"
    if Ready.BATTERY not in ready:
        yield "battery", serious, f"the battery is low: {telemetry.battery / 1000:.2f} V"
    if Ready.TEMPERATURE not in ready:
        yield "temperature", Level.CAUTION, f"the pack is at {telemetry.temperature / 10:.0f} degC"
    if running:
        yield from _of_budget(telemetry)
    if Flag.INSECURE in flags:
        yield "insecure", Level.ADVISORY, "the vest was built without a key: whoever has a radio commands it"


def _of_budget(telemetry: Telemetry) -> Iterator[Condition]:
    if telemetry.issues_left <= FEW_ISSUES:
        yield "issues", Level.CAUTION, f"{telemetry.issues_left} LEFT or RIGHT are left"
    if telemetry.vibration_left <= LITTLE_VIBRATION_DS:
        yield "vibration", Level.CAUTION, f"{telemetry.vibration_left / 10:.1f} s of vibration are left"
    if telemetry.tone_left <= LITTLE_TONE_DS:
        yield "tone", Level.CAUTION, f"{telemetry.tone_left / 10:.1f} s of tones are left"
