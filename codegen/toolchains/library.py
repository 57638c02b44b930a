"""Shared libraries: loaded into this process, or why they cannot be."""

from __future__ import annotations

import ctypes
import os
import platform
import re
import sys
from pathlib import Path

from codegen.toolchains.compiler import CompileError

MACHINES = {
    3: "x86",
    8: "mips",
    20: "ppc",
    21: "ppc64",
    40: "arm",
    62: "x86_64",
    183: "aarch64",
    243: "riscv",
}
MACH_O = {bytes.fromhex(magic) for magic in ("feedface", "feedfacf", "cefaedfe", "cffaedfe", "cafebabe")}
OTHER = re.compile(r"(?P<name>[^\s/:]+): cannot open shared object file")  # a library that this one needs


class LoadError(CompileError):
    """A library cannot be loaded."""


def load_library(path: Path, what: str) -> ctypes.CDLL:
    """Load a library.

    Args:
        what: its name in the message.

    Raises:
        LoadError: it cannot be loaded.
    """
    try:
        return ctypes.CDLL(str(path))
    except OSError as reason:
        raise LoadError(f"{what}: cannot be loaded: {why_not_loaded(path, reason)}") from None


def why_not_loaded(path: Path, reason: object) -> str:
    """Why the system does not load a library, and what to do; `reason` is what it says itself."""
    here = platform.machine()
    kind = _kind(path)
    if kind != ("a macOS library" if sys.platform == "darwin" else f"an ELF library for {_family(here)}"):
        return f"{path.name} is {kind}, this machine is {here} ({sys.platform}); export it for this machine"
    if sys.platform == "linux" and os.statvfs(path).f_flag & os.ST_NOEXEC:
        return (
            f"{path.name} is unpacked below a folder that is mounted noexec, from where no program runs: "
            f"{_mount(path)}; set TMPDIR to a folder elsewhere (and XDG_CACHE_HOME, if the cache lies there)"
        )
    text = " ".join(str(reason).split())
    if (other := OTHER.search(text)) and other["name"] != path.name:
        return (
            f"{path.name} needs {other['name']}, which this machine lacks; install it, or export without it"
        )
    return text.replace(f"{path.parent}{os.sep}", "")


def _family(machine: str) -> str:
    """A machine's name in MACHINES, from the system's own: `armv7l` is `arm`, `i686` is `x86`."""
    if re.fullmatch("i[3-6]86", machine):
        return "x86"
    names = sorted(MACHINES.values(), key=len, reverse=True)  # ppc64 before ppc
    return next((name for name in names if machine.startswith(name)), machine)


def _mount(path: Path) -> Path:
    return next((p for p in path.resolve().parents if p.is_mount()), path.parent)


def _kind(path: Path) -> str:
    """What the first bytes of a file say that it is."""
    with path.open("rb") as file:
        head = file.read(20)
    if head[:4] == b"\x7fELF" and len(head) == 20:
        number = int.from_bytes(head[18:20], "big" if head[5] == 2 else "little")
        return f"an ELF library for {MACHINES.get(number, f'the processor number {number}')}"
    if head[:2] == b"MZ":
        return "a Windows library"
    return "a macOS library" if head[:4] in MACH_O else "no library, or a damaged one"
