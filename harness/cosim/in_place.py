"""Swapped FMUs that a package brings in their places, each with the mapping file beside it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

from harness.cosim.fmu import FmuDescription
from harness.cosim.rename import Rename
from harness.cosim.roles import Adapter, Fit, RoleError, find_role, fit, read_adapter, roles
from harness.cosim.ssp import FmuSystem, ScaledLink


def adapters_in(system: FmuSystem) -> dict[str, Adapter]:
    """The mapping files of a package, by the role of the component.

    Raises:
        RoleError: one is no mapping file of its role.
    """
    known = roles()
    adapters = {
        name: read_adapter(component.fmu, known[name])
        for name, component in system.components.items()
        if name in known
    }
    return {name: adapter for name, adapter in adapters.items() if adapter.path.is_file()}


def fit_in_place(
    system: FmuSystem, fmus: Mapping[str, FmuDescription], others: Collection[str] = ()
) -> tuple[FmuSystem, dict[str, Fit]]:
    """The system with the roles' names of outputs in its links, and how its mapped FMUs fit, by role.

    Args:
        others: roles that other FMUs are to take.

    Raises:
        RoleError: an FMU does not fit its role, or a mapping file is wrong.
    """
    fits = {
        role: fit(fmus[role], find_role(role), adapter, adapter.outputs)
        for role, adapter in adapters_in(system).items()
        if role not in others
    }
    if problems := [problem for fitted in fits.values() for problem in fitted.problems]:
        raise RoleError("\n".join(problems))
    links = tuple(
        _by_role(link, fits[link.source].outputs) if link.source in fits else link for link in system.links
    )
    return replace(system, links=links), fits


def _by_role(link: ScaledLink, outputs: Mapping[str, Rename]) -> ScaledLink:
    """The link with the role's name of its output; of several, the one that the target bears."""
    names = [name for name, rename in outputs.items() if rename.name == link.source_variable]
    name = link.target_variable if link.target_variable in names else next(iter(names), "")
    return link if name == link.source_variable else replace(link, output=name)
