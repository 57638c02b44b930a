"""Lines of generated C within the width of a page."""

from __future__ import annotations

import re
import textwrap

COLUMNS = 110
HARD_SPACE = "\N{NO-BREAK SPACE}"  # of a comment: where a line is not broken
SYMBOL = re.compile(r" (?:(?P<after>&&|\|\||[-+*/<>]=?|[=!]=)(?= )|(?P<before>[?:]) )")
STATEMENT = re.compile(r"( *)((?:const )?\w+ \w+ =|m->[^ ]+ =|return|\} else if|if) (.*)")
COMMENTED = re.compile(r"( *)(.*;) /\* (.*) \*/")


def fit(text: str) -> str:
    """The same C with every line within COLUMNS, where a line can be broken."""
    lines: list[str] = []
    inside = False  # a comment
    for line in text.splitlines():
        opened = not inside and line.lstrip().startswith("/*")
        comment = inside or opened
        if len(line) <= COLUMNS:
            lines.append(line)
        elif comment:
            lines += _comment(line)
        elif match := COMMENTED.fullmatch(line):
            lines += _comment_behind(*match.groups())
        else:
            lines += _code(line)
        inside = comment and "*/" not in line
    return "\n".join(lines).replace(HARD_SPACE, " ") + "\n"


def _comment(line: str) -> list[str]:
    indent = " " * (len(line) - len(line.lstrip()) - (not line.lstrip().startswith("/*")))
    return _wrapped(line, "", f"{indent} * ")


def _comment_behind(indent: str, code: str, comment: str) -> list[str]:
    start = f"{indent}{code} /* "
    return _wrapped(f"{comment} */", start, " " * (len(start) - 2) + "* ")


def _wrapped(text: str, start: str, rest: str) -> list[str]:
    """The text of a comment over several lines; its end stays with its last word."""
    return textwrap.wrap(
        text.replace(" */", f"{HARD_SPACE}*/"),
        COLUMNS,
        initial_indent=start,
        subsequent_indent=rest,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _code(line: str) -> list[str]:
    """A statement over several lines, broken where fewest parentheses are open."""
    match = STATEMENT.fullmatch(line)
    if match is None:
        return [line]
    indent, head, rest = match.groups()
    if head.endswith("="):
        return [f"{indent}{head}", *_broken(f"{indent}    {rest}", len(indent) + 4)]
    return _broken(line, len(indent) + 4)


def _broken(line: str, column: int) -> list[str]:
    """The line in pieces; each goes on behind the innermost parenthesis that is open, else at the column.

    A chain of choices is broken before every colon: each choice has a line of its own.
    """
    lines, opened = [], [column]  # the columns at which pieces go on, the innermost parenthesis last
    chain: list[int] = []  # what was open where a choice was broken
    while len(line) > COLUMNS or chain:
        breaks = _breaks(line, opened, len(line) if chain else COLUMNS)
        colons = [at for at in breaks if at[1] == chain and line[at[0]] == ":"]
        if chain and not colons and len(line) <= COLUMNS:
            break
        within = [at for at in breaks if at[0] <= COLUMNS]
        if colons and colons[0] in within:
            end, opened = colons[0]
        elif within:
            fewest = min(len(at[1]) for at in within)
            outer = [at for at in within if len(at[1]) == fewest]
            end, opened = next((at for at in outer if line[at[0]] == ":"), outer[-1])
        else:
            break
        chain = opened if line[end] in "?:" else chain if len(opened) > len(chain) else []
        lines.append(line[:end].rstrip())
        line = " " * opened[-1] + line[end:].lstrip()
    return [*lines, line]


def _breaks(line: str, opened: list[int], columns: int) -> list[tuple[int, list[int]]]:
    """Where the line may be broken, and the parentheses that are open there."""
    symbols = {m.end("after") if m["after"] else m.start("before") for m in SYMBOL.finditer(line)}
    start = len(line) - len(line.lstrip())
    breaks = []
    for i, c in enumerate(line[: columns + 1]):
        if i in symbols and i > start:
            breaks.append((i, opened))
        if c in "([":
            opened = [*opened, i + 1]
        elif c in ")]":
            opened = opened[:-1]
    return breaks
