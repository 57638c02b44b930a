"""C to machine code with one toolchain everywhere: the Clang of pip's `ziglang`.

No C compiler need be installed, every platform is built on any other, and the same sources give the same
bytes wherever they are built: the compiler is pinned by the lock file, and no path and no time gets in.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from models.errors import CanineError, UsageError, nearest


class CompileError(CanineError):
    """The compiler refuses the C, or there is no compiler for what was asked."""


class PlatformError(CompileError, UsageError):
    """A platform that binaries are not made for was asked for."""


@dataclass(frozen=True)
class Platform:
    """What a shared library can be built for."""

    target: str  # as Zig names it
    fmi2: str  # folder of FMI 2.0 binaries, which has no name of its own for ARM
    fmi3: str  # folder of FMI 3.0 binaries
    suffix: str


PLATFORMS: dict[str, Platform] = {
    "linux64": Platform("x86_64-linux-gnu.2.17", "linux64", "x86_64-linux", ".so"),
    "win64": Platform("x86_64-windows-gnu", "win64", "x86_64-windows", ".dll"),
    "darwin64": Platform("x86_64-macos", "darwin64", "x86_64-darwin", ".dylib"),
    "aarch64-linux": Platform("aarch64-linux-gnu.2.17", "linux64", "aarch64-linux", ".so"),
    "aarch64-darwin": Platform("aarch64-macos", "darwin64", "aarch64-darwin", ".dylib"),
}

# -ffp-contract=off: a fused multiply-add changes results, and only where the processor has it
NUMERICS = ("-std=c99", "-O2", "-ffp-contract=off")
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror")
FLAGS = (*NUMERICS, *WARNINGS, "-fno-sanitize=all", "-fvisibility=hidden", "-g0")  # zig sanitizes by default
TIMEOUT = 1800.0  # s; the first build for Windows compiles its C runtime: minutes on a slow machine


def compiler_version() -> str:
    """Which compiler builds: part of what decides whether a binary is up to date."""
    from importlib.metadata import version  # noqa: PLC0415 - 30 ms that reading PLATFORMS need not wait for

    return f"ziglang {version('ziglang')}"


def this_platform() -> str:
    """The name in PLATFORMS of the machine that this runs on.

    Raises:
        CompileError: it is none of them.
    """
    machine = platform.machine().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    system = {"win32": "windows"}.get(sys.platform, sys.platform)
    for name, candidate in PLATFORMS.items():
        if candidate.fmi3 == f"{machine}-{system}":
            return name
    raise CompileError(f"this machine is {machine}-{system}; binaries are made for {', '.join(PLATFORMS)}")


@cache
def processor() -> str:
    """What tells one processor from another: code built for this very one may not run on others."""
    try:
        told = Path("/proc/cpuinfo").read_text()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return "\n".join(
        sorted({x for x in told.splitlines() if x.startswith(("model name", "flags", "Features"))})
    )


def find_platform(name: str) -> Platform:
    """A platform by its name in PLATFORMS or in FMI 3.0.

    Raises:
        PlatformError: there is none.
    """
    names = {p.fmi3: p for p in PLATFORMS.values()} | PLATFORMS
    if name not in names:
        raise PlatformError(f'platform "{name}" is not known{nearest(name, names)}')
    return names[name]


def zig(arguments: Sequence[str], what: str, folder: Path | None = None) -> str:
    """Run the compiler (`zig cc ...`, `zig ar ...`) in a folder and return what it printed.

    Args:
        what: what is built, for the message if it fails.

    Raises:
        CompileError: with the compiler's own words.
    """
    cache = str(cache_folder())
    environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
    try:
        done = subprocess.run(
            [sys.executable, "-m", "ziglang", *arguments],
            cwd=folder, env=environment, capture_output=True, text=True, timeout=TIMEOUT, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise CompileError(
            f"{what}: {compiler_version()} had no answer after {TIMEOUT:g} s; expected seconds; try again"
        ) from None
    if done.returncode != 0:
        message = (done.stderr or done.stdout).strip() or f"exit status {done.returncode}"
        raise CompileError(f"{what}: {compiler_version()} refuses it:\n{message}")
    return done.stdout


def build_library(
    folder: Path,
    sources: Sequence[str],
    output: Path,
    *,
    what: str,
    target: str = "",
    flags: Sequence[str] = FLAGS,
) -> Path:
    """Compile C into a shared library without symbols but those it exports; the same sources, the same bytes.

    Args:
        folder: where the sources (named relative to it) and their headers lie.
        output: the library, written whole or not at all.
        what: what is built, for the message if it fails: the block's name.
        target: one of PLATFORMS or any target of Zig; this machine's by default.
        flags: of the compiler; `FLAGS` by default.

    Raises:
        CompileError: with the compiler's own words.
    """
    target = target or this_platform()
    target = PLATFORMS[target].target if target in PLATFORMS else target
    folder = folder.resolve()
    output.parent.mkdir(parents=True, exist_ok=True)
    # a folder of its own, since the linker leaves .pdb and .lib beside what it makes for Windows
    with tempfile.TemporaryDirectory(dir=output.parent, prefix=".link-") as scratch:
        library = Path(scratch).resolve() / output.name
        arguments = ["cc", "-target", target, "-shared", "-fPIC", *flags, f"-ffile-prefix-map={folder}=."]
        arguments += ["-s", "-o", str(library), *sources]
        if "windows" in target:
            arguments.append(f"-Wl,--out-implib={library.with_suffix('.lib')}")
        elif "macos" in target:
            arguments.append(f"-Wl,-install_name,@rpath/{output.name}")
        zig(arguments, what, folder)
        return library.replace(output)


@cache
def cache_folder() -> Path:
    """Where the compiler keeps what it has built: the user's cache; a temporary one if that is read-only."""
    if "ZIG_GLOBAL_CACHE_DIR" in os.environ:
        return Path(os.environ["ZIG_GLOBAL_CACHE_DIR"])
    candidates = [Path(tempfile.gettempdir()) / f"guided-canine-{getattr(os, 'getuid', lambda: 'user')()}"]
    if "XDG_CACHE_HOME" in os.environ:
        candidates.insert(0, Path(os.environ["XDG_CACHE_HOME"]) / "guided-canine")
    elif home := os.path.expanduser("~"):
        candidates.insert(0, Path(home) / ".cache" / "guided-canine")
    for candidate in candidates:
        try:
            candidate.mkdir(parents=True, exist_ok=True, mode=0o700)
            with tempfile.TemporaryFile(dir=candidate):  # as root, access rights alone tell nothing
                return candidate
        except OSError:
            continue
    return Path(tempfile.mkdtemp(prefix="guided-canine-"))
