"""C to machine code for the Rabbit 4000: SDCC 4.5 and its simulator, unpacked from Debian 13's packages.

Only this release counts the Rabbit's clocks; 4.2 (Debian 12) does not.

    python -m codegen.toolchains.sdcc                fetches them, once
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from codegen.toolchains.compiler import CompileError
from codegen.toolchains.debian import ToolchainError, folder_of, unpack
from models.errors import CanineError

VERSION = "4.5.0"
NAME = f"sdcc-{VERSION}"
PACKAGES = ("sdcc", "sdcc-libraries", "sdcc-ucsim")
PROGRAMS = (
    *(f"bin/{name}" for name in ("sdcc", "sdcpp", "sdasrab", "sdld", "sdar", "ucsim_rxk")),
    "libexec/sdcc/*/*/cc1",  # the preprocessor
)
LANGUAGE = ("-mr3ka", "--std=c99", "--Werror", "--nostdinc", "--nostdlib")
COMPILING = 600.0  # s


def home() -> Path:
    """The folder with bin/sdcc, bin/ucsim_rxk and share/sdcc.

    Raises:
        ToolchainError: it has not been fetched; the message says how.
    """
    folder = folder_of(NAME)
    if not (folder / "bin" / "sdcc").is_file():
        raise ToolchainError(
            f"the Rabbit 4000 needs SDCC {VERSION} with its simulator, and {folder.parent} has none; "
            f"on Debian: {Path(sys.executable)} -m codegen.toolchains.sdcc"
        )
    return folder


def fetch() -> Path:
    """Fetch and unpack SDCC, unless it is there; its `home`.

    Raises:
        ToolchainError: it cannot be fetched.
    """
    try:
        return home()
    except ToolchainError:
        return unpack(NAME, PACKAGES, PROGRAMS)


def sdcc(arguments: Sequence[str], what: str, folder: Path) -> str:
    """Run the compiler in a folder and return what it printed.

    Raises:
        CompileError: with the compiler's own words; warnings are errors too.
    """
    include = home() / "share" / "sdcc" / "include"
    return _run("sdcc", [*LANGUAGE, f"-I{include}", f"-I{include}/rab", *arguments], what, folder)


def assemble(arguments: Sequence[str], what: str, folder: Path) -> None:
    """Run the assembler in a folder.

    Raises:
        CompileError: with the assembler's own words, if it has any.
    """
    if messages := _run("sdasrab", arguments, what, folder):
        raise CompileError(f"{what}: sdasrab of SDCC {VERSION} refuses it:\n{messages}")


def _run(program: str, arguments: Sequence[str], what: str, folder: Path) -> str:
    programs = home() / "bin"
    environment = os.environ | {"PATH": f"{programs}:{os.environ.get('PATH', '')}"}
    try:
        done = subprocess.run(
            [str(programs / program), *arguments],
            cwd=folder, env=environment, capture_output=True, text=True, timeout=COMPILING, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise CompileError(
            f"{what}: {program} of SDCC {VERSION} had no answer after {COMPILING:g} s"
        ) from None
    messages = (done.stderr + done.stdout).strip()
    if done.returncode != 0 or "warning" in messages.lower():
        messages = messages or f"exit status {done.returncode}"
        raise CompileError(f"{what}: {program} of SDCC {VERSION} refuses it:\n{messages}")
    return messages


def main() -> int:
    """Fetch SDCC and print its folder; the exit status."""
    try:
        folder = fetch()
    except CanineError as wrong:
        print(wrong, file=sys.stderr)
        return 1
    print(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
