"""C to machine code with one toolchain everywhere: the Clang of pip's `ziglang`.

No C compiler needs to be installed, and every platform is built on any other. The same sources give the same
bytes wherever they are built: the lock file pins the compiler, and no path and no time enters the binary.
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

from codegen.scratch import Scratch
from models.errors import CanineError, UsageError, nearest


class CompileError(CanineError):
    """The compiler refuses the C, or this machine has no compiler."""


class PlatformError(CompileError, UsageError):
    """Binaries are not made for this platform."""


@dataclass(frozen=True)
class Platform:
    """A platform for shared libraries."""

    target: str  # as Zig names it
    fmi2: str  # folder of FMI 2.0 binaries, which has no name of its own for ARM
    fmi3: str  # folder of FMI 3.0 binaries
    suffix: str
    flags: tuple[str, ...] = ()  # beside those of all platforms


X86_64 = ("-mcpu=x86_64_v2",)  # has SSE4.2: an instruction rounds down, not a function
PLATFORMS: dict[str, Platform] = {
    "linux64": Platform("x86_64-linux-gnu.2.17", "linux64", "x86_64-linux", ".so", X86_64),
    "win64": Platform("x86_64-windows-gnu", "win64", "x86_64-windows", ".dll", X86_64),
    "darwin64": Platform("x86_64-macos", "darwin64", "x86_64-darwin", ".dylib", X86_64),
    "aarch64-linux": Platform("aarch64-linux-gnu.2.17", "linux64", "aarch64-linux", ".so"),
    "aarch64-darwin": Platform("aarch64-macos", "darwin64", "aarch64-darwin", ".dylib"),
}

# -ffp-contract=off: a fused multiply-add changes results, and only where the processor has it
NUMERICS = ("-std=c99", "-O2", "-ffp-contract=off")
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror")
FLAGS = (
    *NUMERICS,
    *WARNINGS,
    "-fno-math-errno",  # errno of sqrt is never read
    "-fno-sanitize=all",  # zig sanitizes by default
    "-fvisibility=hidden",
    "-g0",
)
TIMEOUT = 1800.0  # s; the first build for Windows compiles its C runtime: minutes on a slow machine


def compiler_version() -> str:
    """The compiler's version: a binary made by another is out of date."""
    from importlib.metadata import version  # noqa: PLC0415 - 30 ms that reading PLATFORMS need not wait for

    return f"ziglang {version('ziglang')}"


def this_platform() -> str:
    """The name in PLATFORMS of this machine.

    Raises:
        CompileError: PLATFORMS lacks it.
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
    """This machine's processor: code built for it may not run on others."""
    try:
        description = Path("/proc/cpuinfo").read_text()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return "\n".join(
        sorted({x for x in description.splitlines() if x.startswith(("model name", "flags", "Features"))})
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
        what: the name of the program or library, for the message if it fails.

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
    """Compile C into a shared library with only its exported symbols; the same sources, the same bytes.

    Args:
        folder: where the sources (named relative to it) and their headers lie.
        output: the library, written whole or not at all.
        what: the name of the block, for the message if it fails.
        target: one of PLATFORMS or any target of Zig; this machine's by default.
        flags: of the compiler; `FLAGS` by default.

    Raises:
        CompileError: with the compiler's own words.
    """
    target = target or this_platform()
    target = PLATFORMS[target].target if target in PLATFORMS else target
    folder = folder.resolve()
    output.parent.mkdir(parents=True, exist_ok=True)
    # a folder of its own, since the linker leaves .pdb and .lib beside a library for Windows
    with Scratch(output.parent) as scratch:
        library = scratch.resolve() / output.name
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
    """The folder in the user's cache for builds; a temporary one if that is read-only."""
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
            with tempfile.TemporaryFile(dir=candidate):  # root may write regardless of access rights
                return candidate
        except OSError:
            continue
    return _own_cache().path


@cache
def _own_cache() -> Scratch:
    return Scratch()  # kept until the process ends
