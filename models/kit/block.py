"""A block: variables declared once, and the equations of its tick, traced into CasADi functions.

The public methods of a block are the updates of its tick, in the order in which they stand. An update may be
`triggered`: it then runs only on ticks on which its guard holds, and is a function of its own, behind a real
`if` in C. A `table` is a state machine. Two names are special: `initialize`, and what begins with it, runs
once, when the parameters are known, and `output` of a `moore` block is its last update and depends on states
and parameters alone.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, ClassVar

from models.errors import DeclarationError, ParameterError
from models.kit import casadi as ca
from models.kit.declaration import SX, Output, Parameter, State, Stream, Variable, flatten
from models.kit.elementary import Precision, lower

Guard = str | Callable[[Any], SX]
Method = Callable[[Any], Any]
GROUPS = ("state", "input", "parameter", "output")  # the arguments of every traced function, in this order


def first_line(documented: type) -> str:
    """The first line of a class's docstring, "" without one."""
    return (documented.__doc__ or "").strip().partition("\n")[0]


def triggered(guard: Guard, *, seldom: bool = False) -> Callable[[Method], Method]:
    """Run an update only on ticks on which the guard holds: a Boolean variable's name, or an expression.

    `seldom` says that this is on less than one tick in about fifty. It changes no result: where many trials
    run side by side, a trial leaves the others for that tick.
    """

    def mark(method: Method) -> Method:
        method.guard, method.seldom = guard, seldom  # type: ignore[attr-defined]
        return method

    return mark


@dataclass(frozen=True)
class Row:
    """One transition: in `mode`, when `guard` holds, assign and go to `next`.

    `anomaly` names what is wrong with the animal, if the transition reports it.
    """

    mode: int
    guard: SX
    next: int
    assign: Mapping[str, SX | float] = field(default_factory=dict)
    anomaly: int = 0


def table(mode: str) -> Callable[[Method], Method]:
    """A state machine over the Integer state `mode`: the method gives its `Row`s.

    The first row of the current mode whose guard holds is carried out; no match stays. Guards and assigned
    values see what stood before the table.
    """

    def mark(method: Method) -> Method:
        method.mode = mode  # type: ignore[attr-defined]
        return method

    return mark


@dataclass(frozen=True)
class Update:
    """One traced update: `writes[i]` becomes element i of `function(states, inputs, parameters, outputs)`."""

    name: str
    doc: str
    writes: tuple[str, ...]
    function: Any  # ca.Function: 4 column vectors -> 1 column vector
    guard: Any = None  # ca.Function: 4 column vectors -> scalar; None: every tick
    seldom: bool = False


@dataclass(frozen=True)
class Transition:
    """One traced row of a table."""

    mode: int
    next: int
    guard: Any  # ca.Function: 4 column vectors -> scalar
    writes: tuple[str, ...]
    function: Any
    anomaly: int


@dataclass(frozen=True)
class Table:
    """One traced state machine over the state `mode`."""

    name: str
    doc: str
    mode: str
    rows: tuple[Transition, ...]
    guard: Any = None  # as in Update


Phase = Update | Table


@dataclass(frozen=True)
class Program:
    """A block's equations as lowered CasADi functions in one precision: what C and the reference run."""

    block: type[Block]
    precision: Precision
    initialize: tuple[Update, ...]
    tick: tuple[Phase, ...]

    @property
    def functions(self) -> Iterable[Any]:
        """Every CasADi function of the program, once."""
        for phase in dict.fromkeys((*self.initialize, *self.tick)):
            if isinstance(phase, Table):
                for row in phase.rows:
                    yield from (row.guard, row.function)
            else:
                yield phase.function
            if phase.guard is not None:
                yield phase.guard


class Block:
    """Base of all blocks. An instance is one tracing of the equations; users work with the class.

    Attributes:
        sample_time: seconds between ticks.
        source: where the equations come from.
        moore: the outputs depend on the states alone (a plant), so that a loop through it closes.
        precisions: what C may be generated in; the double one is the reference.
    """

    sample_time: ClassVar[float] = 0.04  # s, the 25 Hz of the IMU (2.3)
    source: ClassVar[str] = ""
    moore: ClassVar[bool] = False
    precisions: ClassVar[tuple[Precision, ...]] = ("double",)

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Refuse start values outside of their declared range.

        Raises:
            DeclarationError: naming the variable, its start and its range.
        """
        super().__init_subclass__(**kwargs)
        for variable in vars(cls).values():
            if isinstance(variable, Variable):
                try:
                    for value in variable.start:
                        variable.check(value, f"{cls.__name__}.{variable.name}")
                except ParameterError as reason:
                    raise DeclarationError(f"start of {reason}") from None

    def __init__(self, symbols: dict[str, SX], readable: set[str], precision: Precision = "double") -> None:
        self._symbols = symbols
        self._readable = readable  # outputs that have a value by now
        self._values: dict[str, SX] = {}
        self.precision = precision

    def read(self, variable: Variable) -> SX:
        """The variable's value now, during tracing."""
        if variable.name in self._values:
            return self._values[variable.name]
        if isinstance(variable, Output) and variable.name not in self._readable:
            raise DeclarationError(
                f'{type(self).__name__}: output "{variable.name}" is read before it is set'
            )
        return self._symbols[variable.name]

    def write(self, variable: Variable, value: SX | float) -> None:
        """Update the variable, during tracing."""
        if not isinstance(variable, State | Output):
            raise DeclarationError(f'{type(self).__name__}: {variable.kind} "{variable.name}" is assigned')
        value = ca.SX(value)
        if value.numel() != variable.width:
            raise DeclarationError(
                f"{type(self).__name__}.{variable.name} has {variable.width} elements, got {value.numel()}"
            )
        self._values[variable.name] = ca.densify(value)

    def within(self, *names: str) -> SX:
        """Symbolic: are all these variables numbers within their declared ranges?"""
        declared = self.variables()
        checks = [
            declared[name].contains(getattr(self, name)[i])
            for name in names
            for i in range(declared[name].width)
        ]
        return reduce(ca.logic_and, checks)

    @classmethod
    def title(cls) -> str:
        """The block's name outside of Python: `FourState` is `four_state`."""
        return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", cls.__name__).lower()

    @classmethod
    def summary(cls) -> str:
        """What the block is: the first line of its docstring, "" without one."""
        return first_line(cls)

    @classmethod
    def variables(cls, *kinds: type[Variable]) -> dict[str, Variable]:
        """The declared variables (of some kinds) in the order of their declaration, bases first."""
        found: dict[str, Variable] = {}
        for base in reversed(cls.__mro__):
            found.update({n: v for n, v in vars(base).items() if isinstance(v, Variable)})
        return {n: v for n, v in found.items() if not kinds or isinstance(v, kinds)}

    @classmethod
    def group(cls, kind: str) -> list[Variable]:
        """The declared variables of one of GROUPS."""
        return [v for v in cls.variables().values() if v.kind == kind]

    @classmethod
    def flat_names(cls, kind: str) -> list[str]:
        """The scalars of one of GROUPS, in order."""
        return [name for name, _ in flatten(cls.group(kind))]

    @classmethod
    def streams(cls) -> list[Stream]:
        """The block's random streams."""
        return [v for v in cls.variables().values() if isinstance(v, Stream)]

    @classmethod
    def program(cls, precision: Precision = "double") -> Program:
        """Trace the equations into functions (once per precision).

        Raises:
            DeclarationError: an output is not set on every tick, read before it is set, or, in a `moore`
                block, depends on an input; an update assigns what it may not; a table's mode is not a state.
        """
        if (cls, precision) not in _PROGRAMS:
            _PROGRAMS[cls, precision] = _trace(cls, precision)
        return _PROGRAMS[cls, precision]


def _methods(cls: type[Block]) -> dict[str, Method]:
    """The updates of a block, in the order of their definition, bases first."""
    own = set(dir(Block))
    found: dict[str, Method] = {}
    for base in reversed(cls.__mro__):
        if issubclass(base, Block) and base is not Block:
            found.update(
                {
                    n: f
                    for n, f in vars(base).items()
                    if callable(f) and not n.startswith("_") and n not in own
                }
            )
    return {n: getattr(cls, n) for n in found}


class _Tracer:
    """Traces one block; knows which outputs have a value by now."""

    def __init__(self, cls: type[Block], precision: Precision) -> None:
        self.cls, self.precision = cls, precision
        self.readable: set[str] = set()
        for stream in cls.streams():
            if "seed" not in cls.variables(Parameter):
                raise DeclarationError(f'{cls.__name__}: stream "{stream.name}" needs a parameter "seed"')

    def open(self) -> tuple[Block, list[SX]]:
        groups = [self.cls.group(kind) for kind in GROUPS]
        symbols = {v.name: ca.SX.sym(v.name, v.width) for group in groups for v in group}
        arguments = [ca.vertcat(*(symbols[v.name] for v in group)) for group in groups]
        return self.cls(symbols, self.readable, self.precision), arguments

    def close(self, name: str, arguments: list[SX], values: Sequence[SX]) -> Any:
        result = ca.vertcat(*values) if values else ca.SX(0, 1)
        try:
            result = lower(ca.cse(ca.densify(result)), self.precision)
        except ValueError as reason:
            raise DeclarationError(f"{self.cls.__name__}.{name}: {reason}") from None
        return ca.Function(f"{self.cls.title()}_{name}", arguments, [result], list(GROUPS), ["result"])

    def writes(self, assigned: dict[str, SX]) -> tuple[tuple[str, ...], list[SX]]:
        declared = self.cls.variables()
        flat = [
            (n, value[i]) for name, value in assigned.items() for i, n in enumerate(declared[name].flat_names)
        ]
        return tuple(n for n, _ in flat), [value for _, value in flat]

    def guard(self, name: str, method: Method) -> Any:
        guard: Guard | None = getattr(method, "guard", None)
        if guard is None:
            return None
        if isinstance(guard, str) and guard not in self.cls.variables():
            raise DeclarationError(f'{self.cls.__name__}.{name}: guard "{guard}" is not a variable')
        m, arguments = self.open()
        condition = getattr(m, guard) if isinstance(guard, str) else guard(m)
        return self.close(f"{name}_guard", arguments, [ca.SX(condition)])

    def update(self, name: str, method: Method) -> Update:
        guard = self.guard(name, method)
        m, arguments = self.open()
        method(m)
        names, values = self.writes(m._values)
        update = Update(
            name,
            (method.__doc__ or "").strip(),
            names,
            self.close(name, arguments, values),
            guard,
            getattr(method, "seldom", False),
        )
        if guard is None:
            self.readable |= m._values.keys() & self.cls.variables(Output).keys()
        return update

    def table(self, name: str, method: Method, mode: str) -> Table:
        if mode not in self.cls.variables(State):
            raise DeclarationError(f'{self.cls.__name__}.{name}: mode "{mode}" is not a state')
        m, arguments = self.open()
        rows = []
        for index, row in enumerate(list(method(m))):
            m._values.clear()
            assigned = {mode: row.next, **row.assign}
            if row.anomaly:
                assigned["anomaly"] = row.anomaly
            for target, value in assigned.items():
                if target not in self.cls.variables():
                    raise DeclarationError(f'{self.cls.__name__}.{name}: row assigns unknown "{target}"')
                setattr(m, target, value)
            names, values = self.writes(m._values)
            rows.append(
                Transition(
                    int(row.mode),
                    int(row.next),
                    self.close(f"{name}_{index}_guard", arguments, [ca.SX(row.guard)]),
                    names,
                    self.close(f"{name}_{index}", arguments, values),
                    int(row.anomaly),
                )
            )
        return Table(name, (method.__doc__ or "").strip(), mode, tuple(rows), self.guard(name, method))

    def phase(self, name: str, method: Method) -> Phase:
        mode = getattr(method, "mode", None)
        return self.update(name, method) if mode is None else self.table(name, method, mode)


_PROGRAMS: dict[tuple[type[Block], Precision], Program] = {}


def _trace(cls: type[Block], precision: Precision) -> Program:
    tracer = _Tracer(cls, precision)
    methods = _methods(cls)
    initialize = [tracer.update(n, methods.pop(n)) for n in list(methods) if n.startswith("initialize")]
    tick = [tracer.phase(name, method) for name, method in methods.items()]
    missing = cls.variables(Output).keys() - tracer.readable
    if missing:
        raise DeclarationError(f"{cls.__name__}: {', '.join(sorted(missing))} not set on every tick")
    if cls.moore:
        last = tick[-1]
        if not isinstance(last, Update) or last.name != "output":
            raise DeclarationError(f"{cls.__name__}: the last update of a moore block is `output`")
        early = [n for n in cls.flat_names("output") if n not in last.writes]
        if early:
            raise DeclarationError(f"{cls.__name__}: a moore block sets {', '.join(early)} in `output` alone")
        for kind in ("input", "output"):
            if last.function.sparsity_jac(GROUPS.index(kind), 0).nnz():
                raise DeclarationError(f"{cls.__name__}.output depends on {kind}s; a moore block's may not")
        initialize.append(last)
    return Program(cls, precision, tuple(initialize), tuple(tick))
