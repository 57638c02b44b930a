"""The bounded model checker CBMC, unpacked from Debian's packages as SDCC is.

python -m codegen.toolchains.cbmc                fetches it, once
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.toolchains.debian import ToolchainError, folder_of, unpack
from models.errors import CanineError

NAME = "cbmc-6.6.0"
PACKAGES = ("cbmc", "minisat")


class CbmcError(CanineError):
    """CBMC does not answer in time, or refuses the C."""


@dataclass(frozen=True)
class Answer:
    """CBMC's answer.

    Attributes:
        checks: number of properties checked.
        failed: those that do not hold: line and property.
    """

    checks: int
    failed: tuple[str, ...]


def program() -> Path:
    """CBMC's program, fetched if need be; else one that the PATH has.

    Raises:
        ToolchainError: there is none, and it cannot be fetched; the message says how it is had.
    """
    path = folder_of(NAME) / "bin" / "cbmc"
    if path.is_file():
        return path
    try:
        return unpack(NAME, PACKAGES, ("bin/cbmc",)) / "bin" / "cbmc"
    except ToolchainError as reason:
        installed = shutil.which("cbmc")
        if installed is None:
            raise ToolchainError(
                f"the proofs need CBMC 6, and it is missing: {reason}. On Debian 13: apt install cbmc; "
                f"elsewhere: https://diffblue.github.io/cbmc, or with Debian's tools and a network: "
                f"{Path(sys.executable)} -m codegen.toolchains.cbmc"
            ) from None
        return Path(installed)


def check(
    sources: Sequence[str],
    function: str,
    folder: Path,
    *,
    unwind: int,
    checks: Sequence[str] = (),
    timeout: float = 60.0,
) -> Answer:
    """Check all code that a function reaches, for all values of variables that it leaves open.

    Args:
        sources: C files, relative to the folder.
        unwind: how often loops are followed; that they end by then is checked too.
        checks: beside CBMC's own (bounds, pointers, signed overflow, division by zero, shifts).

    Raises:
        CbmcError: no answer in time (s), or the sources are refused.
    """
    command = [
        str(program()), *sources, "-I.", "--function", function, "--unwind", str(unwind), *checks,
        "--slice-formula", "--no-malloc-may-fail",
    ]  # fmt: skip
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=timeout, check=False
        )
    except subprocess.TimeoutExpired:
        raise CbmcError(f"{function}: no answer after {timeout:g} s") from None
    counted = re.search(r"^\*\* (\d+) of (\d+) failed", done.stdout, re.MULTILINE)
    if done.returncode not in (0, 10) or counted is None:
        raise CbmcError(f"{function}: CBMC says\n{(done.stdout + done.stderr)[-2000:]}")
    failed = re.findall(r"^\[.*\] (line .*): FAILURE$", done.stdout, re.MULTILINE)
    return Answer(int(counted[2]), tuple(failed))


if __name__ == "__main__":
    print(program())
