"""What each part of the reference match contributes: `python -m tests.benchmarks.observer_variants [NAME…]`.

The reference drive with one thing changed at a time: the controller, the adapter, the bus, a sensor, what is known of
the bed. A change is a line of ``case.toml``, ``observer.toml`` or ``rig.toml`` of ``examples/road_to_rig``, as a user
would write it. Every variant is a match, judged on 200 fresh beds; the README there shows the table. A variant takes
10 to 20 s of one core.
"""

import re
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import rigmatch as rm
from matching.match.case import Case

FOLDER = Path(__file__).parents[2] / "examples" / "road_to_rig"
BEDS = 200  # fresh ones that judge a variant
PROCESSES = 2


@dataclass(frozen=True)
class Variant:
    """A match of the reference drive: which case, and the lines (file, before, after) that are changed."""

    name: str
    case: str
    changes: tuple[tuple[str, str, str], ...] = ()


def moved_alone(*kinds: str) -> tuple[str, str, str]:
    """[move] of case.toml with the quantities of these kinds alone."""
    text = (FOLDER / "case.toml").read_text(encoding="utf-8")
    (before,) = re.findall(r"\[move\]\n(?:\".*\n)+", text)
    kept = [line for line in before.splitlines()[1:] if line.startswith(tuple(f'"{kind}.' for kind in kinds))]
    return "case.toml", before, "\n".join(["[move]", *kept, ""])


def observed(name: str, before: str, after: str) -> Variant:
    return Variant(f"observer, {name}", "observer.toml", (("observer.toml", before, after),))


def adapters(inertia: str) -> Variant:
    """The observer with both adapters of another inertia, kg·m²: the ends of what case.toml lets move."""
    sides = ("left", "right")
    lines = [
        (f"[inertias.adapter_{side}]          # J_A\nJ = 0.05", f"[inertias.adapter_{side}]\nJ = {inertia}")
        for side in sides
    ]
    changes = tuple(("rig.toml", before, after) for before, after in lines)
    return Variant(f"observer, adapters {inertia} kg·m²", "observer.toml", changes)


STIFFNESS = '"rig.shafts.*.stiffness" = 0.05'
PI = ("case.toml", 'structure = "model_based"', 'structure = "pi"')
VARIANTS = (
    Variant("pi", "case.toml", (PI,)),
    Variant("model_based, gains tuned alone", "case.toml", (moved_alone("loop"),)),
    Variant("model_based, gains and residual vehicle", "case.toml", (moved_alone("loop", "residual_vehicle"),)),
    Variant("model_based, gains and adapters", "case.toml", (moved_alone("loop", "rig"),)),
    Variant("model_based, everything tuned", "case.toml"),
    Variant("observer", "observer.toml"),
    observed("dead time 1 ms", "dead_time = 0.003 ", "dead_time = 0.001 "),
    observed("motor speed not measured", 'measures = ["motor_speed"]', "measures = []"),
    observed("side shafts known to 1 %", STIFFNESS, f'{STIFFNESS}\n"rig.shafts.side_*.stiffness" = 0.01'),
    observed("dynamometers' torque known to 0.5 %", '"loop.torque_gain" = 0.03', '"loop.torque_gain" = 0.005'),
    adapters("0.1"),
    adapters("0.03"),
)


def case_of(variant: Variant) -> Case:
    """The case of a variant."""
    with TemporaryDirectory() as place:
        texts = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.toml")}
        for file, before, after in variant.changes:
            if before not in texts[file]:
                raise ValueError(f"{file} has no line {before!r}")
            texts[file] = texts[file].replace(before, after)
        for name, text in texts.items():
            (Path(place) / name).write_text(text, encoding="utf-8")
        return rm.load_case(Path(place) / variant.case)


def row(variant: Variant) -> dict[str, Any]:
    """What a variant reaches: errors as planned, quantiles over its stable beds, and how many are stable."""
    result = rm.match(case_of(variant), beds=BEDS)
    error, beds = result.response_error, result.robust.beds
    kept = ("drawn", "stable", "damped", "error_median", "error_95", "unmeasured_median", "unmeasured_95")
    made = {
        "name": variant.name,
        "status": result.status,
        "limits": list(result.limits),
        "before": rounded(error.before),
        "measured": rounded(error.after),
        "unmeasured": rounded(error.unmeasured),
        "beds": {key: rounded(value) for key, value in beds.to_dict().items() if key in kept},
    }
    print(made, flush=True)
    return made


def rounded(value: Any) -> Any:
    """To four digits: what is left differs between processors."""
    return float(f"{value:.4g}") if isinstance(value, float) else value


def table(names: list[str]) -> list[dict[str, Any]]:
    """Rows of the variants so named, or of all; each is printed when it is there."""
    chosen = [variant for variant in VARIANTS if not names or variant.name in names]
    with ProcessPoolExecutor(PROCESSES) as pool:
        return list(pool.map(row, chosen))


if __name__ == "__main__":
    table(sys.argv[1:])
