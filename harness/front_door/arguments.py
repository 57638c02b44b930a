"""The arguments of the functions, checked, and as the commands have them.

Raises: each function a UsageError that names the argument, what it is, and what is expected.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING

from harness.cosim.stepping import CALL_LIMIT_S, GIB, MEMORY_LIMIT_GIB, Limits
from harness.trial.scenario import Scenario, Written, toml_of
from models.errors import UsageError

if TYPE_CHECKING:
    from harness.sweep.tls import Certificates

Progress = Callable[[float], None]
StrPath = str | Path


def target_of(scenario: StrPath | Scenario) -> str | Scenario:
    """What a command takes: a scenario that was made in Python, a name, or a path."""
    return scenario if isinstance(scenario, Scenario) else str(scenario)


def check_choice(name: str, value: object, choices: Sequence[object]) -> None:
    """Refuse what is neither None nor one of some choices."""
    if value is not None and value not in choices:
        raise UsageError(f"{name} is {value!r}; expected one of {', '.join(map(repr, choices))}")


def check_type(name: str, value: object, kind: type, expected: str) -> None:
    """Refuse what is neither None nor of a type."""
    if value is not None and not isinstance(value, kind):
        raise UsageError(f"{name} is {value!r}; expected {expected}")


def check_count(name: str, value: object, least: int = 1) -> None:
    """Refuse all but whole numbers from `least` on."""
    if not isinstance(value, Integral) or int(value) < least:
        raise UsageError(f"{name} is {value!r}; expected a whole number from {least} on")


def check_list(name: str, value: object, expected: str) -> None:
    """Refuse all but lists."""
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise UsageError(f"{name} is {value!r}; expected a list, {expected}")


def check_range(name: str, value: object, unit: str, bounds: tuple[float, float]) -> None:
    """Refuse all but numbers within bounds."""
    low, high = bounds
    if not isinstance(value, Real) or not low <= float(value) <= high:
        shown = f"{float(value):g} {unit}" if isinstance(value, Real) else repr(value)
        raise UsageError(f"{name} is {shown}; expected a number from {low:g} to {high:g} {unit}")


def settings_of(parameters: Mapping[str, Written] | None) -> Sequence[str]:
    """Parameters as `--set` has them."""
    check_type("parameters", parameters, Mapping, 'a mapping, {"cmec.moving_deviation": 37}')
    return [f"{name}={toml_of(value, name)}" for name, value in (parameters or {}).items()]


def text_of(name: StrPath | None) -> str | None:
    """A name or a path as text."""
    return None if name is None else str(name)


def name_of(name: str, value: StrPath, expected: str) -> str:
    """A name or a path as text, where there must be one."""
    if not isinstance(value, str | Path):
        raise UsageError(f"{name} is {value!r}; expected {expected}")
    return str(value)


def limits_of(call: float, memory: float) -> Limits:
    """The limits for FMUs of others, checked."""
    check_range("call_limit", call, "s", CALL_LIMIT_S)
    check_range("memory_limit", memory, "GiB", MEMORY_LIMIT_GIB)
    return Limits(call=call, memory=int(memory * GIB))


def certificates_of(*paths: StrPath | None) -> Certificates:
    """The authority's certificate, this machine's, and its key."""
    from harness.sweep.tls import Certificates  # noqa: PLC0415 - trials need not wait

    return Certificates(*(None if path is None else Path(path) for path in paths))


def check_number(name: str, value: object) -> None:
    """Refuse all but numbers."""
    if not isinstance(value, Real):
        raise UsageError(f"{name} is {value!r}; expected a number")


def number_of(name: str, value: float, unit: str) -> float:
    """A number."""
    if not isinstance(value, Real):
        raise UsageError(f"{name} has {value!r}; expected a number, in {unit}")
    return float(value)


def numbers_of(name: str, values: float | Sequence[float], unit: str) -> list[float]:
    """A number, or several."""
    if isinstance(values, Real):
        return [float(values)]
    if isinstance(values, str) or not isinstance(values, Sequence):
        raise UsageError(f"{name} is {values!r}; expected a number or a list of them, in {unit}")
    return [number_of(name, value, unit) for value in values]


def names_of(name: str, values: Sequence[StrPath], example: str) -> list[str]:
    """Several names or paths as texts."""
    check_list(name, values, example)
    return [str(value) for value in values]
