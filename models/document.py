"""`python -m models.document` writes models/README.md from the declarations."""

from __future__ import annotations

import math
from pathlib import Path

from models.cmec import Cmec
from models.kit.block import Block
from models.kit.declaration import Parameter, Type, Variable
from models.kit.tracing import Table
from models.readings import READINGS
from models.system import BLOCKS

README = Path(__file__).with_name("README.md")
INTRODUCTION = """# The models

One file per block, in the order of the dissertation's equations; each line names the equation it comes from.
`kit/` is what blocks are declared with, `system.py` wires them, `readings.py` holds the two readings of what
the text leaves open. Where the text errs or is silent, [CHOICES.md](CHOICES.md) says what is done. Angles are
in rad here and in the FMUs, in degrees at the command line and in scenarios.

A block is a class whose variables are declared one to a line, and whose public methods are the updates of a
tick, in their order. From the class come the C, the FMUs, the log's schema, this page, and the reference:

```python
from models.four_state import FourState
from models.kit.model import Model

estimator = Model(FourState, {"fuzzy": 0})  # runs the CasADi functions
estimator.initialize()
estimator["gps_fix"], estimator["gps_h_acc"], estimator["gps_s_acc"] = 1, 3.5, 0.1
estimator.step()
print(estimator["north_sd"])
```

`models.interconnect` gives a block (`control_system`) or the whole loop (`interconnect(SYSTEMS["full"])`)
as a `control` system.

This page is made by `python -m models.document`.
"""


def readme() -> str:
    """The page: every block's variables, the controller's diagram, the readings."""
    parts = [INTRODUCTION]
    for block in BLOCKS:
        parts.append(_block(block))
        if block is Cmec:
            parts.append(_diagram(block))
    return "\n".join([*parts, _readings()])


def _block(block: type[Block]) -> str:
    lines = [
        f"## {block.title()}",
        "",
        block.summary(),
        "",
        f"Source: {block.source}.",
        "",
    ]
    for kind in ("input", "output", "parameter"):
        variables = block.group(kind)
        if variables:
            has_start = kind != "output"
            lines += [
                f"| {kind} | unit | {'start | ' if has_start else ''}meaning |",
                f"|---|---|{'---|' if has_start else ''}---|",
            ]
            lines += [_row(v, has_start) for v in variables]
            lines.append("")
    return "\n".join(lines)


def _row(variable: Variable, has_start: bool) -> str:
    name = f"`{variable.name}`" + (f" [1..{variable.size}]" if variable.size else "")
    meaning = variable.meaning
    if variable.choices:
        meaning += ": " + ", ".join(f"{int(c)} {c.name}" for c in variable.choices)
    if isinstance(variable, Parameter) and variable.latched:
        meaning += " (read when the trial starts)"
    cells = [name, variable.unit or variable.type.value]
    if has_start:
        cells.append(_start(variable) if variable.has_start else "")
    return f"| {' | '.join([*cells, meaning])} |"


def _start(variable: Variable) -> str:
    value = variable.start[0]
    if variable.type is Type.BOOLEAN:
        return "true" if value else "false"
    if variable.unit in ("rad", "rad/s") and value:
        return f"{math.degrees(value):.6g} {variable.unit.replace('rad', 'deg')}"
    return f"{value:g}"


def _diagram(block: type[Block]) -> str:
    """The state machine, drawn from its rows."""
    edges: dict[tuple[str, str], set[str]] = {}
    for phase in block.program().tick:
        if isinstance(phase, Table):
            names = block.variables()[phase.mode].choices
            anomalies = block.variables()["anomaly"].choices
            assert names
            assert anomalies
            for row in phase.rows:
                label = anomalies(row.anomaly).name.replace("_", " ") if row.anomaly else ""
                edges.setdefault((names(row.mode).name, names(row.next).name), set()).add(label)
    lines = ["```mermaid", "stateDiagram-v2"]
    for (source, target), labels in edges.items():
        label = ", ".join(sorted(filter(None, labels)))
        lines.append(f"    {source} --> {target}" + (f": {label}" if label else ""))
    return "\n".join(
        [
            "The modes and the anomalies that a change of mode reports (the guards are in cmec.py):",
            "",
            *lines,
            "```",
            "",
        ]
    )


def _readings() -> str:
    names = list(READINGS)
    lines = ["## The two readings", "", f"| parameter | {' | '.join(names)} |", "|---|" + "---|" * len(names)]
    for parameter in READINGS[names[0]]:
        cells = [_reading(READINGS[name][parameter]) for name in names]
        lines.append(f"| `{parameter}` | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _reading(value: float) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{math.degrees(value):g} deg"


if __name__ == "__main__":
    README.write_text(readme())
