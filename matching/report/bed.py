"""Views of a planned excitation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.bed.commission import Commissioning
from matching.bed.excite import ExcitationPlan, excitation_csv
from matching.bed.identify import FromRecordings
from matching.bed.proof import Proof, proof_csv
from matching.bed.verify import COVERAGE_FACTOR, BedVerification, FunctionCurves
from matching.report.common import (
    BAND,
    MATCHED,
    NOISE,
    RIG,
    VEHICLE,
    Provenance,
    ScreenPoint,
    csv_table,
    curve,
    embedded,
    environment,
    figure,
    image,
    in_address,
    number,
    plain_ticks,
    spaced,
    styled,
    unit,
)
from matching.report.curves import acting
from modelling import display

# --- The curves of a verification's figure as a table (CSV), to be calculated with.


def curve_data(curves: Sequence[FunctionCurves]) -> str:
    """A row per frequency: moduli and phases of vehicle, prediction and bed, and what the bed's modulus is known to.

    Functions may have frequencies of their own: the table has all of them, and no value where a function has none.
    """
    frequencies = np.unique(np.concatenate([curve.frequencies for curve in curves])) if curves else np.empty(0)
    head, columns = ["frequency [Hz]"], [frequencies]
    for curve in curves:
        row = np.searchsorted(frequencies, curve.frequencies)
        per = f"{unit(curve.unit)} per N·m"
        for who in ("vehicle", "predicted", "measured"):
            values, name = getattr(curve, who), f"{curve.sensor} / {curve.input}, {who}"
            head += [f"{name}, modulus [{per}]", f"{name}, phase [deg]"]
            columns += [
                _placed(np.abs(values), row, frequencies),
                _placed(np.degrees(np.angle(values)), row, frequencies),
            ]
        head.append(f"{curve.sensor} / {curve.input}, expanded uncertainty (k = {COVERAGE_FACTOR:g}) [{per}]")
        columns.append(_placed(COVERAGE_FACTOR * curve.uncertainty, row, frequencies))
    return csv_table(head, ([_known(value) for value in row] for row in zip(*columns, strict=True)))


def _placed(values: np.ndarray, row: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    placed = np.full(len(frequencies), np.nan)
    placed[row] = values
    return placed


def _known(value: Any) -> Any:
    return value if np.isfinite(value) else None


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
    ax.loglog(
        f[known],
        measured[known],
        "o",
        markersize=4,
        color=NOISE,
        alpha=0.5,
        markeredgewidth=0,
        zorder=1.5,
        label="measured on the bed",
    )
    ax.set_xlim(f[0], f[-1])
    plain_ticks(ax.xaxis)
    ax.set_title(f"{spaced(curve.input)} → {spaced(curve.sensor)}", fontsize=8)
    ax.set_ylabel(f"{unit(curve.unit)} per N·m")


# --- The verification of a bed in words.

VERDICT_MEANING = {
    "as_predicted": "The bed answers as the match predicted, within what was measured and what the case states as "
    "uncertain, and no worse than the case allows.",
    "short": "The bed falls short of the prediction by more than the uncertainty of the measurement.",
    "undetermined": "The recordings do not decide it: record longer, or excite the bed more.",
}


def answer(result: Mapping[str, Any]) -> str:
    """The answer in one sentence, with what is short or open."""
    parts = [VERDICT_MEANING[result["status"]]]
    for status, words in (("short", "Short"), ("undetermined", "Open")):
        names = [f"{error['name']} torques" for error in result["errors"] if error["status"] == status]
        names += [f"vehicle mode {mode['vehicle_mode']}" for mode in result["modes"] if mode["status"] == status]
        if names:
            parts.append(f"{words}: {', '.join(names)}.")
    return " ".join(parts)


def with_uncertainty(value: float | None, standard: float | None, digits: int = 3) -> str:
    """A value with its expanded uncertainty, k = 2."""
    if value is None or standard is None:
        return "not determined"
    return f"{number(value, digits)} ± {number(2 * standard, 2)}"


def verification_summary(result: Mapping[str, Any]) -> str:
    """At most twenty lines for a terminal."""
    lines = [f"{result['status']}: {answer(result)}"]
    for error in result["errors"]:
        lines.append(f"response error to {error['name']} torques: {error_words(error)}: {error['status']}")
    for mode in result["modes"]:
        lines.append(f"vehicle mode {mode['vehicle_mode']}: {mode_words(mode)}: {mode['status']}")
    for fidelity in result["fidelity"]:
        lines.append(
            f"R_XiL of {fidelity['recording']}: {with_uncertainty(fidelity['R_XiL'], fidelity['standard_uncertainty'])}"
        )
    lines += [f"why: {sentence}" for sentence in why(result)]
    lines.append(f"uncertainties: k = {number(result['coverage_factor'])}, about 95 %")
    return "\n".join(lines + [f"note: {note}" for note in result["notes"]])


def error_words(error: Mapping[str, Any]) -> str:
    """A measured response error beside what it is judged by."""
    measured = with_uncertainty(error["error"], error["standard_uncertainty"])
    predicted, expected, allowed = (number(error[key], 3) for key in ("predicted", "expected", "allowed"))
    return f"{measured} (predicted {predicted}, on 95 % of drawn beds below {expected}, allowed {allowed})"


def why(result: Mapping[str, Any]) -> list[str]:
    """What a diagnosis of the recordings says, where the bed falls short."""
    return list((result.get("diagnosis") or {}).get("sentences", ()))


def interim(result: Mapping[str, Any]) -> str:
    """One line on what a recording shows that is still being written."""
    errors = [
        f"{error['name']} torques {with_uncertainty(error['error'], error['standard_uncertainty'])}"
        for error in result["errors"]
    ]
    return f"so far {result['status']}: response error to {', '.join(errors)}"


def mode_words(mode: Mapping[str, Any]) -> str:
    """Frequency and damping ratio of vehicle, prediction and bed."""
    parts = [f"vehicle {_pair(mode['vehicle'])}", f"predicted {_pair(mode['predicted'])}"]
    measured = mode["measured"]
    if measured is None:
        return ", ".join([*parts, "measured: does not show"])
    return ", ".join(
        [
            *parts,
            f"measured {with_uncertainty(measured['frequency'], measured['frequency_uncertainty'], 4)} Hz, "
            f"damping ratio {with_uncertainty(measured['damping_ratio'], measured['damping_uncertainty'])}",
        ]
    )


def _pair(values: Mapping[str, float] | None) -> str:
    if values is None:
        return "does not show"
    return f"{number(values['frequency'], 4)} Hz, {number(values['damping_ratio'], 3)}"


def verification_steps(
    result: Mapping[str, Any], case: str, folder: str, *, commissioned: bool = False
) -> list[ScreenPoint]:
    """What to do after a verification, with its command."""
    if result["status"] == "as_predicted":
        return [
            ScreenPoint("Drive the manoeuvres: the bed answers like the vehicle as far as the match promised"),
            ScreenPoint("Repeat the proof after every change of specimen, adapter or loop",
                        command=f"rigmatch verify {case} RECORDING --out {folder}"),
        ]  # fmt: skip
    if result["status"] == "short":
        return [
            ScreenPoint("Find what differs from the model, and match again with it",
                        "it records the bed without emulation, diagnoses it and matches with what it found",
                        command=f"rigmatch commission {case} --bed FOLDER --out commission"),
        ] if not commissioned else []  # fmt: skip
    longer = []
    for error in result["errors"]:
        if error["status"] == "undetermined" and error["interval"]:
            limit = max(error["allowed"], error["predicted"])
            far = max(abs(error["error"] - limit), 0.1 * limit)
            times = (2 * error["standard_uncertainty"] / far) ** 2
            longer.append(
                f"{error['name']} torques: {number(max(times, 1.5), 2)} times as long decides it, as far as noise does"
            )
    hidden = [f"vehicle mode {mode['vehicle_mode']}" for mode in result["modes"] if mode["status"] == "undetermined"]
    why = "; ".join([*longer, *(f"{name} is open" for name in hidden)])
    return [
        ScreenPoint("Record again, longer or with larger torques: the proof plans them for this case", why,
                    command=f"rigmatch excite {case} --proof --out proof"),
        ScreenPoint("Judge it together with what there is", command=f"rigmatch verify {case} OLD NEW --out {folder}"),
    ]  # fmt: skip


# --- The report of a bed's verification: one HTML page that opens anywhere, without network.

CAPTIONS = {
    "responses": "Compared functions over frequency, modulus: the vehicle, the prediction for the bed with its "
    "controller, and what the recordings show with about 95 % uncertainty."
}


def verification_page(
    result: Mapping[str, Any],
    images: Mapping[str, bytes],
    moving: Mapping[str, str] | None = None,
    made: Provenance | None = None,
    data: Mapping[str, str] | None = None,
    steps: Sequence[ScreenPoint] = (),
) -> str:
    """The page as HTML.

    Parameters
    ----------
    result : mapping
        The content of ``verification.json``.
    images : mapping of str to bytes
        The figure ``responses``.
    moving : mapping of str to str, optional
        The same figure to act in the browser, as :func:`matching.report.curves.acting` has it.
    made : Provenance, optional
        Where the result comes from.
    data : mapping of str to str, optional
        Curves of the same figure (CSV).
    steps : sequence of ScreenPoint
        What to do now.
    """
    values = {
        "title": f"Bed against vehicle: {result['title']}" if result["title"] else "Bed against vehicle",
        "status": result["status"],
        "answer": answer(result),
        "band": result["band"],
        "errors": [_row(error) for error in result["errors"]],
        "functions": [_row(function) for function in result["functions"]],
        "modes": [_mode(mode) for mode in result["modes"]],
        "fidelity": [
            {**fidelity, "total": with_uncertainty(fidelity["R_XiL"], fidelity["standard_uncertainty"])}
            for fidelity in result["fidelity"]
        ],
        "notes": result["notes"],
        "diagnosis": why(result),
        "figures": {name: embedded(content) for name, content in images.items()},
        "captions": CAPTIONS,
        "moving": moving or {},
        "data": {name: in_address(text, "text/csv") for name, text in (data or {}).items()},
        "made": made,
        "steps_now": steps,
    }
    return environment().get_template("bed_test.html").render(values)


def _mode(mode: Mapping[str, Any]) -> dict[str, Any]:
    row, bed = {**mode, "number": mode["vehicle_mode"]}, mode["measured"]
    if bed is not None:
        row["frequency"] = with_uncertainty(bed["frequency"], bed["frequency_uncertainty"], 4)
        row["damping"] = with_uncertainty(bed["damping_ratio"], bed["damping_uncertainty"])
    return row


def _row(error: Mapping[str, Any]) -> dict[str, Any]:
    return {**error, "value": with_uncertainty(error["error"], error["standard_uncertainty"])}


# --- Views of a bed's verification.


def _paragraphs(text: str) -> str:
    """A paragraph a line."""
    template = environment().from_string("{% for line in lines %}<p>{{ line }}</p>{% endfor %}")
    return template.render(lines=text.splitlines())


@display.plot.register
def _(verification: BedVerification) -> Figure:
    return responses(verification)


@display.files.register
def verification_files(
    verification: BedVerification, folder: str, made: Provenance | None = None, case: str = "CASE",
    diagnosis: Mapping[str, Any] | None = None,
) -> display.ResultFiles:  # fmt: skip
    """``verification.json``, report and figure; why the bed is short, and the case for the commands of the page."""
    result, figure = {**verification.to_dict(), "diagnosis": diagnosis}, responses(verification)
    images, data = {"responses": image(figure)}, {"responses": curve_data(verification.curves)}
    steps = verification_steps(result, case, folder)
    report = verification_page(result, images, acting({"responses": figure}), made, data, steps)
    return "verification.json", result, {"report.html": report, "figures/responses.svg": images["responses"]}


@display.text.register
def _(verification: BedVerification) -> str:
    return verification_summary(verification.to_dict())


@display.html.register
def _(verification: BedVerification) -> str:
    return _paragraphs(verification_summary(verification.to_dict()))


# --- A commissioning in words.

END_MEANING = {
    "as_predicted": "The bed answers as the last match predicted, within what the case states as uncertain.",
    "short": "The bed falls short of what the last match predicted.",
    "undetermined": "The recordings do not decide whether the bed answers as predicted.",
    "waiting": "A recording is waited for.",
}


def commissioning_summary(result: Mapping[str, Any]) -> str:
    """The answer, then a few lines a round."""
    lines = [f"{result['status']}: {END_MEANING[result['status']]}", *ending(result)]
    if result.get("vehicle"):
        lines += [f"vehicle: {line}" for line in identification_lines(result["vehicle"])]
    for entry in result["rounds"]:
        lines += [f"round {entry['round']}: {line}" for line in round_lines(entry)]
    if result["waiting_for"]:
        lines.append(f"next: {result['waiting_for']}")
    return "\n".join(lines)


def ending(result: Mapping[str, Any]) -> list[str]:
    """Why the circle ended, and which controller to use, a sentence each."""
    lines = []
    if result["end"]:
        lines.append(f"It ended with round {result['rounds'][-1]['round']}: {result['end']}.")
    elif result["status"] in ("short", "undetermined", "as_predicted"):
        lines.append("It ended with the last round that was asked for; a further one may gain.")
    if result["best_round"]:
        lines.append(f"The controller with the least error on the bed: {result['best_round']}_export/controller.fmu.")
    return lines


def identification_summary(result: Mapping[str, Any]) -> str:
    """What the recordings say, a few lines each."""
    parts = {name: result[name] for name in ("bed", "vehicle") if result[name] is not None}
    return "\n".join(f"{name}: {line}" for name, part in parts.items() for line in identification_lines(part))


def identification_lines(identification: Mapping[str, Any]) -> list[str]:
    """What a diagnosis found, a sentence each."""
    causes = ", ".join(f"{cause['kind']} at {cause['at']}" for cause in identification["causes"]) or "no further cause"
    moved = sorted(
        identification["values"],
        key=lambda value: -abs(value["after"] / value["before"] - 1) if value["before"] else 0,
    )
    pairs = [f"{value['name']} {number(value['before'], 4)} → {number(value['after'], 4)}" for value in moved[:4]]
    return [
        f"diagnosis {identification['verdict']}: {causes}", f"moved most: {', '.join(pairs)}", *identification["notes"],
    ]  # fmt: skip


def round_lines(entry: Mapping[str, Any]) -> list[str]:
    """What a round found, a sentence each."""
    lines = identification_lines(entry["identification"]) if "identification" in entry else []
    if "match" in entry:
        lines.append(f"match {entry['match']['status']}")
    if "verification" in entry:
        proof = entry["verification"]
        for error in proof["errors"]:
            lines.append(f"{spaced(proof['status'])}: response error to {error['name']} torques {error_words(error)}")
        lines += [f"not judged: {note}" for note in proof["notes"] if "left out" in note]
        lines += _fidelity(proof, "")
    if "against_last_vehicle" in entry:
        same = entry["against_last_vehicle"]
        for error in same["errors"]:
            measured = with_uncertainty(error["error"], error["standard_uncertainty"])
            lines.append(f"against the last round's vehicle: response error to {error['name']} torques {measured}")
        lines += _fidelity(same, " against the last round's vehicle")
    return lines


def _fidelity(judged: Mapping[str, Any], against: str) -> list[str]:
    return [
        f"R_XiL{against} {with_uncertainty(fidelity['R_XiL'], fidelity['standard_uncertainty'])}"
        for fidelity in judged["fidelity"]
    ]


# --- The page of a commissioning: the circle with what each round gained.


def commissioning_figures(result: Commissioning) -> dict[str, Figure]:
    """The bed's responses of the last round, and the error of every round where there are two."""
    figures = {} if result.last is None else {"responses": responses(result.last)}
    content = result.to_dict()
    return figures | ({"rounds": rounds_figure(content)} if len(round_errors(content)) > 1 else {})


def next_steps(result: Mapping[str, Any], case: str, folder: str) -> list[ScreenPoint]:
    """What to do after a commissioning, with its command."""
    again = f"rigmatch commission {case} --bed BED --out {folder}"
    if result["waiting_for"]:
        return [ScreenPoint(f"Record: {result['waiting_for']}"), ScreenPoint("Go on", command=again)]
    best = result["best_round"]
    judged = {entry["round"]: entry.get("verification") for entry in result["rounds"]}
    points = [ScreenPoint(f"Use the controller of round {best}", f"it has the least error on the bed: "
                          f"{best}_export/controller.fmu")] if best else []  # fmt: skip
    last = next((proof for _, proof in sorted(judged.items(), reverse=True) if proof), None)
    if last:
        points += verification_steps(last, f"{folder}/{max(judged)}_match", folder, commissioned=True)
    if result["end"] is None:
        points.append(ScreenPoint("Allow a further round: it may gain", command=f"{again} --rounds {len(judged) + 1}"))
    return points


def commissioning_page(
    result: Mapping[str, Any],
    made: Provenance | None = None,
    images: Mapping[str, bytes] | None = None,
    moving: Mapping[str, str] | None = None,
    steps: Sequence[ScreenPoint] = (),
) -> str:
    """The content of ``commission.json`` as HTML, where it comes from, its figures and what to do next."""
    rounds = [
        {
            "id": f"round-{entry['round']}", "title": f"Round {entry['round']}", "lines": round_lines(entry),
            "values": entry.get("identification", {}).get("values"),
        }
        for entry in result["rounds"]
    ]  # fmt: skip
    if result.get("vehicle"):
        lines = identification_lines(result["vehicle"])
        values = result["vehicle"]["values"]
        rounds.insert(0, {"id": "vehicle", "title": "Vehicle on the road", "lines": lines, "values": values})
    return (
        environment()
        .get_template("commission.html")
        .render(
            title="Commissioning", status=result["status"], answer=END_MEANING[result["status"]], rounds=rounds,
            ending=ending(result), gain=gain(result), made=made, moving=moving or {}, steps_now=steps,
            figures={name: embedded(content) for name, content in (images or {}).items()},
            captions=CAPTIONS | {"rounds": "Measured response error of each round, against the last round's vehicle."},
        )
    )  # fmt: skip


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


# --- Views of a commissioning.


@display.plot.register
def _(result: Commissioning) -> Figure:
    return rounds_figure(result.to_dict())


@display.files.register
def commissioning_files(
    result: Commissioning, folder: str, made: Provenance | None = None, case: str = "CASE"
) -> display.ResultFiles:
    """``commission.json`` and report; the folders of the rounds stay where they are."""
    entries, figures = result.to_dict(), commissioning_figures(result)
    images = {name: image(drawn) for name, drawn in figures.items()}
    steps = next_steps(entries, case, folder)
    return (
        "commission.json",
        entries,
        {"report.html": commissioning_page(entries, made, images, acting(figures) if figures else {}, steps)},
    )


@display.text.register
def _(result: Commissioning) -> str:
    return commissioning_summary(result.to_dict())


@display.html.register
def _(result: Commissioning) -> str:
    return _paragraphs(commissioning_summary(result.to_dict()))


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
            ax.plot(plan.time, plan.torques[:, j], linewidth=0.6, rasterized=True, **look)
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
        ax.set_yticks(rows, [spaced(quantity.name) for quantity in expected])
        ax.invert_yaxis()
        ax.set_xlabel("part of the response error")
        fig.legend(loc="outside lower center", ncols=2)
    return fig


# --- A planned excitation in words.

NAMED = 8  # quantities in a summary


def excitation_summary(result: Mapping[str, Any]) -> str:
    """What the recording is expected to tell, and what of the limits it uses."""
    if "period" in result:
        return proof_summary(result)
    error = result["response_error"]
    hold = ", ".join(
        f"{name} {number(gains['proportional'], 3)} N·m·s/rad and {number(gains['integral'], 3)} N·m/rad"
        for name, gains in result["speed_hold"].items()
    )
    lines = [
        f"excitation of {number(result['duration'], 3)} s about a rotor speed of {number(result['speed'], 3)} rad/s",
        f"hold the speed slowly beside it: {hold}",
        f"response error from what is not known: {number(error['before'], 2)} now, "
        f"{number(error['after'], 2)} expected with what the recording tells",
    ]
    for quantity in result["expected"][:NAMED]:
        before, after = (number(quantity[f"standard_uncertainty_{when}"], 2) for when in ("before", "after"))
        line = f"{quantity['name']}: {number(quantity['value'], 4)} ± {after} {unit(quantity['unit'])}".rstrip()
        lines.append(f"{line} (known to ± {before})")
    most = max(result["limits_used"], key=result["limits_used"].get)
    lines.append(
        f"limits: {result['beds']} beds within what is not known use at most {result['limits_used'][most]:.0%} of one "
        f"({most}); asked for {1 - result['margin']:.0%}"
    )
    lines.append("± is a standard uncertainty (k = 1) from sensor noise alone: a model that lacks something adds to it")
    return "\n".join(lines + [f"note: {note}" for note in result["notes"]])


def proof_summary(result: Mapping[str, Any]) -> str:
    """How long the proof lasts, and what it will tell."""
    lines = [
        f"proof of {number(result['duration'], 3)} s: {result['periods']} periods of {number(result['period'], 3)} s, "
        f"emulation on, torques {', '.join(result['inputs'])}"
    ]
    for error in result["expected"]:
        at = list(zip(error["errors"], error["standard_uncertainties"], strict=True))
        near = min(at, key=lambda pair: abs(pair[0] - error["allowed"]))
        lines.append(
            f"response error to {error['name']} torques: {number(near[0], 2)} will be known to "
            f"± {number(COVERAGE_FACTOR * near[1], 2)}, and one above {number(COVERAGE_FACTOR * at[0][1], 2)} is told "
            f"from none ({number(error['allowed'], 2)} allowed; k = 2)"
        )
    for mode in result["modes"]:
        known = (mode["frequency_uncertainty"], mode["damping_uncertainty"])
        told = "will not show" if None in known else (
            f"± {number(COVERAGE_FACTOR * known[0], 2)} Hz, damping ratio ± {number(COVERAGE_FACTOR * known[1], 2)}"
        )  # fmt: skip
        lines.append(f"vehicle mode {mode['vehicle_mode']}: {told}")
    most = max(result["limits_used"], key=result["limits_used"].get)
    lines.append(f"limits: at most {result['limits_used'][most]:.0%} of one ({most})")
    lines.append("from the noise of the sensors alone: a bed that is not linear adds to it, and the verdict counts it")
    return "\n".join(lines + [f"note: {note}" for note in result["notes"]])


# --- View


@display.plot.register
def _(plan: ExcitationPlan) -> Figure:
    return excitation(plan)


@display.files.register
def _(plan: ExcitationPlan, folder: str, made: Any = None) -> display.ResultFiles:
    return "excite.json", plan.to_dict(), {
        "excitation.csv": excitation_csv(plan), "figures/excitation.svg": image(excitation(plan)),
    }  # fmt: skip


@display.files.register
def _(proof: Proof, folder: str, made: Any = None) -> display.ResultFiles:
    return "proof.json", proof.to_dict(), {"excitation.csv": proof_csv(proof)}


@display.text.register
def _(known: FromRecordings) -> str:
    return identification_summary(known.to_dict())


@display.html.register
def _(known: FromRecordings) -> str:
    return _paragraphs(identification_summary(known.to_dict()))


@display.files.register
def _(known: FromRecordings, folder: str, made: Any = None) -> display.ResultFiles:
    name = "identification.json"
    return name, known.to_dict(), {file: text for file, text in known.files().items() if file != name}


@display.text.register
def _(proof: Proof) -> str:
    return proof_summary(proof.to_dict())


@display.html.register
def _(proof: Proof) -> str:
    return _paragraphs(proof_summary(proof.to_dict()))


@display.text.register
def _(plan: ExcitationPlan) -> str:
    return excitation_summary(plan.to_dict())


@display.html.register
def _(plan: ExcitationPlan) -> str:
    return _paragraphs(excitation_summary(plan.to_dict()))
