"""What takes the place of a role's block: one of ours by its name, or an FMU by its path."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from harness.files import nearest_file
from models.canine_ahrs import CanineAhrs
from models.errors import UsageError, nearest
from models.kit.block import Block
from models.system import CONTROLLERS, ESTIMATORS, PLANTS, find_estimator

OURS: dict[str, Mapping[str, type[Block]]] = {  # by role and name
    "plant": PLANTS,
    "controller": CONTROLLERS,
    "estimator": ESTIMATORS,
}


def find_replacement(role: str, name: str | Path) -> str | Path:
    """The name of one of ours, or the path of an FMU.

    Raises:
        UsageError: it is neither.
    """
    text, path, ours = str(name), Path(str(name)), OURS.get(role, {})
    if text in ours:
        return text
    if path.suffix == ".toml":
        fmu = path.with_suffix(".fmu")
        raise UsageError(f'"{name}" is no FMU; a mapping file is read beside its FMU: expected "{fmu}"')
    if os.path.isfile(path):  # unlike Path's, it raises nothing
        return path
    if text == CanineAhrs.title():
        find_estimator(text)  # raises an error that says what it is for
    expected = "expected the path of an FMU, or the name of one of ours"
    if os.path.isdir(path):
        raise UsageError(f'"{name}" is a folder; {expected}')
    if path.suffix == ".fmu":
        raise UsageError(f'there is no FMU "{name}"{nearest_file(path)}')
    raise UsageError(f'there is no {role} "{name}"; {expected}{nearest(text, ours)}')
