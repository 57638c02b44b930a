"""Wrong usage in one line: which command or option, what it got, what it expects.

`typer` finds what is wrong, and says it in four lines of its own; these are ours. Imported only when there is
something to say.
"""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from harness.files import nearest_file
from models.errors import nearest


def line_of(error: Any, program: Any, arguments: Sequence[str]) -> str:
    """The line for an error that typer raised.

    Args:
        error: one of typer's own.
        program: the group of commands that raised it.
        arguments: the command line without the program's name.
    """
    name = next((argument for argument in arguments if not argument.startswith("-")), "")
    command: Any = program.commands.get(name, program)
    who = f"{command.name} has" if command is not program else "there is"
    if hasattr(error, "possibilities"):
        if command is program:
            having = [c.name for c in program.commands.values() if _has(c, error.option_name)]
            if having:
                option = error.option_name
                return f'"{option}" stands after the command, as in `canine {having[0]} {option}`'
        known = [option for p in command.params for option in p.opts if option.startswith("--")]
        return f'{who} no option "{error.option_name}"{nearest(error.option_name, {*known, "--help"})}'
    if hasattr(error, "option_name"):
        return _misused(error, command)
    parameter = getattr(error, "param", None)
    if hasattr(error, "param_type"):
        what = f"; expected {expected(parameter)}" if _is_option(parameter) else ""
        return f"{command.name} lacks {_title(parameter)}{what}{_example(command)}"
    if parameter is not None:
        return _refused(error, parameter)
    if command is program:
        return f'there is no command "{name}"{nearest(name, program.commands)}'
    extra = re.search(r"argument\(s\) \((.*)\)$", error.format_message(), re.DOTALL)
    if extra:
        return _too_many(command, extra[1])
    return _one_line(f"{command.name}: {error.format_message()}")


def expected(parameter: Any) -> str:
    """What an option or argument expects, in words."""
    kind, info = parameter.type_descriptor.annotation, parameter.type_descriptor.parameter_info
    if get_origin(kind) is Literal:
        return f"one of {', '.join(get_args(kind))}"
    if kind in (int, float):
        words = "a whole number" if kind is int else "a number"
        words += "" if info.min is None else f" from {info.min:.10g}"
        words += "" if info.max is None else f" to {info.max:.10g}"
        return words if kind is int or not info.help else f"{words}, {info.help.partition(';')[0]}"
    if info.metavar:
        return str(info.metavar)
    if kind is Path:
        return "a folder" if not info.file_okay else "a file"
    about = info.help or ""
    return str(about) if about.startswith("one of") else "a text" + (f", {about}" if about else "")


def _has(command: Any, option: str) -> bool:
    return any(option in parameter.opts for parameter in command.params)


def _is_option(parameter: Any) -> bool:
    return str(parameter.opts[0]).startswith("-")


def _title(parameter: Any) -> str:
    """`--option`, or an argument as the help has it."""
    name = str(parameter.opts[0])
    return name if _is_option(parameter) else parameter.metavar or name.upper()


def _example(command: Any) -> str:
    """The first example of a command's help."""
    example = re.search(
        rf"^ *(canine {re.escape(command.name)} .*?)(  .*)?$", command.help or "", re.MULTILINE
    )
    return f", as in `{example[1].strip()}`" if example else ""


def _misused(error: Any, command: Any) -> str:
    """An option without its value, or a switch with one."""
    parameter = next((p for p in command.params if error.option_name in p.opts), None)
    if parameter is None or not parameter.is_flag:
        what = f"; expected {expected(parameter)}" if parameter else ""
        return f"{error.option_name} has no value{what}"
    return f"{error.option_name} has a value; expected none, it is a switch"


def _too_many(command: Any, extra: str) -> str:
    """Arguments beyond those that a command has."""
    if "=" in extra and _has(command, "--set"):
        return f'{command.name} has no argument for "{extra}"; did you mean --set {extra}?'
    known = " ".join(_title(p) for p in command.params if not _is_option(p))
    return f'{command.name} has no argument for "{extra}"; expected {known or "none"}'


def _refused(error: Any, parameter: Any) -> str:
    """A value of the wrong kind, out of its range, or a path that is not what it must be."""
    descriptor = parameter.type_descriptor
    if descriptor.annotation is Path:
        quoted = re.search(r"'(.*)'", error.message)
        path = Path(quoted[1]) if quoted else Path()
        where = f"{_title(parameter)}: " if _is_option(parameter) else ""
        if "not readable" in error.message:
            return f'{where}"{path}" cannot be read; you lack the permission'
        if not os.path.exists(path):  # unlike Path's, it takes names of any length
            return f'{where}there is no "{path}"{nearest_file(path)}'
        is_what = "a folder; expected a file" if path.is_dir() else "a file; expected a folder"
        return f'{where}"{path}" is {is_what}'
    value = _value(error)
    if value is None:
        return _one_line(f"{_title(parameter)}: {error.message}")
    close = difflib.get_close_matches(value, map(str, get_args(descriptor.annotation)), n=1)
    hint = f'; did you mean "{close[0]}"?' if close else ""
    return f'{_title(parameter)} is "{value}"; expected {expected(parameter)}{hint}'


def _value(error: Any) -> str | None:
    """The text that typer's validator got."""
    details = error.__cause__.errors() if hasattr(error.__cause__, "errors") else []
    return str(details[0]["input"]) if details else None


def _one_line(text: str) -> str:
    return " ".join(text.split())
