"""A scenario's parameters as the firmware takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from codegen.firmware.bundle import BLOCKS, settable
from harness.onboard import ROLES
from harness.onboard.tones import commands
from harness.trial.plan import Interface, interfaces_of_system, plan
from harness.trial.scenario import Scenario, load
from models.errors import UsageError
from models.kit.declaration import flatten
from models.kit.link import Values
from models.system import SYSTEMS


def interfaces_on_board() -> dict[str, Interface]:
    """The interfaces of the onboard program's own components, those that no role has."""
    return {
        component: Interface(
            block.title(), dict(flatten(list(settable(block).values()))), {}, f"{component} {block.title()}"
        )
        for component, block in BLOCKS.items()
        if component not in ROLES
    }


def values_on_board(scenario: str, settings: Sequence[str]) -> Values:
    """The firmware's parameters (SI), by component and flat name.

    Args:
        scenario: the file of a scenario, waypoints or not, or the name of a shipped one; "" for start values.
        settings: `block.name=value` over it.

    Raises:
        ScenarioError: it cannot be read, or a parameter does not exist or is out of its range.
        UsageError: the firmware lacks the parameter of a setting, or two commands sound alike.
    """
    interfaces = interfaces_of_system(SYSTEMS["full"]) | interfaces_on_board()
    written = (load(scenario, mission=False) if scenario else Scenario("--set")).override(settings)
    values = plan(written, interfaces).values
    for setting in settings:
        owner, _, name = setting.partition("=")[0].strip().partition(".")
        if not any(
            owner in (component, block.title()) and name in settable(block)
            for component, block in BLOCKS.items()
        ):
            raise UsageError(
                f"--set {owner}.{name}: not in the firmware, whose blocks are {', '.join(BLOCKS)}; "
                "waypoints and home come by radio"
            )
    commands(values["command_module"])
    return firmware_values(values)


def firmware_values(values: Mapping[str, Mapping[str, float]]) -> Values:
    """Those of all components' values that are parameters of the firmware."""
    return {
        component: {n: x for n, x in values.get(component, {}).items() if n in settable(block)}
        for component, block in BLOCKS.items()
    }
