"""How good the link is: what was lost, late, damaged or forged, and how long an answer takes."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

from codegen.firmware.telemetry import Telemetry
from harness.onboard.radio import Link

LATE_S = 0.3  # s that a telemetry may come later than the vest's clock says
REMEMBERED = 64  # frames whose answer is waited for


@dataclass(frozen=True)
class LinkQuality:
    """Counts since the station began; of both ends where the vest tells its own.

    Attributes:
        lost: telemetry that never came.
        late: telemetry that came more than LATE_S after its time.
        errors: frames with a wrong checksum.
        forged: frames with a wrong tag.
        replayed: frames that came before, or too late.
        unanswered: telemetry that did not know this station.
        sessions: of the vest: each reset begins one.
        round_trip_s: s from a frame to the telemetry that answers it; None before the first.
        age_s: s since the last telemetry; None before the first.
    """

    lost: int
    late: int
    errors: int
    forged: int
    replayed: int
    unanswered: int
    sessions: int
    round_trip_s: float | None
    age_s: float | None


class Quality:
    """Follows the frames of a link."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._sent: OrderedDict[int, float] = OrderedDict()  # when, by counter
        self._last: Telemetry | None = None
        self._heard = 0.0  # s, when the last telemetry came
        self._late = 0
        self._round_trip: float | None = None

    def send(self, now: float) -> None:
        """The link's last frame is on its way."""
        self._sent[self._link.counter] = now
        if len(self._sent) > REMEMBERED:
            self._sent.popitem(last=False)

    def receive(self, now: float, telemetry: Telemetry) -> None:
        """A telemetry has come."""
        before = self._last
        if before and before.session == telemetry.session:
            vest = (telemetry.time_ms - before.time_ms) / 1000
            self._late += now - self._heard > vest + LATE_S
            if telemetry.received != before.received and telemetry.received in self._sent:
                self._round_trip = now - self._sent[telemetry.received]
        else:
            self._sent.clear()  # counters begin anew
        self._last, self._heard = telemetry, now

    def age(self, now: float) -> float | None:
        """s since the last telemetry; None before the first."""
        return now - self._heard if self._last else None

    def at(self, now: float) -> LinkQuality:
        """The counts so far."""
        link, last = self._link, self._last
        return LinkQuality(
            lost=link.lost,
            late=self._late,
            errors=link.decoder.errors + (last.link_errors if last else 0),
            forged=link.decoder.forged + (last.link_forged if last else 0),
            replayed=link.replayed + (last.link_replayed if last else 0),
            unanswered=link.unanswered,
            sessions=link.sessions,
            round_trip_s=self._round_trip,
            age_s=self.age(now),
        )
