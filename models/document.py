"""`python -m models.document` writes models/README.md from the declarations."""

from __future__ import annotations

import math
from enum import IntEnum
from pathlib import Path

from models import glossary, sets
from models.cmec import Cmec
from models.kit.block import Block
from models.kit.declaration import Parameter, Type, Variable
from models.kit.tracing import Table
from models.leader import Leader
from models.readings import READINGS
from models.sets import DOGS, LEADERS
from models.seven_state import TUNINGS, SevenState
from models.system import BLOCKS, SYSTEMS

README = Path(__file__).with_name("README.md")
INTRODUCTION = """# The models

Each block is one file, with the dissertation's equations in their order; every equation names its number.
`kit/` is what blocks are declared with, `system.py` links them, and `readings.py` holds the readings of
what the text leaves open. [CHOICES.md](CHOICES.md) lists where the text errs or is silent, and what is done.
Angles are in rad here and in the FMUs, in degrees at the command line and in scenarios.

A block is a class that declares its variables, one to a line. Its public methods are the updates of a tick,
in their order. The class gives the C, the FMUs, the log's schema, this page, and the reference in Python:

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

`python -m models.document` makes this page.
"""
CONDITIONS = """The controller is *blocked* by a lost link, an operator's command, bad input or an invalid
estimate. The animal is *at rest* when the stop command has lasted DELAYTHRESH and the speed is below V'.

These are the rows of `decide`. In each mode the first row that holds is carried out; if none holds, the mode
stays. |h| is the size of h, and h'' in force is at most h' with `limit_stop_deviation`.
"""
AS_CMEC = """These are the rows of `decide`. The words are those of [cmec](#cmec).
"""
ARROWS = """All changes of the mode: those of `decide` with the anomalies that they may report,
the others with the update that makes them.
"""


def readme() -> str:
    """The page: words, the variables and the tick of every block, the controller's table, the readings."""
    parts = [INTRODUCTION, glossary.page()]
    for block in BLOCKS:
        parts += [_block(block), _tick(block)]
        if block is Cmec:
            parts += [CONDITIONS, _rows(block), ARROWS, _diagram(block)]
        if issubclass(block, Leader):
            parts += [AS_CMEC, _rows(block), ARROWS, _diagram(block)]
        if block is SevenState:
            parts.append(_tunings())
    return "\n".join([*parts, _readings(), _sets()])


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


def _tick(block: type[Block]) -> str:
    """The updates in their order, and when each runs."""
    program = block.program()
    lines = ["| update | when | what it does |", "|---|---|---|"]
    for phases, always in ((program.initialize, "at the start"), (program.tick, "every tick")):
        for phase in phases:
            if always == "every tick" or phase.name.startswith("initialize"):
                when = phase.when if always == "every tick" else f"at the start, {phase.when}"
                cells = [f"`{phase.name}`", when if phase.guard else always, phase.doc.partition("\n")[0]]
                lines.append(_cells(cells))
    return "\n".join([*lines, ""])


def _cells(cells: list[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


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


def _rows(block: type[Block]) -> str:
    """The rows of a state machine."""
    modes, anomalies = _choices(block, "now"), _choices(block, "anomaly")
    lines = ["| in | when | to | reports |", "|---|---|---|---|"]
    for phase in block.program().tick:
        if isinstance(phase, Table):
            for row in phase.rows:
                report = anomalies(row.anomaly).name if row.anomaly else ""
                lines.append(_cells([modes(row.mode).name, row.when, modes(row.next).name, report]))
    return "\n".join([*lines, ""])


def _diagram(block: type[Block]) -> str:
    """The state machine, drawn from its rows and from the updates that beat them."""
    modes, anomalies = _choices(block, "now"), _choices(block, "anomaly")
    arrows: dict[tuple[int, int, str], set[str]] = {}
    for phase in block.program().tick:
        if isinstance(phase, Table):
            for row in phase.rows:
                label = anomalies(row.anomaly).name.replace("_", " ") if row.anomaly else ""
                arrows.setdefault((row.mode, row.next, ""), set()).add(label)
        else:
            for source, target in phase.edges:
                arrows[source, target, phase.name] = {phase.name}
    entered = {target for _, target, _ in arrows}  # the others' modes are not this machine's
    lines = ["```mermaid", "stateDiagram-v2"]
    for (source, target, _), labels in sorted(arrows.items()):
        if source not in entered:
            continue
        label = ", ".join(sorted(filter(None, labels)))
        lines.append(f"    {modes(source).name} --> {modes(target).name}" + (f": {label}" if label else ""))
    return "\n".join([*lines, "```", ""])


def _choices(block: type[Block], variable: str) -> type[IntEnum]:
    choices = block.variables()[variable].choices
    assert choices
    return choices


def _readings() -> str:
    names = list(READINGS)
    lines = ["## The readings", "", f"| parameter | {' | '.join(names)} |", "|---|" + "---|" * len(names)]
    for parameter in dict.fromkeys(p for name in names for p in READINGS[name]):
        block, _, name = parameter.partition(".")
        unit = {b.title(): b for b in BLOCKS}[block].variables()[name].unit
        cells = [_reading(READINGS[name].get(parameter), unit) for name in names]
        lines.append(f"| `{parameter}` | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _sets() -> str:
    """The sets of dog and controller; those of sensors and pack are many numbers, and stand in their file."""
    lines = ["## The sets", "", (sets.__doc__ or "").partition("\n\n")[2]]
    lines += ["| set | component | parameters |", "|---|---|---|"]
    for name, parts in (DOGS | LEADERS).items():
        for component, values in parts.items():
            block = SYSTEMS["full"].components[component]
            cells = (f"`{n}` {_reading(x, block.variables()[n].unit)}" for n, x in values.items())
            lines.append(_cells([name, component, ", ".join(cells)]))
    return "\n".join([*lines, ""])


def _tunings() -> str:
    """The two columns of Table C.1."""
    lines = ["| Table C.1, C.9, C.11 | " + " | ".join(TUNINGS) + " |", "|---|" + "---|" * len(TUNINGS)]
    for parameter in TUNINGS["canine"]:
        lines.append(_cells([f"`{parameter}`", *(f"{tuning[parameter]:g}" for tuning in TUNINGS.values())]))
    return "\n".join([*lines, ""])


def _reading(value: float | None, unit: str) -> str:
    if value is None:
        return "as it starts"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{math.degrees(value):g} deg" if unit == "rad" else f"{value:g} {unit}"


if __name__ == "__main__":
    README.write_text(readme())
