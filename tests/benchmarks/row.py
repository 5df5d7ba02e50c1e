"""How a measurement is printed."""

from collections.abc import Iterator
from contextlib import contextmanager

HEAD = f"{'what':44} {'ours':>10} {'peer':>10} {'ratio':>8}  asked for"


def row(what: str, ours: float, peer: float, asked: str, unit: str = "s") -> str:
    """One line: our time, the peer's, how many times faster we are, and what the project asks of itself."""
    return f"{what:44} {ours:8.3g} {unit:1} {peer:8.3g} {unit:1} {peer / ours:8.1f}  {asked}"


@contextmanager
def peer_runs(what: str) -> Iterator[None]:
    """Say that the peer failed, and why, instead of ending the benchmark: only the peer may run in here."""
    try:
        yield
    except Exception as error:
        print(f"{what:44} the peer failed: {type(error).__name__}: {error}", flush=True)
