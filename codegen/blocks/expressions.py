"""CasADi instructions to C expressions: named fields, typed literals, real conditionals, one value per name.

A function's instructions become nodes in single-assignment form. A node used once stands where it is used;
one used more often gets a local. Integers and Booleans stay what they are, so that comparing a mode costs no
floating-point operation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Generator, Sequence
from typing import Any, Literal

import casadi as ca
import numpy as np

from models.errors import DeclarationError
from models.kit.block import Block
from models.kit.declaration import Type, Variable, flatten
from models.kit.elementary import Precision
from models.kit.tracing import GROUPS

CType = Literal["real", "int", "bool", "constant"]
BINARY = {
    ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/",
    ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!=", ca.OP_AND: "&&", ca.OP_OR: "||",
}  # fmt: skip
COMPARISONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE)
LOGIC = (ca.OP_AND, ca.OP_OR, ca.OP_NOT)
MIRRORED = {"<": ">", "<=": ">=", "==": "==", "!=": "!="}  # to read constants on the right
CALLS = {ca.OP_SQRT: "sqrt", ca.OP_FLOOR: "floor", ca.OP_FABS: "fabs"}
SELECT = -1  # c ? a : b, for which CasADi has no instruction
PRINTED = {SELECT, *BINARY, *CALLS, ca.OP_NEG, ca.OP_NOT, ca.OP_SQ, ca.OP_TWICE, ca.OP_INV}
MEMBERS = {"state": "state", "input": "in", "parameter": "par", "output": "out"}  # group -> C struct member
Asking = Generator[tuple["Node", "CType"], str, str]  # asks for operands' texts, returns its own
WIDTH = 88  # an expression longer than this is given a name


class Node:
    """One value: an operation on other nodes, a field of the block's struct, or a constant.

    Attributes:
        ctype: what C computes it as; `constant`: made of constants alone, it takes the type of its use.
        uses: by how many operands and results of the function.
    """

    def __init__(
        self,
        op: int,
        operands: tuple[Node, ...] = (),
        value: float = 0.0,
        field: str = "",
        variable: Variable | None = None,
    ) -> None:
        self.op, self.operands, self.value, self.field = op, operands, value, field
        self.variable = variable
        self.ctype = self._ctype()
        self.uses = 0
        self.name = ""  # of the local that holds it, once it has one
        self.held_as: CType = "real"  # the type of that local
        self.chosen_for: Variable | None = None  # of a select: the enumerated variable that becomes its value

    def _ctype(self) -> CType:
        if self.op == ca.OP_CONST:
            return "constant" if self.value == int(self.value) and abs(self.value) < 2**31 else "real"
        if self.variable is not None:
            kinds: dict[Type, CType] = {Type.REAL: "real", Type.INTEGER: "int", Type.BOOLEAN: "bool"}
            return kinds[self.variable.type]
        if self.op in COMPARISONS or self.op in LOGIC:
            return "bool"
        if self.op in (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_NEG, SELECT):
            values = self.operands[1:] if self.op == SELECT else self.operands
            kinds_of = {operand.ctype for operand in values}
            if kinds_of == {"constant"}:
                return "constant" if self.op == SELECT else "real"
            return "real" if "real" in kinds_of else "int"
        return "real"


Leaf = Callable[[int, int], Node]  # (which of GROUPS, element) -> its node
Make = Callable[[int, tuple[Node, ...]], Node]  # (operation, operands) -> its node


def read(function: Any, leaf: Leaf, make: Make = Node) -> tuple[list[Node], int]:
    """The nodes of a traced function's results, and how many operations it takes.

    Raises:
        DeclarationError: an operation that C does not get from us (it would be a library call), or a
            constant that is not finite.
    """
    work: dict[int, Node] = {}
    results: list[Node] = [Node(ca.OP_CONST)] * int(function.numel_out(0))
    made: dict[int, int] = {}  # which instruction has made what is in a register
    negates: dict[int, int] = {}  # of a negation: the instruction that has made what it negates
    halves: dict[int, tuple[int, Node, Node]] = {}  # of (c ? a : 0): what has made c, c, a
    operations = 0
    for k in range(function.n_instructions()):
        op, into, of = (
            function.instruction_id(k),
            function.instruction_output(k),
            function.instruction_input(k),
        )
        if op == ca.OP_OUTPUT:
            results[into[1]] = work[of[0]]
            continue
        if op == ca.OP_CONST:
            value = float(function.instruction_constant(k))
            if not math.isfinite(value):
                raise DeclarationError(f"{function.name()}: constant {value} has no C literal")
            node = Node(op, value=value)
        elif op == ca.OP_INPUT:
            node = leaf(of[0], of[1])
        else:
            operations += 1
            operands = tuple(work[i] for i in of)
            if op == ca.OP_IF_ELSE_ZERO:
                halves[k] = (made[of[0]], operands[0], operands[1])
                op, operands = SELECT, (*operands, Node(ca.OP_CONST))
            elif op == ca.OP_NOT:
                negates[k] = made[of[0]]
            elif op == ca.OP_ADD:  # if_else(c, a, b) is (c ? a : 0) + (!c ? b : 0)
                for i, j in (of, of[::-1]):
                    one, other = halves.get(made[i]), halves.get(made[j])
                    if one and other and negates.get(other[0]) == one[0]:
                        op, operands = SELECT, (*one[1:], other[2])
            if op not in PRINTED:
                raise DeclarationError(f"{function.name()}: operation {op} has no C without a library")
            node = make(op, operands)
        work[into[0]], made[into[0]] = node, k
    return results, operations


def fields(block: type[Block], constants: Collection[str] = ()) -> Leaf:
    """The leaves of a block's functions: fields of its struct `m`; parameters may be constants."""
    flat = [list(flatten(block.group(kind))) for kind in GROUPS]

    def leaf(group: int, element: int) -> Node:
        name, variable = flat[group][element]
        if name in constants:
            return Node(ca.OP_INPUT, field=constant_name(block, name), variable=variable)
        return Node(ca.OP_INPUT, field=f"m->{MEMBERS[GROUPS[group]]}.{c_name(name)}", variable=variable)

    return leaf


def count_uses(results: Sequence[Node]) -> None:
    """Count by how many operations and results each node is used."""
    used = list(results)
    while used:
        node = used.pop()
        node.uses += 1
        if node.uses == 1:
            used += node.operands * 2 if node.op == ca.OP_SQ else node.operands  # x * x names x twice


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
    """Writes expressions of one function body; collects the locals they need.

    An expression may be as deep as its function is long, deeper than Python calls go: what writes a node
    yields the operands that it needs, and `_run` keeps the stack.

    Args:
        enum_name: the C of a named value.
        branchless: both sides of "and" and "or" are computed, as vectors do.
        constants: parameters that are constants of the block's header, and no fields.
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
        self.enum_name = enum_name
        self.binary = BINARY | {ca.OP_AND: "&", ca.OP_OR: "|"} if branchless else BINARY
        self.lines: list[str] = []
        self._names = 0

    @property
    def real(self) -> str:
        """The C type of a Real."""
        return self.precision

    def name(self, node: Node, want: CType, name: str = "") -> None:
        """Give the node a local."""
        self._run(self._name(node, want, name), locals_allowed=True)

    def write(self, node: Node, want: CType, locals_allowed: bool = True) -> str:
        """The C expression of a node as the type wanted."""
        return self._run(self._write(node, want, locals_allowed), locals_allowed)

    def _run(self, asking: Asking, locals_allowed: bool) -> str:
        """What the generator returns, once all that it asks for is written."""
        stack, text = [asking], ""
        while stack:
            try:
                operand, want = stack[-1].send(text) if text else next(stack[-1])
            except StopIteration as done:
                stack.pop()
                text = done.value
            else:
                stack.append(self._write(operand, want, locals_allowed))
                text = ""
        return text

    def _name(self, node: Node, want: CType, name: str = "") -> Asking:
        ctype = want if node.ctype == "constant" else node.ctype
        text = yield from self._compose(node, ctype)
        if not name:
            name, self._names = f"t{self._names}", self._names + 1
        c_type = {"real": self.real, "int": "int32_t", "bool": "bool"}[ctype]
        self.lines.append(f"const {c_type} {name} = {_bare(text)};")
        node.name, node.held_as = name, ctype
        return name

    def _write(self, node: Node, want: CType, locals_allowed: bool) -> Asking:
        if node.op == ca.OP_CONST or (node.field and not node.name):
            return (yield from self._compose(node, want))
        if locals_allowed and not node.name:
            text = (yield from self._compose(node, want)) if node.uses == 1 else ""
            if text and len(text) <= WIDTH:
                return text
            yield from self._name(node, want)
        if node.name:
            return _cast(node.name, node.held_as, want, self.real)
        return (yield from self._compose(node, want))

    def _compose(self, node: Node, want: CType) -> Asking:
        if node.op == ca.OP_CONST:
            if want == "int":
                return str(int(node.value))
            if want == "bool":
                return "true" if node.value else "false"
            return _parenthesized(literal(node.value, self.precision))
        if node.field:
            return _cast(node.field, node.ctype, want, self.real)
        ctype: CType = want if node.ctype == "constant" else node.ctype
        a = node.operands
        if node.op in COMPARISONS:
            return _cast((yield from self._compare(node)), "bool", want, self.real)
        if node.op == ca.OP_NOT:
            return _cast(f"!{(yield a[0], 'bool')}", "bool", want, self.real)
        if node.op in LOGIC:
            text = f"({(yield a[0], 'bool')} {self.binary[node.op]} {(yield a[1], 'bool')})"
            return _cast(text, "bool", want, self.real)
        if node.op == SELECT:
            yes = self._choice(node, a[1]) or (yield a[1], ctype)
            no = self._choice(node, a[2]) or (yield a[2], ctype)
            text = f"({(yield a[0], 'bool')} ? {yes} : {no})"
        elif node.op in BINARY:
            text = f"({(yield a[0], ctype)} {BINARY[node.op]} {(yield a[1], ctype)})"
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
            text = f"{CALLS[node.op]}{suffix}({_bare((yield a[0], ctype))})"
        return _cast(text, ctype, want, self.real)

    def _choice(self, select: Node, value: Node) -> str:
        """The name of a constant that an enumerated variable may become, if it has one."""
        variable = select.chosen_for
        if variable is None or value.op != ca.OP_CONST or value.value not in list(variable.choices or ()):
            return ""
        return self.enum_name(variable, int(value.value))

    def _compare(self, node: Node) -> Asking:
        a, b = node.operands
        symbol = BINARY[node.op]
        for field, constant in ((a, b), (b, a)):
            if (
                field.variable is not None
                and field.variable.choices
                and constant.op == ca.OP_CONST
                and constant.value in list(field.variable.choices)
            ):
                symbol = symbol if field is a else MIRRORED[symbol]
                return f"({field.field} {symbol} {self.enum_name(field.variable, int(constant.value))})"
        kinds = {a.ctype, b.ctype}
        as_type: CType = "real" if "real" in kinds or kinds == {"constant"} else "int"
        if a.op == ca.OP_CONST:
            a, b, symbol = b, a, MIRRORED[symbol]
        return f"({(yield a, as_type)} {symbol} {(yield b, as_type)})"


def _cast(text: str, have: CType, want: CType, real: str) -> str:
    if have == want:
        return text
    if want == "bool":
        return f"({text} != 0)"
    if want == "int":
        return f"(int32_t){text}" if have == "bool" else f"(int32_t)({_bare(text)})"
    return f"({real}){text}"


def _bare(text: str) -> str:
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


def statements(
    function: Any,
    block: type[Block],
    writes: Sequence[str],
    writer: Writer,
    keep: Collection[str] | None = None,
) -> tuple[list[str], int]:
    """The body of an update: C lines that compute every result, then store them; and its operation count.

    Args:
        keep: the variables that matter, all by default; others are neither computed nor stored.
    """
    results, operations = read(function, fields(block, writer.constants))
    kept = [(name, node) for name, node in zip(writes, results, strict=True) if keep is None or name in keep]
    writes, results = [name for name, _ in kept], [node for _, node in kept]
    count_uses(results)
    declared = dict(flatten([v for kind in ("state", "output") for v in block.group(kind)]))
    stores = []
    for target, node in zip(writes, results, strict=True):
        if declared[target].choices:
            _mark_chosen(node, declared[target])
    for target, node in zip(writes, results, strict=True):
        variable = declared[target]
        field = f"m->{MEMBERS[variable.kind]}.{c_name(target)}"
        want: CType = {Type.REAL: "real", Type.INTEGER: "int", Type.BOOLEAN: "bool"}[variable.type]  # type: ignore[assignment]
        if variable.choices and node.op == ca.OP_CONST and node.value in list(variable.choices):
            stores.append(f"{field} = {writer.enum_name(variable, int(node.value))};")
        elif node.op == ca.OP_CONST or (len(writes) == 1 and not node.name):
            stores.append(f"{field} = {_bare(writer.write(node, want))};")
        else:
            if not node.name and (node.op != ca.OP_INPUT or _is_overwritten(node.field, writes)):
                writer.name(
                    node, want, "next_" + "".join(c if c.isalnum() else "_" for c in target).rstrip("_")
                )
            stores.append(f"{field} = {_bare(writer.write(node, want))};")
    return writer.lines + stores, operations


def _mark_chosen(node: Node, variable: Variable) -> None:
    """Tell the selects behind a result that their constants are named values."""
    behind = [node]
    while behind:
        node = behind.pop()
        if node.op == SELECT and node.chosen_for is None and node.ctype != "real":
            node.chosen_for = variable
            behind += node.operands[1:]


def _is_overwritten(field: str, writes: Sequence[str]) -> bool:
    return field.partition(".")[2] in {c_name(w) for w in writes}


def condition(function: Any, block: type[Block], writer: Writer) -> tuple[str, int]:
    """A guard as one C expression, and its operation count."""
    (node,), operations = read(function, fields(block, writer.constants))
    count_uses([node])
    return _bare(writer.write(node, "bool", locals_allowed=False)), operations
