"""Conduct: what operators order becomes frames, what the vest tells becomes a state.

It is stepped with the time and with events, and knows no socket and no clock. Three rules hold in it:

- **The station speaks only while a commander lives.** A heartbeat of its own would keep a vest going that
  nobody watches. Without a commander it greets a new session at most once in GREETING_S, which is longer
  than the vest waits for its operator; it lets go of what was held. It aborts a trial that a latched STOP
  holds, which the vest would end anyway once it misses the station.
- **STOP latches.** It is sent at once, and again until it is cleared, whoever ordered it.
- **Nothing resumes.** A reset of the vest, or a START that was refused or not answered, needs a new order.

Frames are repeated by the vest's clock or by ours, whichever is faster, so that a vest that is simulated at
many times real time hears them as often.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Generic, TypeVar

from codegen.firmware.telemetry import NOT_READY, Flag, Ready, Refusal, Telemetry
from harness.onboard.radio import Abort, Heartbeat, Link, Message, Mission, Override, RadioError, Start
from harness.station.desk import Desk, OrderError
from harness.station.draft import Draft, MissionFileError, from_json
from harness.station.events import Level, Told, changes
from harness.station.quality import Quality
from models.commands import Command
from models.errors import printable
from models.modes import ENDED

RESEND_S = 0.4  # s of ours between two frames
RESEND_MS = 350  # of the vest between two frames: each second telemetry
HOLD_S = 0.3  # s after which a hold that is not renewed is let go
SILENT_S = 2.0  # s without telemetry after which the vest counts as lost, as the vest does with us
ANSWER_S = 3.0  # s within which START is to be answered
UPLOAD_S = 5.0  # s within which a mission is to be acknowledged
RELEASE_S = 1.0  # s for which what was held is let go while nobody commands; then it has ended by itself
GREETING_S = 3.0  # s between greetings while nobody commands; longer than watchdog.link_timeout
MOST_UNANSWERED = 10  # telemetry that does not know this station yet: two seconds of it
RELEASE = Override(Command.NONE)
HELD = (Command.FORWARD, Command.LEFT, Command.RIGHT, Command.RECALL)
OF_ANYBODY = ("alive", "take", "stop", "note")  # orders of those, too, who do not command
NOTE_CHARS = 500
OF_MISSION = Ready.REACH | Ready.LEGS | Ready.FIRST_LEG | Ready.PLANNED | Ready.FENCE | Ready.INSIDE


class LinkState(StrEnum):
    """How far the vest is from a trial."""

    DISCONNECTED = "disconnected"
    CONNECTED = "connected"
    LOADED = "loaded"
    READY = "ready"
    RUNNING = "running"


M_co = TypeVar("M_co", bound=Message, covariant=True)


@dataclass
class _Wish(Generic[M_co]):
    """A message that is sent again until the vest shows its effect.

    Attributes:
        since: s, of the order.
        counters: of the frames that carried it in this session.
    """

    since: float
    message: M_co
    counters: list[int] = field(default_factory=list)

    def is_heard(self, telemetry: Telemetry) -> bool:
        """Has the vest accepted a frame that is no older than the first that carried it?"""
        return bool(self.counters) and telemetry.received >= self.counters[0]


class Conduct:
    """The operator's side of a trial.

    Attributes:
        desk: who commands.
        quality: of the link.
        draft: the mission on screen.
        telemetry: the last of this session that can be believed; None before it.
        latched: STOP holds until it is cleared.
        holding: the command of the operator that is held; None for none.
    """

    def __init__(self, link: Link) -> None:
        self.link, self.desk, self.quality = link, Desk(), Quality(link)
        self.draft = Draft()
        self.telemetry: Telemetry | None = None
        self.latched = False
        self.holding: Command | None = None
        self._events: list[Told] = []
        self._held_at = 0.0
        self._sessions = 0
        self._given: Mission | None = None  # and acknowledged, in this session
        self._upload: _Wish[Mission] | None = None
        self._start: _Wish[Start] | None = None
        self._abort: _Wish[Abort] | None = None
        self._release: _Wish[Override] | None = None
        self._urgent = False
        self._sent_at, self._sent_ms = -math.inf, 0  # of the last frame: ours, and the vest's clock
        self._greeted_at = -math.inf
        self._was_silent = True
        self._commanded = False

    # what operators order ---------------------------------------------------------------------------------

    def order(self, now: float, operator: int, order: dict[str, Any]) -> None:
        """Carry out an order, as a browser sends it: `{"do": ..., ...}`.

        Raises:
            OrderError: there is no such order, it lacks something, or it cannot be carried out now.
        """
        name = order.get("do")
        if not isinstance(name, str) or name not in _ORDERS:
            raise OrderError(f"do is {printable(repr(name)):.80}; expected one of {', '.join(_ORDERS)}")
        if name not in OF_ANYBODY:
            self.desk.require(operator, name)
        self.desk.hear(operator, now)
        _ORDERS[name](self, now, operator, order)

    def _alive(self, now: float, operator: int, order: dict[str, Any]) -> None:
        """The desk has heard it."""

    def _take(self, now: float, operator: int, order: dict[str, Any]) -> None:
        before = self.desk.commander
        self.desk.take(operator, now)
        if operator != before:
            self._let_go(now)
            self._tell(Level.ADVISORY, f"operator {operator} commands")
        self._urgent = True

    def _hand_over(self, now: float, operator: int, order: dict[str, Any]) -> None:
        self.desk.hand_over(operator)
        self._let_go(now)
        self._tell(Level.ADVISORY, f"operator {operator} hands over: who takes the command has it")

    def _draft(self, now: float, operator: int, order: dict[str, Any]) -> None:
        try:
            self.draft = from_json(order.get("mission"))
        except MissionFileError as reason:
            raise OrderError(f"draft: {reason}") from None

    def _ask_upload(self, now: float, operator: int, order: dict[str, Any]) -> None:
        mission = self.draft.mission
        if isinstance(mission, str):
            raise OrderError(f"upload: {mission}")
        self._require_heard(now, "upload")
        if self._has(Flag.STARTED):
            raise OrderError(
                "upload: a mission is under way, or has ended, and the vest takes no other; ABORT first"
            )
        self._upload, self._given = _Wish(now, mission), None
        self._urgent = True

    def _ask_start(self, now: float, operator: int, order: dict[str, Any]) -> None:
        missing = self.missing(now)
        if missing or self._given is None:
            words = "; ".join(reason["words"] for reason in missing)
            raise OrderError(f"start: not ready: {words}")
        self._start, self._urgent = _Wish(now, Start(self._given.id)), True

    def _stop(self, now: float, operator: int, order: dict[str, Any]) -> None:
        if not self.latched:
            self._tell(Level.CAUTION, f"STOP by operator {operator}: it holds until it is cleared")
        self.latched, self.holding, self._start, self._release = True, None, None, None
        self._urgent = True

    def _clear_stop(self, now: float, operator: int, order: dict[str, Any]) -> None:
        if self.latched:
            self.latched = False
            self._release, self._urgent = _Wish(now, RELEASE), True
            self._tell(Level.ADVISORY, f"STOP is cleared by operator {operator}")

    def _ask_abort(self, now: float, operator: int, order: dict[str, Any]) -> None:
        self._begin_abort(now)
        self._tell(Level.CAUTION, f"ABORT by operator {operator}")

    def _begin_abort(self, now: float) -> None:
        self._abort = self._abort or _Wish(now, Abort())
        self.holding = self._start = self._upload = self._release = None
        self._urgent = True

    def _hold(self, now: float, operator: int, order: dict[str, Any]) -> None:
        name = order.get("command")
        commands = {command.name: command for command in HELD}
        if not isinstance(name, str) or name not in commands:
            raise OrderError(
                f"hold: command is {printable(repr(name)):.80}; expected one of {', '.join(commands)}"
            )
        if self.latched:
            raise OrderError(f"hold: STOP is latched, and beats {name}; clear it first")
        self._require_heard(now, "hold")
        if self.holding is not commands[name]:
            self._tell(Level.ADVISORY, f"{name} is held by operator {operator}")
            self._urgent = True
        self.holding, self._held_at, self._start, self._release = commands[name], now, None, None

    def _let_go(self, now: float) -> None:
        if self.holding is not None:
            self._tell(Level.ADVISORY, f"{self.holding.name} is let go")
            self.holding, self._release, self._urgent = None, _Wish(now, RELEASE), True

    def _drop(self, now: float, operator: int, order: dict[str, Any]) -> None:
        self._let_go(now)

    def _note(self, now: float, operator: int, order: dict[str, Any]) -> None:
        text = order.get("text")
        if not isinstance(text, str) or not text.strip() or len(text) > NOTE_CHARS:
            raise OrderError(f"note: expected a text of 1 to {NOTE_CHARS} characters")
        self._tell(Level.ADVISORY, f"note of operator {operator}: {printable(text.strip())}")

    def leave(self, now: float, operator: int) -> None:
        """An operator's socket is gone."""
        if operator == self.desk.commander:
            self._let_go(now)
            self._tell(Level.CAUTION, f"operator {operator}, who commanded, is gone")
        self.desk.leave(operator)

    # what the vest tells ----------------------------------------------------------------------------------

    def receive(self, now: float, data: bytes) -> list[Telemetry]:
        """The telemetry in these bytes that can be believed, in order."""
        believed = self.link.receive(data)
        if self.link.sessions != self._sessions:
            self._begin_session()
        for telemetry in believed:
            self._hear(now, telemetry)
        return believed

    def _begin_session(self) -> None:
        if self._sessions:
            was = "the mission under way is over; " if self.is_under_way else ""
            self._tell(Level.WARNING if was else Level.CAUTION, f"the vest has begun anew: {was}upload again")
        self._sessions = self.link.sessions
        self.telemetry = self._given = self.holding = None
        self._upload = self._start = self._release = None
        if self._abort:  # it stays: who plays an old session must not make us forget it
            self._abort.counters.clear()
        self._urgent = self._was_silent = True  # it is greeted at once
        self._greeted_at = -math.inf if self._sessions == 1 else self._greeted_at

    def _hear(self, now: float, telemetry: Telemetry) -> None:
        before = self.telemetry
        for told in changes(before, telemetry):
            self._tell(*told)
        if self._was_silent:
            self._tell(Level.ADVISORY, "the vest is heard")
        self.telemetry, self._was_silent = telemetry, False
        self.quality.receive(now, telemetry)
        if before is None:
            self._urgent = True
        self._answer_upload(telemetry)
        self._answer_start(telemetry)
        if self._abort and self._abort.is_heard(telemetry) and not self._has(Flag.STARTED):
            self._abort = None
        if self._release and self._release.is_heard(telemetry) and Ready.RELEASED in Ready(telemetry.ready):
            self._release = None

    def _answer_upload(self, telemetry: Telemetry) -> None:
        upload = self._upload
        if upload and upload.is_heard(telemetry):
            if telemetry.mission_id == upload.message.id and self._has(Flag.LOADED):
                self._given, self._upload = upload.message, None
                self._tell(Level.ADVISORY, f"mission {telemetry.mission_id:04x} is on board")
        elif self._given and telemetry.mission_id != self._given.id:
            self._tell(
                Level.WARNING,
                f"the vest holds mission {telemetry.mission_id:04x}, expected {self._given.id:04x}: "
                "another station gave it",
            )
            self._given = None

    def _answer_start(self, telemetry: Telemetry) -> None:
        if self._start is None:
            return
        if self._has(Flag.STARTED):
            self._start = None
        elif telemetry.received in self._start.counters and telemetry.refused:
            self._start = None
            self._tell(Level.CAUTION, f"START was refused: {telemetry.refused.words}")

    # what is sent -----------------------------------------------------------------------------------------

    def step(self, now: float) -> bytes:
        """The frames to send now; none most of the time."""
        lives = self.desk.lives(now)
        self._watch(now, lives)
        if not self.link.open or not self._is_due(now):
            return b""
        self._urgent = False
        wishes, frames = self._wishes(now, lives), b""
        try:
            frames = b"".join(self._frame(now, wish) for wish in wishes)
        except RadioError as reason:
            self._tell(Level.WARNING, str(reason))
            self._upload = self._start = None
        if wishes:
            self._sent_at = now
            self._sent_ms = self.telemetry.time_ms if self.telemetry else 0
        return frames

    def _watch(self, now: float, lives: bool) -> None:
        """What ends with time alone."""
        if self.holding is not None and (not lives or now - self._held_at > HOLD_S):
            self._let_go(now)
        if self._commanded and not lives and self.desk.commander is not None:
            self._tell(
                Level.WARNING,
                f"operator {self.desk.commander}, who commands, is silent: the heartbeat to the vest ends",
            )
        self._commanded = lives
        if not lives:
            self._upload = self._start = None
            if self.latched and self._abort is None and self._has(Flag.STARTED):
                self._begin_abort(now)
                self._tell(Level.WARNING, "STOP is latched and nobody commands: the mission is aborted")
        if self._upload and now - self._upload.since > UPLOAD_S:
            self._upload = None
            self._tell(Level.CAUTION, f"the mission was not acknowledged within {UPLOAD_S:g} s; upload again")
        if self._start and now - self._start.since > ANSWER_S:
            self._start = None
            self._tell(Level.CAUTION, f"START was not answered within {ANSWER_S:g} s, and is forgotten")
        if self._release and not lives and now - self._release.since > RELEASE_S:
            self._release = None
        if not self._was_silent and not self.is_heard(now):
            self._was_silent = True
            self._tell(Level.WARNING, f"the vest has not been heard for {SILENT_S:g} s")

    def _is_due(self, now: float) -> bool:
        by_vest = self.telemetry is not None and self.telemetry.time_ms - self._sent_ms >= RESEND_MS
        return self._urgent or by_vest or now - self._sent_at >= RESEND_S

    def _wishes(self, now: float, lives: bool) -> list[_Wish[Message]]:
        """What is due."""
        wishes: list[_Wish[Message]] = [self._abort] if self._abort else []
        if self.latched and lives:
            wishes.append(_Wish(now, Override(Command.STOP)))
        elif self.holding is not None:
            wishes.append(_Wish(now, Override(self.holding)))
        elif self._release:
            wishes.append(self._release)
        if self.telemetry is None:
            if lives or now - self._greeted_at >= GREETING_S:
                self._greeted_at = now
                wishes.append(_Wish(now, Heartbeat(self.link.nonce)))
        elif pending := self._upload or self._start:
            wishes.append(pending)
        if lives and not wishes:
            wishes.append(_Wish(now, Heartbeat(self.link.nonce)))
        return wishes

    def _frame(self, now: float, wish: _Wish[Message]) -> bytes:
        frame = self.link.encode(wish.message)
        self.quality.send(now)
        wish.counters.append(self.link.counter)
        return frame

    def farewell(self) -> list[bytes]:
        """ABORT, twice, since one may be lost: without any, the vest leads on until it misses this station.

        Raises:
            RadioError: no session is open.
        """
        return [self.link.encode(Abort()) for _ in range(2)]

    # how it stands ----------------------------------------------------------------------------------------

    @property
    def is_under_way(self) -> bool:
        """Was a trial on, by the last telemetry?"""
        return self._has(Flag.STARTED) and self.telemetry is not None and self.telemetry.mode not in ENDED

    def is_heard(self, now: float) -> bool:
        """Has telemetry of this session come within SILENT_S?"""
        age = self.quality.age(now)
        return self.telemetry is not None and age is not None and age <= SILENT_S

    @property
    def unheard(self) -> str:
        """Why the vest is not heard, in words, as far as what comes tells."""
        link, words = self.link, "the vest is not heard"
        if not link.open and link.decoder.forged:
            words += ": frames come that another key signed, or none; is --key the vest's?"
        elif self.telemetry is None and link.unanswered > MOST_UNANSWERED:
            words += ": it is there, and does not answer this station; is its key this one?"
        return words

    @property
    def on_board(self) -> Mission | None:
        """The mission that this station gave in this session, and that the vest holds."""
        return self._given

    def state(self, now: float) -> LinkState:
        """How far the vest is from a trial."""
        if not self.is_heard(now):
            return LinkState.DISCONNECTED
        if self.is_under_way:
            return LinkState.RUNNING
        if self._given is None:
            return LinkState.CONNECTED
        return LinkState.LOADED if self.missing(now) else LinkState.READY

    def missing(self, now: float) -> list[dict[str, str]]:
        """What a START needs and lacks: the vest's own bits, then ours, each as `bit` and `words`."""
        if self.telemetry is None or not self.is_heard(now):
            return [{"bit": "heard", "words": self.unheard}]
        own = {
            "commander": (not self.desk.lives(now), "nobody commands"),
            "holding": (self.holding is not None, "a command is held"),
            "stop_latched": (self.latched, "STOP is latched: clear it"),
            "upload": (
                self._given is None and self._has(Flag.LOADED),
                "the mission on board is not from this station: upload",
            ),
            "draft": (
                self._given is not None and self.draft_id not in (None, self._given.id),
                "the mission on screen is not the one on board: upload",
            ),
        }
        here = [{"bit": bit, "words": words} for bit, (lacks, words) in own.items() if lacks]
        return lacking(self.telemetry.ready) + here

    @property
    def draft_id(self) -> int | None:
        """The id that the mission on screen would have on board; None while it cannot be uploaded."""
        mission = self.draft.mission
        return None if isinstance(mission, str) else mission.id

    def pending(self) -> dict[str, bool]:
        """Which wishes wait for the vest."""
        return {
            "uploading": self._upload is not None,
            "starting": self._start is not None,
            "aborting": self._abort is not None,
        }

    def take_events(self) -> list[Told]:
        """The events since the last call."""
        events, self._events = self._events, []
        return events

    def _tell(self, level: Level, text: str) -> None:
        self._events.append((level, text))

    def _has(self, flag: Flag) -> bool:
        return self.telemetry is not None and flag in Flag(self.telemetry.flags)

    def _require_heard(self, now: float, order: str) -> None:
        if not self.is_heard(now):
            raise OrderError(f"{order}: the vest is not heard; is it on, in reach, its key this one?")


def lacking(ready: int) -> list[dict[str, str]]:
    """The bits of a telemetry's `ready` that are off, with words; without a mission, none that judge it."""
    bits = list(Ready)
    return [
        {"bit": str(bit.name).lower(), "words": Refusal(NOT_READY + bits.index(bit)).words}
        for bit in Ready(ready).missing
        if Ready.MISSION in Ready(ready) or bit not in OF_MISSION
    ]


_ORDERS: dict[str, Callable[[Conduct, float, int, dict[str, Any]], None]] = {
    "alive": Conduct._alive,
    "take": Conduct._take,
    "hand_over": Conduct._hand_over,
    "draft": Conduct._draft,
    "upload": Conduct._ask_upload,
    "start": Conduct._ask_start,
    "stop": Conduct._stop,
    "clear_stop": Conduct._clear_stop,
    "abort": Conduct._ask_abort,
    "hold": Conduct._hold,
    "release": Conduct._drop,
    "note": Conduct._note,
}
ORDERS = tuple(_ORDERS)
