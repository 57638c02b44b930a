"""One FMU: its description as fmpy reads it, and an instance whose C functions are called on fixed buffers.

fmpy loads, validates and unpacks; its wrappers build new arrays on every call, so the trial calls the bound
functions themselves with arguments that are prepared once (a `Call`). FMI 2.0 and 3.0 co-simulation.
"""

from __future__ import annotations

import ctypes
import hashlib
import io
import json
import math
import os
import threading
import zipfile
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import chdir, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import fmpy
import fmpy.fmi2
import fmpy.fmi3
import fmpy.logging
import numpy as np
import numpy.typing as npt
from fmpy.model_description import ValidationError

from codegen.cache import stored
from codegen.scratch import Scratch
from codegen.toolchains.library import why_not_loaded
from harness.cosim.archive import parse_xml, plain, read_member, unpack
from harness.cosim.origin import own_content
from harness.cosim.recorder import Position
from harness.interrupts import held_interrupts
from models.errors import CanineError, ParameterError, nearest, printable
from models.kit.declaration import Type

Call = tuple[Callable[..., int | None], tuple[Any, ...]]
Function = ctypes.CFUNCTYPE(ctypes.c_int)  # without argument types, ctypes does not look at each argument

STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
OK, WARNING, FATAL = 0, 1, 4
ASKED = -(2**31)  # what `Steps` returns in the place of a status when a step asks for something
# by the place of the byte in which an FMI 3 step asks for it: the fault's kind, and what is said
ASKS = (
    ("ended", "asks to end the simulation{}"),
    ("event", "asks for an event{}, which this loop does not have; export it without events"),
    ("early", "fmi3DoStep returned early{}, though it may not; expected a whole step"),
)
EARLY, NOTHING = 2, bytes(len(ASKS))
NEARLY = 0.999999  # of a step: it was made
MIN_STEP, MAX_STEP = 1e-6, 1e9  # s; shorter ones make more ticks than a user can wait for
BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")  # of units, whose exponents they hold in this order
MAX_KEPT = 2**17  # bytes of a description that is kept for the next trial; ours have up to 75,000
MAX_VARIABLES = 200_000  # of which FMPy makes 700 MiB of objects in 8 s
REFERENCES = 2**32  # value references are unsigned integers of 32 bits
SET = ("input", "parameter", "structuralParameter")  # causalities of what users set
FMI2_TYPES = {
    "Real": ("Real", np.float64, Type.REAL),
    "Integer": ("Integer", np.int32, Type.INTEGER),
    "Enumeration": ("Integer", np.int32, Type.INTEGER),
    "Boolean": ("Boolean", np.int32, Type.BOOLEAN),
}
FMI3_TYPES = {
    "Float64": ("Float64", np.float64, Type.REAL),
    "Float32": ("Float32", np.float32, Type.REAL),
    "Enumeration": ("Int64", np.int64, Type.INTEGER),
    "Boolean": ("Boolean", np.uint8, Type.BOOLEAN),
    **{
        f"{sign}Int{bits}": (
            f"{sign}Int{bits}",
            np.dtype(f"{sign.lower() or 'i'}{bits // 8}").type,
            Type.INTEGER,
        )
        for sign in ("", "U")
        for bits in (8, 16, 32, 64)
    },
}


Mark = Callable[[str, str], None]


def unmarked(component: str, what: str) -> None:
    """Nobody is told which call outside of the loop is being made."""


@dataclass(frozen=True)
class Fault:
    """What an FMU did wrong while it ran.

    Attributes:
        kind: `status`, `not finite`, `out of range`, `ended`, `event`, `early`; in a worker also `crash`,
            `exit`, `hang`, `memory`.
        component, fmu: its place in the system, and its file; "" if no call was being made.
        call: the function, or the output; "" if no call was being made.
        time: s.
    """

    kind: str
    component: str
    fmu: str
    call: str
    time: float


class FmuError(CanineError):
    """An FMU cannot be loaded, or went wrong while it ran: then with its `fault`."""

    def __init__(self, text: str, fault: Fault | None = None) -> None:
        super().__init__(text)
        self.fault = fault


@dataclass(frozen=True)
class Access:
    """How values of one FMI type are set and got: `fmi3SetInt32`, in arrays of int32."""

    fmi: str
    dtype: npt.DTypeLike


def limits_of(dtype: npt.DTypeLike) -> tuple[float, float]:
    """The least and the largest finite number that a type holds."""
    kind = np.dtype(dtype)
    if kind.kind == "f":
        return float(np.finfo(kind).min), float(np.finfo(kind).max)
    return int(np.iinfo(kind).min), int(np.iinfo(kind).max)


@dataclass(frozen=True)
class Unit:
    """A unit as the FMU defines it: value in SI = factor * value + offset.

    Attributes:
        base: the exponents of BASE; None if it does not say.
    """

    name: str
    base: tuple[int, ...] | None
    factor: float = 1.0
    offset: float = 0.0

    def equals(self, other: Unit) -> bool:
        """The same quantity in the same scale, however it is spelled."""
        if self.base is None or other.base is None:
            return self.name == other.name
        return self.measures(other) and (self.factor, self.offset) == (other.factor, other.offset)

    def measures(self, other: Unit) -> bool:
        """The same quantity in whatever scale (true where one of them does not say)."""
        return self.base is None or other.base is None or self.base == other.base


@dataclass(frozen=True)
class Quantity:
    """One scalar variable of an FMU that the harness can exchange."""

    name: str
    reference: int
    type: Type
    access: Access
    causality: str
    unit: str | None
    meaning: str
    start: float | None
    min: float | None
    max: float | None

    @property
    def type_name(self) -> str:
        """Its type, and how its values are kept: `Integer (int8)`."""
        return f"{self.type.value} ({np.dtype(self.access.dtype).name})"

    @property
    def limits(self) -> tuple[float | None, float | None]:
        """The least and the largest value: what it declares, within a type that is narrower than a double."""
        if self.type is Type.BOOLEAN or np.dtype(self.access.dtype) == np.float64:
            return self.min, self.max
        low, high = limits_of(self.access.dtype)
        return (
            low if self.min is None else max(low, self.min), high if self.max is None else min(high, self.max)
        )  # fmt: skip

    def holds(self, value: float) -> bool:
        """Has its type this value, a Real as near as may be?"""
        if self.type is Type.BOOLEAN:
            return value in (0, 1)
        if not math.isfinite(value):
            return self.type is Type.REAL
        low, high = limits_of(self.access.dtype)
        return low <= value <= high and (self.type is Type.REAL or value == int(value))


@dataclass(frozen=True)
class Refused:
    """A variable that cannot be exchanged, and why."""

    causality: str
    reason: str


@dataclass(frozen=True)
class FmuDescription:
    """What an FMU says about itself.

    Attributes:
        refused: variables that cannot be exchanged (String, arrays, ...), by name.
        feedthrough: some output depends on an input within a step; a plant's do not.
        step: the step size that it states, s; `fixed`: it takes no other.
        warnings: what a strict validator says, and inputs whose start value is not finite.
    """

    path: Path
    model: str
    version: int
    quantities: dict[str, Quantity]
    refused: dict[str, Refused]
    units: dict[str, Unit]
    feedthrough: bool
    step: float | None
    fixed: bool
    warnings: tuple[str, ...] = ()
    fmpy: Any = field(default=None, repr=False, compare=False)

    def group(self, *causalities: str) -> dict[str, Quantity]:
        """The quantities of some causalities, in the FMU's order."""
        return {n: q for n, q in self.quantities.items() if q.causality in causalities}

    @cached_property
    def inputs(self) -> dict[str, Quantity]:
        """What it takes each step."""
        return self.group("input")

    @cached_property
    def outputs(self) -> dict[str, Quantity]:
        """What it gives each step."""
        return self.group("output")

    @cached_property
    def parameters(self) -> dict[str, Quantity]:
        """What may be set before it starts."""
        return self.group("parameter", "structuralParameter")

    def unit(self, quantity: Quantity) -> Unit | None:
        """The unit of a quantity; None if it declares none."""
        if quantity.unit is None:
            return None
        return self.units.get(quantity.unit, Unit(quantity.unit, None))

    def items(self, name: str) -> dict[str, int] | None:
        """An Enumeration's names and their numbers; None for a variable of another type."""
        variable = next((v for v in self.fmpy.modelVariables if v.name == name), None)
        if variable is None or variable.type != "Enumeration" or variable.declaredType is None:
            return None
        return {item.name: int(item.value) for item in variable.declaredType.items}

    def find(self, name: str, *causalities: str) -> Quantity:
        """The variable of this name.

        Raises:
            FmuError: there is none, it has another causality, or it cannot be exchanged.
        """
        quantity = self.quantities.get(name)
        what = " or ".join(causalities)
        if name in self.refused:
            raise FmuError(f'{self.path.name}: {what} "{name}" {self.refused[name].reason}')
        if quantity is None or quantity.causality not in causalities:
            hint = nearest(name, self.group(*causalities))
            actual = f" (it is a {quantity.causality})" if quantity else ""
            raise FmuError(f'{self.path.name}: has no {what} "{name}"{actual}{hint}')
        return quantity


def describe(path: Path, unpacked: Path | None = None) -> FmuDescription:
    """Read an FMU's description without loading its code.

    Args:
        unpacked: a folder that it is unpacked in, which is read in its place.

    Raises:
        FmuError, ArchiveError, XmlError: naming the file and what is wrong.
    """
    folder = unpacked or path
    xml = read_member(folder, "modelDescription.xml")
    if xml is None:
        raise FmuError(f"{path}: has no modelDescription.xml; is it an FMU?")
    members = _Members(xml, read_member(folder, "sources/buildDescription.xml"), path)
    described = _described_once if len(xml) + len(members.sources or b"") <= MAX_KEPT else _described
    return replace(described(members), path=path)


@dataclass(frozen=True)
class _Members:
    """What an FMU is described by: two files; the `path`, of one that has them, is for messages."""

    xml: bytes
    sources: bytes | None
    path: Path = field(compare=False)

    def archive(self) -> io.BytesIO:
        """A ZIP archive of these alone: FMPy reads no other bytes, whatever the path names by then."""
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w") as archive:
            archive.writestr("modelDescription.xml", self.xml)
            if self.sources is not None:
                archive.writestr("sources/buildDescription.xml", self.sources)
        return stream


def _described(members: _Members) -> FmuDescription:
    """The description that an FMU's modelDescription.xml and, if any, sources/buildDescription.xml give."""
    path, xml = members.path, members.xml
    root = parse_xml(xml, f"{path}: modelDescription.xml")
    version = root.get("fmiVersion", "unknown")
    if not version.startswith(("2.", "3.")):
        raise FmuError(f"{path}: is FMI {printable(version)}; expected 2.0 or 3.0")
    if root.find("CoSimulation") is None:
        raise FmuError(f"{path}: is not for co-simulation; export it as a co-simulation FMU")
    if (count := len(root.find("ModelVariables") or ())) > MAX_VARIABLES:
        raise FmuError(f"{path}: has {count} variables; at most {MAX_VARIABLES} are read")
    step = _step(path, root)
    try:
        read = fmpy.read_model_description(members.archive(), validate=False)
        warnings = _findings(members)
    except Exception as reason:  # fmpy raises plain Exception, and what lxml and its own slips raise
        raise FmuError(f"{path}: modelDescription.xml cannot be read: {_one_line(reason)}") from None
    quantities, refused = {}, {}
    for variable in read.modelVariables:
        if variable.name in quantities or variable.name in refused:
            name = printable(variable.name)
            raise FmuError(
                f'{path}: has two variables "{name}"; give each a name of its own and export it again'
            )
        quantity = _quantity(path, read, variable)
        if isinstance(quantity, str):
            refused[variable.name] = Refused(variable.causality or "local", quantity)
        else:
            quantities[variable.name] = quantity
    return FmuDescription(
        path=path,
        model=read.modelName,
        version=read.fmiMajorVersion,
        quantities=quantities,
        refused=refused,
        units={unit.name: _unit(unit) for unit in read.unitDefinitions},
        feedthrough=_feedthrough(read),
        step=step,
        fixed=not _true(read.coSimulation.canHandleVariableCommunicationStepSize),
        warnings=(*warnings, *_without_start(quantities.values())),
        fmpy=read,
    )


_described_once = lru_cache(16)(_described)  # a trial asks for each several times, the next one again


def _findings(members: _Members) -> tuple[str, ...]:
    """What fmpy's validation finds, a line each; kept in the cache: it loads the schemas of the standard."""

    def validate(file: Path) -> None:
        problems: Sequence[object] = ()
        try:
            fmpy.read_model_description(members.archive(), validate_model_structure=True)
        except ValidationError as error:
            problems = error.problems
        file.write_text(json.dumps([_one_line(problem) for problem in problems]))

    contents = [hashlib.sha256(content or b"").hexdigest() for content in (members.xml, members.sources)]
    entry = stored("cosim/validation.json", (contents, fmpy.__version__), validate)
    return tuple(json.loads(entry.read_text()))


def _without_start(quantities: Iterable[Quantity]) -> list[str]:
    """Inputs that start with what no trial can begin with."""
    return [
        f'input "{printable(q.name)}" has the start value {q.start}; connect it, or give it a finite one'
        for q in quantities
        if q.causality == "input" and q.start is not None and not math.isfinite(q.start)
    ]


def _step(path: Path, root: Element) -> float | None:
    """The step size that the description states, s: a fixed one before a preferred one."""
    for element, attribute in (("CoSimulation", "fixedInternalStepSize"), ("DefaultExperiment", "stepSize")):
        stated = root.find(element)
        text = None if stated is None else stated.get(attribute)
        if text is not None:
            try:
                step = float(plain(text))
            except ValueError:
                step = math.nan
            if not MIN_STEP <= step <= MAX_STEP:
                raise FmuError(
                    f'{path}: {element} has {attribute}="{printable(text)}"; '
                    f"expected {MIN_STEP:g} to {MAX_STEP:g} seconds; export it with such a step"
                )
            return step
    return None


def _one_line(reason: object) -> str:
    return " ".join(str(reason).split())


def _true(value: Any) -> bool:
    return value in (True, "true", "1")


def _unit(unit: Any) -> Unit:
    base = unit.baseUnit
    if base is None:
        return Unit(unit.name, None)
    exponents = tuple(int(getattr(base, name)) for name in BASE)
    return Unit(unit.name, exponents, float(base.factor), float(base.offset))


def _quantity(path: Path, read: Any, variable: Any) -> Quantity | str:
    """The variable as a quantity, or why it cannot be exchanged."""
    types = FMI2_TYPES if read.fmiMajorVersion == 2 else FMI3_TYPES
    reference = int(variable.valueReference)
    if not 0 <= reference < REFERENCES:
        raise FmuError(
            f'{path}: "{printable(variable.name)}" has valueReference="{reference}"; '
            f"expected a whole number from 0 to {REFERENCES - 1}; export it again"
        )
    if variable.type not in types:
        return f"has type {variable.type}; expected one of {', '.join(types)}"
    if variable.dimensions:
        return "is an array; expected a scalar (SSP 1.0 has no arrays)"
    fmi, dtype, kind = types[variable.type]
    declared = variable.declaredType
    unit = variable.unit or (declared.unit if declared else None)

    def number(name: str) -> float | None:
        text = getattr(variable, name)
        if text is None and declared is not None and name != "start":
            text = getattr(declared, name)
        if text is None or text == "":
            return None
        try:
            return (
                {"true": 1.0, "false": 0.0}.get(str(text))
                if kind is Type.BOOLEAN and str(text).isalpha()
                else float(plain(text))
            )
        except ValueError:
            raise FmuError(
                f'{path}: "{printable(variable.name)}" has {name}="{printable(text)}"; expected a number'
            ) from None

    items = (
        [float(item.value) for item in declared.items] if variable.type == "Enumeration" and declared else []
    )
    low, high = number("min"), number("max")
    quantity = Quantity(
        variable.name,
        reference,
        kind,
        Access(fmi, dtype),
        variable.causality or "local",
        unit if kind is Type.REAL else None,
        (variable.description or "").strip(),
        number("start"),
        min(items) if items and low is None else low,
        max(items) if items and high is None else high,
    )
    if quantity.start is not None and not quantity.holds(quantity.start) and variable.causality in SET:
        raise FmuError(
            f'{path}: "{printable(variable.name)}" has start="{printable(variable.start)}"; '
            f"expected {quantity.type_name}"
        )
    return quantity


def _feedthrough(read: Any) -> bool:
    """Does an output depend on an input? One that states no dependencies may."""
    inputs = {v.name for v in read.modelVariables if v.causality == "input"}
    if not inputs:
        return False
    listed = {unknown.variable.name for unknown in read.outputs}
    if any(v.causality == "output" and v.name not in listed and not v.alias for v in read.modelVariables):
        return True
    return any(
        unknown.dependencies is None or any(v.name in inputs for v in unknown.dependencies)
        for unknown in read.outputs
    )


def _names(folder: Path) -> str:
    """What is in a folder."""
    names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    return ", ".join(names) or "none"


_messages: dict[str, deque[tuple[int, str]]] = {}


def _log2(environment: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
    """What an FMI 2 instance says; fmpy's proxy, which formats the text, has room for one logger only."""
    if (
        status >= WARNING
        and instance is not None
        and (name := instance.decode(errors="replace")) in _messages
    ):
        _messages[name].append((status, (message or b"").decode(errors="replace").strip()))


_callbacks = fmpy.fmi2.fmi2CallbackFunctions()
_callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(_log2)
_callbacks.allocateMemory = fmpy.fmi2.defaultCallbacks.allocateMemory
_callbacks.freeMemory = fmpy.fmi2.defaultCallbacks.freeMemory
fmpy.logging.addLoggerProxy(ctypes.byref(_callbacks))


class Clock:
    """The time of a simulation, s: `time` of its rows; `now` of its FMUs, which begin at `start`.

    Attributes:
        own: what `now` is after the start; less than `time` for a component that was not stepped for a while.
        position: shows the time of the rows to others.
    """

    def __init__(self, start: float = 0.0) -> None:
        self.time, self.start, self.now, self.position = 0.0, start, ctypes.c_double(start), Position()
        self.own = 0.0

    def set(self, time: float, own: float | None = None) -> None:
        """Set it, s of the rows, and what an FMU gets if that is another."""
        self.time = self.position.time = time
        self.own = time if own is None else own
        self.now.value = self.start + self.own


@dataclass(eq=False)
class Steps:
    """Steps of one instance, each from where the last one ended: a call makes them, and gives a status.

    It stops at one that fails, and with `ASKED` at one that asks for what the loop lacks; the clock then has
    the moment at which that one began. After all of them it has what it had before.

    Attributes:
        step: the call of one; `count`: how many; `size`: of one, s.
        asks: of FMI 3, a byte for each of `ASKS`; `reached`: the time that the last step reached, s.
    """

    step: Call
    count: int
    size: float
    clock: Clock
    asks: ctypes.Array[ctypes.c_char] | None = None
    reached: ctypes.c_double = field(default_factory=ctypes.c_double)

    def __call__(self) -> int:
        (function, arguments), clock, asks = self.step, self.clock, self.asks
        begin, own = clock.time, clock.own
        for number in range(self.count):
            if number:
                clock.set(begin + number * self.size, own + number * self.size)
            if (status := function(*arguments)) and status != WARNING:
                return status
            if asks is not None:
                if self.reached.value < clock.now.value + self.size * NEARLY:
                    asks[EARLY] = b"\1"
                if asks.raw != NOTHING:
                    return ASKED
        if self.count > 1:
            clock.set(begin, own)
        return OK


_unpacked: dict[bytes, Scratch] = {}  # by the hashes of the FMUs
_unpacking = threading.Lock()


def _unpacked_once(path: Path) -> Path | None:
    """The folder in which one of our own FMUs, which write nothing there, is until the process ends.

    None for an FMU made elsewhere, and for what cannot be read.
    """
    with suppress(OSError), _unpacking:
        if path.is_file() and (content := own_content(path)) is not None:
            there = _unpacked.get(key := hashlib.sha256(content).digest())
            if there is None or not there.path.is_dir():
                there = Scratch()
                with zipfile.ZipFile(io.BytesIO(content)) as archive:  # from what was looked at
                    archive.extractall(there.path)
                _unpacked[key] = there
            return there.path
    return None


class FmuInstance:
    """One instance of an FMU, named as in its system. To be closed, or used as a context manager.

    Args:
        name: its name, unique among the instances of the process.
        path: the .fmu file.
        label: how errors call it; by default `name file.fmu`.
        mark: told which call is being made, outside of the loop, and `"", ""` when it is over.
        start: s, the time that it begins at.

    Raises:
        FmuError, ArchiveError, XmlError: it cannot be unpacked, read, loaded or instantiated.
    """

    def __init__(
        self,
        name: str,
        path: Path,
        label: str = "",
        mark: Mark = unmarked,
        start: float = 0.0,
    ) -> None:
        self.name, self._mark, self._start = name, mark, start
        self._asks = (ctypes.c_char * len(ASKS))()
        self.label = label or f"{name} {path.name}"
        self._scratch: Scratch | None = None  # a folder of its own
        self._slave: Any = None
        self._dead = False
        self._keep: list[Any] = []  # what C holds addresses of
        self._functions: dict[str, Callable[..., int]] = {}
        try:
            if (folder := _unpacked_once(path)) is None:
                self._scratch = Scratch()
                folder = self._scratch.path
                unpack(path, folder)
            self._folder = folder
            self.description = describe(path, folder)
            with held_interrupts():  # what it logs calls Python back
                self._instantiate()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> FmuInstance:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _instantiate(self) -> None:
        description = self.description
        _messages[self.name] = deque(maxlen=4)
        arguments = {
            "guid": description.fmpy.guid,
            "unzipDirectory": str(self._folder),
            "modelIdentifier": description.fmpy.coSimulation.modelIdentifier,
            "instanceName": self.name,
        }
        self._mark(self.name, f"load and fmi{description.version}Instantiate")
        try:
            with chdir(Path.cwd()):  # fmpy stays in the folder of a library that it cannot load
                if description.version == 2:
                    self._slave = fmpy.fmi2.FMU2Slave(**arguments)
                    self._slave.instantiate(callbacks=_callbacks, loggingOn=True)
                else:
                    self._slave = fmpy.fmi3.FMU3Slave(**arguments)
                    self._slave.instantiate(loggingOn=True, logMessage=self._log3)
        except Exception as reason:  # fmpy raises plain Exception
            text = self._why_not_loaded() or _one_line(reason).replace(f"{self._folder}{os.sep}", "")
            raise FmuError(f"{self.label}: cannot be instantiated: {text}{self._last_message()}") from None
        self._handle = ctypes.c_void_p(self._slave.component)
        self._quieten()
        self._mark("", "")

    def _why_not_loaded(self) -> str:
        """What is wrong with the binary; empty if the system loads it."""
        platform = fmpy.platform if self.description.version == 2 else fmpy.platform_tuple
        binaries = self._folder / "binaries"
        identifier = self.description.fmpy.coSimulation.modelIdentifier
        library = binaries / platform / f"{identifier}{fmpy.sharedLibraryExtension}"
        if not library.parent.is_dir():
            return f"it has no binary for this machine ({platform}); it has {_names(binaries)}"
        if not library.is_file():
            return (
                f'binaries/{platform} lacks {library.name}, which modelIdentifier="{identifier}" names; '
                f"it holds {_names(library.parent)}; give the binary that name, or export again"
            )
        try:
            ctypes.CDLL(str(library))
        except OSError as reason:
            return why_not_loaded(library, reason)
        return ""

    def _log3(self, environment: Any, status: int, category: bytes, message: bytes) -> None:
        if status >= WARNING:
            _messages[self.name].append((status, (message or b"").decode(errors="replace").strip()))

    def _quieten(self) -> None:
        """Ask for errors and warnings only, where the FMU has log categories for them."""
        names = [
            category.name
            for category in self.description.fmpy.logCategories
            if any(word in category.name.lower() for word in ("error", "fatal", "warning"))
        ]
        if names:
            array = (ctypes.c_char_p * len(names))(*(name.encode() for name in names))
            flag = ctypes.c_int(1) if self.description.version == 2 else ctypes.c_bool(True)
            with suppress(Exception):
                function = f"fmi{self.description.version}SetDebugLogging"
                self._function(function)(self._handle, flag, ctypes.c_size_t(len(names)), array)

    def _last_message(self) -> str:
        messages = _messages.get(self.name)
        return f'; it says: "{_one_line(messages[-1][1])}"' if messages else ""

    def _function(self, name: str) -> Callable[..., int]:
        """The C function that fmpy bound."""
        if name not in self._functions:
            bound = self._slave._functions.get(name)
            if bound is None:
                raise FmuError(f"{self.label}: lacks the function {name}")
            address = ctypes.cast(bound, ctypes.c_void_p).value or 0
            self._functions[name] = Function(address)
        return self._functions[name]

    def _values(self, verb: str, quantities: Sequence[Quantity], address: int) -> Call:
        references = np.array([q.reference for q in quantities], dtype=np.uint32)
        self._keep.append(references)
        count = ctypes.c_size_t(len(quantities))
        arguments = (self._handle, ctypes.c_void_p(references.ctypes.data), count, ctypes.c_void_p(address))
        version = self.description.version
        function = self._function(f"fmi{version}{verb}{quantities[0].access.fmi}")
        return function, arguments if version == 2 else (*arguments, count)

    def setting(self, quantities: Sequence[Quantity], address: int) -> Call:
        """The call that sets quantities of one type from consecutive values at an address."""
        return self._values("Set", quantities, address)

    def getting(self, quantities: Sequence[Quantity], address: int) -> Call:
        """The call that gets quantities of one type into consecutive values at an address."""
        return self._values("Get", quantities, address)

    def stepping(self, clock: Clock, size: float, count: int = 1) -> Call:
        """The call that makes `count` steps, each of `size` s, from the time of the clock on."""
        h = ctypes.c_double(size)
        call: Call
        if self.description.version == 2:
            call = self._function("fmi2DoStep"), (self._handle, clock.now, h, ctypes.c_int(1))
            return call if count == 1 else (Steps(call, count, size, clock), ())
        reached = ctypes.c_double(math.nan)  # as long as it does not tell
        end, event, early = (ctypes.c_void_p(ctypes.addressof(self._asks) + i) for i in range(len(ASKS)))
        answers = (event, end, early, ctypes.c_void_p(ctypes.addressof(reached)))
        call = self._function("fmi3DoStep"), (self._handle, clock.now, h, ctypes.c_bool(True), *answers)
        return Steps(call, count, size, clock, self._asks, reached), ()

    def set_values(self, values: Mapping[str, float], time: float = 0.0) -> None:
        """Set parameters or inputs by name, one call each: for the start, not for the tick.

        Raises:
            FmuError: a name that it lacks, or a status other than ok or warning.
            ParameterError: a value that the type of its variable does not hold.
        """
        for name, value in values.items():
            quantity = self.description.find(name, *SET)
            if not quantity.holds(value):
                raise ParameterError(
                    f"{self.label}: {name} is given {value:.10g}, the FMU declares {quantity.type_name}; "
                    "give one of those"
                )
            buffer = np.array([value]).astype(quantity.access.dtype)
            self.call(self.setting([quantity], buffer.ctypes.data), f'set of "{name}"', time)
            self._keep.pop()

    def initialize(self, values: Mapping[str, float]) -> None:
        """Set parameters and inputs, and bring the instance to its start time.

        Raises:
            FmuError, ParameterError: as `set_values`.
        """
        with held_interrupts():
            self._initialize(values)

    def _initialize(self, values: Mapping[str, float]) -> None:
        self.set_values(values)
        no, zero, start = ctypes.c_int(0), ctypes.c_double(0.0), ctypes.c_double(self._start)
        if self.description.version == 2:
            self.request("SetupExperiment", no, zero, start, no, zero)
            self.request("EnterInitializationMode")
        else:
            off = ctypes.c_bool(False)
            self.request("EnterInitializationMode", off, zero, start, off, zero)
        self.request("ExitInitializationMode")

    def request(self, name: str, *arguments: Any) -> str:
        """Call a function by its name without the version, `Reset`, outside of the tick; its full name.

        Raises:
            FmuError: the FMU lacks it, or a status other than ok or warning.
        """
        function = f"fmi{self.description.version}{name}"
        self.call((self._function(function), (self._handle, *arguments)), function, 0.0)
        return function

    def call(self, call: Call, what: str, time: float) -> None:
        """Make one call; `check` its status."""
        function, arguments = call
        self._mark(self.name, what)
        if status := function(*arguments):
            self.check(status, what, time)
        self._mark("", "")

    def check(self, status: int, what: str, time: float) -> None:
        """Accept a warning; for a worse status raise an error with the FMU's last message.

        Raises:
            FmuError: naming FMU, function, status and time; or what a step asked for.
        """
        if status == WARNING:
            return
        file, moment = self.description.path.name, f" at t = {time:.10g} s"
        if status == ASKED and self._asks.raw != NOTHING:
            kind, text = next(ask for ask, byte in zip(ASKS, self._asks.raw, strict=True) if byte)
            fault = Fault(kind, self.name, file, what, time)
            raise FmuError(f"{self.label}: {text.format(moment)}", fault)
        self._dead = self._dead or status == FATAL
        name = STATUS[status] if 0 <= status < len(STATUS) else f"the illegal status {status}"
        raise FmuError(
            f"{self.label}: {what} returned {name}{moment}{self._last_message()}",
            Fault("status", self.name, file, what, time),
        )

    def close(self) -> None:
        """End and free the instance, unload its library, remove its files."""
        with held_interrupts():
            self._close()

    def _close(self) -> None:
        slave, self._slave = self._slave, None
        if slave is not None and slave.component and not self._dead:
            # an instance after an error may refuse to end; it is freed all the same
            version = self.description.version
            with suppress(Exception):
                self._mark(self.name, f"fmi{version}Terminate")
                slave.terminate()
            with suppress(Exception):
                self._mark(self.name, f"fmi{version}FreeInstance")
                slave.freeInstance()
            self._mark("", "")
        _messages.pop(self.name, None)
        if self._scratch is not None:
            self._scratch.close()
