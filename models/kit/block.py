"""A block: its variables declared once, and the equations of its tick as methods.

The public methods of a block are the updates of its tick, in the order in which they stand. An update may be
`triggered`: it then runs only on ticks on which its guard holds, and is a function of its own, behind a real
`if` in C. A `table` is a state machine. Two names are special. An update whose name begins with `initialize`
runs once, when the parameters are known. `output` of a `moore` block is its last update and depends on states
and parameters alone. `models.kit.tracing` makes CasADi functions of the updates.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, ClassVar

from models.errors import DeclarationError, ParameterError, nearest
from models.kit import casadi as ca
from models.kit.declaration import SX, Output, State, Stream, Variable, flatten
from models.kit.elementary import Precision
from models.kit.timing import TICK
from models.kit.tracing import Condition, Guard, Method, Program, trace


def first_line(documented: type) -> str:
    """The first line of a class's docstring, "" without one.

    Raises:
        DeclarationError: Python has dropped all docstrings.
    """
    if sys.flags.optimize > 1:
        raise DeclarationError(
            "Python runs with -OO (PYTHONOPTIMIZE=2), which drops the texts of which C and FMUs are made; "
            "unset PYTHONOPTIMIZE, or use 1"
        )
    return (documented.__doc__ or "").strip().partition("\n")[0]


def triggered(guard: Guard, when: str = "", *, seldom: bool | str = False) -> Callable[[Method], Method]:
    """Run an update only on ticks on which the guard holds: a Boolean variable's name, or an expression.

    `when` puts an expression into words, for the page about the models. `seldom` says that the guard holds on
    less than one tick in about fifty, or names the Boolean parameter without which it does. It changes no
    result: where many trials run side by side, a trial leaves the others for that tick.
    """

    def mark(method: Method) -> Method:
        method.guard, method.when, method.seldom = guard, when, seldom  # type: ignore[attr-defined]
        return method

    return mark


def before(update: str) -> Callable[[Method], Method]:
    """Run an update that a base lacks before this one of the base; without it, it runs after all of them."""

    def mark(method: Method) -> Method:
        method.before = update  # type: ignore[attr-defined]
        return method

    return mark


def moves(edges: Mapping[int, int]) -> Callable[[Method], Method]:
    """Name the transitions that an update makes outside of the table: in mode m it goes to `edges[m]`.

    They complete the diagram of the state machine and change nothing else.
    """

    def mark(method: Method) -> Method:
        method.edges = tuple(sorted(edges.items()))  # type: ignore[attr-defined]
        return method

    return mark


@dataclass(frozen=True)
class Row:
    """One transition: in `mode`, when `guard` holds, assign and go to `next`.

    A guard with words is a `Condition`. `anomaly` is the one that the transition
    reports, if any.
    """

    mode: int
    guard: SX | Condition
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


class Block:
    """Base of all blocks. An object of it is one tracing of the equations; users work with the class.

    Attributes:
        sample_time: seconds between ticks.
        source: where the equations come from.
        moore: the outputs depend on the states alone (a plant), so that a loop through it closes.
        transparent: it passes a signal on, in whatever unit and with whatever named values; a step of any
            length is one tick.
        behind: what this class declares and does comes behind what the classes that derive from it do.
        precisions: what C may be generated in; the double one is the reference.
    """

    sample_time: ClassVar[float] = TICK
    source: ClassVar[str] = ""
    moore: ClassVar[bool] = False
    transparent: ClassVar[bool] = False
    behind: ClassVar[bool] = False
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

    def __init__(
        self, symbols: Mapping[str, SX], readable: set[str], precision: Precision = "double"
    ) -> None:
        self._symbols = symbols
        self._readable = readable  # outputs that have a value by now
        self.assigned: dict[str, SX] = {}
        self.precision = precision

    def read(self, variable: Variable) -> SX:
        """The variable's value now, during tracing."""
        if variable.name in self.assigned:
            return self.assigned[variable.name]
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
        self.assigned[variable.name] = ca.densify(value)

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
        """The first line of the block's docstring, "" without one."""
        return first_line(cls)

    @classmethod
    def _bases(cls) -> list[type]:
        """The classes that this one is made of: bases first, but those `behind` last."""
        bases = list(reversed(cls.__mro__))
        return sorted(bases, key=lambda base: bool(vars(base).get("behind")))

    @classmethod
    def variables(cls, *kinds: type[Variable]) -> dict[str, Variable]:
        """The declared variables (of some kinds) in the order of their declaration, by `_bases`."""
        if (cls, kinds) not in _VARIABLES:  # a command asks hundreds of times before it begins
            declared: dict[str, Variable] = {}
            for base in cls._bases():
                declared.update({n: v for n, v in vars(base).items() if isinstance(v, Variable)})
            _VARIABLES[cls, kinds] = {n: v for n, v in declared.items() if not kinds or isinstance(v, kinds)}
        return dict(_VARIABLES[cls, kinds])

    @classmethod
    def group(cls, kind: str) -> list[Variable]:
        """The declared variables of one of GROUPS."""
        return [v for v in cls.variables().values() if v.kind == kind]

    @classmethod
    def flat_names(cls, kind: str) -> list[str]:
        """The scalars of one of GROUPS, in order."""
        if (cls, kind) not in _FLAT_NAMES:  # what compiles a batch asks thousands of times
            _FLAT_NAMES[cls, kind] = [name for name, _ in flatten(cls.group(kind))]
        return list(_FLAT_NAMES[cls, kind])

    @classmethod
    def streams(cls) -> list[Stream]:
        """The block's random streams."""
        return [v for v in cls.variables().values() if isinstance(v, Stream)]

    @classmethod
    def updates(cls) -> dict[str, Method]:
        """The updates in the order of their definition, by `_bases`; a redefined one keeps its place.

        Raises:
            DeclarationError: one stands before an update that there is not.
        """
        own = set(dir(Block))
        names: list[str] = []
        for base in cls._bases():
            if issubclass(base, Block) and base is not Block:
                for n, member in vars(base).items():
                    if not callable(member) or n.startswith("_") or n in own or n in names:
                        continue
                    following = getattr(member, "before", None)
                    if following is not None and following not in names:
                        raise DeclarationError(
                            f'{cls.__name__}.{n} is before "{following}", which no base has'
                            f"{nearest(following, names)}"
                        )
                    names.insert(names.index(following) if following else len(names), n)
        return {n: getattr(cls, n) for n in names}

    @classmethod
    def program(cls, precision: Precision = "double") -> Program:
        """Trace the equations into functions (once per precision).

        Raises:
            DeclarationError: an output is not set on every tick, read before it is set, or, in a `moore`
                block, depends on an input; an update assigns what it may not; a table's mode is not a state.
        """
        if (cls, precision) not in _PROGRAMS:
            _PROGRAMS[cls, precision] = trace(cls, precision)
        return _PROGRAMS[cls, precision]


_VARIABLES: dict[tuple[type[Block], tuple[type[Variable], ...]], dict[str, Variable]] = {}
_FLAT_NAMES: dict[tuple[type[Block], str], list[str]] = {}
_PROGRAMS: dict[tuple[type[Block], Precision], Program] = {}
