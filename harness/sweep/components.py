"""What takes the places of plant, controller and estimator: blocks of ours by name, or FMUs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fmus.folder import build_folder, is_current
from harness.sweep.cosimulated import ForeignFmu
from harness.trial.replacements import OURS, find_replacement
from harness.trial.scenario import Scenario
from models.system import CONTROLLER, System, find_system


@dataclass(frozen=True)
class Components:
    """What takes which role's place.

    Attributes:
        swaps: by role, the name of one of ours, or an FMU.
        names: by role, as it was named.
    """

    swaps: Mapping[str, str | ForeignFmu]
    names: Mapping[str, str]

    def __or__(self, others: Components) -> Components:
        return Components({**self.swaps, **others.swaps}, {**self.names, **others.names})

    @property
    def fmus(self) -> dict[str, str]:
        """The FMUs that others built, by role, as they were named."""
        return {role: self.names[role] for role, part in self.swaps.items() if isinstance(part, ForeignFmu)}

    @property
    def foreign(self) -> bool:
        """Is there an FMU that others built?"""
        return bool(self.fmus)

    def system(self, scenario: Scenario) -> System:
        """The scenario's system with our blocks in it."""
        plant, controller = self.block("plant") or scenario.plant, self.block("controller") or CONTROLLER
        return find_system(scenario.system, scenario.estimator, plant, controller)

    @property
    def blocks(self) -> dict[str, str]:
        """The names of our blocks, by role."""
        return {role: part for role, part in self.swaps.items() if isinstance(part, str)}

    def block(self, role: str) -> str | None:
        """The name of our block in a role's place; None for an FMU, or if nothing was named."""
        return self.blocks.get(role)


def find_components(**names: str | Path | None) -> Components:
    """The components of these names, by role; None leaves a role's place as it is.

    An FMU of ours by its path, current and without a mapping file, is our block.

    Raises:
        UsageError: there is no such block or file.
    """
    swaps: dict[str, str | ForeignFmu] = {}
    for role, name in names.items():
        if name is None:
            continue
        part = find_replacement(role, name)
        swaps[role] = part if isinstance(part, str) else _own_block(part, role) or ForeignFmu.of(part)
    return Components(swaps, {role: str(name) for role, name in names.items() if name is not None})


def _own_block(path: Path, role: str) -> str | None:
    """The block whose FMU this is, if it is one of ours as the models are now."""
    if path.with_suffix(".toml").exists() or not is_current():
        return None
    content = path.read_bytes()
    for version in (2, 3):
        for name in OURS[role]:
            own = build_folder() / f"fmi{version}" / f"{name}.fmu"
            if own.is_file() and own.stat().st_size == len(content) and own.read_bytes() == content:
                return name
    return None
