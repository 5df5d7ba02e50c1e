"""Small inputs of the commands that faults are tried on."""

from pathlib import Path

from tests.fuzz.corpus import tuned_result
from tests.fuzz.corpus_runs import bed_recording, narrow_band_case, recorded_motion
from tests.fuzz.seed import MODEL


def written(folder: Path) -> Path:
    """A model with its recording, a case as a match leaves it, and the folder of a bed with a recording in it."""
    for name, content in (narrow_band_case() | {"model.toml": MODEL.encode(), "drive.csv": recorded_motion()}).items():
        _write(folder / name, content)
    _write(folder / "bed_run.csv", bed_recording())
    for name, content in narrow_band_case().items():
        _write(folder / "matched" / name, content)
    _write(folder / "matched" / "result.json", tuned_result(folder / "matched" / "case.toml"))
    _write(folder / "bed" / "1_verify.csv", bed_recording())
    return folder


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
