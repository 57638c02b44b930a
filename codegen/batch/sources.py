"""The C of a batch runner: ordinary ticks in lanes, the blocks' own step functions for other ticks."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.batch.areas import STRIDE
from codegen.batch.lanes import BatchSystem, Tick, field_name, ordinary_tick
from codegen.blocks.block_c import VERSION, generate
from codegen.blocks.expressions import c_name, member_of
from codegen.blocks.layout import fit
from codegen.templating import environment
from models.kit.block import Block
from models.kit.declaration import Type
from models.kit.link import Key
from models.kit.tracing import Table
from models.system import System

TEMPLATES = environment(Path(__file__).parent / "templates")
WORTH = 0.9  # specialize the tick by mode if no mode needs more than this share of its operations
CASTS = {Type.REAL: "", Type.INTEGER: "(int32_t)", Type.BOOLEAN: "(bool)"}


@dataclass(frozen=True)
class Sources:
    """What a runner is generated from; the attributes have the meanings that they have in `Batch`.

    Attributes:
        common: the variables that may be set, in the order in which the runner takes their values.
        lanes: trials that take the ordinary tick together.
        flights: trials under way at a time, in each thread.
        watched: the north and the east of the plant that areas are held against; None for none.
    """

    system: System
    keep: Mapping[str, frozenset[str]]
    varied: Sequence[Key]
    observed: Sequence[Key]
    stop: tuple[Key, frozenset[int]] | None
    common: Sequence[Key]
    lanes: int
    flights: int
    watched: tuple[Key, Key] | None = None

    def ticks(self, changing: Collection[Key], fixed: Mapping[Key, float]) -> list[Tick]:
        """The ordinary ticks: one for each mode of the largest state machine, or one for all modes.

        One for all modes if there is no state machine, or if ticks by mode would not be much shorter.
        A mode in which every tick departs has none.
        """
        keep = {component: self.keep.get(component, frozenset()) for component in self.system.components}
        varying = frozenset([*self.varied, *changing])
        batch_system = BatchSystem(self.system, keep, varying, fixed, self.stop)
        whole = ordinary_tick(batch_system, {})
        tables = [
            (len(phase.rows), component, phase.mode)
            for component in self.keep
            for phase in self.system.components[component].program().tick
            if isinstance(phase, Table) and phase.mode in self.keep[component]
        ]
        if not tables:
            return [whole]
        _, component, mode = max(tables)
        choices = self.system.components[component].variables()[mode].choices
        by_mode = [ordinary_tick(batch_system, {(component, mode): float(m)}) for m in choices or ()]
        by_mode = [tick for tick in by_mode if not tick.always_departs]
        if by_mode and max(tick.operations for tick in by_mode) < WORTH * whole.operations:
            return by_mode
        return [whole]

    def files(
        self, changing: Sequence[Key], fixed: Mapping[Key, float], stalling: Sequence[str] = ()
    ) -> dict[str, str]:
        """The C of the runner, file name to text.

        Args:
            stalling: components that are not stepped for a while.
        """
        components = {c: self.system.components[c] for c in self.keep}
        files: dict[str, str] = {}
        for block in dict.fromkeys(components.values()):
            kept = frozenset().union(*(self.keep[c] for c, b in components.items() if b is block))
            files |= generate(block, keep=kept)
        ticks = self.ticks(changing, fixed)
        fields = sorted(frozenset().union(*(tick.reads | tick.writes for tick in ticks)))
        used = sorted(frozenset().union(*(tick.common for tick in ticks)))
        watched = None
        if self.watched:
            places = ({"field": field_name(key), **self._place(key)} for key in self.watched)
            watched = dict(zip(("north", "east"), places, strict=True))
        context = {
            "watched": watched,
            "stride": STRIDE,
            "system": self.system.name,
            "version": VERSION,
            "flights": self.flights,
            "lanes": self.lanes,
            "blocks": [block.title() for block in dict.fromkeys(components.values())],
            "streams": "mrg32k3a.c" in files,
            "components": [{"name": c, "block": block.title()} for c, block in components.items()],
            "common": [field_name(key) for key in used],
            "common_values": [(field_name(key), self.common.index(key)) for key in used],
            "values": [self._place(key) for key in self.common],
            "own": [self._place(key) for key in self.varied],
            "changing": [self._place(key) for key in changing],
            "stalling": stalling,
            "seeds": [
                f"{c}.par.seed" for c, block in components.items() if "seed" in block.flat_names("parameter")
            ],
            "fields": [{"name": field_name(key)} for key in fields],
            "observed": [self._place(key)["place"] for key in self.observed],
            "ticks": [
                {
                    "what": ", ".join(f"{c}.{n} {v:g}" for (c, n), v in tick.held.items()) or "any mode",
                    "condition": " && ".join(
                        f"f->{self._place(key)['place']} == {value:g}" for key, value in tick.held.items()
                    )
                    or "true",
                    "operations": tick.operations,
                    "moves": self.watched and not tick.writes.isdisjoint(self.watched),
                    "lines": tick.lines,
                    "reads": [(field_name(key), key in tick.writes) for key in sorted(tick.reads)],
                    "fields": [
                        {"name": field_name(key), "written": key in tick.writes, **self._place(key)}
                        for key in sorted(tick.reads | tick.writes)
                    ],
                    "common": sorted(map(field_name, tick.common)),
                }
                for tick in ticks
            ],
            "before": list(self._calls(components, stalling, plants=False)),
            "after": list(self._calls(components, stalling, plants=True)),
            "ends": " || ".join(
                f"(f->{self._place(self.stop[0])['place']} == {value})" for value in sorted(self.stop[1])
            )
            if self.stop
            else "",
        }
        files["batch.c"] = fit(TEMPLATES.get_template("batch.c.jinja").render(context))
        return files

    def _place(self, key: Key) -> dict[str, str]:
        """The place of a variable in a trial's structs, and the cast from a double to its type."""
        component, name = key
        variable = next(
            v for v in self.system.components[component].variables().values() if name in v.flat_names
        )
        return {"place": f"{component}.{member_of(variable)}.{c_name(name)}", "cast": CASTS[variable.type]}

    def _calls(
        self, components: Mapping[str, type[Block]], stalling: Collection[str], plants: bool
    ) -> Iterable[str]:
        """The calls of a tick, the plants' steps or those before them; links are copied before each step."""
        for component, block in components.items():
            has_outputs = not self.keep[component].isdisjoint(block.flat_names("output"))
            if block.moore and not plants and has_outputs:
                yield f"{block.title()}_output(&f->{component});"
        order = [c for c in self.system.order() if c in components and components[c].moore is plants]
        for stage in [order] if plants else [[component] for component in order]:
            for link in self.system.links:
                source = (link.source, link.source_variable)
                if link.target in stage and link.source_variable in self.keep.get(link.source, ()):
                    target = self._place((link.target, link.target_variable))["place"]
                    yield f"f->{target} = f->{self._place(source)['place']};"
            for component in stage:
                step = f"{components[component].title()}_step(&f->{component});"
                yield f"if (f->{component}_goes != STALLED) {{ {step} }}" if component in stalling else step
