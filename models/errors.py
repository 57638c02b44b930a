"""Every error a user can cause, one class per kind, all under `CanineError`."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class CanineError(Exception):
    """What, which, got, expected, what to do: one line that a user can act on."""


class DeclarationError(CanineError):
    """A block is declared in a way that cannot be carried out."""


class WiringError(CanineError):
    """Outputs and inputs do not fit together."""


class UsageError(CanineError):
    """Wrong usage: a request names something that does not exist, or makes no sense."""


class ParameterError(UsageError):
    """A parameter is unknown, of the wrong type or out of its range."""


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint `; did you mean "..."?` with the nearest known name, or the list of them if none is near."""
    known = list(known)
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    if close:
        return f'; did you mean "{close[0]}"?'
    return f"; known: {', '.join(sorted(known))}" if known else ""


def printable(text: object) -> str:
    """A text that a file gave, on one line: what cannot be printed is escaped."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in str(text))
