"""Many trials at native speed: a wired system compiled into one library, called for thousands at once."""

from __future__ import annotations

import ctypes
import hashlib
import math
import tempfile
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from codegen.batch.lanes import BatchSystem, Key, Tick, field_name, ordinary_tick
from codegen.batch.pruning import needed
from codegen.blocks.block_c import VERSION, generate, write_files
from codegen.blocks.expressions import MEMBERS, c_name
from codegen.templating import environment
from codegen.toolchains.compiler import FLAGS, build_library, cache_folder, compiler_version, processor
from models.errors import ParameterError, WiringError, nearest
from models.kit.block import Block
from models.kit.declaration import Type
from models.kit.tracing import Table
from models.system import System

TEMPLATES = environment(Path(__file__).parent / "templates")
WIDE = ("-mprefer-vector-width=512",)  # where a processor has such vectors
FLIGHTS = 128  # trials under way at once in a thread
WORTH = 0.8  # the tick is specialized by mode if that leaves less than this share of its operations
SPEED = (
    "-O3",
    "-march=native",
    "-fno-math-errno",
    "-Werror=pass-failed",
)  # a lane loop that stays scalar fails
CASTS = {Type.REAL: "", Type.INTEGER: "(int32_t)", Type.BOOLEAN: "(bool)"}
Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Change:
    """A free input takes a value from a tick on, in every trial."""

    tick: int
    component: str
    variable: str
    value: float


@dataclass(frozen=True)
class Results:
    """What trials came to.

    Attributes:
        ticks: (trials,) index of each trial's last tick, from 0.
        values: (trials, observed) the observed variables after it.
    """

    ticks: Counts
    values: Array


class Batch:
    """A wired system for many trials, with the bits that its blocks' C gives one by one.

    Args:
        system: any batch_system of blocks.
        varied: parameters that differ from point to point, as "component.parameter[1]".
        observe: states and outputs whose last values are the result.
        stop: an output, and the values of it with which a trial ends.

    Raises:
        ParameterError, WiringError: a name that the system has not.
    """

    def __init__(
        self,
        system: System,
        varied: Sequence[str] = (),
        observe: Sequence[str] = (),
        stop: tuple[str, Collection[int]] | None = None,
    ) -> None:
        self.system = system
        self.varied = [self._key(name, "parameter") for name in varied]
        self.observed = [self._key(name, "state", "output") for name in observe]
        self.stop = None if stop is None else (self._key(stop[0], "output"), frozenset(stop[1]))
        wanted = [*self.observed, *([self.stop[0]] if self.stop else [])]
        self._libraries: dict[object, ctypes.CDLL] = {}
        self.keep = {c: names for c, names in needed(system, wanted).items() if names}

    def run(
        self,
        values: Mapping[str, Mapping[str, float]],
        points: Array,
        point: Counts,
        seed: Counts,
        ticks: int,
        *,
        changes: Sequence[Change] = (),
    ) -> Results:
        """Run trials; other threads run meanwhile.

        Args:
            values: of parameters and free inputs where they differ from their start, by component and name.
            points: (points, varied) values of the varied parameters.
            point: (trials,) each trial's row of `points`.
            seed: (trials,) each trial's value of every parameter `seed`.
            ticks: index of the tick with which a trial ends at the latest.
            changes: of free inputs, in every trial.

        Raises:
            ParameterError: a name or an index is not there, or a shape is wrong.
            CompileError: the library cannot be built.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        self._check(points, np.asarray(point), np.asarray(seed), ticks)
        point, seed = (np.ascontiguousarray(a, dtype=np.int32) for a in (point, seed))
        free = self._free_inputs
        changing = list(dict.fromkeys((change.component, change.variable) for change in changes))
        for component, variable in changing:
            if (component, variable) not in free:
                raise ParameterError(
                    f'{self.system.name}: "{component}.{variable}" is no free input'
                    + nearest(f"{component}.{variable}", [f"{c}.{n}" for c, n in free])
                )
        given = self._given(values)
        library = self._library(
            tuple(changing),
            tuple((key, given.get(key, start)) for key, start in free.items() if key not in changing),
        )
        common = np.array([given.get(key, start) for key, start in self._common.items()])
        schedule = np.array(
            [
                (c.tick, changing.index((c.component, c.variable)), c.value)
                for c in sorted(changes, key=lambda c: c.tick)  # of those on one tick, the last one holds
            ],
            dtype=[("tick", "i4"), ("input", "i4"), ("value", "f8")],
        )
        last, observed = np.empty(len(point), np.int32), np.empty((len(point), len(self.observed)))
        job = _Job(
            common.ctypes.data, points.ctypes.data, len(point), point.ctypes.data, seed.ctypes.data,
            ticks, len(schedule), schedule.ctypes.data, last.ctypes.data, observed.ctypes.data,
        )  # fmt: skip
        if library.batch_run(ctypes.byref(job)) != 0:
            raise MemoryError("batch: no memory for the trials under way")
        return Results(last, observed)

    def _check(self, points: Array, point: Counts, seed: Counts, ticks: int) -> None:
        """Refuse what the library would trust."""
        expected = f"(points, {len(self.varied)})"
        if points.ndim != 2 or points.shape[1] != len(self.varied):
            raise ParameterError(
                f"points has shape {points.shape}; expected {expected}, the varied parameters"
            )
        if point.ndim != 1 or seed.shape != point.shape:
            raise ParameterError(
                f"point and seed have shapes {point.shape} and {seed.shape}; expected (trials,) both"
            )
        if point.size and not 0 <= point.min() <= point.max() < len(points):
            raise ParameterError(
                f"point goes from {point.min()} to {point.max()}; expected indices of {len(points)} points"
            )
        for value in (seed.min(), seed.max()) if seed.size else ():
            if not 0 <= value < 2**31:
                raise ParameterError(f"seed is {value}; expected 0 to {2**31 - 1}")
        if not 0 <= ticks < 2**31:
            raise ParameterError(f"ticks is {ticks}; expected 0 to {2**31 - 1}")

    def _given(self, values: Mapping[str, Mapping[str, float]]) -> dict[Key, float]:
        """Start values by variable, of components that matter and of others."""
        given = {(c, n): float(value) for c, part in values.items() for n, value in part.items()}
        for (component, name), value in given.items():
            if (component, name) not in self._settable:
                self._key(f"{component}.{name}", "parameter", "input")  # which says what is wrong
                raise ParameterError(f'{self.system.name}: input "{component}.{name}" is connected')
            if not math.isfinite(value):
                raise ParameterError(f"{component}.{name} is {value}; expected a finite number")
        return given

    def _key(self, name: str, *kinds: str) -> Key:
        component, _, variable = name.partition(".")
        if component not in self.system.components:
            known = self.system.components
            raise WiringError(f'{self.system.name}: no component "{component}"{nearest(component, known)}')
        block = self.system.components[component]
        names = [n for kind in kinds for n in block.flat_names(kind)]
        if variable not in names:
            what = " or ".join(kinds)
            raise ParameterError(
                f'{component} {block.title()} has no {what} "{variable}"{nearest(variable, names)}'
            )
        return component, variable

    @cached_property
    def _settable(self) -> dict[Key, float]:
        """All that may be set, with its start value: parameters, and inputs that nothing feeds."""
        fed = {(link.target, link.target_variable) for link in self.system.links}
        components = self.system.components
        starts = {
            k: v for c in components for kind in ("parameter", "input") for k, v in self._starts(c, kind)
        }
        return {key: start for key, start in starts.items() if key not in fed}

    @cached_property
    def _common(self) -> dict[Key, float]:
        """What of that matters."""
        return {key: start for key, start in self._settable.items() if key[0] in self.keep}

    @cached_property
    def _free_inputs(self) -> dict[Key, float]:
        """The inputs among them."""
        inputs = {key for component in self.keep for key, _ in self._starts(component, "input")}
        return {key: start for key, start in self._common.items() if key in inputs}

    def _starts(self, component: str, kind: str) -> Iterable[tuple[Key, float]]:
        for variable in self.system.components[component].group(kind):
            for name, start in zip(variable.flat_names, variable.start, strict=True):
                yield (component, name), start

    def ticks(self, changing: Collection[Key], fixed: Mapping[Key, float]) -> list[Tick]:
        """The ordinary ticks: one for each mode of the largest table, or a single one if that is as good."""
        keep = {component: self.keep.get(component, frozenset()) for component in self.system.components}
        own = frozenset([*self.varied, *changing])
        batch_system = BatchSystem(self.system, keep, own, fixed, self.stop)
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
        by_mode = [tick for tick in by_mode if not tick.departs]
        if by_mode and max(tick.operations for tick in by_mode) < WORTH * whole.operations:
            return by_mode
        return [whole]

    def sources(self, changing: Sequence[Key] = (), fixed: Mapping[Key, float] = {}) -> dict[str, str]:
        """The C of the runner, file name to text."""
        components = {c: self.system.components[c] for c in self.keep}
        files: dict[str, str] = {}
        for block in dict.fromkeys(components.values()):
            kept = frozenset().union(*(self.keep[c] for c, b in components.items() if b is block))
            files |= generate(block, keep=kept)
        ticks = self.ticks(changing, fixed)
        common = list(self._common)
        fields = sorted(frozenset().union(*(tick.reads | tick.writes for tick in ticks)))
        used = sorted(frozenset().union(*(tick.common for tick in ticks)))
        context = {
            "system": self.system.name,
            "version": VERSION,
            "flights": FLIGHTS,
            "lanes": 16 if _is_wide() else 8,  # two vectors: while one waits for a result, the other goes on
            "blocks": [block.title() for block in dict.fromkeys(components.values())],
            "streams": "mrg32k3a.c" in files,
            "components": [{"name": c, "block": block.title()} for c, block in components.items()],
            "common": [field_name(key) for key in used],
            "common_values": [(field_name(key), common.index(key)) for key in used],
            "values": [self._place(key) for key in common],
            "own": [self._place(key) for key in self.varied],
            "changing": [self._place(key) for key in changing],
            "seeds": [
                f"{c}.par.seed" for c, block in components.items() if "seed" in block.flat_names("parameter")
            ],
            "fields": [{"name": field_name(key)} for key in fields],
            "observed": [self._place(key)["place"] for key in self.observed],
            "ticks": [
                {
                    "what": ", ".join(f"{c}.{n} {v:g}" for (c, n), v in tick.holds.items()) or "any mode",
                    "condition": " && ".join(
                        f"f->{self._place(key)['place']} == {value:g}" for key, value in tick.holds.items()
                    )
                    or "true",
                    "operations": tick.operations,
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
            "before": list(self._calls(components, plants=False)),
            "after": list(self._calls(components, plants=True)),
            "ends": " || ".join(
                f"f->{self._place(self.stop[0])['place']} == {value}" for value in sorted(self.stop[1])
            )
            if self.stop
            else "",
        }
        files["batch.c"] = TEMPLATES.get_template("batch.c.jinja").render(context)
        return files

    def _place(self, key: Key) -> dict[str, str]:
        """Where a variable stands in a trial's structs, and the cast that sets it from a double."""
        component, name = key
        variable = next(
            v for v in self.system.components[component].variables().values() if name in v.flat_names
        )
        return {"place": f"{component}.{MEMBERS[variable.kind]}.{c_name(name)}", "cast": CASTS[variable.type]}

    def _calls(self, components: Mapping[str, type[Block]], plants: bool) -> Iterable[str]:
        """The C of a tick up to the plants (whose outputs stand for their states), and of the plants."""
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
                yield f"{components[component].title()}_step(&f->{component});"

    def _library(self, changing: tuple[Key, ...], fixed: tuple[tuple[Key, float], ...]) -> ctypes.CDLL:
        """The runner for these changing inputs and values of free inputs; built once on a machine."""
        key = (changing, fixed)
        if key not in self._libraries:
            self._libraries[key] = _load(_Sources(self.sources(changing, dict(fixed)), self.system.name))
        return self._libraries[key]


def _is_wide() -> bool:
    return "avx512f" in processor()


def _flags() -> tuple[str, ...]:
    return (*FLAGS, *SPEED, *(WIDE if _is_wide() else ()))


class _Job(ctypes.Structure):
    _fields_ = [
        ("values", ctypes.c_void_p), ("points", ctypes.c_void_p), ("trials", ctypes.c_int64),
        ("point", ctypes.c_void_p), ("seed", ctypes.c_void_p), ("last_tick", ctypes.c_int32),
        ("changes", ctypes.c_int32), ("change", ctypes.c_void_p), ("ticks", ctypes.c_void_p),
        ("observed", ctypes.c_void_p),
    ]  # fmt: skip


class _Sources:
    """C files, by what they say."""

    def __init__(self, files: Mapping[str, str], what: str) -> None:
        self.files, self.what = files, what
        text = "".join(f"{name}\n{text}" for name, text in sorted(files.items()))
        text += "".join((compiler_version(), processor(), *_flags()))
        self.key = hashlib.sha256(text.encode()).hexdigest()[:20]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Sources) and other.key == self.key

    def __hash__(self) -> int:
        return hash(self.key)


@cache
def _load(sources: _Sources) -> ctypes.CDLL:
    library = cache_folder() / "batch" / f"{sources.what}-{sources.key}.so"
    if not library.exists():
        with tempfile.TemporaryDirectory(prefix="canine-") as folder:
            write_files(dict(sources.files), Path(folder))
            build_library(
                Path(folder),
                ["batch.c"],
                library,
                what=f"batch runner of {sources.what}",
                flags=_flags(),
            )
    return ctypes.CDLL(str(library))
