"""Expressions of `[buffers]`: what a buffer is computed of. Nothing is evaluated.

    sum     = ["-"] term { ("+" | "-") term }
    term    = factor { "*" factor }           numbers, and at most one name
    name    = [files ":"] channel             as in the files, ending in a letter a component
    number  = 0.5, 1, 2e-3

Operators stand between spaces, so that names may hold their signs: `Depth-left.Z`. A name in which
an operator stands between spaces is put in single quotes. `.RGB` at the end of a name is one
channel a component of the buffer; any letters of RGBA, XYZW or UVW will do, as many as components.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from rtsr_cli.core.captures.layouts import ChannelPlace, ChannelSum, Component, Term
from rtsr_cli.core.documents import shorten_value
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer
from rtsr_cli.core.limits import LARGEST_FACTOR

MOST_TERMS, MOST_OPERATORS = 16, 64
"""Terms, and operators, of one expression."""

SHORTHANDS = frozenset(
    {"RGB", "XYZ", "UVW", "RG", "XY", "UV", "rgb", "xyz", "uvw", "rg", "xy", "uv"}
)
"""Ends of a name that stand for one channel a letter, whatever the buffer."""

ALPHABETS = tuple(map(frozenset, ("RGBA", "XYZW", "UVW", "rgba", "xyzw", "uvw")))
"""Letters that stand for one channel each where there are as many as the buffer has channels."""

OPERATORS = frozenset("+-*")

UNREADABLE = {
    "/": "'/' is no operator; multiply by a number (0.01 * x)",
    "(": "there are no parentheses: write a factor before each channel; a name that begins with "
    "one stands in single quotes",
    ")": "there are no parentheses: write a factor before each channel",
    "'": "a closing ' is missing",
}
"""What is said of signs that mean something elsewhere."""

_TOKEN = re.compile(r"'(?P<quoted>[^']*)'(?=\s|$)|(?P<operator>[-+*/()])(?=\s|$)|(?P<word>\S+)")

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


@dataclass(frozen=True, kw_only=True)
class _Token:
    """An operator, a name, or a number; `column` counts from 1."""

    text: str
    column: int
    kind: str
    quoted: bool = False


@dataclass(frozen=True, kw_only=True)
class _Product:
    """A term: a factor on a name, or a constant."""

    factor: float
    name: _Token | None


def is_expression(text: str) -> bool:
    """Tell whether a text is more than the name of a channel."""
    tokens = list(_split_tokens(text))
    plain = len(tokens) == 1 and tokens[0].kind == "name" and not tokens[0].quoted
    return bool(tokens) and not plain


def parse_expression(text: str, channels: int, *, scoped: bool = False) -> tuple[ChannelSum, ...]:
    """Read an expression.

    Args:
        text: as it is written.
        channels: components of the buffer.
        scoped: whether names may have been written without their scope.

    Returns:
        What each component is the sum of.

    Raises:
        ValueError: it is none; names the column.
    """
    tokens = list(_split_tokens(text))
    _check_length(tokens)
    products = _parse_sum(tokens)
    constant = sum(product.factor for product in products if product.name is None)
    factors = [constant, *(product.factor for product in products)]
    if not all(abs(factor) <= LARGEST_FACTOR for factor in factors):
        raise ValueError(f"its numbers are out of range (allowed: up to {LARGEST_FACTOR:g})")
    named = [(product.factor, product.name) for product in products if product.name is not None]
    parts = [_spread_name(token, channels) for _, token in named]
    return tuple(
        ChannelSum(
            terms=tuple(
                Term(
                    place=replace(parts[i][component], scoped=scoped),
                    factor=factor,
                    column=token.column,
                )
                for i, (factor, token) in enumerate(named)
            ),
            constant=constant,
        )
        for component in range(channels)
    )


def _check_length(tokens: Sequence[_Token]) -> None:
    """Hold an expression to a length before it is read, which takes its square in time."""
    operators = [token.text for token in tokens if token.kind == "operator"]
    leading = bool(tokens) and tokens[0].kind == "operator"
    terms = 1 + sum(text in "+-" for text in operators[leading:])
    if terms > MOST_TERMS:
        raise ValueError(f"has {terms} terms (allowed: {MOST_TERMS} or less)")
    if len(operators) > MOST_OPERATORS:
        raise ValueError(f"has {len(operators)} operators (allowed: {MOST_OPERATORS} or less)")


def explain_signs(name: str) -> str:
    """What to say of a name that is not there, and looks as if more were meant; may be empty."""
    if name.startswith("'"):
        return "; column 1: a quote is opened and not closed"
    if "(" in name:
        return f"; column {name.index('(') + 1}: there are no parentheses and no functions"
    if any(sign in name for sign in "+-*/"):
        return "; operators stand between spaces: 'a.RGB + b.RGB', '1 - a.R'"
    return ""


def explain_quotes(name: str, channels: Sequence[str]) -> str:
    """What to say of a name that is a part of one in which an operator stands; may be empty."""
    words = name.split()
    for channel in channels:
        known = [channel.split()[i : i + len(words)] for i in range(len(channel.split()))]
        if is_expression(channel) and words in known:
            return f"; of '{channel}' the whole name stands in single quotes: \"'{channel}'\""
    return ""


def explain_letters(name: str, channels: int) -> str:
    """What to say of a name whose last letters are too many or too few; empty if they are none."""
    last = name.rpartition(".")[2]
    if last == name or not any(alphabet.issuperset(last) for alphabet in ALPHABETS):
        return ""
    return f"; '.{last}' is {len(last)}: end the name in {channels} (.{'RGB'[:channels]})"


def name_sums(buffer: Buffer, *expressions: str) -> tuple[Component, ...]:
    """Components of a buffer that is computed, by the expressions that are tried in order."""
    turns = [parse_expression(text, BUFFER_SPECS[buffer].channels) for text in expressions]
    return tuple(Component(places=places) for places in zip(*turns, strict=True))


def split_name(text: str) -> ChannelPlace:
    """Read `files:channel`, or a channel of any files."""
    file, separated, channel = text.rpartition(":")
    return ChannelPlace(channel=channel, file=file) if separated else ChannelPlace(channel=text)


def list_letters(text: str, channels: int) -> str:
    """Return the letters at the end of a name that stand for one channel each, '' if none do."""
    last = text.rpartition(":")[2].rpartition(".")[2]
    swizzle = len(last) == channels and any(alphabet.issuperset(last) for alphabet in ALPHABETS)
    return last if channels > 1 and (swizzle or last in SHORTHANDS) else ""


def _spread_name(token: _Token, channels: int) -> list[ChannelPlace]:
    """Places of a name's channels, one a component of the buffer."""
    letters = list_letters(token.text, channels)
    if len(letters or " ") != channels:
        raise ValueError(
            f"column {token.column}: '{shorten_value(token.text)}' is {len(letters) or 1} "
            f"channel{'s' if letters else ''}, the buffer has {channels}; end the name in as many "
            f"letters (.{'RGB'[:channels]}, .{'XYZ'[:channels]}, .{'RRR'[:channels]})"
        )
    before = token.text.removesuffix(letters)
    places = [split_name(before + letter) for letter in letters] or [split_name(token.text)]
    if not all(place.channel and place.file for place in places):
        raise ValueError(f"column {token.column}: a name is missing beside the colon")
    return places


def _split_tokens(text: str) -> Iterator[_Token]:
    """Operators, numbers and names, in order; words of a name stay together."""
    words: list[re.Match[str]] = []
    for match in _TOKEN.finditer(text):
        if match["word"] is not None:
            words.append(match)
            continue
        yield from _join_words(text, words)
        words = []
        quoted = match["quoted"]
        yield _Token(
            text=match[0] if quoted is None else quoted,
            column=match.start() + 1,
            kind="operator" if quoted is None else "name",
            quoted=quoted is not None,
        )
    yield from _join_words(text, words)


def _join_words(text: str, words: Sequence[re.Match[str]]) -> Iterator[_Token]:
    if words:
        whole = text[words[0].start() : words[-1].end()]
        kind = "number" if _NUMBER.fullmatch(whole) else "name"
        yield _Token(text=whole, column=words[0].start() + 1, kind=kind)


def _parse_sum(tokens: list[_Token]) -> list[_Product]:
    products: list[_Product] = []
    sign, rest = 1.0, tokens
    if rest and rest[0].text == "-" and rest[0].kind == "operator":
        sign, rest = -1.0, rest[1:]
    before = "" if rest is tokens else "'-'"
    end = tokens[-1].column + len(tokens[-1].text) if tokens else 1
    while True:
        product, rest = _parse_product(rest, before, end)
        products.append(replace(product, factor=sign * product.factor))
        if not rest:
            break
        operator, rest = rest[0], rest[1:]
        sign, before = (-1.0 if operator.text == "-" else 1.0), f"'{operator.text}'"
    return products


def _parse_product(tokens: list[_Token], before: str, end: int) -> tuple[_Product, list[_Token]]:
    """Read a product, and return the tokens after it, the first of which is + or -."""
    factor, name = 1.0, None
    while True:
        operand, tokens = _take_operand(tokens, before, end)
        if operand.kind == "number":
            factor *= float(operand.text)
        elif name is None:
            name = operand
        else:
            raise ValueError(
                f"column {operand.column}: channels are added or subtracted, not multiplied with "
                "each other; a factor is a number"
            )
        if not tokens or (tokens[0].kind == "operator" and tokens[0].text in "+-"):
            return _Product(factor=factor, name=name), tokens
        _check_operator(tokens[0])
        before, tokens = "'*'", tokens[1:]


def _take_operand(tokens: list[_Token], before: str, end: int) -> tuple[_Token, list[_Token]]:
    """Return the name or number that comes next, and the tokens after it."""
    if not tokens or (tokens[0].text in OPERATORS and tokens[0].kind == "operator"):
        column = tokens[0].column if tokens else end
        raise ValueError(
            f"column {column}: a channel or a number is missing{before and f' after {before}'}"
        )
    token = tokens[0]
    if token.kind == "operator":
        _check_operator(token)
    if not token.quoted and token.text[0] in "'(":
        raise ValueError(f"column {token.column}: {UNREADABLE[token.text[0]]}")
    if not token.text:
        raise ValueError(f"column {token.column}: a name is empty")
    return token, tokens[1:]


def _check_operator(token: _Token) -> None:
    """Hold what stands between two operands to be an operator that there is."""
    if token.kind != "operator":
        raise ValueError(f"column {token.column}: an operator (+, -, *) is missing before this")
    if token.text not in OPERATORS:
        raise ValueError(f"column {token.column}: {UNREADABLE[token.text]}")


def write_sum(terms: Sequence[tuple[float, str]], constant: float) -> str:
    """Write a sum as an expression.

    Args:
        terms: factor and name of each channel.
        constant: what is added.
    """
    parts = [(factor, _quote(name)) for factor, name in terms]
    if constant or not parts:
        # 1 - x rather than -1 * x + 1
        parts.insert(len(parts) if parts and parts[0][0] > 0 else 0, (constant, ""))
    return "".join(_write_part(*part, first=i == 0) for i, part in enumerate(parts))


def _quote(name: str) -> str:
    return f"'{name}'" if is_expression(name) else name


def _write_part(factor: float, name: str, *, first: bool) -> str:
    if first and name and factor < 0:
        return f"{_write_number(factor)} * {name}"
    sign = ("-" if factor < 0 else "") if first else (" - " if factor < 0 else " + ")
    number = "" if name and abs(factor) == 1.0 else _write_number(abs(factor))
    return f"{sign}{number}{' * ' if name and number else ''}{name}"


def _write_number(value: float) -> str:
    short = f"{value:g}"
    return short if float(short) == value else repr(value)
