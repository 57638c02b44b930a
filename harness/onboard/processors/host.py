"""This machine's own processor: the onboard program as a shared library."""

from __future__ import annotations

import _ctypes
import ctypes
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from codegen.firmware.bundle import recorded
from codegen.firmware.image import Image, host_image, with_key
from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.targets import Target
from codegen.scratch import Scratch
from codegen.toolchains.library import LoadError, load_library
from harness.onboard.processors.processor import MAX_BYTES, SOURCES, Mailbox, ProcessorError, Received, Reply


class Host:
    """The program in this process. Each instance loads a copy of the library, whose state is static."""

    def __init__(self, image: Image, navigation: Navigation = DEFAULT) -> None:
        self.image = image
        self._scratch = Scratch()
        try:
            copy = shutil.copy(image.path, self._scratch.path / image.path.name)
            self._library = load_library(Path(copy), "host: the onboard program")
        except OSError as reason:
            self._scratch.close()
            raise ProcessorError(f"host: the onboard program cannot be copied: {reason}") from None
        except LoadError:
            self._scratch.close()
            raise
        self._received = self._variable("pil_received", ctypes.c_uint8 * MAX_BYTES * len(SOURCES))
        self._counts = self._variable("pil_counts", ctypes.c_uint16 * len(SOURCES))
        self._sent = self._variable("pil_sent", ctypes.c_uint8 * MAX_BYTES)
        self._sent_count = self._variable("pil_sent_count", ctypes.c_uint16)
        self._tone = self._variable("pil_tone_hz", ctypes.c_uint16)
        self._left = self._variable("pil_vibrate_left", ctypes.c_uint8)
        self._right = self._variable("pil_vibrate_right", ctypes.c_uint8)
        self._record = self._variable("pil_recorded", ctypes.c_uint32 * len(recorded(navigation)))
        self._session = self._variable("pil_session", ctypes.c_uint32)
        self.reset(self._session.value)

    def reset(self, session: int) -> None:
        """As `Resettable.reset`."""
        self.mailbox = Mailbox()
        ctypes.memset(self._counts, 0, ctypes.sizeof(self._counts))
        self._session.value = session
        self._library.pil_start()
        self.start = bytes(self._record)

    def _variable(self, name: str, kind: Any) -> Any:
        return kind.in_dll(self._library, name)

    def tick(self, received: Received) -> Reply:
        """One tick of the program."""
        for i, data in enumerate(self.mailbox.put(received, self._counts)):
            ctypes.memmove(self._received[i], data, len(data))
            self._counts[i] = len(data)
        self._library.pil_tick()
        return Reply(
            bytes(self._record),
            bytes(self._sent[: self._sent_count.value]),
            self._tone.value,
            bool(self._left.value),
            bool(self._right.value),
        )

    def stack(self) -> int | None:
        """Unknown."""
        return None

    def close(self) -> None:
        """Unload the library."""
        _ctypes.dlclose(self._library._handle)
        self._scratch.close()


def start(
    target: Target,
    files: Mapping[str, str],
    navigation: Navigation = DEFAULT,
    key: Key = SIMULATION_KEY,
) -> Host:
    """The processor with a program of these sources, and this key in the place of the simulation's."""
    with Scratch() as folder:
        return Host(with_key(host_image(target, files), key, folder), navigation)
