"""The one parser of units: a text such as ``N·m/rad``, ``kNm`` or ``min-1`` as a product of powers of units."""

from __future__ import annotations

import functools
import re

from modelling.units.common_units import BY_TEXT
from modelling.units.registry import registry

LONGEST_TEXT = 60
LARGEST_EXPONENT = 9
Powers = tuple[tuple[str, int], ...]  # (pint's name of a unit, exponent), e.g. (("kilonewton", 1), ("meter", 1))

_SIGNS = {
    "**": "^", "·": "*", "⋅": "*", "∙": "*", "×": "*", "−": "-", "⁻": "^-", "¹": "1", "²": "2", "³": "3", "⁴": "4",
    "°C": "degC", "°F": "degF", "°": "deg", "″": "arcsecond", "′": "arcminute", "%": "percent", "‰": "permille",
}  # fmt: skip
_TOKEN = re.compile(r"\s*([A-Za-zµμΩΩ_]+|\d+|[*/.^()-])")
_PER_MINUTE = re.compile(r"\(\s*(?:1\s*/\s*min(?:utes?)?|min\s*\^?\s*-\s*1)\s*\)")  # in brackets: a speed
_PER_TIME = r"\s*/\s*(?=(?:min|minutes?|s|secs?|seconds?)\s*$)"
_TURNS = re.compile(rf"(?<![A-Za-z])(?:revs?|turns?|tr|umdr|[ur])\.?{_PER_TIME}", re.IGNORECASE)
_JOINED = re.compile(r"([kMmµμu]?N)([cm]?m)(s?)|(kg)(m)")  # Nm, kNm, Ncm, Nms, kgm2
_ALIASES = {
    "rpm": "turn/minute", "rev": "turn", "revs": "turn", "sec": "second", "secs": "second", "metre": "meter",
    "metres": "meter", "newtonmetre": "newton*meter",
}  # fmt: skip
_ANGLES_AND_TIMES = ("radian", "degree", "turn", "second", "minute", "hour")


class SpellingError(ValueError):
    """The text is no product of powers of known units."""


@functools.lru_cache(maxsize=4096)
def parse(text: str) -> Powers:
    """The unit that a text names.

    Factors are joined by ``*``, ``·``, ``.``, ``-`` or a space; ``/`` divides by the next factor; exponents are written
    ``s^2``, ``s**2``, ``s²``, ``s2``, ``s-2`` or ``s⁻²``. Revolutions are ``rpm``, ``rev/min`` and ``U/min``.

    Raises
    ------
    SpellingError
        If it is too long, not understood, or names a unit that does not exist.
    """
    if len(text) > LONGEST_TEXT:
        raise SpellingError(text)
    for sign, plain in _SIGNS.items():
        text = text.replace(sign, plain)
    text = _TURNS.sub("turn/", _PER_MINUTE.sub("(rpm)", text.strip()))
    tokens = _Tokens(text)
    powers = _product(tokens)
    if tokens.next is not None:
        raise SpellingError(text)
    return tuple((name, exponent) for name, exponent in powers.items() if exponent)


class _Tokens:
    """Tokens of a text; ``next`` is the one ahead (None at the end), ``apart`` whether a space stands before it."""

    def __init__(self, text: str):
        self._tokens: list[tuple[str | None, bool]] = []
        self._at = end = 0
        while end < len(text):
            match = _TOKEN.match(text, end)
            if not match:
                raise SpellingError(f"{text[end:].strip()!r} is not understood")
            parts = _parts(match[1])
            self._tokens += [(part, i == 0 and match.start(1) > end) for i, part in enumerate(parts)]
            end = match.end()
        self._tokens.append((None, True))

    @property
    def next(self) -> str | None:
        return self._tokens[self._at][0]

    @property
    def apart(self) -> bool:
        return self._tokens[self._at][1]

    @property
    def number_after_next(self) -> bool:
        """Whether a number stands behind the token ahead."""
        after = self._tokens[self._at + 1][0]
        return after is not None and after.isdigit()

    def advance(self) -> str | None:
        """The token ahead; the one behind it is next."""
        token = self.next
        self._at += token is not None
        return token


def _parts(word: str) -> list[str]:
    """A word of two or three units written together, as kgm2 and Nms are, as these units with signs between them."""
    joined = _JOINED.fullmatch(word)
    return " * ".join(part for part in joined.groups() if part).split() if joined else [word]


def _product(tokens: _Tokens) -> dict[str, int]:
    """Factors up to the end or a closing bracket."""
    powers: dict[str, int] = {}
    sign = 1
    if tokens.next == "/":  # /min
        tokens.advance()
        sign = -1
    while True:
        for name, exponent in _factor(tokens).items():
            powers[name] = powers.get(name, 0) + sign * exponent
        if tokens.next is None or tokens.next == ")":
            return powers
        sign = 1
        if tokens.next in ("*", "/", ".", "-"):
            sign = -1 if tokens.advance() == "/" else 1
        elif not tokens.apart and tokens.next != "(":
            raise SpellingError("two factors without a sign between them")


def _factor(tokens: _Tokens) -> dict[str, int]:
    token = tokens.advance()
    if token == "(":
        powers = _product(tokens)
        if tokens.advance() != ")":
            raise SpellingError("a bracket is not closed")
    elif token == "1":
        powers = {}
    elif token is not None and (token[0].isalpha() or token[0] == "_"):
        powers = dict(_unit(token))
    else:
        raise SpellingError("a unit is expected")
    exponent = _exponent(tokens, after_name=token not in ("(", "1"))
    return {name: power * exponent for name, power in powers.items()}


def _exponent(tokens: _Tokens, after_name: bool) -> int:
    if tokens.next == "^":
        tokens.advance()
        bracket = tokens.next == "("
        if bracket:
            tokens.advance()
        exponent = _integer(tokens)
        if bracket and tokens.advance() != ")":
            raise SpellingError("a bracket is not closed")
        return exponent
    if after_name and not tokens.apart and tokens.next is not None and tokens.next.isdigit():
        return _integer(tokens)  # s2
    if after_name and not tokens.apart and tokens.next == "-" and tokens.number_after_next:
        return _integer(tokens)  # min-1
    return 1


def _integer(tokens: _Tokens) -> int:
    sign = 1
    if tokens.next == "-":
        tokens.advance()
        sign = -1
    token = tokens.advance()
    if token is None or not token.isdigit() or not 1 <= int(token) <= LARGEST_EXPONENT:
        raise SpellingError("an exponent is expected")
    return sign * int(token)


def _unit(name: str) -> Powers:
    """The unit of one word; words of test beds that pint reads otherwise or not at all come first."""
    if alias := _ALIASES.get(name.lower()):
        return parse(alias)
    return ((_pint_name(name), 1),)


def _pint_name(name: str) -> str:
    if known := BY_TEXT.get(name):
        return known.name
    candidates = registry().parse_unit_name(name)
    if not candidates and len(name) > 3:
        candidates = registry().parse_unit_name(name.lower())
    if not candidates:
        raise SpellingError(f"{name} is no unit")
    prefix, unit, _ = candidates[0]
    if unit in _ANGLES_AND_TIMES and prefix not in ("", "milli", "micro", "nano"):
        raise SpellingError(f"{name} is no unit of an angle or a time")  # Grad is a degree, Ms or MS a millisecond
    return f"{prefix}{unit}"
