"""What adapters can do without emulation, and what 1.6 Hz would take of them.

python examples/adapter_only/run.py
"""

from pathlib import Path

from matching.match.case import apply
from matching.match.case_file import load_case
from matching.match.match import match
from matching.match.responses import error_figures
from matching.match.result import MatchResult

HERE = Path(__file__).parent


def main() -> MatchResult:
    """Match with adapters alone, say what stands in the way, and check the figures against a hand calculation."""
    result = match(load_case(HERE / "case.toml"), starts=3)
    print(result.status)
    for sentence in result.limits:
        print("-", sentence)
    before, after = result.response_error.before, result.response_error.after
    print(f"response error {before:.2f} before, {after:.2f} after")

    assert result.status == "limited"
    assert result.verification.stable
    shuffle, symmetric = result.targets
    for target in result.targets:
        print(f"{target.rig:.2f} Hz becomes {target.matched:.2f} Hz, {target.vehicle:.2f} Hz is wanted")
    assert abs(shuffle.matched - 8.33) < 0.03
    assert abs(symmetric.matched - 10.92) < 0.03

    # Everything at its bound leaves the least error; the adapter's inertia hardly matters.
    flange, adapter, rotor = result.parameters
    assert flange.at_bound
    assert rotor.at_bound
    bounds = {name: move.upper for move in result.case.moves for name in move.together}
    bounds |= dict.fromkeys(result.case.moves[0].together, flange.lower)
    least = error_figures(apply(result.case, bounds)).after
    print(f"adapter {adapter.tuned:.3f} kg·m², with {adapter.upper:g} kg·m² the response error is {least:.3f}")
    assert adapter.start < adapter.tuned <= adapter.upper
    assert 0.999 * least < after < 1.0025 * least

    # One side against ground, the differential at rest: the rotor hangs on side shaft and flange in series.
    omega = 2 * 3.141592653589793 * shuffle.vehicle
    rotor, side = 0.895, 1.092e4
    flange = 1 / (1 / (rotor * omega**2) - 1 / side)
    heavier = (shuffle.rig / shuffle.vehicle) ** 2
    print(f"by hand: {flange:.1f} N·m/rad, {1500 / flange / 6.2832:.2f} turns; {heavier:.0f} times the inertia")
    told = " ".join(result.limits)
    assert abs(flange - 91.2) < 0.1
    assert "91.2 N·m/rad" in told
    assert "2.6 turns" in told
    assert "109 times the inertia behind each cut" in told
    return result


if __name__ == "__main__":
    main()
