"""On the bed: planned excitation and proof, identification, verification, commissioning: figures and reports."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from shlex import quote
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from matching.bed.channels import ChannelCheck, ChannelPlan
from matching.bed.commission import Commissioning
from matching.bed.excite import ExcitationPlan, excitation_csv
from matching.bed.identify import FromRecordings
from matching.bed.proof import Proof, proof_csv
from matching.bed.verify import COVERAGE_FACTOR, BedVerification, FunctionCurves
from matching.report.common import (
    BAND,
    INK,
    MATCHED,
    NOISE,
    RIG,
    VEHICLE,
    component,
    csv_table,
    curve,
    decimated,
    figure,
    number,
    plus_minus,
    spaced,
    styled,
    unit,
)
from matching.report.drivetrain import MOST_INERTIAS, noted_figure
from matching.report.match import HEADS, key_figures
from matching.report.page import Fold, Picture, Provenance, Report, Step, Table, View, register

# --- The curves of a verification's figure as a table (CSV), to be calculated with.


def curve_data(curves: Sequence[FunctionCurves]) -> str:
    """A row per frequency: moduli and phases of vehicle, prediction and bed, and what the bed's modulus is known to.

    Functions may have frequencies of their own: the table has all of them, and no value where a function has none.
    """
    frequencies = np.unique(np.concatenate([curve.frequencies for curve in curves])) if curves else np.empty(0)
    columns = {"frequency [Hz]": frequencies}
    for curve in curves:
        name, per = f"{curve.sensor} / {curve.input}", f"{unit(curve.unit)} per {unit(curve.per)}"
        own: dict[str, np.ndarray] = {}
        for who in ("vehicle", "predicted", "measured"):
            values = getattr(curve, who)
            own |= {f"{name}, {who}, modulus [{per}]": np.abs(values),
                    f"{name}, {who}, phase [deg]": np.degrees(np.angle(values))}  # fmt: skip
        own[f"{name}, expanded uncertainty (k = {COVERAGE_FACTOR:g}) [{per}]"] = COVERAGE_FACTOR * curve.uncertainty
        for head, values in own.items():
            columns[head] = np.full(len(frequencies), np.nan)
            columns[head][np.searchsorted(frequencies, curve.frequencies)] = values
    return csv_table(list(columns), zip(*columns.values(), strict=True))


# --- Figure of a bed's verification: measured responses with their uncertainty over vehicle and prediction.

MOST_COLUMNS = 3
LARGEST_BAND = 3.0  # of a modulus: a wider uncertainty is not drawn, it would hide the rest


def responses(verification: BedVerification) -> Figure:
    """One panel a compared function: modulus over frequency of vehicle, prediction and bed."""
    curves = verification.curves
    columns = min(MOST_COLUMNS, len(curves))
    rows = -(-len(curves) // columns)
    fig = figure(3.4 * columns + 0.4, 2.5 * rows + 0.5)
    with styled():
        axes = fig.subplots(rows, columns, squeeze=False, sharex=True).ravel()
        for ax, curve in zip(axes, curves, strict=False):
            _panel(ax, curve)
        for ax in axes[len(curves) :]:
            ax.set_visible(False)
        for ax in axes[max(len(curves) - columns, 0) : len(curves)]:
            ax.set_xlabel("frequency in Hz")
        handles, labels = axes[0].get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return fig


def _panel(ax: Any, curve: FunctionCurves) -> None:
    f, measured = curve.frequencies, np.abs(curve.measured)
    known = np.isfinite(measured) & np.isfinite(curve.uncertainty)
    spread = np.where(known, COVERAGE_FACTOR * curve.uncertainty, np.nan)
    low, high = (
        np.maximum(measured - spread, measured / LARGEST_BAND),
        np.minimum(measured + spread, measured * LARGEST_BAND),
    )
    ax.loglog(f, np.abs(curve.vehicle), color=VEHICLE, label="vehicle")
    ax.loglog(f, np.abs(curve.predicted), color=MATCHED, linestyle="--", label="predicted for the bed")
    ax.fill_between(f, low, high, where=known, color=NOISE, alpha=0.3, linewidth=0, label="about 95 %")
    ax.loglog(f[known], measured[known], "o", markersize=3, color=NOISE, markeredgecolor=INK, markeredgewidth=0.5,
              zorder=3, label="measured on the bed")  # fmt: skip
    ax.set_xlim(f[0], f[-1])
    ax.set_title(f"{spaced(curve.input)} → {spaced(curve.sensor)}", fontsize=8)
    ax.set_ylabel(f"{unit(curve.unit)} per {unit(curve.per)}")


# --- The report of a bed's verification: measured errors with their uncertainty, and what to do.

RESPONSES = (
    "Compared functions over frequency, modulus: the vehicle, the prediction for the bed with its controller, and what "
    "the recordings show with about 95 % uncertainty."
)
VERDICT_MEANING = {
    "as_predicted": "The bed answers as the match predicted, within what was measured and what the case states as "
    "uncertain, and no worse than the case allows.",
    "short": "The bed falls short of the prediction by more than the uncertainty of the measurement.",
    "undetermined": "The recordings do not decide whether the bed answers as predicted.",
}
HOW_ERRORS = (
    "Root mean square of |log(H bed/H vehicle)| over the band, with expanded uncertainty (k = 2); noise taken off. "
    "From whole periods each value is the quotient at a line; from other recordings it comes from local rational "
    "models of the spectra."
)
HOW_MODES = "One estimator for vehicle, prediction and bed: a pair of poles that the compared functions share."
HOW_FIDELITY = "The vehicle is simulated on the recorded torques (Eqs. 14 to 23 of the paper as defined)."


def verification_report(
    content: Mapping[str, Any], folder: str = "OUT", made: Provenance | None = None, result: Any = None
) -> Report:
    """What a verification says."""
    fidelity = [
        {"recording": row["recording"], "R_SD": number(row["R_SD"]), "R_MU": number(row["R_MU"]), "R_XiL": _known(row)}
        for row in content["fidelity"]
    ]
    band = f"{number(content['band'][0])} to {number(content['band'][1])} Hz"
    return Report(
        title=f"Bed against vehicle: {content['title']}" if content["title"] else "Bed against vehicle",
        status=spaced(content["status"]),
        answer=answer(content),
        good=content["status"] == "as_predicted",
        lists={
            "Why it falls short": [Step(spaced(sentence)) for sentence in why(content)],
            "What to do now": verification_steps(content, _case_of(made), folder),
        },
        table=error_table(content),
        folds=[
            Fold("Modes", [Table([row for mode in content["modes"] for row in _mode(mode)], HOW_MODES)], told=True),
            Fold("XiL fidelity of the recordings", [Table(fidelity, HOW_FIDELITY)], told=True),
            Fold(f"Response error of each compared function, {band}",
                 [Table([_error(spaced(row["name"]), row) for row in content["functions"]], HOW_ERRORS)]),
        ],
        notes=content["notes"],
    )  # fmt: skip


def _case_of(made: Provenance | None) -> str:
    """What a command names the case by."""
    return quote(made.case) if made else "case.toml"


def answer(result: Mapping[str, Any]) -> str:
    """The answer in one sentence, with what is short or open."""
    close = [open_words(one) for one in result["open"] if one["because"] == "near_limit"]
    parts = [too_weak(result), VERDICT_MEANING[result["status"]]]
    names = [f"{error['name']} torques" for error in result["errors"] if error["status"] == "short"]
    names += [f"vehicle mode {mode['vehicle_mode']}" for mode in result["modes"] if mode["status"] == "short"]
    parts += [f"Short: {', '.join(names)}."] if names else []
    parts += [f"Near what is allowed: {'; '.join(close)}."] if close else []
    return " ".join(filter(None, parts))


def too_weak(result: Mapping[str, Any]) -> str:
    """A sentence on what the excitation, or what is known of the vehicle, is not enough for, and what would do."""
    weak, vehicle = (
        [one for one in result.get("open", ()) if one["because"] == because] for because in ("excitation", "vehicle")
    )
    said = []
    if vehicle:
        said.append(
            f"Too little is known of the vehicle for an answer: {'; '.join(map(open_words, vehicle))}. A longer "
            "recording of the bed does not change that, but a recording of the vehicle does, or less uncertainty of it "
            "under [uncertainty]."
        )
    if weak:
        said.append(f"The excitation is too weak for its own question: {'; '.join(map(open_words, weak))}.")
        times = [one["times_as_long"] for one in weak]
        if None in times:
            said.append("No recording up to 100 times as long decides it.")
        else:
            said.append(
                f"{number(max(times), 2)} times as long ({number(max(times) * result['duration'], 2)} s), or torques "
                f"{number(max(times) ** 0.5, 2)} times as large, would do."
            )
    return " ".join(said)


def open_words(question: Mapping[str, Any]) -> str:
    """What is open, how well it is known, and what is allowed."""
    per = f" {question['unit']}" if question["unit"] else ""
    allowed = f"{number(question['allowed'], 2)}{per} is allowed"
    if question["expanded_uncertainty"] is None:
        return f"the {question['name']} does not show above the noise ({allowed})"
    return f"the {question['name']} is known to ± {number(question['expanded_uncertainty'], 2)}{per}, {allowed}"


def with_uncertainty(value: float | None, standard: float | None, digits: int = 3) -> str:
    """A value with its expanded uncertainty, k = 2, to the second digit of that, without trailing zeros; ``digits``
    where it is 0. Where zeros shall stand, see :func:`matching.report.common.plus_minus`."""
    if value is None or standard is None:
        return "not determined"
    if not standard > 0 or not np.isfinite(standard):
        return f"{number(value, digits)} ± {number(2 * standard, 2)}"
    place = int(np.floor(np.log10(2 * standard))) - 1
    return f"{number(round(value, -place), 12)} ± {number(2 * standard, 2)}"


def _known(row: Mapping[str, Any], key: str = "R_XiL") -> str:
    return with_uncertainty(row[key], row["standard_uncertainty"])


def _error(name: str, error: Mapping[str, Any]) -> dict[str, str]:
    predicted, expected, allowed = (number(error[key], 3) for key in ("predicted", "expected", "allowed"))
    return {
        "response error": name, "on the bed": _known(error, "error"), "predicted": predicted,
        "95 % of drawn beds below": expected, "allowed": allowed, "": spaced(error["status"]),
    }  # fmt: skip


def _mode(mode: Mapping[str, Any]) -> list[dict[str, str]]:
    """Frequency and damping ratio of vehicle, prediction and bed."""
    rows = dict.fromkeys(("vehicle", "predicted", "on the bed"), ("does not show", ""))
    for who in ("vehicle", "predicted"):
        if (own := mode[who]) is not None:
            rows[who] = f"{number(own['frequency'], 4)} Hz", number(own["damping_ratio"], 3)
    if (bed := mode["measured"]) is not None:
        frequency = with_uncertainty(bed["frequency"], bed["frequency_uncertainty"], 4)
        rows["on the bed"] = f"{frequency} Hz", with_uncertainty(bed["damping_ratio"], bed["damping_uncertainty"])
    return [
        {"vehicle mode": f"{mode['vehicle_mode']}, {who}", "frequency": frequency, "damping ratio": damping,
         "": spaced(mode["status"]) if who == "on the bed" else ""}
        for who, (frequency, damping) in rows.items()
    ]  # fmt: skip


def why(result: Mapping[str, Any]) -> list[str]:
    """What a diagnosis of the recordings says, where the bed falls short."""
    return list((result.get("diagnosis") or {}).get("sentences", ()))


def interim(result: Mapping[str, Any]) -> str:
    """One line on what a recording shows that is still being written."""
    errors = [f"{error['name']} torques {_known(error, 'error')}" for error in result["errors"]]
    return f"so far {result['status']}: response error to {', '.join(errors)}"


def verification_steps(result: Mapping[str, Any], case: str, folder: str, *, commissioned: bool = False) -> list[Step]:
    """What to do after a verification, with its command."""
    if result["status"] == "as_predicted":
        return [
            Step("Drive the manoeuvres: the bed answers like the vehicle as far as the match promised"),
            Step("Repeat the proof after every change of specimen, adapter or loop, and record it as again.csv",
                 command=f"rigmatch verify {case} again.csv --out {folder}"),
        ]  # fmt: skip
    if result["status"] == "short":
        return [
            Step("Find what differs from the model, and match again with it",
                        "it records the bed without emulation, diagnoses it and matches with what it found",
                        command=f"rigmatch commission {case} --bed recordings --out commission"),
        ] if not commissioned else []  # fmt: skip
    if result["status"] == "unlike_model":
        return [
            Step("Allow a further round: it records the bed without emulation and diagnoses it", result["sentence"]),
        ] if not commissioned else []  # fmt: skip
    vehicle = [Step("Record the vehicle on the road as road.csv, and begin again with what it tells",
                    command=f"rigmatch identify {case} --vehicle road.csv --out identify")]  # fmt: skip
    if all(one["because"] == "vehicle" for one in result["open"]) and result["open"]:
        return vehicle
    recordings = " ".join(quote(row["recording"]) for row in result["fidelity"]) or "recording.csv"
    why = "; ".join(f"{one['name']}: {number(one['times_as_long'], 2)} times as long decides it, as far as noise does"
                    for one in result["open"] if one["times_as_long"])  # fmt: skip
    return [
        *(vehicle if any(one["because"] == "vehicle" for one in result["open"]) else ()),
        Step("Record again as again.csv, longer or with larger torques; the proof plans torques for this case", why,
             command=f"rigmatch excite {case} --proof --out proof"),
        Step("Judge it together with what there is",
             command=f"rigmatch verify {case} {recordings} again.csv --out {folder}"),
    ]  # fmt: skip


def verification_pictures(found: BedVerification) -> dict[str, Picture]:
    """Measured responses over vehicle and prediction."""
    return {"responses": Picture(lambda: responses(found), RESPONSES, curve_data(found.curves))}


register(BedVerification, View("verification.json", verification_report, verification_pictures))


# --- The report of a commissioning: the circle with what each round gained.

END_MEANING = {
    "as_predicted": "The bed answers as the last match predicted, within what the case states as uncertain.",
    "short": "The bed falls short of what the last match predicted.",
    "undetermined": "The recordings do not decide whether the bed answers as predicted.",
    "waiting": "Waiting for your recording.",
    "unlike_model": "The bed answers otherwise than its model, so nothing could be judged.",
}
ROUNDS = "Measured response error of each round, against the last round's vehicle."
BESIDE = Markup(
    "<p>± is the half-width that the next match counts with (k = 2). Errors and R_XiL are stated with k = 2. Every "
    "step's files lie in a folder of its name beside this page. The C sources of a controller are in its FMU: "
    "<code>unzip -j 1_export/controller.fmu 'sources/controller*'</code>, then <code>cc -std=c99 main.c controller.c "
    "-lm</code>; <code>controller.h</code> says what <code>main.c</code> has to call.</p>"
)


def commissioning_report(
    content: Mapping[str, Any], folder: str = "OUT", made: Provenance | None = None, result: Any = None
) -> Report:
    """What a commissioning says."""
    told = [("Vehicle on the road", identification_lines(content["vehicle"]), content["vehicle"]["values"])] \
        if content.get("vehicle") else []  # fmt: skip
    checked = content.get("channels")
    wrong = content["status"] == "wrong_channel"
    last = content["rounds"][-1].get("verification", {}) if content["rounds"] else {}
    meaning = _sentence(checked["sentence"]) if checked and wrong else END_MEANING[content["status"]]
    weak = too_weak(last) if content["status"] == "undetermined" else ""
    return Report(
        title="Commissioning",
        status=spaced(content["status"]),
        answer=" ".join(filter(None, [weak, meaning, ending(content), gain(content)])),
        good=content["status"] == "as_predicted",
        lists={"Why it falls short": [Step(spaced(sentence)) for sentence in why(last)],
               "What to do now": next_steps(content, _case_of(made), folder)},
        table=channel_table(checked) if checked and wrong else error_table(last),
        folds=[
            *(Fold(name, [lines, *([Table([_value(own) for own in values])] if values else [])], told=True)
              for name, lines, values in told),
            *([Fold("Channels before the first emulation", [[checked["sentence"]], channel_table(checked)], told=True)]
              if checked and not wrong else []),
            *(Fold(f"Round {entry['round']}", [round_lines(entry), *round_tables(entry)], told=True)
              for entry in content["rounds"]),
            Fold("Files beside this page", [BESIDE]),
        ],
    )  # fmt: skip


def round_tables(entry: Mapping[str, Any]) -> list[Table]:
    """Tables of a round: what a recording told, what the match reaches, and the modes of the bed then."""
    values, matched, proof = (entry.get(key) or {} for key in ("identification", "match", "verification"))
    made = [Table([_value(own) for own in values.get("values", ())])]
    if matched.get("response_error"):  # a match that was done before, or a round that waits, has none
        made.append(Table([dict(zip(HEADS, row, strict=True)) for row in key_figures(matched)], "The match."))
    made.append(Table([row for mode in proof.get("modes", ()) for row in _mode(mode)], HOW_MODES))
    return [table for table in made if table.rows]


def error_table(verification: Mapping[str, Any]) -> Table:
    """Measured response errors of a verification, by what they are judged."""
    return Table([_error(f"all {error['name']} torques", error) for error in verification.get("errors", ())])


def channel_table(checked: Mapping[str, Any]) -> Table:
    """Gain, delay, zero and noise of every channel, as the check of the channels found them."""
    rows = []
    for own in checked["channels"]:
        zero, per = own["zero"], unit(own["unit"])
        rows.append({
            "channel": spaced(own["name"]),
            "": own["words"] or ("not judged" if own["name"] in checked["unjudged"] else "as modelled"),
            "gain": _with(own["gain"], own["gain_uncertainty"]),
            "delay beyond the model in ms": _with(own["delay"], own["delay_uncertainty"], 1e3),
            "reads at rest": "" if zero is None else f"{_with(zero, own['zero_uncertainty'])} {per}",
            "noise of a sample": "" if own["noise"] is None else f"{number(own['noise'], 2)} {per}",
        })  # fmt: skip
    return Table(
        rows, "± is an expanded uncertainty (k = 2). A gain is that of the reading over the model's, of a torque that "
        "of torque over command. The delay is that beyond the stated one. One fit of the bed measures them all.",
    )  # fmt: skip


def _sentence(words: str) -> str:
    """With a full stop, and a capital unless a name begins it."""
    first = words.partition(" ")[0]
    return f"{words if '_' in first else words[:1].upper() + words[1:]}."


def _with(value: float | None, uncertainty: float | None, factor: float = 1.0) -> str:
    if value is None or uncertainty is None:
        return "not told"
    return plus_minus(factor * value, 2 * factor * uncertainty).replace("-", "−")


def _value(own: Mapping[str, Any]) -> dict[str, str]:
    found = own.get("found", True)
    return {"quantity": component(own["name"]), "before": number(own["before"]),
            "as recorded": plus_minus(own["after"], own["half_width"]) if found else "not told",
            "": "" if found else "at the end of its range, or not narrowed"}  # fmt: skip


def ending(result: Mapping[str, Any]) -> str:
    """Why the circle ended, a sentence."""
    if result["status"] == "wrong_channel":
        return "No emulation was begun."
    if result["end"]:
        after = f"with round {result['rounds'][-1]['round']}" if result["rounds"] else "before its first round"
        return f"It ended {after}: {result['end']}."
    if result["status"] in VERDICT_MEANING:
        return "It ended with the last round that was asked for; a further one may gain."
    return ""


def next_steps(result: Mapping[str, Any], case: str, folder: str) -> list[Step]:
    """What to do after a commissioning, with its command."""
    folder = result.get("out") or folder
    again = result.get("command") or f"rigmatch commission {case} --bed BED --out {folder}"
    if result["waiting_for"]:
        return [Step(f"Record: {result['waiting_for']}"), Step("Go on", command=again)]
    if result["status"] == "wrong_channel":
        return wrong_channel_steps(result["channels"], again, f"{again} --skip-channel-check")
    best = result["best_round"]
    judged = {entry["round"]: entry.get("verification") for entry in result["rounds"]}
    points = [Step(f"Use the controller of round {best}", f"it has the least error on the bed: "
                          f"{best}_export/controller.fmu")] if best else []  # fmt: skip
    last = next((proof for _, proof in sorted(judged.items(), reverse=True) if proof), None)
    if last:
        points += verification_steps(last, f"{folder}/{max(judged)}_match", "verify", commissioned=True)
    if result["end"] is None:
        before = re.sub(r" --rounds \d+", "", again)
        points.append(Step("Allow a further round: it may gain", command=f"{before} --rounds {len(judged) + 1}"))
    return points


def wrong_channel_steps(checked: Mapping[str, Any], again: str, skipped: str = "", smaller: str = "") -> list[Step]:
    """What to mend on the bed, and how to read what was recorded before.

    ``again``, ``skipped``, ``smaller``: the commands that check again, that go on without a check, and that plan a
    check with smaller torques.
    """
    points = [
        Step(f"{spaced(wrong['channel'])} {wrong['words']}: mend it on the bed, for the controller reads it there",
             f"of recordings made before: a channel file with the line {wrong['line']}" if wrong["line"] else "")
        for wrong in checked["wrong"]
    ]  # fmt: skip
    if not points and checked["tripped"]:
        points = [Step(f"The check ended early: {checked['tripped']}",
                       "look at the recording: is a rotor loose, or a command larger than it says? Then repeat the "
                       "check with smaller torques", command=smaller)]  # fmt: skip
    elif not points:
        names = ", ".join(spaced(name) for name in checked["needed"])
        points = [Step(f"Not judged: {names}", "no torque of the check moves it beyond its noise: turn the rotors by "
                       "hand or with more torque and look at it; where it reads right, go on without the check",
                       command=skipped)]  # fmt: skip
    if checked["unjudged"] and checked["wrong"]:
        points.append(Step(f"Not judged yet: {', '.join(spaced(name) for name in checked['unjudged'])}"))
    return [*points, Step("Check again, and go on", command=again)]


MOVED = 4  # quantities that are told in a sentence


def identification_lines(identification: Mapping[str, Any]) -> list[str]:
    """What a diagnosis found, a sentence each."""
    causes = ", ".join(f"{cause['kind']} at {cause['at']}" for cause in identification["causes"]) or "no further cause"
    known = [value for value in identification["values"] if value.get("found", True) and value["half_width"] > 0]
    moved = sorted(known, key=lambda value: -abs(value["after"] - value["before"]) / value["half_width"])
    pairs = [
        f"{component(value['name'])} {number(value['before'], 4)} → "
        f"{plus_minus(value['after'], value['half_width'])}"
        for value in moved[:MOVED] if abs(value["after"] - value["before"]) > value["half_width"]
    ]  # fmt: skip
    open_ = [component(value["name"]) for value in identification["values"] if not value.get("found", True)]
    return [
        f"diagnosis {identification['verdict']}: {causes}",
        *([f"off beyond their uncertainty (k = 2), the clearest first: {'; '.join(pairs)}"] if pairs else []),
        *([f"not told by the recording: {'; '.join(open_)}"] if open_ else []),
        *identification["notes"],
    ]


def round_lines(entry: Mapping[str, Any]) -> list[str]:
    """What a round found, a sentence each."""
    lines = identification_lines(entry["identification"]) if "identification" in entry else []
    if "match" in entry:
        lines.append(f"match {entry['match']['status']}")
    if "verification" in entry:
        proof = entry["verification"]
        if proof["status"] == "unlike_model":
            lines.append(f"unlike its model: {proof['sentence']}")
        for error in proof["errors"]:
            lines.append(f"{spaced(error['status'])}: response error to {error['name']} torques {error_words(error)}")
        lines += [f"short: {sentence}" for sentence in why(proof) if sentence.startswith("vehicle mode")]
        lines += [f"undetermined: {open_words(one)}" for one in proof.get("open", ()) if "vehicle mode" in one["name"]]
        lines += [f"not judged: {note}" for note in proof["notes"] if "left out" in note]
        lines += _fidelity(proof, "")
    if "against_last_vehicle" in entry:
        same = entry["against_last_vehicle"]
        for error in same["errors"]:
            measured = _known(error, "error")
            lines.append(f"against the last round's vehicle: response error to {error['name']} torques {measured}")
        lines += _fidelity(same, " against the last round's vehicle")
    return lines


def error_words(error: Mapping[str, Any]) -> str:
    """A measured response error beside what it is judged by."""
    predicted, expected, allowed = (number(error[key], 3) for key in ("predicted", "expected", "allowed"))
    measured = _known(error, "error")
    return f"{measured} (predicted {predicted}, on 95 % of drawn beds below {expected}, allowed {allowed})"


def _fidelity(judged: Mapping[str, Any], against: str) -> list[str]:
    return [f"R_XiL{against} {_known(fidelity)}" for fidelity in judged["fidelity"]]


def gain(result: Mapping[str, Any]) -> str:
    """What the rounds gained, in a sentence; empty where it does not exceed its uncertainty.

    All errors are against the vehicle of the last round, which holds the specimen as it is known best.
    """
    errors = [error for _, error in round_errors(result)]
    if len(errors) < 2 or errors[0]["interval"][0] <= errors[-1]["interval"][1]:
        return ""
    first, last = (with_uncertainty(error["error"], error["standard_uncertainty"]) for error in (errors[0], errors[-1]))
    factor = errors[0]["interval"][0] / errors[-1]["interval"][1]
    return f"The measured response error fell from {first} to {last}, at least by a factor of {number(factor, 2)}."


def round_errors(result: Mapping[str, Any]) -> list[tuple[int, Mapping[str, Any]]]:
    """Number of each round whose first error is determined, and that error, against the vehicle of the last round."""
    judged = [
        (entry["round"], (entry.get("against_last_vehicle") or entry.get("verification") or {}).get("errors", ()))
        for entry in result["rounds"]
    ]
    return [(name, errors[0]) for name, errors in judged if errors and errors[0]["error"] is not None]


def rounds_figure(result: Mapping[str, Any]) -> Figure:
    """Response error of every round with its 95 % interval, beside what the case allows."""
    rows = round_errors(result)
    fig = figure(3.4, 2.6)
    with styled():
        ax = fig.subplots()
        for name, error in rows:
            low, high = error["interval"]
            ax.plot([name, name], [low, high], color=MATCHED, linewidth=5, alpha=0.4, solid_capstyle="butt",
                    label="about 95 %" if name == rows[0][0] else None)  # fmt: skip
        ax.plot([name for name, _ in rows], [error["error"] for _, error in rows], "o", color=MATCHED, label="measured")
        allowed = max(error["allowed"] for _, error in rows)
        ax.axhline(allowed, color=NOISE, linestyle="--", label="allowed")
        ax.set_xticks([name for name, _ in rows])
        ax.set_xlim(rows[0][0] - 0.5, rows[-1][0] + 0.5)
        ax.set_ylim(0, 1.15 * max([allowed, *(error["interval"][1] for _, error in rows)]))
        ax.set_xlabel("round")
        ax.set_ylabel("response error")
        fig.legend(loc="outside upper center", ncols=3)
    return fig


WRONG = "What a wrong channel reads in the check, and what it would read on the bed as measured."


def wrong_channels_figure(shown: Mapping[str, Sequence[float]], units: Mapping[str, str]) -> Figure:
    """Readings of wrong sensors (t,) over time, next to those of the bed."""
    names = [name for name in shown if f"{name} model" in shown]
    with styled():
        drawn = figure(6.4, 0.9 + 1.6 * len(names))
        panels = np.atleast_1d(drawn.subplots(len(names), 1, sharex=True))
        for axes, name in zip(panels, names, strict=True):
            axes.plot(shown["time"], shown[name], color=RIG, linewidth=1.0, label="reads")
            axes.plot(shown["time"], shown[f"{name} model"], "--", color=MATCHED, linewidth=1.0, label="should read")
            axes.set_ylabel(f"{spaced(name)}\nin {unit(units[name])}")
        panels[0].legend(loc="upper right", ncols=2)
        panels[-1].set_xlabel("time in s")
    return drawn


def wrong_channel_pictures(checked: Mapping[str, Any]) -> dict[str, Picture]:
    """The wrong sensors of a check of the channels; nothing where only torques are wrong."""
    shown, units = checked.get("shown", {}), {own["name"]: own["unit"] for own in checked["channels"]}
    return {"wrong": Picture(lambda: wrong_channels_figure(shown, units), WRONG)} if len(shown) > 1 else {}


def commissioning_pictures(result: Commissioning) -> dict[str, Picture]:
    """The bed's responses of the last round, and the error of every round where there are two; or wrong channels."""
    pictures, last, content = dict[str, Picture](), result.last, result.to_dict()
    if content["status"] == "wrong_channel":
        return wrong_channel_pictures(content["channels"])
    if len(round_errors(content)) > 1:
        pictures["rounds"] = Picture(lambda: rounds_figure(content), ROUNDS)
    if last is not None:
        pictures["responses"] = Picture(lambda: responses(last), RESPONSES)
    return pictures


register(Commissioning, View("commission.json", commissioning_report, commissioning_pictures))


# --- Figures of a planned excitation: torques over time, and what is known before and after.

SHOWN = 12  # quantities, those that matter most
SMALLEST_SHARE = 1e-6


def excitation(plan: ExcitationPlan) -> Figure:
    """Demanded torques over time, one panel an input; below, the part of each quantity in the response error."""
    count = len(plan.inputs)
    expected = plan.expected[:SHOWN]
    fig = figure(7.4, 1.3 * count + 0.22 * len(expected) + 1.2)
    with styled():
        grid = fig.add_gridspec(count + 1, 1, height_ratios=[1.0] * count + [0.2 * len(expected) + 0.5])
        first = None
        for j, name in enumerate(plan.inputs):
            ax = fig.add_subplot(grid[j], sharex=first)
            first = first or ax
            for part in plan.parts[::2]:
                ax.axvspan(part.begin, part.end, color=BAND, linewidth=0)
            look = curve(j) | {"linestyle": "-"}  # alone in its panel
            ax.plot(*decimated(plan.time, plan.torques[:, j]), linewidth=0.6, **look)
            ax.set_ylabel(f"{spaced(name)}\nin N·m")
            if j == 0:
                for part in plan.parts:
                    ax.text(
                        (part.begin + part.end) / 2, 1.02, part.kind, transform=ax.get_xaxis_transform(), ha="center"
                    )
            if j == count - 1:
                ax.set_xlabel("time in s")
            else:
                ax.tick_params(labelbottom=False)
        ax = fig.add_subplot(grid[count])
        rows = np.arange(len(expected))
        looks = (("share_before", RIG, "o", "now"), ("share_after", MATCHED, "D", "expected after"))
        for share, colour, mark, label in looks:
            values = np.maximum([getattr(quantity, share) for quantity in expected], SMALLEST_SHARE)
            ax.plot(values, rows, mark, color=colour, label=label, fillstyle="full" if mark == "o" else "none")
        ax.set_xscale("log")
        ax.set_yticks(rows, [component(quantity.name) for quantity in expected])
        ax.invert_yaxis()
        ax.set_xlabel("part of the response error")
        fig.legend(loc="outside lower center", ncols=2)
    return fig


def proof_figure(plan: Proof) -> Figure:
    """Torques of a proof over its last period, one panel an input."""
    return torques_figure(plan.inputs, plan.torques[-round(plan.period / plan.step) :], plan.step)


def torques_figure(inputs: Sequence[str], torques: np.ndarray, step: float) -> Figure:
    """Torques (t, u), N·m, at steps (s) over time, one panel an input."""
    fig = figure(7.4, 1.3 * len(inputs) + 0.8)
    with styled():
        panels = fig.subplots(len(inputs), 1, sharex=True, squeeze=False).ravel()
        for j, (axes, name) in enumerate(zip(panels, inputs, strict=True)):
            time = np.arange(len(torques)) * step
            axes.plot(*decimated(time, torques[:, j]), linewidth=0.8, **(curve(j) | {"linestyle": "-"}))
            axes.set_ylabel(f"{spaced(name)}\nin N·m")
        panels[-1].set_xlabel("time in s")
    return fig


# --- The reports of an identification, of a planned excitation, a planned proof and a planned check of the channels.

EXCITATION = "Torques over time; below, the part of each quantity in the response error, now and after the recording."
IDENTIFIED = "What the recordings change of each quantity that they tell, with the half-width that stays (k = 2)."
ON_DRIVETRAIN = (
    "What the recordings tell of each part, with the half-width that stays (k = 2), in SI: k stiffness, d damping, "
    "i ratio."
)
PROOF = "The last period of the torques."
PULSES = "Torques of the check of the channels: every one alone, then all at once."

NAMED = 8  # quantities of a plan that are told
HALF_WIDTHS = "± is the half-width that the next match counts with (k = 2)."
FROM_NOISE = "± is a standard uncertainty (k = 1) from sensor noise alone: a model that lacks something adds to it"


def identification_report(content: Mapping[str, Any], folder: str = "OUT", *_: Any) -> Report:
    """What the recordings say."""
    parts = {name: content[name] for name in ("bed", "vehicle") if content[name] is not None}
    folds = [Fold(name, [identification_lines(part)], told=True) for name, part in parts.items()]
    rows = [{**_value(own), "recording of": name} for name, part in parts.items() for own in part["values"]]
    count = sum(own.get("found", True) for part in parts.values() for own in part["values"])
    return Report(
        "Identification", "identified",
        f"{count} of {len(rows)} quantities of {' and '.join(parts)} are told by the recordings.",
        lists={"What to do now": [
            Step("Match with what was found", command=f"rigmatch match {quote(folder)}/case.toml --out match"),
        ]},
        table=Table(rows, HALF_WIDTHS),
        folds=folds,
    )  # fmt: skip


def identified_figure(content: Mapping[str, Any]) -> Figure:
    """What recordings change of each quantity that they tell, in per cent, with what stays uncertain of it."""
    told = [own for part in ("bed", "vehicle") if content[part] for own in content[part]["values"]
            if own.get("found", True) and own["before"]]  # fmt: skip
    fig = figure(7.4, 0.24 * len(told) + 0.9)
    with styled():
        ax, rows = fig.subplots(), np.arange(len(told))
        before = np.array([own["before"] for own in told])
        changed = 100 * (np.array([own["after"] for own in told]) / before - 1)
        spread = 100 * np.array([own["half_width"] for own in told]) / np.abs(before)
        ax.axvline(0, color=INK, linewidth=0.8)
        ax.errorbar(changed, rows, xerr=spread, fmt="o", color=MATCHED, markersize=4, capsize=3)
        ax.set_yticks(rows, [component(own["name"]) for own in told])
        ax.invert_yaxis()
        ax.set_xlabel("change by the recordings in %")
    return fig


SIGNS = {"J": "J", "stiffness": "k", "damping": "d", "drag": "drag", "ratio": "i"}


def found_on_drivetrain(known: FromRecordings) -> Figure:
    """Vehicle and bed with what the recordings tell of each part, and with what they do not tell."""
    content, vehicle, rig = known.to_dict(), dict[str, list[str]](), dict[str, list[str]]()
    of_vehicle, of_rig = ({*case.places()} for case in (known.case.vehicle, known.case.rig))
    for recorded in ("bed", "vehicle"):
        for own in (content[recorded] or {}).get("values", ()):
            place, _, key = own["name"].partition(".")[2].rpartition(".")
            if key not in SIGNS or own["name"].partition(".")[0] not in ("rig", "vehicle"):
                continue
            told = plus_minus(own["after"], own["half_width"]) if own.get("found", True) else "not told"
            for lines, places in ((vehicle, of_vehicle), (rig, of_rig)):
                if place in places and (recorded == "vehicle") == (lines is vehicle):
                    lines.setdefault(place, []).append(f"{SIGNS[key]}: {told}")
    return noted_figure(known.case, vehicle, rig)


def _identified_pictures(known: FromRecordings) -> dict[str, Picture]:
    content = known.to_dict()
    made = {"identified": Picture(lambda: identified_figure(content), IDENTIFIED)}
    small = max(len(system.inertias) for system in (known.case.vehicle, known.case.rig)) <= MOST_INERTIAS
    named = (own["name"].partition(".")[0] for part in content.values() if part for own in part["values"])
    if small and not {"rig", "vehicle"}.isdisjoint(named):
        made["drivetrain"] = Picture(lambda: found_on_drivetrain(known), ON_DRIVETRAIN)
    return made


def excitation_report(
    content: Mapping[str, Any], folder: str = "OUT", made: Provenance | None = None, *_: Any
) -> Report:
    """What the recording is expected to tell, and what of the limits it uses."""
    error = content["response_error"]
    hold = ", ".join(
        f"{name} {number(gains['proportional'], 3)} N·m·s/rad and {number(gains['integral'], 3)} N·m/rad"
        for name, gains in content["speed_hold"].items()
    )
    rows = [
        {"quantity": component(own["name"]), "value": f"{number(own['value'])} {unit(own['unit'])}".rstrip(),
         "now known to": f"± {number(own['standard_uncertainty_before'], 2)}",
         "then to": f"± {number(own['standard_uncertainty_after'], 2)}"}
        for own in content["expected"][:NAMED]
    ]  # fmt: skip
    most, weak, longer = max(content["limits_used"], key=content["limits_used"].get), "", content["times_as_long"]
    if longer != 1:
        enough = "No excitation up to 100 times as long is enough. " if longer is None else (
            f"{number(longer, 2)} times as long ({number(longer * content['duration'], 2)} s), or torques "
            f"{number(longer**0.5, 2)} times as large, would do. "
        )  # fmt: skip
        weak = (
            f"The excitation is too weak: after the recording the bed is known to a response error of "
            f"{number(error['after'], 2)}, {number(error['allowed'], 2)} is allowed. {enough}"
        )
    return Report(
        title="Excitation",
        status="too weak" if weak else "planned",
        answer=f"{weak}{number(content['duration'], 3)} s about a rotor speed of {number(content['speed'], 3)} rad/s. "
        f"The uncertain quantities cause a response error "
        f"of {number(error['before'], 2)} now, and {number(error['after'], 2)} is expected after the recording.",
        lists={"What to do now": [
            Step(f"Hold the speed slowly: {hold}"),
            Step("Add the torques of excitation.csv, emulation off; record the torque commands and every sensor of the "
                 "rig as recording.csv"),
            Step("Identify the bed from it",
                 command=f"rigmatch identify {_case_of(made)} --bed recording.csv --out identify"),
        ]},
        table=Table(rows, FROM_NOISE),
        notes=[
            f"{content['beds']} beds drawn within [uncertainty] use at most "
            f"{100 * content['limits_used'][most]:.0f} % of one limit ({component(most)}); "
            f"asked for {100 * (1 - content['margin']):.0f} %",
            *content["notes"],
        ],
    )  # fmt: skip


def proof_report(content: Mapping[str, Any], folder: str = "OUT", made: Provenance | None = None, *_: Any) -> Report:
    """How long the proof lasts, and what it will tell; first of all whether it is too weak for that."""
    told, weak = [], []
    for error in content["expected"]:
        largest = COVERAGE_FACTOR * max(error["standard_uncertainties"])
        if not largest <= error["allowed"]:
            weak.append(f"the response error to {error['name']} torques will be known to ± {number(largest, 2)} only, "
                        f"{number(error['allowed'], 2)} is allowed")  # fmt: skip
        at = list(zip(error["errors"], error["standard_uncertainties"], strict=True))
        near = min(at, key=lambda pair: abs(pair[0] - error["allowed"]))
        told.append(
            f"response error to {error['name']} torques: {number(near[0], 2)} will be known to "
            f"± {number(COVERAGE_FACTOR * near[1], 2)}, and one above {number(COVERAGE_FACTOR * at[0][1], 2)} is told "
            f"from none ({number(error['allowed'], 2)} allowed; k = 2)"
        )
    for mode in content["modes"]:
        known = (mode["frequency_uncertainty"], mode["damping_uncertainty"])
        words = "will not show" if None in known else (
            f"± {number(COVERAGE_FACTOR * known[0], 2)} Hz, damping ratio ± {number(COVERAGE_FACTOR * known[1], 2)}"
        )  # fmt: skip
        told.append(f"vehicle mode {mode['vehicle_mode']}: {words}")
    most, case = max(content["limits_used"], key=content["limits_used"].get), _case_of(made)
    first = f"The excitation that the limits allow is too weak: {'; '.join(weak)}. " if weak else ""
    if weak:
        first += " ".join(f"{note}." for note in content["notes"] if "would do" in note) + " "
    return Report(
        title="Proof",
        status="too weak" if weak else "planned",
        answer=f"{first}{number(content['duration'], 3)} s: {content['periods']} periods of "
        f"{number(content['period'], 3)} s with the emulation on; torques "
        f"{', '.join(map(spaced, content['inputs']))}.",
        lists={
            "What to do now": [
                Step("Export the controller", command=f"rigmatch export {case} --controller controller.fmu"),
                Step(
                    "Emulation on, add the torques of excitation.csv; record these, the torque commands and every "
                    "sensor of the rig as recording.csv"
                ),
                Step("Judge the recording", command=f"rigmatch verify {case} recording.csv --out verify"),
            ]
        },
        folds=[Fold("What it will tell", [told], told=True)],
        notes=[
            f"at most {100 * content['limits_used'][most]:.0f} % of one limit is used ({component(most)})",
            "from the noise of the sensors alone: a bed that is not linear adds to it, and the verdict counts it",
            *content["notes"],
        ],
    )


register(FromRecordings, View(
    "identification.json", identification_report,
    _identified_pictures,
    others=lambda known: {name: text for name, text in known.files().items() if name != "identification.json"},
))  # fmt: skip
register(ExcitationPlan, View(
    "excite.json", excitation_report, lambda plan: {"excitation": Picture(lambda: excitation(plan), EXCITATION)},
    others=lambda plan: {"excitation.csv": excitation_csv(plan)},
))  # fmt: skip
register(Proof, View(
    "proof.json", proof_report, lambda proof: {"excitation": Picture(lambda: proof_figure(proof), PROOF)},
    others=lambda proof: {"excitation.csv": proof_csv(proof)},
))  # fmt: skip


def channel_plan_report(
    content: Mapping[str, Any], folder: str = "OUT", made: Provenance | None = None, *_: Any
) -> Report:
    """What moves the bed while its channels are checked."""
    rows = [{"torque": spaced(name), "largest": f"{number(size, 3)} N·m"}
            for name, size in content["largest_torques"].items()]  # fmt: skip
    return Report(
        title="Check of the channels",
        status="planned",
        answer=f"{number(content['duration'], 3)} s from rest; no reading is fed back. Rotors turn at most at "
        f"{number(content['largest_speed'], 2)} rad/s.",
        lists={"What to do now": [
            Step("At rest, run the controller in mode 3 with the torques of channels.csv as added torques and demands"),
            Step("Record the torque commands and every sensor of the rig as recording.csv, then judge it",
                 command=f"rigmatch verify {_case_of(made)} recording.csv --channel-check --out channels"),
        ]},
        table=Table(rows, ""),
    )  # fmt: skip


def channel_check_report(
    content: Mapping[str, Any], folder: str = "OUT", made: Provenance | None = None, *_: Any
) -> Report:
    """Every channel with what is wrong of it."""
    case = _case_of(made)
    steps = wrong_channel_steps(
        content, f"rigmatch verify {case} again.csv --channel-check --out {quote(folder)}",
        f"rigmatch commission {case} --bed recordings --skip-channel-check --out commission",
        f"rigmatch excite {case} --channel-check --torque-share 0.3 --out channels",
    )  # fmt: skip
    return Report(
        title="Channels",
        status="right" if content["right"] else "wrong channel" if content["wrong"] else "ended early",
        answer=_sentence(content["sentence"]),
        good=content["right"],
        lists={} if content["right"] else {"What to do now": steps},
        table=channel_table(content),
        notes=[f"{spaced(one)} and {spaced(other)} answer alike: nothing tells whether they are exchanged"
               for one, other in content["alike"]],
    )  # fmt: skip


register(ChannelPlan, View(
    "channels_plan.json", channel_plan_report,
    lambda plan: {"torques": Picture(lambda: torques_figure(plan.inputs, plan.torques, plan.step), PULSES)},
    others=lambda plan: {"channels.csv": plan.csv()},
))  # fmt: skip
register(ChannelCheck, View(
    "channels.json", channel_check_report, lambda found: wrong_channel_pictures(found.to_dict())
))  # fmt: skip
