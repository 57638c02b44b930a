"""The parts as text, for a page that holds all of its scripts and styles, and the policy of such a page."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

PARTS = Path(__file__).parent / "parts"
LIBRARIES = ("leaflet-1.9.4/leaflet.js", "uplot-1.6.32/uPlot.iife.min.js")
SCRIPTS = (*LIBRARIES, "canine.js", "map.js", "plots.js", "strip.js")  # each after those that it uses
STYLES = ("leaflet-1.9.4/leaflet.css", "uplot-1.6.32/uPlot.min.css", "style.css")
COMMENT = re.compile(r"/\*(?!!).*?\*/", re.DOTALL)
# our scripts end each statement with a sign, have no regular expressions, and no text with " // "
SAYING = re.compile(r"(?:^|\s)// .*$", re.MULTILINE)
BLANKS = re.compile(r"""(?P<text>"(?:\\.|[^"\\])*"|`[^`]*`)|\s*(?P<sign>[-+*/%=<>!?:;,{}()\[\]|&]|\s)\s*""")
RULE = re.compile(r"(?P<selectors>[^{}]+)\{[^{}]*\}")
# rules of the libraries for what no part draws: pictures, pop-ups, an old browser
UNUSED = re.compile(
    r"popup|tooltip|layers|vml|oldie|attribution|default-icon|\.u-(legend|inline|series|title)"
)


@cache
def script(name: str) -> str:
    """A script of `parts/` without comments and idle blanks; a library without its source map."""
    text = (PARTS / name).read_text(encoding="utf-8")
    if "/" in name:
        return "\n".join(line for line in text.splitlines() if not line.startswith("//"))
    return BLANKS.sub(lambda found: found["text"] or found["sign"], SAYING.sub("", text)).strip()


@cache
def style(name: str) -> str:
    """A style sheet of `parts/` without comments, blanks, and the libraries' rules for what no part draws."""
    text = COMMENT.sub("", (PARTS / name).read_text(encoding="utf-8"))
    if "/" in name:
        text = RULE.sub(lambda rule: "" if UNUSED.search(rule["selectors"]) else rule[0], text)
    return re.sub(r"\s*([{};,])\s*|(:)\s+", r"\1\2", re.sub(r"\s+", " ", text)).strip()


def policy(scripts: Iterable[str], styles: Iterable[str]) -> str:
    """The Content-Security-Policy of a page that runs these scripts and styles alone."""
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src {' '.join(map(_source, scripts))}",
            f"style-src {' '.join(map(_source, styles))}",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )


def _source(text: str) -> str:
    """A script or style as the policy names it: by its hash."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
