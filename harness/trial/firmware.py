"""A scenario's parameters as the firmware takes them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from codegen.firmware.bundle import settable
from codegen.firmware.navigation import DEFAULT, Navigation
from harness.onboard import ROLES
from harness.onboard.tones import commands
from harness.trial.plan import Interface, interfaces_of_system, plan
from harness.trial.scenario import Scenario, load
from models.errors import UsageError
from models.kit.declaration import flatten
from models.kit.link import Values
from models.readings import ON_BOARD
from models.system import System, find_system


def interfaces_on_board() -> dict[str, Interface]:
    """The interfaces of the onboard program's own components, those that no system has."""
    return {
        component: Interface(
            block.title(), dict(flatten(list(settable(block).values()))), {}, f"{component} {block.title()}"
        )
        for component, block in DEFAULT.blocks.items()
        if component not in ROLES
    }


def navigation_of(system: System) -> Navigation:
    """The estimator of a system, and what comes before it, as the firmware has them."""
    return Navigation(system.components["estimator"], system.components.get("ahrs"))


def firmware_of(
    scenario: str,
    settings: Sequence[str],
    estimator: str | None = None,
    *,
    ahrs: bool = False,
    note: Callable[[str], None] = lambda text: None,
) -> tuple[Navigation, Values]:
    """The firmware's estimator, and its parameters (SI) by component and flat name.

    Args:
        scenario: the file of a scenario, waypoints or not, or the name of a shipped one; "" for start values.
            Without a reading of its own it has ON_BOARD, the one with limits.
        settings: `block.name=value` over it.
        estimator: its name; None for the scenario's.
        ahrs: with the AHRS before it, even if the scenario has none.
        note: is told what of the scenario is not built in: the mission and orders, which the operator sends
            by radio, faults, and the streets and poles of the simulated dog.

    Raises:
        ScenarioError: it cannot be read, or a parameter does not exist or is out of its range.
        UsageError: there is no such estimator, the firmware lacks the parameter of a setting, or two commands
            sound alike.
    """
    written = load(scenario, mission=False) if scenario else Scenario("--set")
    if mission := [name for name in ("waypoints", "fence") if getattr(written, name)]:
        note(f"{scenario}: {' and '.join(mission)} are not built in; the operator's MISSION sends them")
    if written.sets:
        note(f"{scenario}: its [[set]] are not built in; the operator orders by radio")
    if written.faults:
        note(f"{scenario}: its [[fault]] are not built in; a trial has them, `canine run --onboard`")
    if ground := [f"[[{name}]]" for name in ("street", "pole") if getattr(written, f"{name}s")]:
        note(
            f"{scenario}: its {' and '.join(ground)} are not built in: they are the simulated dog's world, "
            "of which the vest knows nothing; a trial has them, `canine run --onboard`"
        )
    written = replace(written, reading=written.reading or ON_BOARD)
    name = "full_ahrs" if ahrs or written.system == "full_ahrs" else "full"
    system = find_system(name, estimator or written.estimator, written.plant)
    written = replace(written, system=name, estimator=estimator or written.estimator).override(settings)
    navigation = navigation_of(system)
    values = plan(written, interfaces_of_system(system) | interfaces_on_board()).values
    for setting in settings:
        owner, _, name = setting.partition("=")[0].strip().partition(".")
        if not any(
            owner in (component, block.title()) and (not name or name in settable(block))
            for component, block in navigation.blocks.items()
        ):
            raise UsageError(
                f"--set {setting}: not in the firmware, whose blocks are "
                f"{', '.join(navigation.blocks)}; waypoints and home come by radio"
            )
    commands(values["command_module"])
    return navigation, firmware_values(values, navigation)


def firmware_values(values: Mapping[str, Mapping[str, float]], navigation: Navigation) -> Values:
    """Those of all components' values that are parameters of the firmware."""
    return {
        component: {n: x for n, x in values.get(component, {}).items() if n in settable(block)}
        for component, block in navigation.blocks.items()
    }
