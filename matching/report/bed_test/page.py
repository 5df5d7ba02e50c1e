"""The report of a bed's verification: one HTML page that opens anywhere, without network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.report.bed_test.text import answer, why, with_uncertainty
from matching.report.common.environment import embedded, environment, in_address
from matching.report.common.provenance import Provenance

CAPTIONS = {
    "responses": "Compared functions over frequency, modulus: the vehicle, the prediction for the bed with its "
    "controller, and what the recordings show with about 95 % uncertainty."
}


def page(
    result: Mapping[str, Any],
    images: Mapping[str, bytes],
    moving: Mapping[str, str] | None = None,
    made: Provenance | None = None,
    data: Mapping[str, str] | None = None,
) -> str:
    """The page as HTML.

    Parameters
    ----------
    result : mapping
        The content of ``verification.json``.
    images : mapping of str to bytes
        The figure ``responses``.
    moving : mapping of str to str, optional
        The same figure to act in the browser, as :func:`matching.report.curves.acting_axes.acting` has it.
    made : Provenance, optional
        Where the result comes from.
    data : mapping of str to str, optional
        Curves of the same figure (CSV).
    """
    values = {
        "title": f"Bed against vehicle: {result['title']}" if result["title"] else "Bed against vehicle",
        "status": result["status"],
        "answer": answer(result),
        "band": result["band"],
        "errors": [_row(error) for error in result["errors"]],
        "functions": [_row(function) for function in result["functions"]],
        "modes": [_mode(mode) for mode in result["modes"]],
        "fidelity": [
            {**fidelity, "total": with_uncertainty(fidelity["R_XiL"], fidelity["standard_uncertainty"])}
            for fidelity in result["fidelity"]
        ],
        "notes": result["notes"],
        "diagnosis": why(result),
        "figures": {name: embedded(content) for name, content in images.items()},
        "captions": CAPTIONS,
        "moving": moving or {},
        "data": {name: in_address(text, "text/csv") for name, text in (data or {}).items()},
        "made": made,
    }
    return environment().get_template("bed_test.html").render(values)


def _mode(mode: Mapping[str, Any]) -> dict[str, Any]:
    row, bed = {**mode, "number": mode["vehicle_mode"]}, mode["measured"]
    if bed is not None:
        row["frequency"] = with_uncertainty(bed["frequency"], bed["frequency_uncertainty"], 4)
        row["damping"] = with_uncertainty(bed["damping_ratio"], bed["damping_uncertainty"])
    return row


def _row(error: Mapping[str, Any]) -> dict[str, Any]:
    return {**error, "value": with_uncertainty(error["error"], error["standard_uncertainty"])}
