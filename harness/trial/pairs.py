"""Pairs of vectors: a window has a start and an end after it, a point has a north and an east."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from harness.trial.scenario import ScenarioError
from models.kit.block import Block
from models.kit.declaration import Parameter
from models.system import BLOCKS

Window = tuple[str, int, float, float]


def windows(block: str, values: Mapping[str, float]) -> Iterator[Window]:
    """The windows that a block's parameters state: name of the start's vector, number, start and end.

    Args:
        block: its name outside of Python; of another's block there is none.
        values: by flat name; those that lack have their declared start.
    """
    for start, end in _pairs(block, "begins"):
        for i in range(start.width):
            begin = values.get(start.flat_names[i], start.start[i])
            until = values.get(end.flat_names[i], end.start[i])
            if (begin, until) != (start.start[i], end.start[i]):
                yield start.name, i + 1, begin, until


def check_windows(block: str, values: Mapping[str, float], where: str, varied: Collection[str] = ()) -> None:
    """Refuse a window that ends before it starts, or has a start and no end.

    Args:
        varied: flat names whose values are not known yet; their windows are not checked.

    Raises:
        ScenarioError: naming `where`, the window, and both of its ends.
    """
    ends = {start.name: end for start, end in _pairs(block, "begins")}
    for name, number, begin, until in windows(block, values):
        end = ends[name]
        pair = f"{name}[{number}]", f"{end.name}[{number}]"
        if until >= begin or any(flat in varied for flat in pair):
            continue
        unit = end.unit
        what = (
            f"{pair[1]} is not set"
            if until == end.start[number - 1]
            else f"{pair[1]} is {until:g} {unit}, before it"
        )
        raise ScenarioError(
            f"{where}: window {number} of {block}: {pair[0]} is {begin:g} {unit} and {what}; "
            f"expected {pair[1]} from {begin:g} {unit} on"
        )


def check_points(block: str, written: Collection[str], where: str) -> None:
    """Refuse a point of which one coordinate is set only.

    Args:
        written: flat names of the parameters that are set.

    Raises:
        ScenarioError: naming `where` and the coordinate that lacks.
    """
    for first, second in _pairs(block, "beside"):
        for names in zip(first.flat_names, second.flat_names, strict=True):
            lacking = [name for name in names if name not in written]
            if len(lacking) == 1:
                other = next(name for name in names if name in written)
                raise ScenarioError(
                    f"{where}: {block}.{other} is set and {block}.{lacking[0]} is not; set both, or neither"
                )


def is_paired(block: str, flat: str) -> bool:
    """Is this one end of a window?"""
    base = flat.partition("[")[0]
    return any(base in (start.name, end.name) for start, end in _pairs(block, "begins"))


def _pairs(block: str, kind: str) -> Iterator[tuple[Parameter, Parameter]]:
    """A block's pairs of a kind: the vector that is named, and the one that names it."""
    declared = next((known for known in BLOCKS if known.title() == block), Block)
    parameters = {p.name: p for p in declared.group("parameter") if isinstance(p, Parameter)}
    for parameter in parameters.values():
        if named := getattr(parameter, kind):
            yield parameters[named], parameter
