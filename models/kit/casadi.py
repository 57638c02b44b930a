"""CasADi, imported when it is first used: declarations are read without it, only tracing needs it."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    if name.startswith("__"):  # questions about this module, such as whether it is a package
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module("casadi"), name)
    return value


def __dir__() -> list[str]:
    return dir(import_module("casadi"))
