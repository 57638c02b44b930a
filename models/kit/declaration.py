"""The declaration of a block's variables: name, unit, meaning, start and range on one line.

A variable is a typed descriptor. On the class it is the declaration; on an instance, while the block's
equations are traced, it is the symbol that stands for its value now, and assigning to it is an update.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator, Sequence
from typing import Any, Literal, Protocol, TypeAlias, overload

from models.errors import DeclarationError, ParameterError, nearest
from models.kit import casadi as ca
from models.kit.units import UNITS

SX: TypeAlias = Any  # ca.SX: CasADi has no type stubs
Kind = Literal["input", "output", "parameter", "state"]


class Type(enum.Enum):
    """The three types a variable can have; an enumeration is an Integer with named values."""

    REAL = "Real"
    INTEGER = "Integer"
    BOOLEAN = "Boolean"


class Traced(Protocol):
    """One tracing of a block: it holds the values of the variables while equations are traced."""

    def read(self, variable: Variable) -> SX: ...
    def write(self, variable: Variable, value: SX | float) -> None: ...


Real = Type.REAL  # without a unit
Integer = Type.INTEGER
Boolean = Type.BOOLEAN


class Variable:
    """One declared variable, scalar or vector.

    `unit_or_type` is a unit of `models.kit.units` (then the type is Real), `Integer`, `Boolean`, an
    `enum.IntEnum` (an Integer with named values), or `Real` for a value in whatever unit. A vector of n is n
    scalars `name[1]` .. `name[n]` outside.
    """

    kind: Kind
    name: str

    def __init__(
        self,
        unit_or_type: str | Type | type[enum.IntEnum],
        meaning: str,
        *,
        start: float | Sequence[float] | None = None,
        min: float | None = None,
        max: float | None = None,
        size: int | None = None,
    ) -> None:
        self.meaning = meaning
        self.size = size
        self.unit = ""
        self.choices: type[enum.IntEnum] | None = None
        if isinstance(unit_or_type, str):
            if unit_or_type not in UNITS:
                raise DeclarationError(
                    f'"{meaning}": unit "{unit_or_type}" is unknown{nearest(unit_or_type, UNITS)}'
                )
            self.type, self.unit = Type.REAL, unit_or_type
        elif isinstance(unit_or_type, Type):
            self.type = unit_or_type
        else:
            self.type, self.choices = Type.INTEGER, unit_or_type
            min, max = float(unit_or_type(_lowest(unit_or_type))), float(_highest(unit_or_type))
        if self.type is Type.BOOLEAN:
            min, max = 0.0, 1.0
        self.min, self.max = min, max
        self.has_start = start is not None
        if start is None:  # unset: zero, or the nearest value in the range
            start = (min if min is not None and min > 0 else 0.0) if max is None or max >= 0 else max
        values = list(start) if isinstance(start, Sequence) else [start]
        self.start: tuple[float, ...] = tuple(
            float(v) for v in (values * self.width if len(values) == 1 else values)
        )
        if len(self.start) != self.width:
            raise DeclarationError(f'"{meaning}": {len(self.start)} start values for size {self.width}')

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, block: None, owner: type) -> Variable: ...
    @overload
    def __get__(self, block: Traced, owner: type) -> SX: ...
    def __get__(self, block: Traced | None, owner: type) -> Variable | SX:
        return self if block is None else block.read(self)

    def __set__(self, block: Traced, value: SX | float) -> None:
        block.write(self, value)

    @property
    def width(self) -> int:
        """Number of scalars: 1, or the size of the vector."""
        return self.size or 1

    @property
    def flat_names(self) -> tuple[str, ...]:
        """`name`, or `name[1]` .. `name[n]`."""
        return (self.name,) if self.size is None else tuple(f"{self.name}[{i + 1}]" for i in range(self.size))

    def contains(self, value: SX) -> SX:
        """Symbolic: is the value a number within the declared range? False for NaN and infinities."""
        low = self.min if self.min is not None else -LARGEST
        high = self.max if self.max is not None else LARGEST
        return ca.fabs(value) <= high if low == -high else ca.logic_and(value >= low, value <= high)

    def check(self, value: float, what: str) -> None:
        """Refuse a value of the wrong type or out of the declared range.

        Raises:
            ParameterError: naming `what`, the value, and what was expected.
        """
        if not math.isfinite(value):
            raise ParameterError(f"{what} is {value}; expected a finite number")
        if self.type is not Type.REAL and value != int(value):
            raise ParameterError(f"{what} is {value}; expected {self.expected()}")
        if (self.min is not None and value < self.min) or (self.max is not None and value > self.max):
            raise ParameterError(f"{what} is {value:.15g}; expected {self.expected()}")
        if self.choices and value not in list(self.choices):
            raise ParameterError(f"{what} is {value:.15g}; expected {self.expected()}")

    def expected(self) -> str:
        """The values that are accepted, in words: type, named values, range, unit."""
        if self.choices:
            return "one of " + ", ".join(f"{int(c)} ({c.name})" for c in self.choices)
        if self.type is Type.BOOLEAN:
            return "true or false"
        words = {Type.REAL: "a number", Type.INTEGER: "a whole number"}[self.type]
        if self.min is not None:
            words += f" from {self.min:.10g}"
        if self.max is not None:
            words += f" up to {self.max:.10g}"
        return words + (f" {self.unit}" if self.unit not in ("", "1") else "")

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, {self.unit or self.type.value!r})"


LARGEST = 3.4028234663852886e38  # the largest float32: a larger value is infinite on board


def _lowest(choices: type[enum.IntEnum]) -> int:
    return min(int(c) for c in choices)


def _highest(choices: type[enum.IntEnum]) -> int:
    return max(int(c) for c in choices)


class Input(Variable):
    """A value from another block on each tick. Without a start value it must be linked."""

    kind = "input"


class Output(Variable):
    """An answer of the block; assigned on every tick."""

    kind = "output"


class Parameter(Variable):
    """A value that is set before initialization; a `latched` one is read when the trial starts.

    What a tick computes depends on a `structural` one, the number of streets or whether there are limits: a
    batch of trials that share its value is compiled for it. Of a `switch` only whether it is 0 counts.
    Two vectors of a block may be a pair: the elements of one end windows that those of the other begin
    (`begins`), or complete them to points (`beside`). Each names the other vector.
    """

    kind = "parameter"

    def __init__(
        self,
        *args: Any,
        latched: bool = False,
        structural: bool = False,
        switch: bool = False,
        begins: str = "",
        beside: str = "",
        **kwargs: Any,
    ) -> None:
        super().__init__(*args, **kwargs)
        self.latched, self.structural, self.switch = latched, structural or switch, switch
        self.begins, self.beside = begins, beside
        if not self.has_start:
            raise DeclarationError(f'parameter "{self.meaning}" has no start value')


class State(Variable):
    """A value that the block remembers from tick to tick; on most ticks it may have a `usual` one."""

    kind = "state"

    def __init__(self, *args: Any, usual: float | None = None, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.usual = usual


SUBSTREAMS = 256  # of a stream


class Stream(State):
    """The six numbers of a random stream (MRG32k3a), one substream per purpose.

    Its start is the substream `substream` of the stream that the block's parameter `seed` selects; if it has
    a `number`, as many substreams further on as the parameter of this name says.
    """

    def __init__(self, meaning: str, *, substream: int, number: str = "") -> None:
        if not 0 <= substream < SUBSTREAMS:
            raise DeclarationError(
                f'stream "{meaning}" has substream {substream}; expected 0 to {SUBSTREAMS - 1}'
            )
        super().__init__("1", f"random stream: {meaning}", start=12345.0, size=6)
        self.substream, self.number = substream, number


def flatten(variables: Sequence[Variable]) -> Iterator[tuple[str, Variable]]:
    """The scalars of some variables in order, as (flat name, variable)."""
    for variable in variables:
        for name in variable.flat_names:
            yield name, variable
