"""`rigmatch diagnose`: find what a model lacks, from recordings."""

import argparse
import threading
from importlib import import_module
from pathlib import Path
from typing import Any

HELP = """Fits the model to recordings, shows where it fails, names the cause and its place, and writes the extended
model. Writes diagnosis.json, extended.toml, report.html and figures. A quantity of the model with a range is fitted
within it; one without is taken as known. Every sensor's uncertainty is also the noise that the fit assumes. Without
--holdout the last 30 % of every recording is not fitted but used to judge the result. Files joined by + are one motion
recorded by several loggers, whose clocks are set to that of the one with the inputs."""
EXAMPLES = (
    "python examples/diagnosis/record.py out/recordings",
    "rigmatch diagnose examples/diagnosis/model.toml out/recordings/play.csv --out out/diagnosis",
    "rigmatch diagnose examples/diagnosis/model.toml out/recordings/play.csv "
    "--holdout out/recordings/play_pulled_one_way.csv --out out/held_out",
)

PICTURING = 2  # processes: one draws, one makes figures that act in the browser
PAGE = "report.html"  # in the folder of --out


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Model, recordings, held-out recording, output directory."""
    parser.add_argument("model", metavar="MODEL", help="model file (TOML)")
    parser.add_argument(
        "recordings", metavar="RECORDING", nargs="+", help="recordings of the system (CSV, MDF, .mat, Parquet)"
    )
    parser.add_argument(
        "--holdout", metavar="RECORDING", action="append", default=[],
        help="a recording that is not fitted but used to judge the result; may be given several times",
    )  # fmt: skip
    parser.add_argument("--channels", metavar="FILE", help="what the channels are called in the recordings (TOML)")
    parser.add_argument(
        "--keep-rest", action="store_true",
        help="keep the torque that no cause explains as a table in the extended model, if unseen data gain by it",
    )  # fmt: skip
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Diagnose and write files; the result object is that of diagnosis.json."""
    from tqdm import tqdm

    from matching.arguments import watched
    from matching.aside import beside
    from matching.diagnosis.diagnosis import diagnose
    from matching.diagnosis.loggers import read_loggers
    from modelling.common.cores import cores
    from modelling.measurement.channels import read_channels
    from modelling.model.files import dumps, load
    from modelling.writing.output import write_results

    tqdm.monitor_interval = 0  # no thread of its own, as for the copy below
    looks = {"desc": "diagnose", "bar_format": "{desc} [{elapsed}]"}
    with tqdm(disable=not watched(), leave=False, **looks) as bar, beside(cores(), PICTURING) as aside:
        aside.prepare("scipy.signal", "matching.report.diagnosis.figures", "bokeh.plotting")  # while this one searches
        aside.start()
        threading.Thread(target=import_module, args=("scipy.signal",), daemon=True).start()  # which the fits need late
        system = load(arguments.model)
        channels = read_channels(arguments.channels) if arguments.channels else None
        recordings = [read_loggers(paths, system, channels) for paths in arguments.recordings]
        holdout = [read_loggers(paths, system, channels) for paths in arguments.holdout]
        pictures = _Pictures(aside, system)

        def tell(step: str) -> None:
            bar.set_description_str(f"{step:50.50}")
            bar.update()

        diagnosis = diagnose(system, recordings, holdout, tell, arguments.keep_rest, pictures.begin)
        tell("report")
        result, files = _written(diagnosis, system, pictures, _made(arguments))
    files["extended.toml"] = dumps(diagnosis.extended)
    return write_results(arguments.out, "diagnosis.json", result, files)


def _made(arguments: argparse.Namespace) -> Any:
    from matching.diagnosis.loggers import SEVERAL_LOGGERS
    from matching.report.common.provenance import made_from, with_recordings

    recordings = [*arguments.recordings, *arguments.holdout]
    paths = [path for each in recordings for path in ([each] if Path(each).exists() else each.split(SEVERAL_LOGGERS))]
    if arguments.channels:
        paths.insert(0, arguments.channels)
    return with_recordings(made_from(arguments.model, None), zip(paths, paths, strict=True))


class _Pictures:
    """The figures as files and for the browser, made by other processes while this one judges the causes."""

    def __init__(self, aside: Any, system: Any):
        self._aside, self._system = aside, system

    def begin(self, shown: Any) -> None:
        """Have them made."""
        self._drawn = self._aside.begin(_drawn, shown, self._system)
        self._moving = self._aside.begin(_moving, shown, self._system)

    def files(self) -> dict[str, bytes]:
        """SVG by name."""
        drawn: dict[str, bytes] = self._drawn.result()
        return drawn

    def moving(self) -> dict[str, str]:
        """Scripts and elements by name."""
        acting: dict[str, str] = self._moving.result()
        return acting


def _drawn(shown: Any, system: Any) -> dict[str, bytes]:
    from matching.report.diagnosis.figures import pictures  # here: the process that begins this does not draw

    return pictures(shown, system)


def _moving(shown: Any, system: Any) -> dict[str, str]:
    from matching.report.diagnosis.figures import acting_figures

    return acting_figures(shown, system)


def _written(
    diagnosis: Any, system: Any, pictures: _Pictures, made: Any
) -> tuple[dict[str, Any], dict[str, str | bytes]]:
    """Result and files by name."""
    from matching.report.diagnosis.page import content, page

    result, drawn = content(diagnosis), pictures.files()
    units = {sensor.name: sensor.unit for sensor in system.sensors}
    files: dict[str, str | bytes] = {"report.html": page(result, system.title, units, drawn, pictures.moving(), made)}
    return result, files | {f"figures/{name}.svg": picture for name, picture in drawn.items()}


def summary(result: dict[str, Any]) -> str:
    """The answer in a sentence, then errors and causes."""
    from matching.report.diagnosis.sentences import summary as words

    return words(result)
