"""How long a step of an FMU takes, on the way a real-time system goes: inputs in, step, outputs out, called from C."""

import sys
import tempfile
from pathlib import Path

from tests.benchmarks.row import row

AIM = 20.0  # µs
EXAMPLES = Path(__file__).parents[2] / "examples"
STEPS = 200_000
ASKED = [
    ("residual vehicle of road_to_rig", "road_to_rig/case.toml", 1e-3),
    ("the same at 10 kHz", "road_to_rig/case.toml", 1e-4),
    ("residual vehicle of compact_bev", "compact_bev/case.toml", 5e-4),
    ("whole vehicle of road_to_rig", "road_to_rig/vehicle.toml", 1e-3),
]


def main() -> int:
    sys.path.insert(0, str(Path(__file__).parents[1]))
    try:
        from fmu.timing import possible, timed
    except ImportError as missing:
        print(f"FMU steps are not timed: {missing}")
        return 0
    if not possible():
        print("FMU steps are not timed: needs a C compiler and the GNU C library")
        return 0
    from matching.export import read_export_source
    from modelling.fmu.export import fmu

    with tempfile.TemporaryDirectory() as work:
        for number, (what, source, span) in enumerate(ASKED):
            path = Path(work) / f"{number}.fmu"
            path.write_bytes(fmu(read_export_source(EXAMPLES / source).block).content)
            found = timed(path, work, STEPS, span)
            asked = f"aim 20 µs; median {found.median:.2f}, 99.9 % {found.slow:.2f}, longest {found.longest:.0f} µs"
            print(row(f"FMU step, {what}", found.mean, AIM, f"{asked} of {STEPS} steps of {span * 1e3:g} ms", "µs"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
