"""The `canine` command as a user calls it, within this process."""

from __future__ import annotations

import sys

import pytest

from harness import main


def canine(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Exit status, standard output and error of the command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["canine", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            main.main()
    said = capsys.readouterr()
    return int(caught.value.code or 0), said.out, said.err
