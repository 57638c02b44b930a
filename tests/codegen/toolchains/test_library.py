"""Why a shared library is not loaded."""

from __future__ import annotations

import platform
import sys
from pathlib import Path

import pytest

from codegen.toolchains.library import why_not_loaded

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="ELF is Linux's")


@pytest.mark.parametrize(
    ("machine", "number"),
    [("armv7l", 40), ("ppc64le", 21), ("ppc", 20), ("riscv64", 243), ("i686", 3), ("x86_64", 62)],
)
def test_a_library_for_this_machine_is_known_by_whatever_name_the_system_gives_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, machine: str, number: int
) -> None:
    # given a library of the machine's own kind, which the system does not load for another reason
    monkeypatch.setattr(platform, "machine", lambda: machine)
    library = tmp_path / "dog.so"
    library.write_bytes(b"\x7fELF" + bytes([1, 1]) + bytes(12) + number.to_bytes(2, "little"))
    # when, then the system's own reason is given
    assert why_not_loaded(library, "undefined symbol: bark") == "undefined symbol: bark"


def test_a_library_for_another_machine_is_named_beside_this_machines_own_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "armv7l")
    library = tmp_path / "dog.so"
    library.write_bytes(b"\x7fELF" + bytes([1, 1]) + bytes(12) + (62).to_bytes(2, "little"))
    assert why_not_loaded(library, "wrong ELF class") == (
        "dog.so is an ELF library for x86_64, this machine is armv7l (linux); export it for this machine"
    )
