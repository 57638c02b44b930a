"""An unpacked FMU run over its own reference inputs, and the bits that must come out."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import numpy.typing as npt

from fmus.reference import FOLDER


@dataclass(frozen=True)
class Experiment:
    """What an FMU's files of FMI-LS-REF say: times in s, inputs and outputs with a column for each."""

    start: float
    stop: float
    step: float
    inputs: npt.NDArray[Any]
    outputs: npt.NDArray[Any]


def experiment_of(folder: Path) -> Experiment:
    """The experiment in an unpacked FMU, found by way of its manifest."""
    related = ET.parse(folder / FOLDER / "fmi-ls-manifest.xml").getroot().findall("Related")
    (source,) = (r.attrib["source"] for r in related if r.get("role") == "experiment")
    (experiment,) = ET.parse(folder / FOLDER / source).getroot().findall("Experiment")
    start, stop, step = (float(experiment.attrib[name]) for name in ("startTime", "stopTime", "stepSize"))
    files = (experiment.find(tag) for tag in ("Stimuli", "References"))
    inputs, outputs = (fmpy.read_csv(folder / FOLDER / f.attrib["source"]) for f in files if f is not None)
    return Experiment(start, stop, step, inputs, outputs)


def rerun(folder: Path) -> None:
    """Run an unpacked FMU with FMPy; all outputs have the bits of its reference results at all times."""
    experiment = experiment_of(folder)
    result = fmpy.simulate_fmu(
        str(folder),
        start_time=experiment.start,
        stop_time=experiment.stop,
        output_interval=experiment.step,
        input=experiment.inputs,
        output=list(experiment.outputs.dtype.names or ())[1:],
    )
    assert_same_bits({name: result[name] for name in result.dtype.names}, experiment.outputs)


def assert_same_bits(got: dict[str, npt.NDArray[Any]], expected: npt.NDArray[Any]) -> None:
    """All columns have the same bits."""
    assert set(got) == set(expected.dtype.names or ())
    for name, values in got.items():
        bits = np.ascontiguousarray(values, dtype=np.float64).view(np.uint64)
        np.testing.assert_array_equal(bits, expected[name].view(np.uint64), name)
