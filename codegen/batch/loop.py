"""The C of a series: the blocks' own step functions, in the order of a tick, within a loop over arrays."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

from codegen.blocks.block_c import VERSION, generate
from codegen.blocks.expressions import c_name, member_of
from codegen.blocks.layout import fit
from codegen.blocks.nodes import ctype_of
from codegen.templating import environment
from models.kit.block import Block
from models.kit.declaration import flatten
from models.kit.elementary import Precision
from models.kit.link import Link
from models.kit.tracing import GROUPS

TEMPLATES = environment(Path(__file__).parent / "templates")


def loop_files(
    name: str,
    components: Mapping[str, type[Block]],
    links: Sequence[Link],
    order: Sequence[str],
    precision: Precision,
) -> dict[str, str]:
    """File name to text; `series.c` includes the others.

    Args:
        order: the components in data-flow order within a tick, plants last.

    Raises:
        DeclarationError: a block does not come in this precision.
    """
    blocks = list(dict.fromkeys(components.values()))
    files: dict[str, str] = {}
    for block in blocks:
        files |= generate(block, precision)
    plants = [c for c in order if components[c].moore]
    context = {
        "name": name,
        "version": VERSION,
        "precision": precision,
        "blocks": [block.title() for block in blocks],
        "streams": "mrg32k3a.c" in files,
        "components": [(component, block.title()) for component, block in components.items()],
        "fields": list(_fields(components, precision)),
        "answers": [
            line
            for component in order
            if component not in plants
            for line in (*_copies(links, [component]), _step(components, component))
        ],
        "plants": [*_copies(links, plants), *(_step(components, plant) for plant in plants)],
    }
    files["series.c"] = fit(TEMPLATES.get_template("series.c.jinja").render(context))
    return files


def _fields(components: Mapping[str, type[Block]], precision: Precision) -> Iterator[tuple[str, str]]:
    """Every variable's place and type."""
    for component, block in components.items():
        for kind in GROUPS:
            for name, variable in flatten(block.group(kind)):
                short = ctype_of(variable, precision) == "short"
                place = f"{component}.{member_of(variable)}.{c_name(name)}"
                yield place, "SHORT" if short else variable.type.name


def _copies(links: Sequence[Link], targets: Collection[str]) -> Iterator[str]:
    """The links to some components."""
    for link in links:
        if link.target in targets:
            source = f"w->{link.source}.out.{c_name(link.source_variable)}"
            yield f"w->{link.target}.in.{c_name(link.target_variable)} = {source};"


def _step(components: Mapping[str, type[Block]], component: str) -> str:
    return f"{components[component].title()}_step(&w->{component});"
