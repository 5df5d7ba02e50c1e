"""Verdicts on drawn beds: one controller, matched on the model, proven on beds that are off, held against the truth.

``python -m tests.campaign.verdicts [--beds 30] [--seed 77] [--hidden] [--out out/verdicts]``. The truth is the
best linear approximation of the same bed at the excitation that is used: what it shows without noise, its mean square
over other draws of the torques (Pintelon and Schoukens, System Identification, 2012, section 3.4).
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # the truth plant is imported as `plant`

import numpy as np
from virtual_bed.bed import VirtualBed

from matching.bed.commission import CommissionOrder, plan_speed
from matching.bed.proof import Proof, plan_proof
from matching.bed.simulated_bed import FmuBed, FmuController, proof_recording
from matching.bed.verify import BedVerification, judge, read_recordings
from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from matching.match.match import match
from modelling.errors import InputError
from modelling.fmu.export import controller_fmu
from tests.campaign.drawn_bed import build, draw_bed, write_case

OTHER_DRAWS = 5, 6, 7  # seeds of the torques of the truth


@dataclass(frozen=True)
class Verdict:
    """A bed's number, what was hidden in it, status, error with 95 % interval, its truth, and width over prediction."""

    number: int
    hidden: tuple[str, ...]
    status: str
    error: float
    interval: tuple[float, float]
    truth: float
    width: float

    @property
    def covered(self) -> bool:
        """Whether the interval holds the truth."""
        return self.interval[0] <= self.truth <= self.interval[1]


def verdicts(beds: int, seed: int, out: Path, hidden: bool = False) -> Iterator[Verdict]:
    """One bed after the other."""
    case = match(load_case(write_case(out / "model"))).tuned
    speed, exported = plan_speed(case, CommissionOrder()), exported_controller(case)
    plan, others = plan_proof(case, speed), [plan_proof(case, speed, seed) for seed in OTHER_DRAWS]
    controller = out / "controller.fmu"
    controller.write_bytes(controller_fmu(exported).content)

    def judged(bed: VirtualBed, plan: Proof) -> BedVerification:
        recording = out / "recording.csv"
        path = bed.write(out / "bed.fmu")
        with (
            FmuBed(path, ["dyno", "motor_torque"], [sensor.name for sensor in case.rig.sensors]) as running,
            FmuController(controller, exported.law) as law,
        ):
            text = proof_recording(running, case, exported.law, law, plan, speed)
        recording.write_text(text, encoding="utf-8")
        return judge(case, read_recordings([recording], case))

    for number in range(beds):
        drawn = draw_bed(seed, number, out / "model")
        bed = drawn.bed if hidden else build(drawn, [])
        names = tuple(one.kind for one in drawn.hidden) if hidden else ()
        try:
            error = judged(bed, plan).errors[0]
            # a bed that is linear answers every draw alike
            squares = [judged(_quiet(bed), other).errors[0].value ** 2 for other in others[: None if hidden else 1]]
        except InputError as fault:
            print(number, *names, fault)
            continue
        low, high = error.interval
        width = (high - low) / 4 / plan.expected[0].at(error.value)
        yield Verdict(number, names, error.status, error.value, error.interval, float(np.sqrt(np.mean(squares))), width)


def _quiet(bed: VirtualBed) -> VirtualBed:
    return replace(bed, readers={name: replace(reader, noise=0.0) for name, reader in bed.readers.items()})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--beds", type=int, default=30)
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--hidden", action="store_true", help="two effects hidden in every bed")
    parser.add_argument("--out", type=Path, default=Path("out/verdicts"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    found = []
    for one in verdicts(given.beds, given.seed, given.out, given.hidden):
        found.append(one)
        low, high = one.interval
        print(f"{one.number} {' '.join(one.hidden)} {one.status} {one.error:.4f} ({low:.4f} to {high:.4f}), "
              f"true {one.truth:.4f}, width over prediction {one.width:.2f}", flush=True)  # fmt: skip
    widths = np.percentile([one.width for one in found], [5, 50, 95])
    print(
        f"covered {np.mean([one.covered for one in found]):.1%}, "
        f"undetermined {np.mean([one.status == 'undetermined' for one in found]):.1%}, "
        f"width over prediction {widths[1]:.2f} ({widths[0]:.2f} to {widths[2]:.2f})"
    )


if __name__ == "__main__":
    main()
