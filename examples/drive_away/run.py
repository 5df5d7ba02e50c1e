"""One controller from standstill to 100 km/h.

python examples/drive_away/run.py
"""

from pathlib import Path

from matching.match.case_file import load_case
from matching.match.match import match
from matching.match.result import MatchResult

HERE = Path(__file__).parent


def main() -> MatchResult:
    """Match, show the figures of README.md and check them."""
    result = match(load_case(HERE / "case.toml"))
    driving = result.driving
    assert driving is not None
    print(f"{result.status}: {len(driving.speeds)} speeds, {sum(one.stable for one in driving.speeds)} beds stable")
    for drive in driving.drives:
        planned, high, other = drive.errors.planned, drive.errors.high, drive.one_speed.planned
        assert planned is not None
        assert high is not None
        print(f"{drive.title}: {100 * planned:.2f} %, 95 % of beds {100 * high:.2f} %")
        if other is not None:
            print(f"  the controller of one speed: {100 * other:.2f} %")
        assert planned < 0.03
        assert high < 0.05
    at_80 = next(drive for drive in driving.drives if "80 km/h" in drive.title)
    assert at_80.one_speed.planned is None or at_80.one_speed.planned > 5 * (at_80.errors.planned or 0.0)
    assert result.status == "matched"
    assert all(one.stable == one.drawn for one in driving.speeds)
    return result


if __name__ == "__main__":
    main()
