"""The report of a bed's verification: one HTML page that opens anywhere, without network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.report.bed_test.text import answer, mode_words, with_uncertainty
from matching.report.common.environment import embedded, environment

CAPTIONS = {
    "responses": "Compared functions over frequency, modulus: the vehicle, the prediction for the bed with its "
    "controller, and what the recordings show with about 95 % uncertainty."
}


def page(result: Mapping[str, Any], images: Mapping[str, bytes], diagnosis: str = "") -> str:
    """The page as HTML.

    Parameters
    ----------
    result : mapping
        The content of ``verification.json``.
    images : mapping of str to bytes
        The figure ``responses``.
    diagnosis : str
        What a diagnosis of the recording says, where there is one.
    """
    values = {
        "title": f"Bed against vehicle: {result['title']}" if result["title"] else "Bed against vehicle",
        "status": result["status"],
        "answer": answer(result),
        "band": result["band"],
        "errors": [_row(one) for one in result["errors"]],
        "functions": [_row(one) for one in result["functions"]],
        "modes": [
            {"number": one["vehicle_mode"], "words": mode_words(one), "status": one["status"]}
            for one in result["modes"]
        ],
        "fidelity": [
            {**one, "total": with_uncertainty(one["R_XiL"], one["standard_uncertainty"])} for one in result["fidelity"]
        ],
        "notes": result["notes"],
        "diagnosis": diagnosis,
        "figures": {name: embedded(content) for name, content in images.items()},
        "captions": CAPTIONS,
    }
    return environment().get_template("bed_test.html").render(values)


def _row(one: Mapping[str, Any]) -> dict[str, Any]:
    return {**one, "value": with_uncertainty(one["error"], one["standard_uncertainty"])}
