"""Options that several commands have."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from codegen.firmware.targets import IN_THE_LOOP
from harness.cosim.stepping import CALL_LIMIT_S, MEMORY_LIMIT_GIB
from models.errors import UsageError
from models.kit.random import MAX_SEED

Seed = Annotated[int | None, typer.Option(min=0, max=MAX_SEED, help="the trial's number")]
Settings = Annotated[
    list[str] | None, typer.Option("--set", metavar="block.name=value", help="a parameter; angles in deg")
]
Plant = Annotated[
    str | None, typer.Option(metavar="NAME|X.fmu", help="one of ours, such as differential_drive, or an FMU")
]
Controller = Annotated[
    str | None, typer.Option(metavar="NAME|X.fmu", help="one of ours, such as quarter_turn, or an FMU")
]
Estimator = Annotated[
    str | None, typer.Option(metavar="NAME|X.fmu", help="one of ours, such as six_state, or an FMU")
]
Ahrs = Annotated[
    bool,
    typer.Option(
        "--ahrs",
        help="put canine_ahrs between sensors and estimator; canine_tracker then leads less often "
        "(`canine study leading`)",
    ),
]
Onboard = Annotated[
    str | None,
    typer.Option(
        metavar="fmu|pil:TARGET",
        help=f"pil: firmware on a processor ({', '.join(IN_THE_LOOP)}) for estimator and controller",
    ),
]
Fmi = Annotated[Literal["2", "3"] | None, typer.Option(help="version of our FMUs; 2 by default")]
Foxglove = Annotated[
    int | None,
    typer.Option(
        metavar="PORT",
        min=0,
        max=65535,
        help="show it live to Foxglove or Lichtblick (1.26 or newer); they look at 8765",
    ),
]
CallLimit = Annotated[
    float,
    typer.Option(
        min=CALL_LIMIT_S[0], max=CALL_LIMIT_S[1], help="s that one call of an FMU made elsewhere may take"
    ),
]
MemoryLimit = Annotated[
    float,
    typer.Option(
        min=MEMORY_LIMIT_GIB[0],
        max=MEMORY_LIMIT_GIB[1],
        help="GiB that all FMUs may take, if one was made elsewhere",
    ),
]


def listed(text: str) -> list[str]:
    """The parts of an option's text with commas between them; an empty one stays, for its user to refuse."""
    return [part.strip() for part in text.split(",")]


def numbers(option: str, text: str, unit: str) -> list[float]:
    """The numbers of an option's text with commas between them.

    Raises:
        UsageError: a part is no number.
    """
    return [number(option, part, unit) for part in listed(text)]


def number(option: str, text: str, unit: str) -> float:
    """The number of a text.

    Raises:
        UsageError: it is none.
    """
    try:
        return float(text)
    except ValueError:
        raise UsageError(f'{option} "{text}": expected a number, in {unit}') from None
