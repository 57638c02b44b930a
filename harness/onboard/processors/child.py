"""Processes of ours that outlive nobody."""

from __future__ import annotations

import shutil
from collections.abc import Sequence


def tied(command: Sequence[str]) -> list[str]:
    """The command as a process that Linux kills with the thread that started it, if util-linux is there."""
    guard = shutil.which("setpriv")
    return [guard, "--pdeathsig", "KILL", *command] if guard else [*command]
