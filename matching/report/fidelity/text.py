"""An XiL fidelity in words and columns, from the content of ``fidelity.json``."""

from __future__ import annotations

from typing import Any

RANKED = 8  # causes that are listed
LEAST_SHOWN = 5e-5  # of an uncertainty: less is 0.00 %


def summary(answer: dict[str, Any]) -> str:
    """Total and partial fidelities, then every signal and sensor, then what is lost to which cause."""
    lines = [answer["title"], *_fidelities(answer), "", f"{'':44} {'R_NRMSE':>9} {'R_τ':>9}   delay"]
    for domain, signals in answer["signals"].items():
        for signal in signals:
            name = f"{domain}.{signal['name']}"
            lines.append(f"{name:44} {_percent(signal['R_NRMSE'])} {_percent(signal['R_tau'])}   {_delay(signal)}")
    for sensor in answer["sensors"]:
        lines.append(f"{'measurement_uncertainty.' + sensor['name']:44} {_percent(sensor['fidelity'])}   (1 - U/range)")
    if "attribution" in answer:
        lines += ["", *_losses(answer["attribution"])]
    return "\n".join([*lines, *(f"note: {note}" for note in answer["notes"])]) + "\n"


def _fidelities(answer: dict[str, Any]) -> list[str]:
    lines = []
    for name, value in [("R_XiL", answer["R_XiL"]), *answer["domains"].items()]:
        spread = answer["uncertainty"]["total" if name == "R_XiL" else name]
        weight = f"weight {answer['weights'][name]:g}" if name in answer["weights"] else "total"
        lines.append(f"{name:44} {_percent(value)}   {_uncertainty(spread):32} {weight}")
    return lines


def _uncertainty(spread: dict[str, Any]) -> str:
    if spread["standard_uncertainty"] < LEAST_SHOWN:
        return "without uncertainty"
    low, high = spread["interval"]
    return f"u = {100 * spread['standard_uncertainty']:.2f} %, {100 * low:.2f} ... {100 * high:.2f} %"


def _losses(attribution: dict[str, Any]) -> list[str]:
    shares = ", ".join(f"{origin} {100 * share:.1f} %" for origin, share in attribution["by_origin"].items())
    return [f"lost to {shares}"] + [
        f"  {loss['origin']:12} {loss['signal']:24} {loss['cause']:12} "
        f"R_XiL would rise by {100 * loss['gain']:.2f} percentage points"
        for loss in attribution["ranked"][:RANKED]
    ]


def _percent(share: float) -> str:
    return f"{100 * share:7.2f} %"


def _delay(signal: dict[str, Any]) -> str:
    if signal["delay"] is None:
        return f"undetermined: {signal['delay_undetermined']}"
    uncertainty = signal["delay_standard_uncertainty"]
    return f"{1000 * signal['delay']:.3f} ms" + (f" (u = {1000 * uncertainty:.3f} ms)" if uncertainty else "")
