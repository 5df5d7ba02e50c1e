"""`rigmatch diagnose`: find out what a model lacks against recordings."""

import argparse
import sys
from typing import Any

HELP = """Fits the model to recordings, shows where it fails, names the cause and its place, and writes the extended
model. Writes diagnosis.json and extended.toml. A quantity of the model with a range is fitted within it; one without is
taken as known. Every sensor's uncertainty is also the noise that the fit assumes. Without --holdout the last 30 % of
every recording is kept from all fits and judges the result."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Model, recordings, hold-out, place to write to."""
    parser.add_argument("model", metavar="MODEL", help="model file (TOML)")
    parser.add_argument(
        "recordings", metavar="RECORDING", nargs="+", help="recordings of the system (CSV, MDF4, .mat, Parquet)"
    )
    parser.add_argument("--holdout", metavar="RECORDING", help="a recording that judges and is not fitted")
    parser.add_argument("--out", metavar="DIR", required=True, help="directory to write to")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Diagnose and write files; the result object is that of diagnosis.json."""
    from tqdm import tqdm

    from matching.diagnosis.diagnosis import diagnose
    from modelling.files import dumps, load
    from modelling.output import strict_json, write_all
    from modelling.recording import read_recording

    system = load(arguments.model)
    recordings = [read_recording(path, system) for path in arguments.recordings]
    holdout = read_recording(arguments.holdout, system) if arguments.holdout else None
    with tqdm(disable=not sys.stderr.isatty(), bar_format="{desc} {n} [{elapsed}]", leave=False) as bar:

        def tell(step: str) -> None:
            bar.set_description_str(f"{step:50.50}")
            bar.update()

        found = diagnose(system, recordings, holdout, tell)
    result = found.to_dict()
    write_all(arguments.out, {"diagnosis.json": strict_json(result), "extended.toml": dumps(found.extended)})
    return result


def summary(result: dict[str, Any]) -> str:
    """The answer in a sentence, then errors and causes."""
    lines = [headline(result)]
    for cause in result["causes"]:
        lines.append(f"  {cause['kind']} at {cause['at']}, confidence {cause['confidence']:.2f}: {cause['evidence']}")
        rivals = [f"{one['kind']} at {one['at']} ({one['confidence']:.2f})" for one in cause["alternatives"][:3]]
        if rivals:
            lines.append(f"    rivals: {', '.join(rivals)}")
    for name, own in result["errors"].items():
        held = [own["before_holdout"], own["after_holdout"]]
        text = " to ".join("–" if value is None else f"{value / own['noise']:.3g}" for value in held)
        lines.append(f"  {name}: error on unseen data from {text} times the noise")
    for one in result["rest"]:
        lines.append(
            f"  left over: {one['sensor']}, most from {one['from']:g} to {one['to']:g} s, "
            f"{one['worst_ratio']:.3g} times the noise"
        )
    if result["next_recording"]:
        lines.append(f"  next: {result['next_recording']}")
    return "\n".join([*lines, *(f"  note: {note}" for note in result["notes"])])


def headline(result: dict[str, Any]) -> str:
    """The answer in one sentence."""
    if result["verdict"] == "adequate":
        return "The model is adequate: nothing stands above the noise."
    if not result["causes"]:
        return "What the model misses fits nothing in the vocabulary."
    parts = []
    for cause in result["causes"]:
        values = ", ".join(
            f"{key} {own['value']:.4g} ± {own['standard_uncertainty'] or float('nan'):.2g} "
            + own["unit"].replace("*", "·").removesuffix("1").rstrip()
            for key, own in cause["parameters"].items()
        )
        parts.append(f"{cause['at']} has {cause['kind'].replace('_', ' ')} ({values})")
    text = " and ".join(parts)
    worst = max(result["errors"].values(), key=lambda own: (own["before_holdout"] or 0) / own["noise"])
    if worst["before_holdout"] is not None and worst["after_holdout"] is not None:
        text += (
            f"; the error on unseen data falls from {worst['before_holdout'] / worst['noise']:.3g}"
            f" to {worst['after_holdout'] / worst['noise']:.3g} times the noise"
        )
    return text + ("." if result["verdict"] == "explained" else ", but something unexplained remains.")
