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
OF_MAPS = ("leaflet-1.9.4/leaflet.js", "map.js", "leaflet-1.9.4/leaflet.css")  # three fifths of a page
COMMENT = re.compile(r"/\*(?!!).*?\*/", re.DOTALL)
# our scripts end each statement with a sign, have no regular expressions, no text with " // " or ";}"
SAYING = re.compile(r"(?:^|\s)// .*$", re.MULTILINE)
BLANKS = re.compile(r"""(?P<text>"(?:\\.|[^"\\])*"|`[^`]*`)|\s*(?P<sign>[-+*/%=<>!?:;,{}()\[\]|&]|\s)\s*""")
RULE = re.compile(r"(?P<selectors>[^{}]+)(?P<body>\{[^{}]*\})")
# selectors of the libraries for what no part draws: pictures, tiles, pop-ups, links, an old browser
UNUSED = re.compile(
    r"popup|tooltip|layer|vml|oldie|attribution|(default|div)-icon|tile|shadow|safari|crosshair|container a"
    r"|interactive|draggable|:not\(|pane (> )?(canvas|img)|\.u-(legend|inline|series|title|cursor)"
)
# declarations of the libraries: what the browsers meant say without, fonts, which pages choose, places of
# pictures, defence against the rules of pages that are not ours, and what the same rule states again
IDLE = re.compile(
    r"(?<=[{;\s])(-(webkit|moz|ms)-[^:;{}]+:[^;}]*|[\w-]+:\s*-(webkit|moz|ms)-[^;}]*|font-family:[^;}]*"
    r"|background-(position|repeat):[^;}]*|[\w-]+:[^;}]*!important"
    r"|(?P<name>[\w-]+):[^;{}]*;(?=[^{}]*[;\s](?P=name):));?"
)


@cache
def script(name: str) -> str:
    """A script of `parts/` without comments and idle blanks; a library without its source map."""
    text = (PARTS / name).read_text(encoding="utf-8")
    if "/" in name:
        return "\n".join(line for line in text.splitlines() if not line.startswith("//"))
    short = BLANKS.sub(lambda found: found["text"] or found["sign"], SAYING.sub("", text)).strip()
    return short.replace(";}", "}")


@cache
def style(name: str) -> str:
    """A style sheet of `parts/` without comments, blanks, and the libraries' rules for what no part draws."""
    text = COMMENT.sub("", (PARTS / name).read_text(encoding="utf-8"))
    if "/" in name:
        text = RULE.sub(_used, IDLE.sub("", text))
    text = re.sub(r"\s*([{};,])\s*|(:)\s+", r"\1\2", re.sub(r"\s+", " ", text)).strip()
    return text.replace(";}", "}")


def _used(rule: re.Match[str]) -> str:
    """A rule for those of its selectors that something is drawn for."""
    if not rule["body"].strip("{} \n\t"):
        return ""
    selectors = [one for one in rule["selectors"].split(",") if not UNUSED.search(one)]
    return ",".join(selectors) + rule["body"] if selectors else ""


def policy(scripts: Iterable[str], styles: Iterable[str], *, speaks: bool = False) -> str:
    """The Content-Security-Policy of a page that runs these scripts and styles alone.

    Args:
        speaks: the page may speak with the server that it came from.
    """
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src {' '.join(map(_source, scripts))}",
            f"style-src {' '.join(map(_source, styles))}",
            "img-src data:",
            *(["connect-src 'self'"] if speaks else []),
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )


def _source(text: str) -> str:
    """A script or style as the policy names it: by its hash."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
