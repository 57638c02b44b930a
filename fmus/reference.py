"""Reference results in an FMU (layered standard FMI-LS-REF): inputs of some ticks, and the model's answers.

Whoever has the FMU runs it over the inputs, and compares. The answers come from the block's equations in
Python, not from the FMU's own C. The inputs are of no trial: each goes up and down within its declared range,
at its own pace, so that all of them act.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

from fmus.description import to_bytes
from models.kit.block import Block
from models.kit.declaration import Type, Variable, flatten
from models.kit.model import Model

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
MANIFEST = {
    "xmlns:fmi-ls": "http://fmi-standard.org/fmi-ls-manifest",
    "fmi-ls:fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
    "fmi-ls:fmi-ls-version": "1.0.0-alpha.1",
    "fmi-ls:fmi-ls-description": "Layered Standard providing information on related files included in an "
    "FMU.",
}
EXPERIMENTS = "application/x-ma-ls-experiments"
TICKS = 50
FAR = 10.0  # how far from 0 a Real goes, in its unit, where its range allows more
DIGITS = 3  # of a Real after the point


def reference_files(block: type[Block]) -> dict[str, bytes]:
    """What the layered standard puts into an FMU: path to content.

    The manifest names the experiment, and that names two CSVs, with the time in s in the first column. Inputs
    hold from their time on. Outputs are those after the step that ends at their time, at first those after
    initialization. Booleans are 0 and 1.
    """
    stimuli, references = f"{block.title()}_in.csv", f"{block.title()}_ref.csv"
    inputs, outputs = (dict(flatten(block.group(kind))) for kind in ("input", "output"))
    model = Model(block)
    model.initialize()
    rows = [_row(model, 0, outputs)]
    fed = []
    for tick in range(TICKS):
        for place, (name, variable) in enumerate(inputs.items()):
            model[name] = _input(variable, place, tick)
        fed.append(_row(model, tick, inputs))
        model.step()
        rows.append(_row(model, tick + 1, outputs))
    files = {
        "fmi-ls-manifest.xml": _manifest(block, stimuli, references),
        f"{block.title()}.exp": _experiments(block, stimuli, references),
        stimuli: _csv(inputs, fed),
        references: _csv(outputs, rows),
    }
    return {f"{FOLDER}/{name}": content for name, content in files.items()}


def _input(variable: Variable, place: int, tick: int) -> float:
    """What the input at this place gets on a tick."""
    if variable.type is Type.REAL:
        low = -FAR if variable.min is None else max(variable.min, -FAR)
        high = FAR if variable.max is None else min(variable.max, FAR)
        period = 8 + 2 * place
        height = abs((tick + place) % period * 2 / period - 1)
        return float(min(max(round(low + (high - low) * height, DIGITS), low), high))
    choices = [int(choice) for choice in variable.choices or (1, 0)]
    return float(choices[tick // (5 + place) % len(choices)])


def _row(model: Model, tick: int, variables: Mapping[str, Variable]) -> list[str]:
    """Time and values, as they stand in a CSV: reals with the digits that read back to the same bits."""
    values = ((model[name], variable.type) for name, variable in variables.items())
    texts = (repr(value) if kind is Type.REAL else str(int(value)) for value, kind in values)
    return [repr(tick * model.block.sample_time), *texts]


def _csv(variables: Mapping[str, Variable], rows: Sequence[Sequence[str]]) -> bytes:
    return "".join(f"{','.join(row)}\n" for row in [["time", *variables], *rows]).encode()


def _manifest(block: type[Block], stimuli: str, references: str) -> bytes:
    """fmi-ls-manifest.xml: the files, and what each is for."""
    root = ET.Element("fmiReferences", dict(MANIFEST))
    for source, kind, role, description in (
        (f"{block.title()}.exp", EXPERIMENTS, "experiment", f"{TICKS} ticks, with all that they need"),
        (stimuli, "text/csv", "testcase", "inputs of the experiment"),
        (references, "text/csv", "result", "outputs of the experiment, computed from the block's equations"),
    ):
        ET.SubElement(root, "Related", type=kind, source=source, role=role, description=description)
    return to_bytes(root)


def _experiments(block: type[Block], stimuli: str, references: str) -> bytes:
    """The experiment: its times, its inputs, and what must come out, to the last bit."""
    root = ET.Element(
        "Experiments", name=block.title(), description="to try that the FMU runs as it was made"
    )
    experiment = ET.SubElement(
        root, "Experiment", name="ticks", description="inputs within their ranges, parameters as they start",
        startTime="0.0", stopTime=repr(TICKS * block.sample_time), stepSize=repr(block.sample_time),
    )  # fmt: skip
    ET.SubElement(experiment, "Stimuli", source=stimuli)
    ET.SubElement(experiment, "References", source=references)
    return to_bytes(root)
