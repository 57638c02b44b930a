"""A parameter that a sweep varies: its values as written, and in SI."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from decimal import Decimal

from harness.sweep.table import THRESHOLD_COLUMN, name_of, plain
from harness.trial.plan import Interface, plan, si_value
from harness.trial.scenario import Scenario, ScenarioError, toml_of
from harness.trial.units import stated_unit
from models.errors import UsageError
from models.kit.declaration import Type, Variable

THRESHOLD = "cmec.moving_deviation"
MAX_POINTS = 10_000


class SweepError(UsageError):
    """A sweep's options are invalid."""


@dataclass(frozen=True)
class Axis:
    """A varied parameter.

    Attributes:
        column: its name in the table: its address, or `threshold_deg`.
        unit: of `written`; deg for angles.
        variable: `component.parameter`.
        written: the values as users write them.
        values: the values in SI.
        settings: the values as a scenario's settings, `cmec.guarded=true`.
    """

    column: str
    unit: str
    variable: str
    written: tuple[Decimal, ...]
    values: tuple[float, ...]
    settings: tuple[str, ...]

    @property
    def label(self) -> str:
        """Its name and unit in tables and pictures."""
        return name_of(self.column) + (f" [{self.unit}]" if self.unit else "")


def split_option(text: str) -> tuple[str, str, str]:
    """The option's text, the address and the range of `--vary`."""
    address, equals, values = text.partition("=")
    if not equals or not address.strip() or not values.strip():
        raise SweepError(f"--vary {text}: expected block.name=a:b:step, as in cmec.capture_radius=3:10:0.5")
    return f"--vary {text}", address.strip(), values.strip()


def variables_at(address: str, interfaces: Mapping[str, Interface]) -> list[str]:
    """`component.parameter` of an address; a vector's name stands for all its elements."""
    owner, _, name = address.partition(".")
    return [
        f"{component}.{flat}"
        for component, interface in interfaces.items()
        if owner in (component, *interface.names)
        for flat in interface.parameters
        if name in (flat, flat.partition("[")[0])
    ]


def axis_of(
    option: str, address: str, text: str, scenario: Scenario, interfaces: Mapping[str, Interface]
) -> Axis:
    """A varied parameter, each of whose values is checked as `--set` checks one."""
    what = option if option.startswith("--vary") else f"--thresholds {text}"
    written = _range(what, text)
    variables = variables_at(address, interfaces)
    if len(variables) != 1:
        if len(variables) > 1:
            raise SweepError(f"{what}: is a vector; vary one element, as in {address}[1]")
        alone = replace(scenario, name=what, parameters={address: float(written[0])}, sets=())
        plan(alone, interfaces)  # raises an error that names the nearest address
        raise SweepError(f"{what}: there is nothing to vary")
    component, _, name = variables[0].partition(".")
    variable = interfaces[component].parameters[name]
    if name == "seed":
        raise SweepError(f"{what}: each trial has its own seed; choose the first with --seed")
    try:
        values = tuple(si_value(_as_written(value, variable), variable, what) for value in written)
    except ScenarioError:
        for end, field in zip(("start", "end"), text.split(":"), strict=False):
            si_value(_as_written(_number(what, field), variable), variable, f"{what}: its {end}")
        raise
    is_threshold = variables == variables_at(THRESHOLD, interfaces)
    column = THRESHOLD_COLUMN if is_threshold else address
    settings = tuple(f"{variables[0]}={toml_of(_as_written(value, variable))}" for value in written)
    return Axis(column, stated_unit(variable.unit), variables[0], written, values, settings)


def _as_written(value: Decimal, variable: Variable) -> bool | int | float:
    """A value of a range as a scenario states it: 0 and 1 of a Boolean are false and true."""
    if variable.type is Type.BOOLEAN and value in (0, 1):
        return bool(value)
    return int(value) if value == int(value) else float(value)


def _range(what: str, text: str) -> tuple[Decimal, ...]:
    """The values of `a`, `a:b` or `a:b:step`, b too if a step falls on it.

    They are decimals, so that 0.1:0.3:0.1 has 0.3.
    """
    fields = text.split(":")
    if not text or len(fields) > 3:
        raise SweepError(f"{what}: expected a:b:step, as in 15:90:5")
    numbers = [_number(what, field) for field in fields]
    first, last, step = numbers[0], (*numbers, numbers[0])[1], (*numbers[2:], Decimal(1))[0]
    if step <= 0:
        raise SweepError(f"{what}: the step is {step}; expected more than 0")
    if last < first:
        raise SweepError(f"{what}: the range is empty, {first} is more than {last}; expected a:b with a <= b")
    if (last - first) / step >= MAX_POINTS:
        raise SweepError(f"{what}: has more than {MAX_POINTS} points; take larger steps")
    return tuple(first + k * step for k in range(int((last - first) / step) + 1))


def _number(what: str, text: str) -> Decimal:
    try:
        if math.isfinite(float(text)) and abs(float(text)) <= 1e12:
            return Decimal(text.strip())
    except (ValueError, ArithmeticError):
        pass
    raise SweepError(f'{what}: "{text}" is not a number; expected a:b:step, as in 15:90:5')


def span_of(axis: Axis) -> str:
    first, last = axis.written[0], axis.written[-1]
    step = f" in steps of {plain(axis.written[1] - first)}" if len(axis.written) > 1 else ""
    return f"{plain(first)} to {plain(last)} {axis.unit}".rstrip() + step
