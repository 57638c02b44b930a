"""The computer on board in the loop, whose operator is whoever speaks at the radio's port."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping, Sequence

from codegen.firmware.navigation import Navigation
from codegen.firmware.telemetry import Telemetry
from harness.onboard.garbage import Garbage
from harness.onboard.memory import Memory
from harness.onboard.processors import Resettable
from harness.onboard.radio import LAST, Decoder
from harness.onboard.stand_in import Instrumented, is_in_reach
from harness.vest.port import Port
from models.kit.link import Values

BYTES = 230  # that the radio brings on a tick, at most: 40 ms at 57600 baud
ROOM = 4096  # bytes that wait for that: a modem's buffer

SOUNDS = ("tone_hz", "vibrate_left", "vibrate_right")  # the outputs of the command module


class Worn(Instrumented):
    """A processor with its instruments and the vest's end of the radio.

    Args:
        processor: is reset before the first tick, into a session that nobody can foresee.
        radio: the vest's end.
        before: called before each tick with its time; it waits until that has come.

    Attributes:
        resets: since it was opened.
        dropped: bytes that the radio did not bring, since they came faster than it carries.
    """

    def __init__(
        self,
        processor: Resettable,
        origin: tuple[float, float],
        values: Values,
        *,
        radio: Port,
        before: Callable[[float], None],
        pvt: bool,
        navigation: Navigation,
        garbage: Sequence[Garbage] = (),
    ) -> None:
        super().__init__(processor, origin, values, pvt=pvt, navigation=navigation, garbage=garbage)
        self._resettable, self._radio, self._before = processor, radio, before
        self._decoder = Decoder(None)
        self._coming = b""
        self.resets = self.dropped = 0
        self._restart()
        import pyubx2  # noqa: F401, PLC0415 - 0.3 s, which the first fix has no time for

    def reset(self) -> None:
        """Reset the processor: its program begins anew, in another session."""
        self.resets += 1
        self._restart()

    def _restart(self) -> None:
        self._resettable.reset(secrets.randbelow(LAST + 1))
        self.memory = Memory(self.processor.start, self.navigation)
        self._shift = None
        self._coming = b""

    def output(self, component: str, name: str) -> float:
        """As `Instrumented.output`; what the command module does is heard."""
        if component == "command_module":
            return float(self.played[SOUNDS.index(name)])
        return super().output(component, name)

    def make_tick(self, time: float) -> None:
        """One tick of the loop, when its time has come."""
        self._before(time)
        super().make_tick(time)

    def _hear(self, time: float, wishes: Mapping[str, float]) -> bytes:
        sent = self._radio.read()
        if not is_in_reach(wishes):
            self._coming = b""
            return b""
        waiting = self._coming + sent
        brought, self._coming = waiting[:BYTES], waiting[BYTES : BYTES + ROOM]
        self.dropped += max(0, len(waiting) - BYTES - ROOM)
        return brought

    def _tell(self, sent: bytes, wishes: Mapping[str, float]) -> Telemetry | None:
        if not is_in_reach(wishes):
            return None
        if sent:
            self._radio.write(sent)
        telemetry = self._decoder.receive(sent)
        return telemetry[-1][1] if telemetry else None
