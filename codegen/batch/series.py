"""One long run at native speed: a block, or a wired system of blocks, over arrays of its inputs."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from codegen.cache import kept, knows
from codegen.scratch import Scratch
from codegen.toolchains.compiler import FLAGS, build_library
from codegen.toolchains.library import load_library
from models.errors import ParameterError, WiringError, nearest
from models.kit.block import Block
from models.kit.declaration import Type, Variable, flatten
from models.kit.elementary import Precision
from models.kit.link import Key, Link, Values
from models.kit.tracing import GROUPS
from models.system import System

Array = npt.NDArray[np.float64]


class Series:
    """A block or a system in C, to be run over arrays: the bits are those of the blocks, one by one.

    A block alone is the component of its own title: `four_state.speed`. Threads may share a series; each run
    begins anew.

    Args:
        system: a wired system of blocks, or a block.
        observe: states and outputs, as "component.name[1]".
        precision: of the blocks' arithmetic.

    Raises:
        WiringError, ParameterError: there is no such component, or no such state or output.
        DeclarationError: a block does not come in this precision.
    """

    def __init__(
        self,
        system: System | type[Block],
        observe: Sequence[str] = (),
        precision: Precision = "double",
    ) -> None:
        self.name = system.name if isinstance(system, System) else system.title()
        self.components: dict[str, type[Block]] = (
            dict(system.components) if isinstance(system, System) else {system.title(): system}
        )
        self.links: tuple[Link, ...] = system.links if isinstance(system, System) else ()
        self.order = system.order() if isinstance(system, System) else list(self.components)
        self.precision = precision
        self.observe = tuple(dict.fromkeys(observe))
        self._observed = [self._key(name, "state", "output") for name in self.observe]

    def run(
        self,
        signals: Mapping[str, npt.ArrayLike],
        parameters: Values | None = None,
        ticks: int | None = None,
    ) -> dict[str, Array]:
        """Run from the start; other threads of the process run meanwhile.

        Row k holds what belongs to time k * sample_time: a plant's outputs before its step k, every other
        block's answers to the inputs of tick k.

        Args:
            signals: of inputs without a source, "component.input" to (ticks,), or to a value for all ticks.
            parameters: by component and flat name; the others have their start values.
            ticks: the length of the run; that of the signals by default.

        Returns:
            Each observed variable, (ticks,).

        Raises:
            ParameterError: a name does not exist; a value is out of its range; lengths differ or lack.
            WiringError: an input has neither a source, nor a signal, nor a start value.
            CompileError: the library cannot be built.
        """
        rows = {self._key(name, "input"): np.asarray(row, np.float64) for name, row in signals.items()}
        self._check(rows)
        values = self._checked(parameters or {})
        ticks = self._ticks(rows, ticks)
        columns = [np.ascontiguousarray(np.broadcast_to(row, ticks)) for row in rows.values()]
        results = np.empty((len(self._observed), ticks))
        arrays = (
            self._places(values), np.array(list(values.values()), np.float64),
            self._places(rows), np.array([column.ctypes.data for column in columns], np.uintp),
            self._places(self._observed), np.array([row.ctypes.data for row in results], np.uintp),
        )  # fmt: skip
        job = _Job(ticks, len(values), len(columns), len(results), *(a.ctypes.data for a in arrays))
        self._library.series_run(ctypes.byref(job))
        return dict(zip(self.observe, results, strict=True))

    def _ticks(self, rows: Mapping[Key, Array], ticks: int | None) -> int:
        """The length of a run."""
        if ticks is None:
            lengths = [len(row) for row in rows.values() if row.ndim]
            if not lengths:
                raise ParameterError(f"{self.name}: no signal has a value per tick; expected one, or `ticks`")
            ticks = max(lengths)
        for (component, name), row in rows.items():
            if row.ndim > 1 or (row.ndim and len(row) != ticks):
                raise ParameterError(
                    f"signal {component}.{name} has shape {row.shape}; expected ({ticks},), a value per tick"
                )
        return ticks

    def _check(self, rows: Mapping[Key, Array]) -> None:
        """Check that signals can feed their inputs, and that no input is left without a source."""
        linked = {(link.target, link.target_variable) for link in self.links}
        for (component, name), row in rows.items():
            if (component, name) in linked:
                raise ParameterError(f'{self.name}: input "{component}.{name}" is connected')
            variable = self._variables[component, name]
            if variable.type is not Type.REAL and not _are_whole(row):
                raise ParameterError(
                    f"signal {component}.{name} has values that are not whole; expected {variable.expected()}"
                )
        for component, block in self.components.items():
            for name, variable in flatten(block.group("input")):
                key = (component, name)
                if not variable.has_start and key not in linked and key not in rows:
                    raise WiringError(
                        f'{self.name}: input "{component}.{name}" has neither source, signal nor start value'
                    )

    def _checked(self, parameters: Values) -> dict[Key, float]:
        values: dict[Key, float] = {}
        for component, part in parameters.items():
            for name, value in part.items():
                key = self._key(f"{component}.{name}", "parameter")
                self._variables[key].check(float(value), f"{component}.{name}")
                values[key] = float(value)
        return values

    def _key(self, name: str, *kinds: str) -> Key:
        component, _, variable = name.partition(".")
        if (known := self._variables.get((component, variable))) and known.kind in kinds:
            return component, variable
        if component not in self.components:
            raise WiringError(f'{self.name}: no component "{component}"{nearest(component, self.components)}')
        block = self.components[component]
        names = [n for kind in kinds for n in block.flat_names(kind)]
        raise ParameterError(
            f'{component} {block.title()} has no {" or ".join(kinds)} "{variable}"{nearest(variable, names)}'
        )

    @cached_property
    def _variables(self) -> dict[Key, Variable]:
        """Every variable; its place is its number in C."""
        return {
            (component, name): variable
            for component, block in self.components.items()
            for kind in GROUPS
            for name, variable in flatten(block.group(kind))
        }

    @cached_property
    def _numbers(self) -> dict[Key, int]:
        return {key: number for number, key in enumerate(self._variables)}

    def _places(self, keys: Iterable[Key]) -> npt.NDArray[np.int32]:
        return np.array([self._numbers[key] for key in keys], np.int32)

    def sources(self) -> dict[str, str]:
        """The C of the library, file name to text."""
        from codegen.batch.loop import loop_files  # noqa: PLC0415 - imports CasADi

        return loop_files(self.name, self.components, self.links, self.order, self.precision)

    @cached_property
    def _library(self) -> ctypes.CDLL:
        """The C of the system, from the cache; signals and what is observed need no other."""
        asked: object = (
            (self.name, list(self.components.items()), self.links, self.precision)
            if knows(self.components.values())
            else self.sources()
        )
        return _load(kept(f"batch/{self.name}-series.so", (asked, FLAGS), self._build))

    def _build(self, library: Path) -> None:
        from codegen.blocks.block_c import write_files  # noqa: PLC0415 - imports CasADi

        with Scratch() as folder:
            write_files(self.sources(), folder)
            build_library(folder, ["series.c"], library, what=f"series of {self.name}")


class _Job(ctypes.Structure):
    _fields_ = [
        ("ticks", ctypes.c_int64), ("values", ctypes.c_int32), ("signals", ctypes.c_int32),
        ("observed", ctypes.c_int32), ("value_fields", ctypes.c_void_p), ("value", ctypes.c_void_p),
        ("signal_fields", ctypes.c_void_p), ("signal", ctypes.c_void_p),
        ("observed_fields", ctypes.c_void_p), ("result", ctypes.c_void_p),
    ]  # fmt: skip


def _are_whole(row: Array) -> bool:
    """Is every value a whole number that 32 bits hold?"""
    return bool(np.all((np.floor(row) == row) & (np.abs(row) < 2**31)))


@cache
def _load(library: Path) -> ctypes.CDLL:
    return load_library(library, "series")
