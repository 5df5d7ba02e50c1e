"""How a measurement is printed."""

HEAD = f"{'what':44} {'ours':>10} {'peer':>10} {'ratio':>8}  asked for"


def row(what: str, ours: float, peer: float, asked: str, unit: str = "s") -> str:
    """One line: our time, the peer's, how many times faster we are, and what the project asks of itself."""
    return f"{what:44} {ours:8.3g} {unit:1} {peer:8.3g} {unit:1} {peer / ours:8.1f}  {asked}"
