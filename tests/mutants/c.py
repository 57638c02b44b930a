"""Mutants of C as it stands in this project: clang-format's spaces, parentheses around operands (MISRA 12.1).

Comparisons, their bounds, logic and its operands, conditions, arithmetic, numbers, statements. What does not
compile without warnings is no mutant.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from tests.mutants.mutant import Mutant, changed, distinct

TOKEN = re.compile(
    r"""(?P<skip>/\*.*?\*/|"[^"\n]*"|^[ \t]*\#[ \t]*(?:include|if|else|endif|error|ifndef|ifdef)[^\n]*)
    |(?P<number>\b(?:0[xX][0-9a-fA-F]+[uUlL]*|\d+\.\d*(?:e[-+]?\d+)?[fF]?|\d+[uUlL]*)\b)
    |(?P<word>[A-Za-z_]\w*)
    |(?P<sign><<=|>>=|->|\+\+|--|<<|>>|[-+*/|&^]=|[<>=!]=|&&|\|\||[-+*/%<>=!&|^~?:;,(){}\[\].#])""",
    re.DOTALL | re.MULTILINE | re.VERBOSE,
)
SWAPS = {
    "<": ("<=", ">="), "<=": ("<", ">"), ">": (">=", "<="), ">=": (">", "<"), "==": ("!=",), "!=": ("==",),
    "&&": ("||",), "||": ("&&",), "+": ("-",), "-": ("+",), "*": ("/",), "/": ("*",), "|": ("&",),
    "&": ("|",),
    "^": ("|",), "<<": (">>",), ">>": ("<<",), "|=": ("&=",), "+=": ("-=",), "-=": ("+=",), "^=": ("|=",),
    "++": ("--",), "true": ("false",), "false": ("true",),
}  # fmt: skip
BINARY = {"+", "-", "*", "/", "|", "&", "^", "<", ">"}  # between spaces; else pointers, signs, addresses
NEUTRAL = {"&&": "true", "||": "false"}
OPENING, CLOSING = set("([{"), set(")]}")
ENDS = {";", ",", "?", ":", "=", "return", "{", "}"}
DECLARATION = re.compile(r"(?:static |const )|\w+ (?:\*\s?(?:const )?)?\w+(?:\[\w*\])?(?: =|;|,)")
STATEMENT = re.compile(r"(?:\([\w ]+\))?[A-Za-z_][\w.>\[\]()&* -]*?(?: [-+|&^]?= |\(|\+\+|--)")


class _Token:
    """One token and its place."""

    def __init__(self, match: re.Match[str]) -> None:
        self.text, self.kind = match.group(), match.lastgroup
        self.start, self.end = match.span()


def mutants(file: str, source: str) -> list[Mutant]:
    """The mutants of a C file."""
    tokens = [token for token in map(_Token, TOKEN.finditer(source)) if token.kind != "skip"]
    return distinct(
        changed(file, source, start, end, new)
        for i in range(len(tokens))
        for start, end, new in (
            *_swaps(source, tokens, i),
            *_logic(source, tokens, i),
            *_dropped(source, tokens, i),
        )
    )


def _swaps(source: str, tokens: list[_Token], i: int) -> Iterator[tuple[int, int, str]]:
    """Other operators, other numbers."""
    token = tokens[i]
    spaced = source[token.start - 1 : token.start] == " " == source[token.end : token.end + 1]
    if token.text not in BINARY or spaced:
        for new in SWAPS.get(token.text, ()):
            yield token.start, token.end, new
    if token.text == "!" or (token.text == "-" and not spaced and tokens[i + 1].kind == "number"):
        yield token.start, token.end, ""
    if token.kind == "number":
        digits = re.match(r"0[xX][0-9a-fA-F]+|[\d.]+(?:e[-+]?\d+)?", token.text)
        assert digits is not None
        suffix = token.text[digits.end() :]
        if "." in digits.group():
            yield token.start, token.end, f"{2.0 * float(digits.group())!r}{suffix}"
        else:
            value = int(digits.group(), 0)
            for new_value in (value + 1, value - 1):
                if new_value >= 0:
                    yield token.start, token.end, f"{new_value}{suffix}"


def _logic(source: str, tokens: list[_Token], i: int) -> Iterator[tuple[int, int, str]]:
    """Operands of && and || left out; a condition of `if`, `while` or `?` without a comparison, inverted."""
    token = tokens[i]
    if token.text in NEUTRAL:
        for start, end in (_left(tokens, i), _right(tokens, i)):
            yield start, end, NEUTRAL[token.text]
    elif token.text == "?":
        start, end = _left(tokens, i)
        yield start, end, f"!({source[start:end]})"
    elif token.text in ("if", "while"):
        start, end = _within(tokens, i + 1)
        yield start, end, f"!({source[start:end]})"


def _left(tokens: list[_Token], i: int) -> tuple[int, int]:
    """The operand to the left of a token."""
    depth, k = 0, i - 1
    while k >= 0 and not (depth == 0 and (tokens[k].text in OPENING | ENDS or tokens[k].text in NEUTRAL)):
        depth += (tokens[k].text in CLOSING) - (tokens[k].text in OPENING)
        k -= 1
    return tokens[k + 1].start, tokens[i - 1].end


def _right(tokens: list[_Token], i: int) -> tuple[int, int]:
    """The operand to the right of a token."""
    depth, k = 0, i + 1
    while not (depth == 0 and (tokens[k].text in CLOSING | ENDS or tokens[k].text in NEUTRAL)):
        depth += (tokens[k].text in OPENING) - (tokens[k].text in CLOSING)
        k += 1
    return tokens[i + 1].start, tokens[k - 1].end


def _within(tokens: list[_Token], i: int) -> tuple[int, int]:
    """What stands within the parentheses that open at a token."""
    depth, k = 1, i + 1
    while depth > 0:
        depth += (tokens[k].text in OPENING) - (tokens[k].text in CLOSING)
        k += 1
    return tokens[i + 1].start, tokens[k - 2].end


def _dropped(source: str, tokens: list[_Token], i: int) -> Iterator[tuple[int, int, str]]:
    """A statement left out: an assignment or a call."""
    if tokens[i].text not in (";", "{", "}", ":", "else") or i + 1 == len(tokens):
        return
    k = i + 1
    while k < len(tokens) and tokens[k].text not in (";", "{", "}"):
        k += 1
    if k == len(tokens) or tokens[k].text != ";" or k == i + 1:
        return
    statement = source[tokens[i + 1].start : tokens[k].end]
    if STATEMENT.match(statement) and not DECLARATION.match(statement):
        keyword = tokens[i + 1].text in (
            "if",
            "while",
            "for",
            "switch",
            "case",
            "default",
            "return",
            "do",
            "typedef",
        )
        if not keyword:
            yield tokens[i + 1].start, tokens[k].end, ";"
