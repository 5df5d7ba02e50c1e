"""An XiL fidelity in words and columns, from the content of ``fidelity.json``."""

from __future__ import annotations

from typing import Any


def summary(answer: dict[str, Any]) -> str:
    """The partial fidelities and what follows from them, for a reader."""
    lines = [answer["title"], "", f"{'':44} {'R_NRMSE':>9} {'R_τ':>9}   delay"]
    for domain, members in answer["signals"].items():
        lines += [
            f"{domain + '.' + one['name']:44} {_percent(one['R_NRMSE'])} {_percent(one['R_tau'])}   {_delay(one)}"
            for one in members
        ]
    lines += [
        f"{'measurement_uncertainty.' + one['name']:44} {_percent(one['fidelity'])}   (1 - U/range)"
        for one in answer["sensors"]
    ]
    lines.append("")
    for name, value in [*answer["domains"].items(), ("R_XiL", answer["R_XiL"])]:
        spread = answer["uncertainty"]["total" if name == "R_XiL" else name]
        low, high = spread["interval"]
        weight = f"weight {answer['weights'][name]:g}" if name in answer["weights"] else "total"
        lines.append(
            f"{name:44} {_percent(value)}   u = {100 * spread['standard_uncertainty']:.2f} %, "
            f"{100 * low:.2f} ... {100 * high:.2f} %   {weight}"
        )
    if "attribution" in answer:
        lines += [
            "",
            "lost to "
            + ", ".join(f"{origin} {100 * part:.1f} %" for origin, part in answer["attribution"]["by_origin"].items()),
        ]
        lines += [
            f"  {loss['origin']:12} {loss['signal']:24} {loss['cause']:12} R_XiL would rise by "
            f"{100 * loss['gain']:.2f} %"
            for loss in answer["attribution"]["ranked"][:8]
        ]
    return "\n".join([*lines, *(f"note: {note}" for note in answer["notes"])]) + "\n"


def _percent(value: float) -> str:
    return f"{100 * value:7.2f} %"


def _delay(one: dict[str, Any]) -> str:
    if one["delay"] is None:
        return f"undetermined: {one['delay_undetermined']}"
    doubt = one["delay_standard_uncertainty"]
    return f"{1000 * one['delay']:.3f} ms" + (f" (u = {1000 * doubt:.3f} ms)" if doubt else "")
