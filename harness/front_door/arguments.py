"""The arguments of the functions, checked, and as the commands have them.

Raises: each function a UsageError that names the argument, what it is, and what is expected.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast

from harness.cosim.stepping import CALL_LIMIT_S, GIB, MEMORY_LIMIT_GIB, Limits
from harness.trial.scenario import Scenario, Written, toml_of
from models.errors import CanineError, UsageError

if TYPE_CHECKING:
    from harness.sweep.tls import Certificates

Progress = Callable[[float], None]
StrPath = str | Path
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

OPTION = re.compile(r"(?<![\w/'\"-])--([a-z][a-z-]*)(?![\w/])")
TOLD = {"notes", "assumes"}  # in a report, what is told in words
RENAMED = {  # options whose arguments have names of their own
    "set": "parameters", "from": "begin", "to": "end", "clearance": "clearances", "spacing": "spacings",
}  # fmt: skip


def named_from_python(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function, in whose errors and notes its arguments stand for the options of its command.

    `--vary x: expected a:b:step` becomes `vary x: expected a:b:step`. Commands in backticks, names in quotes
    and paths stay as they are, and so do options that the function does not have. A result's report is that
    of its file, but for its notes and what it assumes.
    """
    own = inspect.signature(function).parameters

    def argument(option: re.Match[str]) -> str:
        name = RENAMED.get(option[1], option[1].replace("-", "_"))
        return name if name in own else option[0]

    def renamed(text: str) -> str:
        parts = text.split("`")
        parts[::2] = [OPTION.sub(argument, part) for part in parts[::2]]
        return "`".join(parts)

    def told(result: Any) -> Any:
        texts: dict[str, Any] = {}
        for name in getattr(result, "__dataclass_fields__", ()):
            value = getattr(result, name)
            if name == "notes":
                texts[name] = tuple(map(renamed, value))
            elif isinstance(value, Mapping) and (keys := value.keys() & TOLD):
                texts[name] = {**value, **{key: [*map(renamed, value[key])] for key in keys}}
        return replace(result, **texts) if texts else result

    @wraps(function)
    def called(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        try:
            return cast(Result, told(function(*args, **kwargs)))
        except CanineError as error:
            error.args = tuple(renamed(each) if isinstance(each, str) else each for each in error.args)
            raise

    return called


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


def certificates_of(address: str | None, *paths: StrPath | None) -> Certificates:
    """The authority's certificate, this machine's, and its key, for the address of a cluster."""
    from harness.sweep.tls import Certificates, check_use  # noqa: PLC0415 - trials need not wait

    certificates = Certificates(*(None if path is None else Path(path) for path in paths))
    check_use(address, certificates)
    return certificates


def number_of(name: str, value: float, unit: str = "") -> float:
    """A number."""
    if not isinstance(value, Real):
        raise UsageError(f"{name} is {value!r}; expected a number" + (f", in {unit}" if unit else ""))
    return float(value)


def numbers_of(name: str, values: float | Sequence[float], unit: str) -> list[float]:
    """A number, or several."""
    if isinstance(values, Real):
        return [float(values)]
    if isinstance(values, str) or not isinstance(values, Sequence):
        raise UsageError(f"{name} is {values!r}; expected a number or a list of them, in {unit}")
    return [number_of(f"{name}[{place}]", value, unit) for place, value in enumerate(values)]


def names_of(name: str, values: Sequence[StrPath], example: str) -> list[str]:
    """Several names or paths as texts."""
    check_list(name, values, example)
    return [str(value) for value in values]
