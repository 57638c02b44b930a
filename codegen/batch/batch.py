"""Many trials at native speed: a wired system compiled into one library that runs thousands in a call."""

from __future__ import annotations

import ctypes
import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from codegen.batch.areas import Areas
from codegen.cache import kept, knows
from codegen.files import write_whole
from codegen.scratch import Scratch
from codegen.toolchains.compiler import FLAGS, build_library, processor
from codegen.toolchains.library import load_library
from models.errors import ParameterError, WiringError, nearest
from models.kit.block import Block
from models.kit.declaration import Parameter
from models.kit.link import Key
from models.system import System

if TYPE_CHECKING:
    from codegen.batch.lanes import Tick
    from codegen.batch.sources import Sources

WIDE = ("-mprefer-vector-width=512",)  # where a processor has such vectors
FLIGHTS = 128  # trials under way at a time, in each thread
# with the last flag, a loop over lanes that does not become vectors is an error
SPEED = ("-O3", "-march=native", "-Werror=pass-failed")
ON, ALONE, STALLED = range(3)  # how a component goes on
Stalls = Mapping[str, Sequence[tuple[int, int]]]  # ticks from and to before, by component
Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Change:
    """From this tick on, a free input has this value in every trial."""

    tick: int
    component: str
    variable: str
    value: float


@dataclass(frozen=True)
class Results:
    """How trials ended.

    Attributes:
        ticks: (trials,) index of each trial's last tick, from 0.
        values: (trials, observed) the observed variables after that tick.
        entered: (trials,) the number of the first area that each trial's plant was in, 0 for none; None
            where nothing is watched.
    """

    ticks: Counts
    values: Array
    entered: Counts | None = None


class Batch:
    """A wired system for many trials, each with the bits that its blocks' C gives alone.

    Args:
        system: any wired system of blocks.
        varied: parameters that differ from point to point, as "component.parameter[1]".
        observe: states and outputs; the results are their values at the end of a trial.
        stop: an output, and the values of it that end a trial.
        watch: the states that are the plant's north and east, to be held against areas from the start of a
            trial to its end; without it the runner is what it is without areas.

    Raises:
        ParameterError, WiringError: the system has no variable of this name.
    """

    def __init__(
        self,
        system: System,
        varied: Sequence[str] = (),
        observe: Sequence[str] = (),
        stop: tuple[str, Collection[int]] | None = None,
        watch: tuple[str, str] | None = None,
    ) -> None:
        self.system = system
        self.varied = [self._key(name, "parameter") for name in varied]
        self.observed = [self._key(name, "state", "output") for name in observe]
        self.stop = None if stop is None else (self._key(stop[0], "output"), frozenset(stop[1]))
        self.watched = None if watch is None else (self._key(watch[0], "state"), self._key(watch[1], "state"))
        self._libraries: dict[object, ctypes.CDLL] = {}

    def run(
        self,
        values: Mapping[str, Mapping[str, float]],
        points: Array,
        point: Counts | Sequence[int],
        seed: Counts | Sequence[int],
        ticks: int,
        *,
        changes: Sequence[Change] = (),
        stalls: Stalls = MappingProxyType({}),
        areas: Areas | None = None,
    ) -> Results:
        """Run trials; other threads of the process run meanwhile.

        Args:
            values: of parameters and free inputs that differ from their start values, by component and name.
            points: (points, varied) values of the varied parameters.
            point: (trials,) each trial's row of `points`.
            seed: (trials,) each trial's value of every parameter `seed`.
            ticks: index of the last tick of a trial that nothing ends before.
            changes: of free inputs, in every trial; of two on one tick, the later one in the list holds.
            stalls: ticks on which components are not stepped, in every trial: spans of one are apart, and in
                their order.
            areas: what a batch that watches holds the plant's place against.

        Raises:
            ParameterError, WiringError: a name or an index does not exist, or a shape is wrong.
            CompileError: the library cannot be built.
        """
        if (areas is None) != (self.watched is None):
            raise ParameterError(f"{self.system.name}: expected areas and what to watch, or neither")
        points = np.ascontiguousarray(points, dtype=np.float64)
        point, seed = np.asarray(point), np.asarray(seed)
        self._check(points, point, seed, ticks)
        point, seed = (np.ascontiguousarray(a, dtype=np.int32) for a in (point, seed))
        free = self._free_inputs
        changing = list(dict.fromkeys((change.component, change.variable) for change in changes))
        for component, variable in changing:
            if (component, variable) not in free:
                raise ParameterError(
                    f'{self.system.name}: "{component}.{variable}" is not a free input'
                    + nearest(f"{component}.{variable}", [f"{c}.{n}" for c, n in free])
                )
        chosen = self._chosen(values)
        stalling = [component for component in stalls if self._block(component) and component in self.keep]
        fixed = {key: chosen.get(key, start) for key, start in free.items() if key not in changing}
        for key, parameter in self.structural.items():
            value = chosen.get(key, parameter.start[0])
            fixed[key] = float(value != 0) if parameter.switch else value
        library = self._library(tuple(changing), tuple(fixed.items()), tuple(stalling))
        common = np.array([chosen.get(key, start) for key, start in self._common.items()])
        planned = [(c.tick, changing.index((c.component, c.variable)), c.value) for c in changes]
        for place, component in enumerate(stalling, start=len(changing)):
            for first, after in stalls[component]:
                ways = ((max(0, first - 1), ALONE), (first, STALLED), (after, ON))
                planned += [(tick, place, float(way)) for tick, way in ways]
        schedule = np.array(
            sorted(planned, key=lambda change: change[0]),
            dtype=[("tick", "i4"), ("input", "i4"), ("value", "f8")],
        )
        last, observed = np.empty(len(point), np.int32), np.empty((len(point), len(self.observed)))
        plain = (
            common.ctypes.data, points.ctypes.data, len(point), point.ctypes.data, seed.ctypes.data,
            ticks, len(schedule), schedule.ctypes.data, last.ctypes.data, observed.ctypes.data,
        )  # fmt: skip
        job, entered = _Job(*plain), None
        if areas is not None:
            entered, grid = np.zeros(len(point), np.int32), _Areas.of(areas)
            job = _WatchedJob(*plain, ctypes.addressof(grid), entered.ctypes.data)
        if library.batch_run(ctypes.byref(job)) != 0:
            raise MemoryError("batch: no memory for the trials under way")
        return Results(last, observed, entered)

    def _check(self, points: Array, point: Counts, seed: Counts, ticks: int) -> None:
        """Check what the library takes for granted."""
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

    def _chosen(self, values: Mapping[str, Mapping[str, float]]) -> dict[Key, float]:
        """The values by variable, checked."""
        chosen = {(c, n): float(value) for c, part in values.items() for n, value in part.items()}
        for (component, name), value in chosen.items():
            if (component, name) not in self._settable:
                self._key(f"{component}.{name}", "parameter", "input")  # raises if there is no such variable
                raise ParameterError(f'{self.system.name}: input "{component}.{name}" is connected')
            if not math.isfinite(value):
                raise ParameterError(f"{component}.{name} is {value}; expected a finite number")
        return chosen

    def _block(self, component: str) -> type[Block]:
        known = self.system.components
        if component not in known:
            raise WiringError(f'{self.system.name}: no component "{component}"{nearest(component, known)}')
        return known[component]

    def _key(self, name: str, *kinds: str) -> Key:
        component, _, variable = name.partition(".")
        block = self._block(component)
        names = [n for kind in kinds for n in block.flat_names(kind)]
        if variable not in names:
            what = " or ".join(kinds)
            raise ParameterError(
                f'{component} {block.title()} has no {what} "{variable}"{nearest(variable, names)}'
            )
        return component, variable

    @cached_property
    def _settable(self) -> dict[Key, float]:
        """The variables that may be set, with their start values: parameters, and inputs without a link."""
        linked = {(link.target, link.target_variable) for link in self.system.links}
        components = self.system.components
        starts = {
            k: v for c in components for kind in ("parameter", "input") for k, v in self._starts(c, kind)
        }
        return {key: start for key, start in starts.items() if key not in linked}

    @cached_property
    def _common(self) -> dict[Key, float]:
        """Those of the components that matter; all trials begin with the same value, unless it is varied."""
        return {key: start for key, start in self._settable.items() if key[0] in self.keep}

    @cached_property
    def structural(self) -> dict[Key, Parameter]:
        """The structural parameters that are the same in all trials."""
        return {
            (component, name): variable
            for component in self.keep
            for name, variable in self.system.components[component].variables().items()
            if isinstance(variable, Parameter) and variable.structural
            if (component, name) not in self.varied
        }

    @cached_property
    def _free_inputs(self) -> dict[Key, float]:
        """The inputs of these."""
        inputs = {key for component in self.keep for key, _ in self._starts(component, "input")}
        return {key: start for key, start in self._common.items() if key in inputs}

    def _starts(self, component: str, kind: str) -> Iterable[tuple[Key, float]]:
        for variable in self.system.components[component].group(kind):
            for name, start in zip(variable.flat_names, variable.start, strict=True):
                yield (component, name), start

    @cached_property
    def keep(self) -> dict[str, frozenset[str]]:
        """The states and outputs that matter, of each component that has any."""
        if not self._is_shipped:
            return self._needed()

        def write(path: Path) -> None:
            names = {component: sorted(kept_names) for component, kept_names in self._needed().items()}
            write_whole(path, json.dumps(names).encode())

        path = kept(f"batch/{self.system.name}.json", self._asked, write)
        return {component: frozenset(names) for component, names in json.loads(path.read_bytes()).items()}

    def _needed(self) -> dict[str, frozenset[str]]:
        from codegen.batch.pruning import needed  # noqa: PLC0415 - traces the models

        observed = [*self.observed, *([self.stop[0]] if self.stop else []), *(self.watched or ())]
        return {component: names for component, names in needed(self.system, observed).items() if names}

    @property
    def _is_shipped(self) -> bool:
        return knows(self.system.components.values())

    @property
    def _asked(self) -> object:
        """What decides the runner, beside the sources of the models and the values of inputs."""
        components = [(c, block.__module__, block.__name__) for c, block in self.system.components.items()]
        stop = None if self.stop is None else (self.stop[0], sorted(self.stop[1]))
        watched = () if self.watched is None else (self.watched,)
        return self.system.name, components, self.system.links, self.varied, self.observed, stop, *watched

    def _sources(self) -> Sources:
        from codegen.batch.sources import Sources  # noqa: PLC0415 - traces the models

        lanes = 16 if _is_wide() else 8  # two vectors: one computes while the other waits for a result
        common = list(self._common)
        return Sources(
            self.system,
            self.keep,
            self.varied,
            self.observed,
            self.stop,
            common,
            lanes,
            FLIGHTS,
            self.watched,
        )

    def ticks(self, changing: Collection[Key], fixed: Mapping[Key, float]) -> list[Tick]:
        """The ordinary ticks, as in `Sources.ticks`."""
        return self._sources().ticks(changing, fixed)

    def sources(
        self,
        changing: Sequence[Key] = (),
        fixed: Mapping[Key, float] = {},
        stalling: Sequence[str] = (),
    ) -> dict[str, str]:
        """The C of the runner, file name to text."""
        return self._sources().files(changing, fixed, stalling)

    def _library(
        self, changing: tuple[Key, ...], fixed: tuple[tuple[Key, float], ...], stalling: tuple[str, ...]
    ) -> ctypes.CDLL:
        """The runner for these changing inputs, and these values of others and of structural parameters."""
        key = (changing, fixed, stalling)
        if key not in self._libraries:
            made_of = (changing, dict(fixed), stalling)
            asked = (self._asked, *key) if self._is_shipped else self.sources(*made_of)
            path = kept(
                f"batch/{self.system.name}.so",
                (asked, FLIGHTS, processor(), _flags()),
                lambda path: self._build(self.sources(*made_of), path),
            )
            self._libraries[key] = _load(path)
        return self._libraries[key]

    def _build(self, files: dict[str, str], library: Path) -> None:
        from codegen.blocks.block_c import write_files  # noqa: PLC0415 - imports CasADi

        with Scratch() as folder:
            write_files(files, folder)
            what = f"batch runner of {self.system.name}"
            build_library(folder, ["batch.c"], library, what=what, flags=_flags())


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


class _WatchedJob(_Job):
    _fields_ = [("areas", ctypes.c_void_p), ("entered", ctypes.c_void_p)]


class _Areas(ctypes.Structure):
    _fields_ = [
        ("north", ctypes.c_double), ("east", ctypes.c_double), ("per_metre", ctypes.c_double),
        ("rows", ctypes.c_int32), ("columns", ctypes.c_int32), ("edges", ctypes.c_int32),
        ("cell", ctypes.c_void_p), ("list", ctypes.c_void_p), ("near", ctypes.c_void_p),
        ("edge", ctypes.c_void_p),
    ]  # fmt: skip

    @classmethod
    def of(cls, areas: Areas) -> _Areas:
        """The areas for the runner; they must outlive it."""
        arrays = areas.cells, areas.lists, areas.near, areas.edges
        places = (array.ctypes.data for array in arrays)
        return cls(*areas.corner, 1 / areas.side, *areas.cells.shape, len(areas.edges), *places)


@cache
def _load(library: Path) -> ctypes.CDLL:
    return load_library(library, "batch runner")
