"""`rigmatch modes`: modes of a model with energy shares and symmetry."""

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from modelling.modal.result import Modes
    from modelling.model.system import System

HELP = """Modes of a model: frequencies, where the kinetic and the potential energy sits, left/right symmetry.
Undamped unless --damped; of more than 300 degrees of freedom the lowest 100. Writes modes.json, and with --out the
figures modes.svg (frequencies and shares of the first modes) and energy_shares.svg (all shares)."""
EXAMPLES = (
    "rigmatch modes examples/road_to_rig/vehicle.toml --out out/modes",
    'rigmatch modes examples/road_to_rig/rig.toml --damped --change "inertias.rotor_left.J=1.8 kg*m^2" --out out/rig',
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Model file, kind of modes, place to write to."""
    from matching.arguments import completed

    parser.add_argument("model", metavar="MODEL", help="model file (TOML)")
    parser.add_argument("--damped", action="store_true", help="damped modes with damping ratios")
    parser.add_argument(
        "--reduced", action="store_true", help="also give values reduced to the model's reference shaft"
    )
    change = parser.add_argument(
        "--change",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="what a new value does to the frequencies: first-order prediction (Eq. 8) beside the exact solution; "
        'e.g. --change "inertias.rotor_left.J=1.8 kg*m^2", may be repeated',
    )
    completed(change, _parameters)
    parser.add_argument("--out", metavar="DIR", help="directory to write to (default: here, without figures)")


def _parameters(arguments: argparse.Namespace) -> list[str]:
    from matching.completion import parameters_of_model

    return [f"{name}=" for name in parameters_of_model(arguments.model)]


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Find the modes and write files; the result object is the content of ``modes.json``."""
    from modelling.common.errors import InputError
    from modelling.model.files import load
    from modelling.writing.output import write_results

    system = load(arguments.model)
    try:
        changes = _changes(arguments.change, system)
        analysed = _modes(system, arguments.damped)
        result = analysed.to_dict()
        if len(analysed) < len(analysed.coordinates) and not arguments.damped:
            result["degrees_of_freedom"] = len(analysed.coordinates)
        if arguments.reduced:
            _add_reduced(result, system, analysed)
        if changes:
            from modelling.modal.sensitivity import what_if

            rows = [change.to_dict() for change in what_if(system, changes)]
            result["what_if"] = {"changes": changes, "modes": rows}
    except InputError as error:
        raise InputError(f"{arguments.model}: {error.where}".rstrip(": "), error.wrong, error.right) from None
    title = system.title or str(arguments.model)
    files = _figures(analysed, title) if arguments.out is not None else {}
    return write_results(arguments.out or ".", "modes.json", result, files)


def checked(arguments: argparse.Namespace) -> dict[str, str]:
    """For ``--check``: whether the quantities to change exist; names no further file.

    Raises
    ------
    InputError
        As the command itself would.
    """
    from modelling.model.files import load

    _changes(arguments.change, load(arguments.model))
    return {}


def _modes(system: "System", damped: bool) -> "Modes":
    """Only what is asked for is imported: the answer comes while one waits for it."""
    if damped:
        from modelling.modal.damped_modes import damped_modes

        return damped_modes(system)
    from modelling.modal.modes import modes

    return modes(system)


def _add_reduced(result: dict[str, Any], system: "System", analysed: "Modes") -> None:
    from modelling.modal.reduction import reduced, reduced_values, speed_ratios

    result["reference"] = system.reference
    result["reduced"] = reduced_values(system)
    at_reference = reduced(analysed, speed_ratios(system))
    for entry, mass, stiffness in zip(result["modes"], at_reference.modal_mass, at_reference.modal_stiffness):
        entry |= {"modal_mass": float(mass), "modal_stiffness": float(stiffness)}


def _figures(analysed: "Modes", title: str) -> dict[str, str | bytes]:
    from matching.report.common.style import VEHICLE, image
    from matching.report.modes.figures import Column, energy_figure, shares_figure

    return {
        "modes.svg": image(energy_figure([Column(title, VEHICLE, analysed)])),
        "energy_shares.svg": image(shares_figure(analysed, title)),
    }


def _changes(assignments: list[str], system: "System") -> dict[str, float]:
    """``NAME=VALUE`` with or without unit, as values in SI by name."""
    from modelling.common.errors import InputError, unknown
    from modelling.units import to_si

    changes = {}
    for text in assignments:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError("--change", f"{text!r} has no '='", "write NAME=VALUE, e.g. inertias.motor.J=0.06")
        if name.strip() not in system.parameters:
            raise unknown(name.strip(), list(system.parameters), "--change")
        changes[name.strip()] = to_si(value, system.units[name.strip()], f"--change {name.strip()}")
    system.with_values(changes)  # says what is impossible
    return changes


def summary(result: dict[str, Any]) -> str:
    """The mode table, and reduced values where asked for."""
    from matching.report.common.table import aligned
    from matching.report.modes.mode_table import mode_table

    lines = [aligned(mode_table(result["modes"]))]
    if "degrees_of_freedom" in result:
        lines += ["", f"the lowest {len(result['modes'])} of {result['degrees_of_freedom']} modes"]
    if "what_if" in result:
        rows = [
            {
                "mode": str(row["number"]),
                "now [Hz]": f"{row['frequency']:.4g}",
                "Eq. 8 [Hz]": f"{row['predicted']:.4g}",
                "Eq. 8": f"{100 * row['predicted_change']:+.1f} %",
                "exact [Hz]": f"{row['exact']:.4g}",
                "exact": f"{100 * row['exact_change']:+.1f} %",
            }
            for row in result["what_if"]["modes"]
        ]
        lines += [
            "",
            "with the changes (Eq. 8 is a first-order prediction; the exact solution is the true value):",
            aligned(rows),
        ]
    if "reduced" in result:
        lines += ["", f"reduced to {result['reference']}:"]
        lines += [f"  {name:40} {value:.5g}" for name, value in result["reduced"].items() if value]
    return "\n".join(lines)
