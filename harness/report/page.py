"""A page from a template, its data and the parts: one file, which asks for no other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from markupsafe import Markup

from codegen.templating import environment
from harness.log.channel import Array
from harness.report.inline import OF_MAPS, SCRIPTS, STYLES, policy, script, style
from harness.report.times import clock

TEMPLATES = environment(Path(__file__).parent / "templates")
TEMPLATES.filters["clock"] = clock
DECIMALS = {"m": 3, "m/s": 3, "rad": 5, "rad/s": 5, "s": 4}  # finer than a screen shows; others 6


def render(
    template: str,
    title: str,
    data: Mapping[str, Any] | None,
    scripts: Sequence[str],
    *,
    styles: Sequence[str] = (),
    maps: bool = True,
    speaks: bool = False,
    **content: Any,
) -> bytes:
    """The page as UTF-8.

    Args:
        template: its name in `templates/`; `content` is for it.
        data: what the scripts draw; numbers that are not finite become null; None where they come later.
        scripts, styles: names in `parts/`, after those of all pages.
        maps: the scripts draw maps.
        speaks: the page is served, and speaks with its server.
    """
    text = "\n".join(script(name) for name in (*SCRIPTS, *scripts) if maps or name not in OF_MAPS)
    sheet = "".join(style(name) for name in (*STYLES, "page.css", *styles) if maps or name not in OF_MAPS)
    page = TEMPLATES.get_template(template).render(
        title=title,
        policy=Markup(policy([text], [sheet], speaks=speaks)),
        sheet=Markup(sheet),
        script=Markup(text),
        data=Markup(_json(data)),
        **content,
    )
    return page.encode()


def column(values: Array, unit: str = "") -> list[float]:
    """A signal's values, (rows,), for `data`: as many decimals as a screen can show."""
    rounded: list[float] = (np.round(values, DECIMALS.get(unit, 6)) + 0.0).tolist()
    return rounded


def _json(data: Mapping[str, Any] | None) -> str:
    """Data as JSON that ends no element of HTML early."""
    return orjson.dumps(data).decode().replace("<", "\\u003c")
