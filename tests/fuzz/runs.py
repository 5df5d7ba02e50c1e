"""What is calculated, written and shown from files: the targets of the fuzzer that go beyond reading.

Beside answering or refusing in one line, text of a file has to stay text: XML and HTML are parsed again.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from html.parser import HTMLParser
from pathlib import Path

from matching import studies
from matching.api import simulate
from matching.bed.commission import RECORD, Stages
from matching.bed.excite import ExcitationOrder, plan_excitation
from matching.bed.simulated_bed import ByHand
from matching.bed.verify import judge, read_recordings
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.loggers import read_loggers
from matching.explore.common import read_as_suggested
from matching.explore.files import CaseForm, opened
from matching.export import read_export_source
from matching.match.case_file import load_case
from matching.report.drivetrain import MOST_INERTIAS
from matching.studies import CHECKSUM
from modelling.equations import lagrange as latex
from modelling.equations.lagrange import derive
from modelling.fmu.export import description, page_of, sources
from modelling.model_file import load
from modelling.recordings.read import read_channels, read_recording
from modelling.writing import strict_json

DRAWN_SHARE = 8  # one model in so many is drawn
SVG = "data:image/svg+xml;base64,"
TAGS = re.compile(
    "a|article|b|body|br|caption|code|col|colgroup|dd|details|div|dl|dt|em|figure|h[1-6]|head|html|i|li|math|meta|m[a-z]+"
    "|ol|p|pre|section|small|span|strong|style|sub|summary|sup|table|tbody|td|th|thead|title|tr|ul"
)  # that the program writes


def _one_in(share: int, path: Path) -> bool:
    return zlib.crc32(path.read_bytes()) % share == 0


def drive(path: Path, deep: bool) -> None:
    """A vehicle, a rig or a residual vehicle of the user's own, as the case reads them."""
    role = (path.parent / "role.txt").read_text()
    path.replace(path.parent / f"{role}.toml")
    load_case(path.parent / "case.toml")


def trace(path: Path, deep: bool) -> None:
    """A recorded torque that a case names as its manoeuvre."""
    path.replace(path.parent / "trace.csv")
    load_case(path.parent / "case.toml")


def loggers(path: Path, deep: bool) -> None:
    """A second logger's recording of a motion."""
    read_loggers(f"{path.parent / 'first.csv'}+{path}", load(path.parent / "model.toml"))


def bed(path: Path, deep: bool) -> None:
    """A recording of the controlled bed, judged."""
    case = load_case(path.parent / "case.toml")
    recordings = read_recordings([path], case)
    if deep:
        strict_json(judge(case, recordings).to_dict())


def by_hand(path: Path, deep: bool) -> None:
    """A recording that somebody puts into the folder of a commissioning."""
    taken = ByHand(path.parent, None, str).recording(path.stem, {}, "record", str)
    path.write_bytes(taken.content.encode() if isinstance(taken.content, str) else taken.content)
    read_recordings([path], load_case(path.parent / "case.toml"))


def diagnosed(path: Path, deep: bool) -> None:
    """A recording, diagnosed."""
    system = load(path.parent / "model.toml")
    recording = read_recording(path, system)
    if deep:
        strict_json(diagnose(system, [recording]).to_dict())


def record(path: Path, deep: bool) -> None:
    """A record to go on from, whose checksums are those of its changed lines."""
    text = path.read_text(errors="replace")
    lines = [_with_checksum(line) for line in text.split("\n")]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with ThreadPoolExecutor(1) as pool:
        studies.run(_work, str, 1, [1, 2], pool, content="S", record=path)
    path.replace(path.parent / RECORD)
    Stages(path.parent).done("1_export", "I")


def _work(prepared: str, chunk: int) -> list[float]:
    return [float(prepared), chunk]


def _with_checksum(line: str) -> str:
    try:
        row = json.loads(line)
        if isinstance(row, dict):
            if row.get("study") == "S":
                row["study"] = hashlib.sha256(b"S").hexdigest()
            row.pop(CHECKSUM, None)
            row[CHECKSUM] = hashlib.sha256(json.dumps(row).encode()).hexdigest()[:32]
            return json.dumps(row)
    except (ValueError, RecursionError):
        pass
    return line


def columns(path: Path, deep: bool) -> None:
    """A channel file that names columns of a matrix."""
    read_recording(path.parent / "drive.mat", load(path.parent / "model.toml"), read_channels(path))


def groups(path: Path, deep: bool) -> None:
    """A channel file that names groups of an MDF file."""
    read_recording(path.parent / "drive.mf4", load(path.parent / "model.toml"), read_channels(path))


def simulated(path: Path, deep: bool) -> None:
    """A model over recorded inputs."""
    system = load(path)
    if deep:
        simulate(system, path.parent / "drive.csv")


def written(path: Path, deep: bool) -> None:
    """A model as C, XML, HTML and SVG."""
    source = read_export_source(path)
    described = description(source.block, "m", "2.0", "{0}", 1e-3, "m.c")
    ET.fromstring(described.encode())
    for name, text in sources(source.block, "m", "2.0", "{0}").items():
        _check_c(name, text)
    check_html(page_of("index.html", block=source.block, fmi="2.0"))
    system = load(path)
    check_html(latex.html(derive(system), system))
    if not deep or _one_in(DRAWN_SHARE, path):
        drawn = len(system.inertias) <= MOST_INERTIAS
        check_html(system._repr_html_(), [system.title or "drivetrain"] if drawn else [])


def _check_c(name: str, text: str) -> None:
    """Comments end where they were meant to, and nothing stands in the file but ASCII."""
    if not text.isascii() or "??" in text:
        raise AssertionError(f"{name}: not plain ASCII, or a trigraph")
    if "*/" in text.replace("/*", "").partition("*/")[2] and text.count("/*") != text.count("*/"):
        raise AssertionError(f"{name}: comments that do not match")


class _Tags(HTMLParser):
    """Collects the titles of the pictures."""

    def __init__(self) -> None:
        super().__init__()
        self.pictures: list[str | None] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Only tags that the program writes, and no attribute that runs anything."""
        if tag == "img" and _is_drawing(attrs):
            self.pictures.append(dict(attrs)["alt"])
        elif not TAGS.fullmatch(tag) or any(name.startswith("on") for name, _ in attrs):
            raise AssertionError(f"HTML holds <{tag[:20]}>")


def _is_drawing(attributes: list[tuple[str, str | None]]) -> bool:
    """Whether an image is an SVG within the page, well-formed and without script, and has no other attributes."""
    source = dict(attributes).get("src") or ""
    if [name for name, _ in attributes] != ["alt", "src", "style"] or not source.startswith(SVG):
        return False
    elements = ET.fromstring(base64.b64decode(source.removeprefix(SVG), validate=True)).iter()
    return not any(
        element.tag.endswith(("}script", "}foreignObject")) or any(name.startswith("on") for name in element.attrib)
        for element in elements
    )


def check_html(page: str, pictures: Sequence[str] = ()) -> None:
    """Only what the program writes, and exactly its pictures, each with its title.

    Raises
    ------
    AssertionError
        Where a tag, an attribute or a picture stands there that the program does not write.
    """
    parser = _Tags()
    parser.feed(page)
    parser.close()
    if parser.pictures != list(pictures):
        raise AssertionError(f"HTML holds {len(parser.pictures)} <img>")


def opened_to_edit(path: Path, deep: bool) -> None:
    """A model or a case, open in the browser, with every field shown and some written again."""
    workspace = opened([path], path.parent / "out")
    for document in workspace.models.values():
        for name, quantity in list(document.system.parameters.items())[-2:]:
            document.written(name)
            document.set_value(name, quantity.value)
    if workspace.case is not None:
        form = CaseForm(workspace.case)
        for field in [table[-1] for table in form.fields.values()][:1]:
            form.set(field.keys, field.text)
    elif deep and "model" in workspace.models:
        read_as_suggested(path.parent / "drive.csv", workspace.models["model"].system)


def planned(path: Path, deep: bool) -> None:
    """A case, for which the recording that identifies its bed is planned."""
    case = load_case(path)
    if deep:
        strict_json(plan_excitation(case, ExcitationOrder(duration=6.0, beds=2)).to_dict())


RUNS = {
    "drive": (".toml", drive, 1.5),
    "trace": (".csv", trace, 0.2),
    "loggers": (".csv", loggers, 0.2),
    "bed": (".csv", bed, 0.05),
    "by_hand": (".csv", by_hand, 0.1),
    "diagnosed": (".csv", diagnosed, 0.05),
    "record": (".jsonl", record, 0.3),
    "columns": (".toml", columns, 0.05),
    "groups": (".toml", groups, 0.02),
    "simulated": (".toml", simulated, 0.5),
    "written": (".toml", written, 0.25),
    "opened": (".toml", opened_to_edit, 0.15),
    "planned": (".toml", planned, 0.02),
}
