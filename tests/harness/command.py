"""The `canine` command as a user calls it, within this process."""

from __future__ import annotations

import pytest

from harness import main


def canine(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Exit status, standard output and error of the command."""
    status = main.run([str(argument) for argument in arguments])
    printed = capsys.readouterr()
    return status, printed.out, printed.err
