"""`canine prove`: what it prints, and its exit status."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from codegen.firmware import proving
from codegen.firmware.proving import Verdict
from codegen.toolchains import cbmc
from codegen.toolchains.debian import ToolchainError
from harness.main import FAULT, USAGE
from tests.harness.command import canine


@pytest.fixture
def faulty(monkeypatch: pytest.MonkeyPatch) -> None:
    """All proofs hold within a second, except that of the counters of mt.c."""
    monkeypatch.setattr(
        proving,
        "prove",
        lambda proof, folder: Verdict(proof, ("line 7 step",) if proof.name == "mt.sample" else (), 0.5),
    )


@pytest.mark.usefixtures("faulty")
def test_proofs_that_hold_are_printed_with_rule_seconds_and_assumptions(
    capsys: pytest.CaptureFixture[str],
) -> None:
    status, output, _ = canine(capsys, "prove", "8", "watchdog")
    assert status == 0
    begin, step, assumptions = output.splitlines()
    assert begin.split()[:7] == ["rule", "8", "onboard.begin", "CBMC", "holds", "0.5", "s"]
    assert step.split()[:5] == ["watchdog.step", "CBMC", "holds", "0.5", "s"]
    assert assumptions.strip() == "assumes: parameters as the firmware ships"


@pytest.mark.usefixtures("faulty")
def test_a_proof_that_fails_is_named_and_is_a_fault(capsys: pytest.CaptureFixture[str]) -> None:
    status, output, error = canine(capsys, "prove", "mt")
    assert status == FAULT
    assert "fails: line 7 step" in output
    assert "1 of 5 proofs fail: mt.sample" in error


@pytest.mark.usefixtures("faulty")
def test_verdicts_are_given_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    status, output, _ = canine(capsys, "prove", "mt.sample", "--json")
    assert status == FAULT
    (verdict,) = json.loads(output)
    assert (verdict["proof"], verdict["holds"], verdict["failed"]) == ("mt.sample", False, ["line 7 step"])


def test_unknown_rule_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, error = canine(capsys, "prove", "99")
    assert status == USAGE
    assert "99: no such proof; rules that are proved: " in error


def test_missing_cbmc_is_told_with_the_way_to_get_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> Path:
        raise ToolchainError("the proofs need CBMC 6, and it is missing: apt install cbmc")

    monkeypatch.setattr(cbmc, "program", fail)
    status, _, error = canine(capsys, "prove", "mt.value")
    assert status == FAULT
    assert "apt install cbmc" in error
