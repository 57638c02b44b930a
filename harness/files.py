"""Results in files: folders that are made, files that are written whole or not at all."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from codegen import files
from codegen.scratch import Scratch
from models.errors import CanineError, UsageError

SHOWN_FILES = 5  # at most, in a hint
DIFFERENCES = 5  # named one by one at most
LONGEST = 60  # characters of a value that is named
OTHERS = {"pyproject.toml"}  # of a kind that is ours, and never meant


class FileError(CanineError):
    """A file of results that cannot be written."""


def make_folder(out: Path) -> None:
    """Make the folder for results.

    Raises:
        UsageError: it cannot be made, or written into.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"--out {out}: the folder cannot be made ({error.strerror}); choose another folder"
        ) from error
    if not os.access(out, os.W_OK | os.X_OK):
        raise UsageError(f"--out {out}: the folder cannot be written into; choose another folder")


def remove_folder(folder: Path) -> None:
    """Remove a folder of results.

    Raises:
        FileError: it cannot be removed.
    """
    try:
        shutil.rmtree(folder)
    except OSError as error:
        raise FileError(
            f"{folder}: cannot be removed ({error.strerror}); remove it, or choose another folder"
        ) from error


def replaced(path: Path, new: Mapping[str, Any]) -> str:
    """How the results that a JSON file holds differ from new ones of these properties; "" if they do not.

    Properties that the file does not state, as those of an earlier version, count as the same.
    """
    try:
        held = json.loads(path.read_text())
    except (FileNotFoundError, NotADirectoryError):
        return ""
    except (OSError, ValueError, RecursionError):
        held = None
    if not isinstance(held, dict):
        return f"{path.name} is not of canine"
    shared = {key: value for key, value in new.items() if key in held}
    named = list(differences({key: held[key] for key in shared}, shared))
    more = f" and {len(named) - DIFFERENCES} more" if len(named) > DIFFERENCES else ""
    return ", ".join(named[:DIFFERENCES]) + more


def differences(held: Mapping[str, Any], new: Mapping[str, Any], within: str = "") -> Iterator[str]:
    """What differs between two results' properties, such as `trials: 1000, now 100`.

    Args:
        within: what both are part of, with a point at its end.
    """
    for name, before, now in changes(held, new, within):
        yield f"{name}: {in_words(before)}, now {in_words(now)}"


def changes(
    held: Mapping[str, Any], new: Mapping[str, Any], within: str = ""
) -> Iterator[tuple[str, Any, Any]]:
    """The properties that differ, those of a mapping one by one: name, value before (None if none), now."""
    for key in {**new, **held}:
        before, now, name = held.get(key), new.get(key), f"{within}{key}"
        if isinstance(before, Mapping | None) and isinstance(now, Mapping | None):
            yield from changes(before or {}, now or {}, f"{name}.")
        elif before != now:
            yield name, before, now


def in_words(value: object) -> str:
    """A property's value as it is named in a note, cut if it is long."""
    if value is None:
        return "none"
    text = ""
    for part in [value] if isinstance(value, str) else json.JSONEncoder(ensure_ascii=False).iterencode(value):
        text += part
        if len(text) > LONGEST:  # the rest may be as large as a file
            break
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def write_whole(path: Path, data: bytes) -> None:
    """Write a file whole or not at all.

    Raises:
        FileError: it cannot be written; what was there before still is.
    """
    try:
        files.write_whole(path, data)
    except OSError as error:
        raise FileError(
            f"{path}: cannot be written ({error.strerror}); make room, or choose another folder"
        ) from error


def write_set(folder: Path, contents: Mapping[str, bytes], others: Iterable[str] = ()) -> None:
    """Write files that belong together into a folder, and make it if need be.

    All are made before the earlier ones go, and are then put in their places in this order: whenever it ends,
    no file stands beside one of an earlier set.

    Args:
        contents: by file name.
        others: names of files that a set may have, and this one has not.

    Raises:
        UsageError: the folder cannot be made, or written into.
        FileError: a file cannot be written or removed.
    """
    make_folder(folder)
    for name in {*contents, *others}:
        if os.path.isdir(folder / name):  # unlike Path.is_dir, it raises nothing
            raise FileError(f"{folder / name}: is a folder; remove it, or choose another folder")
    try:
        with Scratch(beside=folder) as parts:
            for name, content in contents.items():
                (parts / name).write_bytes(content)
            for name in dict.fromkeys((*others, *contents)):
                (folder / name).unlink(missing_ok=True)
            for name in contents:
                (parts / name).replace(folder / name)
    except OSError as error:
        name = Path(error.filename or "").name
        place = folder / name if name in {*contents, *others} else folder  # the scratch folder is gone
        raise FileError(
            f"{place}: cannot be written ({error.strerror}); make room, or choose another folder"
        ) from error


def is_pipe(path: Path) -> bool:
    """Is it a pipe or a device? To open one may wait for ever for its writer."""
    return path.exists() and not path.is_file() and not path.is_dir()


def nearest_file(path: Path) -> str:
    """A hint at the files of a missing one's kind that are in its folder; "" if none is."""
    if not path.parent.is_dir():
        return f'; there is no folder "{path.parent}"'
    try:
        names = sorted(
            p.name
            for p in path.parent.iterdir()
            if p.suffix == path.suffix and p.name not in OTHERS and p.is_file()
        )
    except OSError:
        return ""
    close = get_close_matches(path.name, names, n=1) or (names if len(names) == 1 else [])
    if close:
        return f'; did you mean "{path.with_name(close[0])}"?'
    more = ", ..." if len(names) > SHOWN_FILES else ""
    return f"; there are {', '.join(names[:SHOWN_FILES])}{more}" if names and path.suffix else ""
