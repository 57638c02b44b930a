"""Reference results in FMUs (FMI-LS-REF): whoever has an FMU runs it again, and gets the same bits."""

from __future__ import annotations

import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import fmus
from fmus.folder import FmiVersion
from fmus.reference import FOLDER, TICKS, reference_files
from models.cmec import Cmec
from models.commands import Command
from models.kit.block import Block
from models.kit.declaration import Type, flatten
from models.system import BLOCKS
from tests.fmus.pulse import Pulse, Slide
from tests.fmus.rerun import experiment_of, rerun

Fmu = Callable[[type[Block]], Path]


def test_fmpy_runs_an_fmu_again_to_its_reference_results(block: type[Block], unpacked: Fmu) -> None:
    rerun(unpacked(block))
    # and the results have all outputs, after initialization and after each step
    outputs = experiment_of(unpacked(block)).outputs
    assert outputs.dtype.names == ("time", *block.flat_names("output"))
    assert len(outputs) == TICKS + 1


def test_a_result_that_differs_in_one_bit_is_noticed(unpacked: Fmu, tmp_path: Path) -> None:
    # given reference results that are one bit off in one place
    shutil.copytree(unpacked(Slide), tmp_path, dirs_exist_ok=True)
    file = tmp_path / FOLDER / "slide_ref.csv"
    text = file.read_text()
    assert text.count("0.6000000000000001\n") > 0
    file.write_text(text.replace("0.6000000000000001\n", "0.6\n", 1))
    with pytest.raises(AssertionError, match="place"):
        rerun(tmp_path)


def test_the_files_are_those_that_the_layered_standard_names(unpacked: Fmu) -> None:
    folder = unpacked(Pulse) / FOLDER
    root = ET.parse(folder / "fmi-ls-manifest.xml").getroot()
    standard = "{http://fmi-standard.org/fmi-ls-manifest}fmi-ls-"
    assert root.tag == "fmiReferences"
    assert root.get(f"{standard}name") == "org.fmi-standard.fmi-ls-ref"
    assert root.get(f"{standard}version") == "1.0.0-alpha.1"
    assert root.get(f"{standard}description") == (
        "Layered Standard providing information on related files included in an FMU."
    )
    related = {r.attrib["source"]: (r.get("role"), r.get("type")) for r in root}
    assert related == {
        "pulse.exp": ("experiment", "application/x-ma-ls-experiments"),
        "pulse_in.csv": ("testcase", "text/csv"),
        "pulse_ref.csv": ("result", "text/csv"),
    }
    # and nothing else is there
    assert {path.name for path in folder.iterdir()} == {"fmi-ls-manifest.xml", *related}
    # and the experiment is 2 s long
    experiments = ET.parse(folder / "pulse.exp").getroot()
    assert (experiments.tag, experiments.get("name")) == ("Experiments", "pulse")
    assert [(e.tag, e.get("startTime"), e.get("stopTime"), e.get("stepSize")) for e in experiments] == [
        ("Experiment", "0.0", "2.0", "0.04")
    ]


def test_the_results_are_those_that_the_equations_give_by_hand() -> None:
    # given a plant that moves by 0.04 s times its input, which runs to and fro between -10 and 10 in 8 ticks
    files = reference_files(Slide)
    pushes = [10.0, 5.0, 0.0, -5.0, -10.0, -5.0, 0.0, 5.0, 10.0]
    lines = files[f"{FOLDER}/slide_in.csv"].decode().splitlines()
    assert lines[:3] == ["time,push", "0.0,10.0", "0.04,5.0"]
    assert [float(line.split(",")[1]) for line in lines[1:10]] == pushes
    # then it is where the pushes before have brought it
    lines = files[f"{FOLDER}/slide_ref.csv"].decode().splitlines()
    assert lines[:4] == ["time,place", "0.0,0.0", "0.04,0.4", "0.08,0.6000000000000001"]
    places = [float(line.split(",")[1]) for line in lines[1:11]]
    np.testing.assert_allclose(places, [0.0, *np.cumsum(pushes) * 0.04], rtol=0, atol=1e-12)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.title())
def test_every_input_moves_within_its_range_and_most_outputs_answer(block: type[Block]) -> None:
    files = reference_files(block)
    columns = {}
    for name in ("in", "ref"):
        header, *rows = files[f"{FOLDER}/{block.title()}_{name}.csv"].decode().splitlines()
        table = np.array([[float(text) for text in row.split(",")] for row in rows])
        columns[name] = dict(zip(header.split(","), table.T, strict=True))
    for name, variable in flatten(block.group("input")):
        values = columns["in"][name]
        assert len(set(values)) > 1, name
        assert variable.min is None or values.min() >= variable.min
        assert variable.max is None or values.max() <= variable.max
        if variable.type is not Type.REAL:
            assert set(values) <= {int(choice) for choice in variable.choices or (0, 1)}
    moving = [name for name in block.flat_names("output") if len(set(columns["ref"][name])) > 1]
    assert len(moving) >= len(block.flat_names("output")) / 4


def test_the_controller_gets_each_order_and_gives_more_than_one() -> None:
    # given the inputs of a block with enumerations and Booleans
    files = reference_files(Cmec)
    header, *rows = files[f"{FOLDER}/cmec_in.csv"].decode().splitlines()
    orders = {row.split(",")[header.split(",").index("override")] for row in rows}
    # then they are whole numbers
    assert orders <= {str(int(command)) for command in Command}
    assert len(orders) > 3


def test_two_builds_give_the_same_results_in_any_process(unpacked: Fmu) -> None:
    # the FMU was built by another call than this one
    for path, content in reference_files(Pulse).items():
        assert (unpacked(Pulse) / path).read_bytes() == content


def test_the_page_of_fmus_shows_how_they_are_run_again(
    fmu: Fmu, version: FmiVersion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given the lines of Python in the page, and the FMU that they name
    page = (Path(fmus.__file__).parent / "README.md").read_text()
    (lines,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "four_state.fmu").write_bytes(fmu(BLOCKS[1]).read_bytes())
    assert BLOCKS[1].title() == "four_state"
    # when, then
    exec(compile(lines, "README.md", "exec"), {})
