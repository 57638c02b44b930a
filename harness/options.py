"""Options that several commands have."""

from __future__ import annotations

from typing import Annotated

import typer

from models.kit.random import MAX_SEED

Seed = Annotated[int | None, typer.Option(min=0, max=MAX_SEED, help="the trial's number")]
Settings = Annotated[
    list[str] | None, typer.Option("--set", metavar="block.name=value", help="a parameter; angles in deg")
]
