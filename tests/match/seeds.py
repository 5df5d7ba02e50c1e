"""The reference match from ten random seeds: each must end within 1 % of the same objective. By hand, minutes long.

python tests/match/seeds.py [how many]
"""

import sys
from pathlib import Path

from matching.match.case_file import load_case
from matching.match.match import match

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"


def main(count: int = 10) -> None:
    found = []
    for seed in range(count):
        result = match(load_case(CASE), seed, workers=2)
        error = result.response_error
        print(
            f"seed {seed}: {result.status}, objective {result.objective:.5f}, {len(result.starts)} starts, "
            f"after {error.after:.5f}, unmeasured {error.unmeasured:.4f}, "
            f"margin {result.verification.modulus_margin:.4f}, {result.seconds:.0f} s",
            flush=True,
        )
        assert result.status == "matched"
        found.append(result.objective)
    print(f"largest over smallest objective: {max(found) / min(found):.6f}")
    assert max(found) <= 1.01 * min(found)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
