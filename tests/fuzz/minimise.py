"""A failing input made small: lines, then characters are left out as long as it fails in the same way."""

from __future__ import annotations

from collections.abc import Callable

MOST_TRIES = 400


def minimised(content: bytes, fails: Callable[[bytes], bool]) -> bytes:
    """The smallest input found that still fails; ``fails`` is asked at most 400 times."""
    tries = 0
    for mark in (b"\n", b""):
        size = max(1, len(_parts(content, mark)) // 2)
        while size >= 1 and tries < MOST_TRIES:
            at = 0
            while at < len(parts := _parts(content, mark)) and tries < MOST_TRIES:
                shorter = mark.join(parts[:at] + parts[at + size :])
                tries += 1
                if fails(shorter):
                    content = shorter
                else:
                    at += size
            size //= 2
    return content


def _parts(content: bytes, mark: bytes) -> list[bytes]:
    return content.split(mark) if mark else [content[i : i + 1] for i in range(len(content))]
