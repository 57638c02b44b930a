"""The onboard program's C under static analysis, three compilers, sanitizers and a fuzzer.

codegen/QUALITY.md tells the firmware engineer the same, and holds the list of deviations from MISRA C.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import codegen
from codegen.blocks.block_c import write_files
from codegen.firmware.bundle import SOURCES, library, processor_in_the_loop
from codegen.firmware.targets import TARGETS
from tests.codegen.firmware import onboard_orders as orders
from tests.codegen.firmware.onboard_drivers import DATA

QUALITY = Path(codegen.__file__).parent / "QUALITY.md"
WARNINGS = (
    "-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion",
    "-Wsign-conversion", "-Wdouble-promotion", "-Wshadow", "-Werror",
)  # fmt: skip
COMPILERS = {"gcc": ("gcc",), "clang": ("clang",), "zig": (sys.executable, "-m", "ziglang", "cc")}
UNDEFINED = "address,undefined,float-cast-overflow,float-divide-by-zero"
SANITIZERS = {"gcc": UNDEFINED, "clang": f"{UNDEFINED},implicit-conversion"}
MODE_SUCCESS, MODE_FAILED, MODE_DEAD = 9, 10, 5  # of models.cmec.Mode
FUZZING = 10  # s


def leave_out(reason: str) -> None:
    """Skip, but in CI fail."""
    (pytest.fail if os.environ.get("CI") == "true" else pytest.skip)(reason)


def need(tool: str, package: str) -> None:
    """Leave the test out where a tool is missing."""
    if shutil.which(tool) is None:
        leave_out(f"no {tool}; apt install {package}")


def run(command: list[str | Path], folder: Path, timeout: float = 120.0) -> str:
    """What a program prints; it must succeed."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=timeout, check=False)
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]
    return done.stdout + done.stderr


# --- MISRA C ---


def cppcheck(folder: Path, files: list[str]) -> set[tuple[str, str]]:
    """(file, finding) of all C together, as one program."""
    output = run(
        ["cppcheck", "--addon=misra", "--enable=all", "--inline-suppr", "--std=c99", "--quiet", "-I.",
         "--suppress=missingIncludeSystem", "--template={file}\t{id}", "--template-location=", *files],
        folder,
    )  # fmt: skip
    rows = [line.split("\t") for line in output.splitlines() if "\t" in line]
    return {(file, finding.removeprefix("misra-c2012-")) for file, finding in rows}


def deviations() -> set[tuple[str, str]]:
    """(file, finding) of the table of QUALITY.md, whose rows each have a reason."""
    table = QUALITY.read_text().partition("| finding | where | why |\n|---|---|---|\n")[2]
    rows = re.findall(r"^\| (\S+) \| ([^|]+) \| ([^|]+) \|$", table, re.MULTILINE)
    assert len(rows) == len(table.splitlines())
    return {(file, finding) for finding, files, _ in rows for file in files.split(", ")}


def test_cppcheck_finds_a_planted_violation_and_a_planted_fault(tmp_path: Path) -> None:
    need("cppcheck", "cppcheck")
    # a number as a condition, which rule 14.4 forbids, and a place beyond an array
    (tmp_path / "planted.c").write_text(
        "int f(int i);\nint f(int i) { int a[3] = {0}; if (i) { a[0] = 1; } return a[3]; }\n"
    )
    findings = {finding for _, finding in cppcheck(tmp_path, ["planted.c"])}
    assert {"14.4", "arrayIndexOutOfBounds"} <= findings


def test_the_programs_c_deviates_from_misra_exactly_as_quality_md_lists(tmp_path: Path) -> None:
    need("cppcheck", "cppcheck")
    # given the program as it is shipped, with parameters and with constants, and with the mailbox
    findings = set()
    for constants in (False, True):
        folder, files = tmp_path / str(constants), library(constants=constants)
        write_files(files, folder)
        findings |= cppcheck(folder, sorted(n for n in files if n.endswith(".c")))
    mailbox = processor_in_the_loop()
    write_files(mailbox, folder)
    findings |= {
        (file, finding)
        for file, finding in cppcheck(folder, sorted(n for n in mailbox if n.endswith(".c")))
        if file in mailbox
    }
    # then each finding stands in QUALITY.md with its reason, and nothing else does
    compare(findings, {(file, finding) for file, finding in deviations() if "/" not in file})


@pytest.mark.parametrize("target", TARGETS)
def test_the_c_of_a_target_deviates_from_misra_exactly_as_quality_md_lists(
    target: str, tmp_path: Path
) -> None:
    need("cppcheck", "cppcheck")
    # given what the target adds, beside the program
    folders = {name for name in (TARGETS[target].folder, TARGETS[target].shared) if name}
    added = {
        path.name: path
        for name in folders
        for path in (SOURCES / name).iterdir()
        if path.suffix in (".c", ".h")
    }
    write_files(
        library() | processor_in_the_loop() | {name: path.read_text() for name, path in added.items()},
        tmp_path,
    )
    # then the findings are those listed
    findings = cppcheck(tmp_path, sorted(name for name in added if name.endswith(".c")))
    found = {(f"{added[file].parent.name}/{file}", finding) for file, finding in findings if file in added}
    compare(found, {(file, finding) for file, finding in deviations() if file.partition("/")[0] in folders})


def compare(findings: set[tuple[str, str]], listed: set[tuple[str, str]]) -> None:
    """Findings and table agree."""
    assert sorted(findings - listed) == [], "new: mend the code, or give the reason in codegen/QUALITY.md"
    assert sorted(listed - findings) == [], "no longer so: take it out of codegen/QUALITY.md"


# --- warnings ---


@pytest.mark.parametrize("constants", [False, True], ids=["parameters", "constants"])
@pytest.mark.parametrize("compiler", COMPILERS)
def test_whole_library_compiles_without_a_warning(compiler: str, constants: bool, tmp_path: Path) -> None:
    if compiler != "zig":
        need(compiler, compiler)
    files = library(constants=constants)
    write_files(files, tmp_path)
    sources = [name for name in files if name.endswith(".c")]
    for source in sources:  # one by one: zig compiles only the first of several
        assert run([*COMPILERS[compiler], *WARNINGS, "-I.", "-c", source], tmp_path) == ""
    assert len(list(tmp_path.glob("*.o"))) == len(sources) == 15


# --- sanitizers ---


@pytest.fixture(scope="module")
def trial() -> bytes:
    """A recorded trial as orders."""
    return orders.as_orders(orders.recorded_trial(60.0))


def sanitized(compiler: str, folder: Path, *, constants: bool = False) -> Path:
    """The whole program with all its checks, which runs inputs from files."""
    need(compiler, "gcc" if compiler == "gcc" else "clang libclang-rt-dev")
    sources = orders.write_program(folder, constants=constants)
    shutil.copy(orders.FUZZ / "run_tick.c", folder)
    run(
        [compiler, "-std=c99", "-g", "-O1", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror",
         f"-fsanitize={SANITIZERS[compiler]}", "-fno-sanitize-recover=all", "-I.", *sources, "run_tick.c",
         "-lm", "-o", "run"], folder,
    )  # fmt: skip
    return folder / "run"


def modes(line: str) -> set[int]:
    """The controller's modes of a line that run_tick prints."""
    bits = int(line.rsplit(maxsplit=1)[-1])
    return {mode for mode in range(32) if bits >> mode & 1}


@pytest.mark.parametrize("compiler", SANITIZERS)
def test_hard_inputs_and_a_recorded_trial_pass_the_sanitizers(
    compiler: str, trial: bytes, tmp_path: Path
) -> None:
    # given inputs at the limits of what a tick can meet, and a trial
    program = sanitized(compiler, tmp_path, constants=compiler == "gcc")
    inputs = {**orders.EXTREMES, "trial": trial}
    for i, data in enumerate(inputs.values()):
        (tmp_path / f"input{i}").write_bytes(data)
    # when they run, nothing is found and every check of fuzz_tick.c holds
    lines = run([program, *(f"input{i}" for i in range(len(inputs)))], tmp_path).splitlines()
    reached = dict(zip(inputs, map(modes, lines), strict=True))
    # and they lead where they are meant to
    assert MODE_SUCCESS in reached["trial"]
    assert MODE_SUCCESS in reached["a mission done"]
    assert reached["long silence"] > {0}
    assert all(len(reached[f"fixes at {place}"]) > 1 for place in ("the date line", "the north pole"))
    assert reached["missions with a leg that is too short"] == {0}
    assert len(reached["missions of all lengths"]) > 1


# --- fuzzing ---


def test_fuzzer_finds_no_broken_invariant_in_the_whole_tick(trial: bytes, tmp_path: Path) -> None:
    need("clang", "clang libclang-rt-dev")
    sources = orders.write_program(tmp_path)
    build = subprocess.run(
        ["clang", "-std=c99", "-g", "-O1", "-ffp-contract=off", "-fno-sanitize-recover=all", "-I.",
         f"-fsanitize=fuzzer,{SANITIZERS['clang']}", *sources, "-lm", "-o", "fuzz"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if "clang_rt.fuzzer" in build.stderr:
        leave_out("no libFuzzer; apt install libclang-rt-dev")
    assert build.returncode == 0, build.stderr
    corpus = tmp_path / "corpus"
    corpus.mkdir()
    inputs = [*orders.EXTREMES.values(), trial[:4000]]
    for capture in sorted((DATA / "ubx_captures").glob("*.log")):  # none: the rest alone
        inputs.append(orders.BEGUN + orders.raw("gps", capture.read_bytes()[:2000]) + orders.ticks(50))
    for i, data in enumerate(inputs):
        (corpus / str(i)).write_bytes(data)
    output = run(
        [tmp_path / "fuzz", f"-max_total_time={FUZZING}", "-seed=1", "-max_len=2048", "-timeout=20", corpus],
        tmp_path,
    )
    done = re.search(r"Done (\d+) runs", output)
    assert done is not None
    assert int(done[1]) > len(inputs)
