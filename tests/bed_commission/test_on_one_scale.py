"""The recordings of all rounds are judged against the vehicle of the last round."""

from types import SimpleNamespace

from matching.bed import commission as circle
from matching.bed.commission import Circle, CommissionOrder, Round


def test_every_round_but_the_last_is_judged_again_against_the_last_vehicle(tmp_path, monkeypatch):
    bed = tmp_path / "bed"
    bed.mkdir()
    going = Circle(tmp_path / "out", bed, CommissionOrder(rounds=4))
    going._rounds = [Round(number, verification={}) for number in (1, 2, 3)] + [Round(4)]
    going._tuned = {number: f"case {number}" for number in (1, 2, 3, 4)}
    monkeypatch.setattr(circle, "kept_recording", lambda folder: folder / "recording.csv")
    monkeypatch.setattr(circle, "_of_case", lambda case: case)
    monkeypatch.setattr(circle, "read_recordings", lambda paths, case, names: [path.parent.name for path in paths])
    monkeypatch.setattr(
        circle, "judge", lambda case, recordings, **_: SimpleNamespace(
            to_dict=lambda: {"errors": [case, *recordings], "functions": 0, "modes": 0, "fidelity": 0, "rest": 0}
        )
    )  # fmt: skip
    going._stages = SimpleNamespace(
        of_files=lambda *paths: str(paths), run=lambda name, inputs, work: work()[1] | {"step": name}
    )
    going._on_one_scale()
    expected = [
        {"errors": ["case 3", f"{n}_verify"], "functions": 0, "modes": 0, "fidelity": 0, "step": f"{n}_verify_again"}
        for n in (1, 2)
    ]
    assert [entry.against_last_vehicle for entry in going._rounds] == [*expected, None, None]
