"""What `canine check` tries of an FMU: states that are saved, resets, and what is not exchanged."""

import re
from pathlib import Path
from typing import Any, Literal

import pytest

from fmus.build import build_fmu
from fmus.folder import build_folder
from harness.cosim.check import check_fmu
from harness.cosim.fmu import FmuError
from models.pedestrian import Pedestrian
from tests.harness.cosim.tiny_fmu import V, tiny_fmu

GROWS = "v[0] += 1 + v[1];"
VARIABLES = [V("n"), V("command", "input", "Integer")]


def checked(path: Path, role: str | None = None) -> tuple[str, list[str]]:
    """What is said of an FMU, and the notes."""
    notes: list[str] = []
    return check_fmu(path, role, notes.append), notes


@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_of_ours_lives_as_fmi_promises(version: Literal[2, 3]) -> None:
    fmu = build_fmu(Pedestrian, build_folder() / f"fmi{version}", version)
    line, notes = checked(fmu, "plant")
    assert notes == []
    assert re.fullmatch(
        rf"pedestrian\.fmu: FMI {version} co-simulation, 1 input, \d+ outputs, \d+ parameters; "
        r"a fixed step of 0\.04 s: every tick of 0\.04 s; "
        r"runs, saves its state, serializes it, resets; fits the plant role",
        line,
    )


@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_made_elsewhere_is_stepped_with_each_command_and_reset(tmp_path: Path, version: int) -> None:
    kind = "Integer" if version == 2 else "Int32"
    variables = [V("n"), V("command", "input", kind)]
    fmu = tiny_fmu(tmp_path / "x.fmu", variables, GROWS, version=version, restore="")
    line, _ = checked(fmu)
    assert line == (
        f"x.fmu: FMI {version} co-simulation, 1 input, 1 output, 0 parameters; "
        "any step: every tick of 0.04 s; runs, saves its state, serializes it, resets"
    )
    # and one that fails on RECALL (3), the fourth command
    bad = tiny_fmu(tmp_path / "y.fmu", variables, f"{GROWS} if (v[1] == 3) return 3;", version=version)
    with pytest.raises(FmuError, match=rf"fmu y\.fmu: fmi{version}DoStep returned error at t = 30 s"):
        checked(bad)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"reset": "v[0] = 0.5;"}, 'after fmi{v}Reset: output "n" is .*0.5 at t = 0 s, and was .*0'),
        ({"reset": "return 3;"}, "fmi{v}Reset returned error"),
        ({"restore": "v[0] += 0.5;"}, 'after fmi{v}SetFMU[sS]tate: output "n" is .* at t = 30 s, and was'),
        (
            {"restore": "", "deserialize": "((tiny *)*s)->v[0] = 7;"},
            'after fmi{v}SetFMU[sS]tate of a state that was serialized: output "n" is .*7.* at t = 30 s',
        ),
        (
            {"restore": "*(volatile int *)8 = 1;"},
            "fmi{v}SetFMU[sS]tate ended the process.*segmentation fault",
        ),
        ({"free": "*(volatile int *)8 = 1;"}, "fmi{v}FreeInstance ended the process.*segmentation fault"),
    ],
)
def test_an_fmu_that_does_not_repeat_itself_is_told_with_the_function(
    tmp_path: Path, version: int, options: dict[str, Any], text: str
) -> None:
    fmu = tiny_fmu(tmp_path / "x.fmu", [V("n")], "v[0] += 1;", version=version, **options)
    with pytest.raises(FmuError, match=rf"^fmu x\.fmu: .*{text.format(v=version)}"):
        checked(fmu)


def test_what_is_not_exchanged_is_counted_and_named_by_kind(tmp_path: Path) -> None:
    # given an FMI 3 FMU with texts, bytes, clocks and arrays
    variables = [V("n"), V("s", type="String"), V("b", "input", type="Binary"), V("c", type="Clock")]
    fmu = tiny_fmu(tmp_path / "x.fmu", variables, GROWS, version=3, arrays=("n2", "n3", "n4", "n5"))
    # when
    line, notes = checked(fmu)
    # then
    assert "0 inputs and 1 not exchanged, 1 output and 6 not exchanged, 0 parameters; any step" in line
    text = "\n".join(notes)
    assert "x.fmu: 1 output not exchanged, s: has type String; expected one of Float64" in text
    assert "x.fmu: 1 input not exchanged, b: has type Binary" in text
    assert "x.fmu: 1 output not exchanged, c: has type Clock" in text
    assert "x.fmu: 4 outputs not exchanged, n2, n3, n4 and 1 more: is an array; expected a scalar" in text


def test_a_command_that_is_mapped_is_given_as_the_fmu_takes_it(tmp_path: Path) -> None:
    # given a plant that takes ten times the command under another name, and fails at 50 (RIGHT)
    outputs = [V(name) for name in ("north", "east", "speed", "heading")]
    fmu = tiny_fmu(
        tmp_path / "dog.fmu",
        [*outputs, V("cmd", "input", "Integer")],
        "if (v[4] == 50) return 3;",
        depends=False,
    )
    (tmp_path / "dog.toml").write_text('[inputs]\ncommand = { name = "cmd", factor = 10.0 }\n')
    with pytest.raises(FmuError, match="fmi2DoStep returned error at t = 50 s"):
        checked(fmu, "plant")
