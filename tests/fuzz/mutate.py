"""Mutations of a text or binary input: a pure function of the seed, so that every input can be made again."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][\w.\-]*")
QUOTED = re.compile(rb'"[^"\n]*"')
VALUES = (
    b"0", b"-1", b"1", b"-0.0", b"1e-300", b"1e300", b"1.7e308", b"nan", b"inf", b"-inf", b"1" + b"0" * 400, b"0x10",
    b"true", b'""', b"[]", b"{}", b"[[1, 2], [3]]", b'"1 N*m"', b'"5 %"', b'"3 kg*m^2"', b"1979-05-27", b"2e9", b"1e-9",
    b'"' + "µ°é\u202e\u2028".encode() + b'"', b'"\\u0007"', b'"../x"', b'"$a_b$"', b'"<b>&amp;"', b'"*/ int x; /*"',
    b'"' + b"x" * 3000 + b'"', b"{value = 1, lower = 2, upper = 3}", b"{value = 1, tolerance = 0.1}",
)  # fmt: skip
TEXTS = (
    b"\n", b"=", b"[", b"]", b"[[effects]]\n", b"[inertias.a]\nJ = 1\n", b".", b",", b";", b"\t", b"\r", b"#", b"\\",
    b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", "−½²".encode(), b"log(", b"atan2(", b")", b"**", b"/", b"inf", b"nan",
    b"a." * 60,
)  # fmt: skip


def mutated(seed: str, content: bytes, others: Sequence[bytes], *, binary: bool = False) -> bytes:
    """The content changed in one to four places; ``others`` are inputs of the same kind to take parts from."""
    rng = random.Random(seed)
    ways = (_byte, _cut, _repeat, _truncate) if binary else _TEXT_WAYS
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        content = rng.choice(ways)(rng, content, others)
    return content[:1_000_000]


def _span(rng: random.Random, size: int) -> slice:
    first = rng.randrange(size + 1)
    return slice(first, min(size, first + int(2 ** rng.uniform(0, 8))))


def _byte(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    at = rng.randrange(len(content) + 1)
    return content[:at] + bytes([rng.randrange(256)]) + content[at + 1 :]


def _cut(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    span = _span(rng, len(content))
    return content[: span.start] + content[span.stop :]


def _repeat(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    span = _span(rng, len(content))
    return content[: span.stop] + content[span] * rng.choice((1, 1, 2, 30)) + content[span.stop :]


def _truncate(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    return content[: rng.randrange(len(content) + 1)]


def _insert(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
    at = rng.randrange(len(content) + 1)
    return content[:at] + rng.choice(TEXTS) + content[at:]


def _lines(rng: random.Random, content: bytes, others: Sequence[bytes]) -> bytes:
    """Lines dropped, doubled, swapped, or taken from another input."""
    lines = content.split(b"\n")
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    way = rng.randrange(4)
    if way == 0:
        del lines[at]
    elif way == 1:
        lines.insert(to, lines[at])
    elif way == 2:
        lines[at], lines[to] = lines[to], lines[at]
    else:
        source = rng.choice(others).split(b"\n")
        first = rng.randrange(len(source))
        lines[at:at] = source[first : first + rng.randrange(1, 6)]
    return b"\n".join(lines)


def _token(pattern: re.Pattern[bytes], choices: Callable[[random.Random, bytes, bytes], bytes]) -> Callable:
    def way(rng: random.Random, content: bytes, _: Sequence[bytes]) -> bytes:
        places = list(pattern.finditer(content))
        if not places:
            return content
        place = rng.choice(places)
        return content[: place.start()] + choices(rng, content, place[0]) + content[place.end() :]

    return way


def _any_value(rng: random.Random, _: bytes, __: bytes) -> bytes:
    if rng.random() < 0.3:
        return b"%g" % (rng.choice((-1, 1)) * 10 ** rng.uniform(-12, 12))
    return rng.choice(VALUES)


def _near_value(rng: random.Random, _: bytes, number: bytes) -> bytes:
    """Of the same size or nearly, so that the input is often still accepted."""
    return b"%.6g" % ((float(number) or 1.0) * 10 ** rng.gauss(0, 0.7))


def _any_word(rng: random.Random, content: bytes, _: bytes) -> bytes:
    return rng.choice(WORD.findall(content) or [b"x"])


_TEXT_WAYS = (
    _byte, _cut, _repeat, _truncate, _insert, _lines, _lines,
    *8 * (_token(NUMBER, _near_value),), *3 * (_token(NUMBER, _any_value),), *2 * (_token(WORD, _any_word),),
    _token(QUOTED, _any_value),
)  # fmt: skip
