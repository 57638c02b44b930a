"""Tracing: a block's equations become CasADi functions, the program that C and the reference run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

from models.errors import DeclarationError
from models.kit import casadi as ca
from models.kit.declaration import SX, Output, Parameter, State, Stream, Variable
from models.kit.elementary import Precision, lower
from models.kit.geometry import all_of

Guard = str | Callable[[Any], SX]
Method = Callable[[Any], Any]
GROUPS = ("state", "input", "parameter", "output")  # the arguments of every traced function, in this order


class Condition(NamedTuple):
    """A condition and its words, joined with others by `&`."""

    holds: SX
    words: str

    def __and__(self, other: Condition) -> Condition:
        """Both hold."""
        return Condition(all_of(self.holds, other.holds), f"{self.words}, {other.words}")


@dataclass(frozen=True)
class Update:
    """One traced update: `writes[i]` becomes element i of `function(states, inputs, parameters, outputs)`."""

    name: str
    doc: str
    writes: tuple[str, ...]
    function: Any  # ca.Function: 4 column vectors -> 1 column vector
    guard: Any = None  # ca.Function: 4 column vectors -> scalar; None: every tick
    when: str = ""  # the guard in words
    seldom: bool | str = False  # or the parameter without which it is
    edges: tuple[tuple[int, int], ...] = ()  # of the state machine: from which mode to which


@dataclass(frozen=True)
class Transition:
    """One traced row of a table."""

    mode: int
    next: int
    guard: Any  # ca.Function: 4 column vectors -> scalar
    writes: tuple[str, ...]
    function: Any
    anomaly: int
    when: str = ""  # the guard in words


@dataclass(frozen=True)
class Table:
    """One traced state machine over the state `mode`."""

    name: str
    doc: str
    mode: str
    rows: tuple[Transition, ...]
    guard: Any = None  # as in Update
    when: str = ""


Phase = Update | Table


@dataclass(frozen=True)
class Program:
    """A block's equations as lowered CasADi functions in one precision: what C and the reference run."""

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


class Equations(Protocol):
    """What tracing needs of a block: its class declares, an object of it is one tracing of the equations.

    Attributes:
        moore: the outputs depend on the states alone.
        assigned: the values that were assigned in this tracing, by variable.
    """

    moore: ClassVar[bool]
    assigned: dict[str, SX]

    def __init__(self, symbols: Mapping[str, SX], readable: set[str], precision: Precision = ...) -> None: ...
    @classmethod
    def title(cls) -> str: ...
    @classmethod
    def variables(cls, *kinds: type[Variable]) -> dict[str, Variable]: ...
    @classmethod
    def group(cls, kind: str) -> list[Variable]: ...
    @classmethod
    def flat_names(cls, kind: str) -> list[str]: ...
    @classmethod
    def streams(cls) -> list[Stream]: ...
    @classmethod
    def updates(cls) -> dict[str, Method]: ...


def trace(block: type[Equations], precision: Precision) -> Program:
    """Trace a block's equations into functions of one precision.

    Raises:
        DeclarationError: an output is not set on every tick, read before it is set, or, in a `moore`
            block, depends on an input; an update assigns what it may not; a table's mode is not a state.
    """
    name = block.__name__
    tracer = _Tracer(block, precision)
    methods = block.updates()
    initialize = [tracer.update(n, methods.pop(n)) for n in list(methods) if n.startswith("initialize")]
    tick = [tracer.phase(name, method) for name, method in methods.items()]
    missing = block.variables(Output).keys() - tracer.readable
    if missing:
        raise DeclarationError(f"{name}: {', '.join(sorted(missing))} not set on every tick")
    if block.moore:
        last = tick[-1]
        if not isinstance(last, Update) or last.name != "output":
            raise DeclarationError(f"{name}: the last update of a moore block is `output`")
        early = [n for n in block.flat_names("output") if n not in last.writes]
        if early:
            raise DeclarationError(f"{name}: a moore block sets {', '.join(early)} in `output` alone")
        for kind in ("input", "output"):
            if last.function.sparsity_jac(GROUPS.index(kind), 0).nnz():
                raise DeclarationError(f"{name}.output depends on {kind}s; a moore block's may not")
        initialize.append(last)
    return Program(precision, tuple(initialize), tuple(tick))


class _Tracer:
    """Traces one block; knows which outputs have a value by now."""

    def __init__(self, block: type[Equations], precision: Precision) -> None:
        self.block, self.precision = block, precision
        self.readable: set[str] = set()
        for stream in block.streams():
            if "seed" not in block.variables(Parameter):
                raise DeclarationError(f'{block.__name__}: stream "{stream.name}" needs a parameter "seed"')

    def open(self) -> tuple[Equations, list[SX]]:
        """A new tracing: an instance of the block, and the four vectors of symbols that it reads."""
        groups = [self.block.group(kind) for kind in GROUPS]
        symbols = {v.name: ca.SX.sym(v.name, v.width) for group in groups for v in group}
        arguments = [ca.vertcat(*(symbols[v.name] for v in group)) for group in groups]
        return self.block(symbols, self.readable, self.precision), arguments

    def close(self, name: str, arguments: list[SX], values: Sequence[SX]) -> Any:
        """The values as a lowered function of the arguments."""
        result = ca.vertcat(*values) if values else ca.SX(0, 1)
        try:
            result = lower(ca.cse(ca.densify(result)), self.precision)
        except ValueError as reason:
            raise DeclarationError(f"{self.block.__name__}.{name}: {reason}") from None
        return ca.Function(f"{self.block.title()}_{name}", arguments, [result], list(GROUPS), ["result"])

    def writes(self, assigned: Mapping[str, SX]) -> tuple[tuple[str, ...], list[SX]]:
        """The assignments, as flat names and scalars."""
        declared = self.block.variables()
        flat = [
            (n, value[i]) for name, value in assigned.items() for i, n in enumerate(declared[name].flat_names)
        ]
        return tuple(n for n, _ in flat), [value for _, value in flat]

    def guard(self, name: str, method: Method) -> tuple[Any, str]:
        """The guard of an update as a function, and in words; (None, "") without one."""
        guard: Guard | None = getattr(method, "guard", None)
        if guard is None:
            return None, ""
        if isinstance(guard, str) and guard not in self.block.variables():
            raise DeclarationError(f'{self.block.__name__}.{name}: guard "{guard}" is not a variable')
        m, arguments = self.open()
        condition = getattr(m, guard) if isinstance(guard, str) else guard(m)
        words = f"`{guard}`" if isinstance(guard, str) else getattr(method, "when", "")
        return self.close(f"{name}_guard", arguments, [ca.SX(condition)]), words

    def update(self, name: str, method: Method) -> Update:
        guard, when = self.guard(name, method)
        m, arguments = self.open()
        method(m)
        names, values = self.writes(m.assigned)
        seldom = getattr(method, "seldom", False)
        if isinstance(seldom, str):
            switch = self.block.variables(Parameter).get(seldom)
            if not (isinstance(switch, Parameter) and switch.structural):
                raise DeclarationError(
                    f'{self.block.__name__}.{name}: seldom "{seldom}" does not name a structural parameter'
                )
        update = Update(
            name,
            (method.__doc__ or "").strip(),
            names,
            self.close(name, arguments, values),
            guard,
            when,
            seldom,
            getattr(method, "edges", ()),
        )
        if guard is None:
            self.readable |= m.assigned.keys() & self.block.variables(Output).keys()
        return update

    def table(self, name: str, method: Method, mode: str) -> Table:
        if mode not in self.block.variables(State):
            raise DeclarationError(f'{self.block.__name__}.{name}: mode "{mode}" is not a state')
        m, arguments = self.open()
        rows = []
        for index, row in enumerate(list(method(m))):
            m.assigned.clear()
            assigned = {mode: row.next, **row.assign}
            if row.anomaly:
                assigned["anomaly"] = row.anomaly
            for target, value in assigned.items():
                if target not in self.block.variables():
                    raise DeclarationError(f'{self.block.__name__}.{name}: row assigns unknown "{target}"')
                setattr(m, target, value)
            names, values = self.writes(m.assigned)
            holds, words = row.guard if isinstance(row.guard, Condition) else (row.guard, "")
            rows.append(
                Transition(
                    int(row.mode),
                    int(row.next),
                    self.close(f"{name}_{index}_guard", arguments, [ca.SX(holds)]),
                    names,
                    self.close(f"{name}_{index}", arguments, values),
                    int(row.anomaly),
                    words,
                )
            )
        return Table(name, (method.__doc__ or "").strip(), mode, tuple(rows), *self.guard(name, method))

    def phase(self, name: str, method: Method) -> Phase:
        mode = getattr(method, "mode", None)
        return self.update(name, method) if mode is None else self.table(name, method, mode)
