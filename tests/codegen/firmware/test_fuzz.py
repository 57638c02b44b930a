"""The parsers on board under libFuzzer with the address and undefined-behaviour sanitizers (tests/fuzz)."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.codegen.firmware.onboard_drivers import DATA, GOOD, write_drivers

FUZZ = Path(__file__).resolve().parents[2] / "fuzz"
FLAGS = ("-std=c99", "-g", "-O1", "-Wall", "-Wextra", "-Werror", "-fno-sanitize-recover=all")
RUNS = 200_000


def fuzzer(name: str, folder: Path) -> Path:
    """The program that feeds one parser; where Clang cannot make it the test is skipped, but in CI fails."""
    program = folder / f"fuzz_{name}"
    write_drivers(folder)
    beside = ["telemetry.c", "siphash.c", "key.c"] if name == "link" else []
    drivers = ["scanner.c", f"{name}.c", *beside]
    sources: list[str | Path] = [
        FUZZ / f"fuzz_{name}.c",
        *(folder / driver for driver in drivers),
        f"-I{folder}",
        f"-I{FUZZ}",
    ]
    sanitizers = "-fsanitize=fuzzer,address,undefined"
    probe = folder / "probe.c"
    probe.write_text("int LLVMFuzzerTestOneInput(const char *data, unsigned long size) { return 0; }\n")
    try:
        subprocess.run(["clang", sanitizers, probe, "-o", folder / "probe"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        leave_out = pytest.fail if os.environ.get("CI") == "true" else pytest.skip
        leave_out("no clang with libFuzzer; apt install clang libclang-rt-dev")
    done = subprocess.run(
        ["clang", *FLAGS, sanitizers, *sources, "-o", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return program


def corpus(name: str, folder: Path) -> Path:
    """Good frames at several sizes of block (the first byte), and pieces of captures where they are."""
    folder.mkdir()
    inputs = [b"".join(GOOD[name]), *GOOD[name]]
    if name == "ubx":
        for capture in sorted((DATA / "ubx_captures").glob("*.log")):
            data = capture.read_bytes()[:20_000]
            inputs += [data[i : i + 250] for i in range(0, len(data), 250)]
    for i, data in enumerate(inputs):
        (folder / f"{i}").write_bytes(bytes([(0, 6, 254)[i % 3], *([20] if name == "link" else [])]) + data)
    return folder


@pytest.mark.parametrize("name", ["ubx", "mt", "link"])
def test_fuzzer_finds_no_broken_invariant_in_a_parser(name: str, tmp_path: Path) -> None:
    program = fuzzer(name, tmp_path)
    done = subprocess.run(
        [program, f"-runs={RUNS}", "-seed=1", "-max_len=256", "-use_value_profile=1",
         f"-artifact_prefix={tmp_path}/", corpus(name, tmp_path / "corpus")],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-4000:]
    assert f"Done {RUNS} runs" in done.stderr
