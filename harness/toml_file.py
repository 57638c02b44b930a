"""TOML from elsewhere, checked before it is parsed: scenarios, mapping files, recordings.

Python's parser takes minutes for a name of 50,000 levels, and ends in its recursion on deep arrays. What no
file of ours needs is refused first, in one pass over the text.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from models.errors import CanineError, printable

MAX_BYTES = 2**19  # a scenario with all parameters has 10 kB; Python parses the worst of this size in 4 s
MAX_DEPTH = 16  # brackets within brackets; waypoints need 2
MAX_LEVELS = 8  # of a dotted name; ours have 2
MAX_WORD = 1000  # characters of a number, a date or a bare name; Python refuses a number of 4,300 digits

SHOWN_LINE = 60  # characters
EXPECTED_TOML = {  # by what tomllib says
    "Invalid value": 'a number, true, false, a text in quotes ("STOP") or a list ([35.73, 0.0])',
    "Invalid statement": "key = value, [table] or # comment",
    "Expected '=' after a key in a key/value pair": "key = value; a key with a dot stands in quotes",
    "Expected newline or end of document after a statement": "one key = value on a line",
    "Cannot overwrite a value": "each key once",
    "Unclosed array": "a ] at the end of each list",
    "Unclosed inline table": "a } at the end of each inline table",
    "Unterminated string": "a quote at the end of each text, on the same line",
    "Illegal character '\\n'": "a quote at the end of each text, on the same line",
}

# what matters outside texts and comments; a text without an end runs to that of its line, or of the file
_TOKEN = re.compile(
    r'''(?P<text>"""(?:\\.|(?!""").)*+(?:"{3,5})?|\'\'\'(?:(?!\'\'\').)*+(?:'{3,5})?'''
    r"""|"(?:\\[^\n]|[^"\\\n])*+"?|'[^'\n]*+'?|\#[^\n]*+)"""
    r"""|(?P<open>[\[{])|(?P<close>[\]}])|(?P<dot>\.)|(?P<end>[\n=,])|(?P<word>[^\s"'\#\[\]{}.=,]++)""",
    re.DOTALL,
)


class TomlError(CanineError, ValueError):
    """A file is no TOML, or needs more than any of ours does."""


def read_toml(path: Path) -> str:
    """The text of a TOML file, without a byte order mark, its lines ended by a line feed.

    Raises:
        OSError: it cannot be read.
        TomlError: it is too large, or is not UTF-8; the message does not name the file.
    """
    with path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise TomlError(f"has more than {MAX_BYTES} bytes; is it the right file?")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as reason:
        line = data.count(b"\n", 0, reason.start) + 1
        raise TomlError(
            f"line {line}: byte 0x{data[reason.start]:02x} is not UTF-8; save the file as UTF-8"
        ) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse_toml(text: str) -> dict[str, Any]:
    """The table of a TOML text.

    Raises:
        TomlError: no TOML, or beyond a limit; the message names the line, not the file.
    """
    if len(text) > MAX_BYTES:
        raise TomlError(f"has more than {MAX_BYTES} characters; is it the right file?")
    _check(text)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as reason:  # a TOMLDecodeError, or what int and datetime raise
        raise TomlError(printable(_told(text, str(reason)))) from None


def _told(text: str, reason: str) -> str:
    """What is wrong: the line, what it holds, and what is expected."""
    placed = re.fullmatch(r"(.*) \(at (?:line (\d+), column \d+|end of document)\)", reason, re.DOTALL)
    if placed is None:
        return reason
    what, lines = placed[1], text.rstrip().split("\n")
    line = min(int(placed[2] or len(lines)), len(lines))
    content = lines[line - 1].strip()
    shown = content if len(content) <= SHOWN_LINE else f"{content[:SHOWN_LINE]}..."
    if what.startswith("Expected") and what not in EXPECTED_TOML:
        return f"line {line} is `{shown}`: e{what[1:]}"
    return f"line {line} is `{shown}` ({what}); expected {EXPECTED_TOML.get(what, 'key = value')}"


def _check(text: str) -> None:
    depth = dots = 0
    for token in _TOKEN.finditer(text):
        match token.lastgroup:
            case "open":
                depth += 1
                dots = 0
            case "close":
                depth, dots = max(depth - 1, 0), 0
            case "dot":
                dots += 1
            case "end":
                dots = 0
        if depth > MAX_DEPTH:
            raise _beyond(text, token, f"brackets are nested {depth} deep; at most {MAX_DEPTH} are read")
        if dots >= MAX_LEVELS:
            raise _beyond(text, token, f"a name has more than {MAX_LEVELS} levels")
        if token.lastgroup == "word" and (length := len(token[0])) > MAX_WORD:
            what = f'"{token[0][:20]}..." has {length} characters'
            raise _beyond(text, token, f"{what}; outside quotes at most {MAX_WORD} are read")


def _beyond(text: str, token: re.Match[str], what: str) -> TomlError:
    return TomlError(f"line {text.count(chr(10), 0, token.start()) + 1}: {what}")
