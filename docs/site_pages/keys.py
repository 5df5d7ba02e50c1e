"""The reference of the keys of every input file: names from the readers' own tables, with what each means.

The page is not written, and the site not built, where a reader knows a key that is not described here, or the reverse.
"""

from collections.abc import Iterable, Mapping

from matching import fidelity as case_file
from matching.key_meanings import (
    BUDGET,
    CASE,
    CHANNEL,
    FIDELITY,
    FIDELITY_SENSOR,
    FIDELITY_SIGNAL,
    INPUT,
    LIMITS,
    LINE,
    MODEL,
    MODEL_TABLES,
    OPERATING,
)  # fmt: skip
from matching.match import case_file as case
from matching.match.case_file import KEYS as OPERATING_POINT
from matching.match.requirements import LIMIT_UNITS, OPENED_SHAFTS
from matching.uncertainty import budget as budget_file
from matching.uncertainty import budget as inputs
from modelling import model_file as files
from modelling.bed.bed import HARDWARE
from modelling.bed.controllers import STRUCTURES
from modelling.recordings import read as channels
from modelling.units import GEARBOX_UNITS, QUANTITY_UNITS

TOP = """# Keys of input files

Written from the tables that the program's own readers use. All files are TOML. A quantity is a number in SI, a string
with a unit (`"170 N*m/deg"`), or a table `{ value, lower, upper }` or `{ value, tolerance }` (relative). What the files
are for, with examples: [Files](../files.md). `--check` reads a file, says what it holds, and calculates nothing.
"""


def keys_page() -> str:
    """One section a kind of file."""
    model = [
        _table(f"[{table}.NAME]", [*known, *files.BY_DRAWING.get(table, ())], MODEL_TABLES[table])
        for table, known in files.KEYS.items()
    ]
    structures = [_structure(name, structure.quantities) for name, structure in STRUCTURES.items()]
    return "\n".join(
        [
            TOP,
            "## Model", "", _table("The file", files.TOP, MODEL), *model,
            "Effects: [Effects](effects.md).", "",
            "## Case", "", _table("The file", case.TOP, CASE),
            "### [loop]", "",
            "`structure`, `knows` (inputs of the rig whose torque the controller measures), `measures` (sensors that "
            "reach the controller beside the dynamometers'), `fixed` (true: no search moves the controller), and:", "",
            *_quantities(HARDWARE), "", *structures,
            _table("[limits]", [*LIMIT_UNITS, OPENED_SHAFTS], LIMITS, LIMIT_UNITS),
            'Also `"shafts.NAME.torque"` (N·m) and `"shafts.NAME.twist"` (rad) of every shaft of the rig, '
            '`"shafts.NAME.shear_stress"` and `"shafts.NAME.shear_stress_amplitude"` (Pa) of one by its drawing, '
            '`"dynamometers.NAME.torque"` and `"dynamometers.NAME.command_noise"` (N·m) of one dynamometer, and '
            "`dynamometer_torque_over_speed`, pairs of speed and torque.", "",
            _table("[operating_point]", OPERATING_POINT, OPERATING),
            "## Channel file", "", _table("[channels] NAME", channels.KEYS, CHANNEL),
            "## Budget", "", _table("The file", budget_file.TOP, BUDGET), _table("[inputs.NAME]", inputs.KNOWN, INPUT),
            _table("[lines.NAME]", inputs.LINE, LINE),
            "## Fidelity case", "", _table("The file", case_file.KEYS, FIDELITY),
            _table("A signal, `[system_dynamics.NAME]` or `[residual_vehicle_model.NAME]`",
                   (*case_file.STATED_KEYS, *case_file.MEASURED_KEYS), FIDELITY_SIGNAL),
            _table("A sensor, `[measurement_uncertainty.NAME]`", case_file.SENSOR_KEYS, FIDELITY_SENSOR),
        ]
    )  # fmt: skip


def _table(
    title: str,
    known: Iterable[str],
    meanings: Mapping[str, str],
    units: Mapping[str, str] = QUANTITY_UNITS | GEARBOX_UNITS,
) -> str:
    names = list(known)
    if set(names) != set(meanings):
        raise LookupError(
            f"{title}: keys without a meaning or unknown to the reader: {sorted(set(names) ^ set(meanings))}"
        )
    rows = [f"| `{name}` | {_unit(units.get(name, ''))} | {meanings[name]} |" for name in meanings]
    return "\n".join([f"### {title}", "", "| key | SI unit | means |", "|---|---|---|", *rows, ""])


def _structure(name: str, quantities: Mapping) -> str:
    return "\n".join([f'### Loop with structure = "{name}"', "", *_quantities(quantities), ""])


def _quantities(quantities: Mapping) -> list[str]:
    rows = [f"| `{name}` | {_unit(part.unit)} | {part.start:g} | {part.meaning} |" for name, part in quantities.items()]
    return ["| key | SI unit | unless stated | means |", "|---|---|---|---|", *rows]


def _unit(text: str) -> str:
    return "" if text in ("", "1") else text.replace("*", "·").replace("^2", "²").replace("^3", "³")
