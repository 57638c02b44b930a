"""Proofs of the C that ships, by the model checker CBMC; and faults planted in it, which they must find.

CANINE_PROVE=all runs the long ones too, and every fault.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from codegen.firmware import proving
from codegen.firmware.proving import GRAPH, NAMED, PROOFS, SHORT_INT, SOURCES, Proof
from codegen.toolchains import cbmc
from codegen.toolchains.debian import ToolchainError
from models.errors import UsageError
from tests.codegen.firmware.planted import FAULTS, FEW, Fault, plant
from tests.codegen.firmware.test_c_quality import leave_out

ALL = os.environ.get("CANINE_PROVE") == "all"
RUN = [proof for proof in PROOFS if ALL or not proof.long]
PLANTED = FAULTS if ALL else [next(f for f in FAULTS if f.proof == name) for name in FEW]


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the C that ships and the proofs."""
    folder = tmp_path_factory.mktemp("proofs")
    proving.write_sources(folder)
    return folder


@pytest.fixture(scope="module")
def checker() -> None:
    """CBMC is there."""
    try:
        cbmc.program()
    except ToolchainError as reason:
        leave_out(str(reason))


@pytest.mark.usefixtures("checker")
@pytest.mark.parametrize("proof", RUN, ids=lambda proof: proof.name)
def test_cbmc_proves_the_function_for_all_its_inputs(proof: Proof, sources: Path) -> None:
    assert proving.prove(proof, sources).failed == ()


@pytest.mark.usefixtures("checker")
@pytest.mark.parametrize("proof", [p for p in PROOFS if p.short], ids=lambda proof: proof.name)
def test_cbmc_proves_the_function_with_an_int_of_16_bits(proof: Proof, sources: Path) -> None:
    assert proving.prove(proof, sources, SHORT_INT).failed == ()


@pytest.mark.usefixtures("checker")
@pytest.mark.parametrize("fault", PLANTED, ids=lambda fault: fault.name)
def test_the_proof_fails_with_the_planted_fault(fault: Fault, sources: Path) -> None:
    # given the C that ships with one text changed
    before = plant(fault, sources)
    # then the proof does not hold
    try:
        assert proving.prove(NAMED[fault.proof], sources).failed != ()
    finally:
        (sources / fault.file).write_text(before)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_each_fault_finds_the_text_that_it_replaces(fault: Fault, sources: Path) -> None:
    before = plant(fault, sources)
    (sources / fault.file).write_text(before)
    assert fault.proof in NAMED


def test_every_function_of_the_proofs_is_listed() -> None:
    functions = {
        f"{path.stem.removeprefix('prove_')}.{line.removeprefix('void prove_').partition('(')[0]}"
        for path in SOURCES.glob("prove_*.c")
        for line in path.read_text().splitlines()
        if line.startswith("void prove_")
    }
    assert functions == {proof.name for proof in PROOFS}


def test_proofs_are_found_by_rule_unit_and_name() -> None:
    assert [p.name for p in proving.find(["8", "onboard.begin", "mt.value"])] == ["onboard.begin", "mt.value"]
    assert {p.name for p in proving.find(["ubx"])} == {p.name for p in PROOFS if p.name.startswith("ubx.")}
    assert [p.name for p in proving.find(["graph"])] == [p.name for p in GRAPH]
    assert proving.find() == [*PROOFS, *GRAPH]


def test_unknown_rule_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(UsageError, match=r"^99: no such proof; rules that are proved: .*8.*; units: scanner"):
        proving.find(["99"])


def test_missing_cbmc_is_named_with_the_way_to_get_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fail(*_: object) -> Path:
        raise ToolchainError("no network")

    monkeypatch.setattr(cbmc, "folder_of", lambda name: tmp_path / name)
    monkeypatch.setattr(cbmc, "unpack", fail)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(ToolchainError, match=r"CBMC 6, and it is missing: no network\. .*apt install cbmc"):
        cbmc.program()


@pytest.mark.usefixtures("checker")
def test_cbmc_finds_a_planted_sum_that_only_an_int_of_16_bits_is_too_small_for(tmp_path: Path) -> None:
    # given C that adds to the greatest int16_t
    shutil.copytree(SOURCES / "int16", tmp_path / "int16")
    (tmp_path / "sum.c").write_text(
        "#include <stdint.h>\nint16_t nondet_i16(void);\nint32_t sum;\n"
        "void prove_sum(void)\n{\n    const int16_t ticks = nondet_i16();\n\n    sum = ticks + 1;\n}\n"
    )
    # then it overflows where an int has 16 bits alone
    assert cbmc.check(["sum.c"], "prove_sum", tmp_path, unwind=1).failed == ()
    (failed,) = cbmc.check(["sum.c"], "prove_sum", tmp_path, unwind=1, checks=SHORT_INT).failed
    assert "overflow" in failed
