"""The operator's laptop: it repeats messages until the telemetry shows their effect."""

from __future__ import annotations

import math

from codegen.firmware.telemetry import Flag, Telemetry
from harness.onboard.radio import Abort, Heartbeat, Link, Message, Mission, Override, Start
from models.commands import Command

RESEND = 0.4  # s between the operator's messages; two may get lost before an override or the link is over


class Operator:
    """Keeps the vest in the state that the operator wishes, by its telemetry.

    It stands for an operator who presses START until the trial begins, and no more afterwards: a trial that
    has ended, or a vest that was reset, needs a new wish. An override is renewed while it is wished.

    Nothing is sent before the vest is heard, and only a heartbeat until it answers. The mission is given once
    in each session at least: another that the vest holds may have the same id, of 16 bits (rule 9).

    Args:
        mission: home and waypoints.
        link: to the vest.
    """

    def __init__(self, mission: Mission, link: Link) -> None:
        self.mission, self.link = mission, link
        self._telemetry: Telemetry | None = None  # of this session
        self._sessions = 0
        self._silent_since = -math.inf
        self._wish: tuple[bool, Command] | None = None
        self._given: int | None = None  # counter of the first MISSION of this session
        self._asked: int | None = None  # counter of the first START of this wish
        self._begun = False  # the trial of this wish has begun

    def send(self, time: float, start: bool, override: Command, link_ok: bool) -> bytes:
        """The frames that the laptop sends on a tick.

        Args:
            time: s.
            start: the trial is to be on.
            override: the operator's own command.
            link_ok: false while the radio is out of reach: then nothing passes either way.
        """
        if not link_ok or not self.link.open:
            return b""
        wish = (start, override)
        if wish == self._wish and time < self._silent_since + RESEND - 1e-6:
            return b""
        messages: list[Message] = []
        flags = Flag(self._telemetry.flags) if self._telemetry else Flag(0)
        started = Flag.STARTED in flags
        if self._telemetry is None:
            messages.append(Heartbeat(self.link.nonce))
        elif not self._is_held(self._telemetry):
            messages.append(self.mission)
        if start and self._telemetry and not self._has_begun(started):
            messages.append(Start(self.mission.id))
        if not start:
            self._asked, self._begun = None, False
            if started or wish != self._wish:
                messages.append(Abort())
        messages.append(Override(override))  # always, since an earlier one may be lost
        self._wish, self._silent_since = wish, time
        return b"".join(self._frame(message) for message in messages)

    def _is_held(self, telemetry: Telemetry) -> bool:
        """Does the vest hold the mission, and has it heard this laptop since that was given?"""
        heard = self._given is not None and telemetry.received >= self._given
        return heard and telemetry.mission_id == self.mission.id

    def _has_begun(self, started: bool) -> bool:
        """Has the vest, having heard a START of this wish, begun? Telemetry from before it tells nothing."""
        if started and self._asked and self._telemetry:
            self._begun = self._begun or self._telemetry.received >= self._asked
        return self._begun

    def _frame(self, message: Message) -> bytes:
        frame = self.link.encode(message)
        if isinstance(message, Mission):
            self._given = self._given or self.link.counter
        if isinstance(message, Start):
            self._asked = self._asked or self.link.counter
        return frame

    def receive(self, data: bytes) -> Telemetry | None:
        """The last telemetry in the bytes that can be believed, if there is any."""
        believed = self.link.receive(data)
        if self.link.sessions != self._sessions:
            self._sessions, self._telemetry = self.link.sessions, None
            self._given = self._asked = None
            self._silent_since = -math.inf  # it is greeted at once
        if not believed:
            return None
        if self._telemetry is None:
            self._silent_since = -math.inf
        self._telemetry = believed[-1]
        return self._telemetry
