"""Nodes as C expressions: named fields, typed literals, real conditionals, a local for what is used again.

A node used once stands where it is used; one used more often gets a local. Integers and Booleans stay what
they are, so that comparing a mode costs no floating-point operation.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterator
from contextlib import contextmanager

import casadi as ca
import numpy as np

from codegen.blocks.nodes import COMPARISONS, ELEMENT, LOGIC, SELECT, CType, Leaf, Node, ctype_of
from models.errors import DeclarationError
from models.kit.block import Block
from models.kit.declaration import Parameter, Variable, flatten
from models.kit.elementary import Precision
from models.kit.tracing import GROUPS

BINARY = {
    ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/",
    ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!=", ca.OP_AND: "&&", ca.OP_OR: "||",
}  # fmt: skip
MIRRORED = {"<": ">", "<=": ">=", "==": "==", "!=": "!="}  # to read constants on the right
CALLS = {ca.OP_SQRT: "sqrt", ca.OP_FLOOR: "floor", ca.OP_FABS: "fabs"}
MEMBERS = {"state": "state", "input": "in", "parameter": "par", "output": "out"}  # group -> C struct member
WHOLE: dict[CType, str] = {"int": "int32_t", "short": "int16_t"}  # C's type of whole numbers
MISSION = "mission"  # the member of the parameters that are latched
Asking = Generator[tuple[Node, CType], str, str]  # asks for operands' texts, returns its own
WIDTH = 104  # an expression longer than this gets a local; 88 costs the Rabbit 2 % more clocks
MOST_CHOICES = 12  # a longer chain of choices gets a local


def member_of(variable: Variable) -> str:
    """The member of the block's C struct that has a variable.

    A latched parameter has one beside the others': these are set once, all together.
    """
    is_latched = isinstance(variable, Parameter) and variable.latched
    return MISSION if is_latched else MEMBERS[variable.kind]


def members(block: type[Block]) -> dict[str, list[Variable]]:
    """The variables of each member of the block's C struct, in their order."""
    variables: dict[str, list[Variable]] = {}
    for kind in GROUPS:
        for variable in block.group(kind):
            variables.setdefault(member_of(variable), []).append(variable)
    return variables


def fields(block: type[Block], precision: Precision = "double", constants: Collection[str] = ()) -> Leaf:
    """The leaves of a block's functions: fields of its struct `m`; parameters may be constants."""
    flat = [list(flatten(block.group(kind))) for kind in GROUPS]

    def leaf(group: int, element: int) -> Node:
        name, variable = flat[group][element]
        place = (
            constant_name(block, name) if name in constants else f"m->{member_of(variable)}.{c_name(name)}"
        )
        return Node(ca.OP_INPUT, field=place, variable=variable, ctype=ctype_of(variable, precision))

    return leaf


def c_name(flat_name: str) -> str:
    """`waypoint_north[1]` of a declaration is `waypoint_north[0]` in C."""
    name, bracket, index = flat_name.partition("[")
    return f"{name}[{int(index[:-1]) - 1}]" if bracket else name


def constant_name(block: type[Block], name: str) -> str:
    """The macro of a parameter that is a constant."""
    return f"{block.title()}_{name}".upper()


def literal(value: float, precision: Precision) -> str:
    """The shortest C literal that reads back as this very number in the precision.

    Raises:
        DeclarationError: it is too large for the precision.
    """
    with np.errstate(over="ignore"):
        text = repr(value) if precision == "double" else str(np.float32(value))
    if "inf" in text:
        raise DeclarationError(f"constant {value!r} is too large for {precision}")
    if not any(c in text for c in ".en"):
        text += ".0"
    return text + ("f" if precision == "float" else "")


class Writer:
    """Writes the C of nodes; collects the lines of the locals that they need.

    An expression may be as deep as its function is long, deeper than Python calls go. So what writes a node
    yields the operands whose text it needs, and `_run` keeps the stack.

    Args:
        enum_name: the C of a named value.
        branchless: both sides of "and" and "or" are computed, as vectors do.
        constants: parameters that are constants of the block's header, not fields.
    """

    def __init__(
        self,
        precision: Precision,
        enum_name: Callable[[Variable, int], str] = lambda variable, value: str(value),
        branchless: bool = False,
        constants: Collection[str] = (),
    ) -> None:
        self.precision = precision
        self.constants = constants
        self._enum_name = enum_name
        self.enum_values: dict[str, int] = {}  # by the names that were written
        self.binary = BINARY | {ca.OP_AND: "&", ca.OP_OR: "|"} if branchless else BINARY
        self.lines: list[str] = []
        self._named: list[Node] = []
        self._numbers = 0
        self._chained: set[Node] = set()  # choices that are the last operand of another

    @property
    def real(self) -> str:
        """The C type of a Real."""
        return self.precision

    def enum_name(self, variable: Variable, value: int) -> str:
        """The C of a value of an enumeration."""
        name = self._enum_name(variable, value)
        if name.isidentifier():
            self.enum_values[name] = value
        return name

    @contextmanager
    def braces(self) -> Iterator[None]:
        """Lines written meanwhile stand between braces: indented, and their locals end with them."""
        outer, named, numbers = self.lines, self._named, self._numbers
        self.lines, self._named = [], []
        yield
        for node in self._named:
            node.name = ""
        self.lines = outer + [f"    {line}" for line in self.lines]
        self._named, self._numbers = named, numbers

    def name(self, node: Node, ctype: CType) -> None:
        """Give the node a local."""
        self._run(self._name(node, ctype), locals_allowed=True)

    def write(self, node: Node, ctype: CType, locals_allowed: bool = True) -> str:
        """The C expression of a node, of this type."""
        return self._run(self._write(node, ctype, locals_allowed), locals_allowed)

    def write_whole(self, node: Node, ctype: CType) -> str:
        """The same for a node that needs no local itself, however long its text is."""
        text = self._compose(node, ctype) if not node.name else self._write(node, ctype, True)
        return bare(self._run(text, locals_allowed=True))

    def _run(self, asking: Asking, locals_allowed: bool) -> str:
        """What the generator returns, once all that it asks for is written."""
        stack, text = [asking], ""
        while stack:
            try:
                operand, ctype = stack[-1].send(text) if text else next(stack[-1])
            except StopIteration as done:
                stack.pop()
                text = done.value
            else:
                stack.append(self._write(operand, ctype, locals_allowed))
                text = ""
        return text

    def _name(self, node: Node, use: CType) -> Asking:
        ctype = use if node.ctype == "constant" else node.ctype
        text = yield from self._compose(node, ctype)
        name = node.hint
        if not name:
            name, self._numbers = f"t{self._numbers}", self._numbers + 1
        self.lines.append(f"const {c_type(ctype, self.real)} {name} = {bare(text)};")
        node.name, node.held_as = name, ctype
        self._named.append(node)
        return name

    def _write(self, node: Node, ctype: CType, locals_allowed: bool) -> Asking:
        if node.op == ca.OP_CONST or (node.op == ca.OP_INPUT and not node.name):
            return (yield from self._compose(node, ctype))
        if locals_allowed and not node.name:
            text = (yield from self._compose(node, ctype)) if node.uses == 1 else ""
            if text and _is_short(text, node in self._chained):
                return text
            yield from self._name(node, ctype)
        if node.name:
            return _cast(node.name, node.held_as, ctype, self.real)
        return (yield from self._compose(node, ctype))

    def _compose(self, node: Node, use: CType) -> Asking:
        if node.op == ca.OP_CONST:
            if use in WHOLE:
                return str(int(node.value))
            if use == "bool":
                return "true" if node.value else "false"
            return _parenthesized(literal(node.value, self.precision))
        if node.op == ca.OP_INPUT:
            return _cast(node.field, node.ctype, use, self.real)
        ctype: CType = use if node.ctype == "constant" else node.ctype
        a = node.operands
        if node.op in COMPARISONS:
            text = yield from self._compare(node)
        elif node.op == ca.OP_NOT:
            text = f"!{(yield a[0], 'bool')}"
        elif node.op in LOGIC:
            sides = []
            for side in a:  # a && (b && c) is a && b && c
                text = yield side, "bool"
                sides.append(bare(text) if side.op == node.op and not side.name else text)
            text = f"({sides[0]} {self.binary[node.op]} {sides[1]})"
        elif node.op == SELECT:
            yes = self._named_value(node, a[1]) or (yield a[1], ctype)
            if a[2].op == SELECT:
                self._chained.add(a[2])
            no = self._named_value(node, a[2]) or (yield a[2], ctype)
            if a[2].op == SELECT and not a[2].name:  # c ? a : (d ? b : e) is c ? a : d ? b : e
                no = bare(no)
            text = f"({(yield a[0], 'bool')} ? {yes} : {no})"
        elif node.op == ELEMENT:
            text = f"{node.field}[{bare((yield a[0], a[0].ctype if a[0].ctype in WHOLE else 'int'))}]"
        elif node.op in BINARY:
            text = f"({(yield a[0], ctype)} {BINARY[node.op]} {(yield a[1], ctype)})"
            if ctype == "short":  # C computes it as an int
                text = f"({WHOLE[ctype]}){text}"
        elif node.op == ca.OP_NEG:
            text = f"(-{(yield a[0], ctype)})"
        elif node.op == ca.OP_SQ:
            text = f"({(yield a[0], ctype)} * {(yield a[0], ctype)})"
        elif node.op == ca.OP_TWICE:
            text = f"({literal(2.0, self.precision)} * {(yield a[0], ctype)})"
        elif node.op == ca.OP_INV:
            text = f"({literal(1.0, self.precision)} / {(yield a[0], ctype)})"
        else:
            suffix = "f" if self.precision == "float" else ""
            text = f"{CALLS[node.op]}{suffix}({bare((yield a[0], ctype))})"
        return _cast(text, ctype, use, self.real)

    def _named_value(self, node: Node, constant: Node) -> str:
        """The name of a constant that stands beside a node with named values, "" if it has none."""
        variable = node.enumeration
        if (
            variable is None
            or constant.op != ca.OP_CONST
            or constant.value not in list(variable.choices or ())
        ):
            return ""
        return self.enum_name(variable, int(constant.value))

    def _compare(self, node: Node) -> Asking:
        a, b = node.operands
        symbol = BINARY[node.op]
        if a.steadiness > b.steadiness:  # what is compared on the left, what it is compared with on the right
            a, b, symbol = b, a, MIRRORED[symbol]
        named = self._named_value(a, b)
        if named:
            return f"({(yield a, 'short' if a.ctype == 'short' else 'int')} {symbol} {named})"
        kinds = {a.ctype, b.ctype}
        as_type: CType = "real" if "real" in kinds or kinds == {"constant"} else "int"
        if "short" in kinds and kinds <= {"short", "constant"} and a.is_short and b.is_short:
            as_type = "short"
        return f"({(yield a, as_type)} {symbol} {(yield b, as_type)})"


def _is_short(text: str, chained: bool) -> bool:
    """May the text stand in another? The rest of a chain of choices may if each of them is short."""
    if not chained:
        return len(text) <= WIDTH
    return text.count("?") <= MOST_CHOICES and max(map(len, text.split(" : "))) <= WIDTH


def c_type(ctype: CType, real: str) -> str:
    """The type by which C declares a value."""
    return {"real": real, "bool": "bool", **WHOLE}[ctype]


def _cast(text: str, have: CType, want: CType, real: str) -> str:
    if have == want:
        return text
    if want == "bool":
        return f"({text} != 0)"
    if want in WHOLE:
        return f"({WHOLE[want]}){text}" if have in ("bool", "short") else f"({WHOLE[want]})({bare(text)})"
    return f"({real}){text}"


def bare(text: str) -> str:
    """Without the outermost parentheses, if they enclose the whole."""
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for i, c in enumerate(text):
        depth += (c == "(") - (c == ")")
        if depth == 0 and i < len(text) - 1:
            return text
    return text[1:-1]


def _parenthesized(text: str) -> str:
    return f"({text})" if text.startswith("-") else text
