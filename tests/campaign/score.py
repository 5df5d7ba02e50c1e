"""What a campaign's answers are worth: confusion, false alarms, reliability and coverage."""

import datetime
import json
from pathlib import Path
from typing import Any

import numpy as np


def where(cause: dict[str, Any]) -> str:
    """The place of a named cause; of a shared one as the truth plant writes it."""
    return cause["at"] if isinstance(cause["at"], str) else "+".join(cause["at"])


def right(row: dict[str, Any]) -> bool:
    """Whether the first cause is the hidden one, or one that the recording cannot tell from it."""
    causes, answer = row["found"]["causes"], row["answer"]
    if not causes:
        return False
    return matches(causes[0], answer)


def matches(cause: dict[str, Any], answer: dict[str, Any]) -> bool:
    """Whether a named cause is a hidden one or equivalent to it."""
    good = {(answer["kind"], answer["at"])} | {(one["kind"], one["at"]) for one in answer.get("equivalent_causes", [])}
    good |= {(answer["kind"], at) for at in answer.get("equivalent", [])}
    return (cause["kind"], where(cause)) in good


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures of a campaign; shares with the number of recordings behind them."""
    made = [row for row in rows if "found" in row]

    def of(category: str, *sizes: Any) -> list[dict[str, Any]]:
        own = [row for row in made if row["order"]["category"] == category]
        return [row for row in own if not sizes or row["order"]["size"] in sizes]

    def share(flags: list[bool]) -> dict[str, Any]:
        return {"share": float(np.mean(flags)) if flags else None, "of": len(flags)}

    def quiet(row: dict[str, Any]) -> bool:
        sure = [cause["confidence"] for cause in row["found"]["causes"]]
        return row["found"]["verdict"] == "unexplained" or max(sure, default=1.0) < 0.5

    single, clean, double, outside = (of(name) for name in ("single", "clean", "double", "outside"))
    return {
        "recordings": len(rows),
        "failed": [row["failed"] for row in rows if "failed" in row],
        "plain_right_first": share([right(row) for row in of("single", "plain")]),
        "subtle_right_first": share([right(row) for row in of("single", "subtle")]),
        "false_alarms": share([bool(row["found"]["causes"]) for row in clean]),
        "clean_adequate": share([row["found"]["verdict"] == "adequate" for row in clean]),
        "outside_told": share([quiet(row) for row in outside]),
        "both_found": share([both(row) for row in double]),
        "sure_and_right": share([flag for p, flag in confidences(made) if p >= 0.9]),
        "coverage_causes": share(covered(single, causes=True)),
        "coverage_base": share(covered([row for row in single if right(row)], causes=False)),
        "held_out_within_1.1": share([within(row) for row in single if right(row)]),
        "explained_when_right": share([row["found"]["verdict"] == "explained" for row in single if right(row)]),
        "seconds": {"median": median(made), "most": max((row["seconds"] for row in made), default=None)},
    }


def median(rows: list[dict[str, Any]]) -> float | None:
    return float(np.median([row["seconds"] for row in rows])) if rows else None


def both(row: dict[str, Any]) -> bool:
    """Whether both hidden causes are among the named ones, or others that the recording cannot tell from them."""
    named, hidden = row["found"]["causes"], row["answer"]["causes"]
    return len(named) >= len(hidden) and all(any(matches(cause, one) for cause in named) for one in hidden)


def confidences(rows: list[dict[str, Any]]) -> list[tuple[float, bool]]:
    """Confidence of every named cause, and whether it is right."""
    out = []
    for row in rows:
        hidden = (
            {(one["kind"], one["at"]) for one in row["answer"]["causes"]} if not row["answer"]["outside"] else set()
        )
        for cause in row["found"]["causes"]:
            good = (cause["kind"], where(cause)) in hidden
            if row["order"]["category"] == "single":
                good |= matches(cause, row["answer"])
            out.append((cause["confidence"], good))
    return out


def deviations(rows: list[dict[str, Any]], causes: bool) -> list[float]:
    """Errors of estimates in their standard uncertainties: parameters of causes named right, or of the base model.

    A ripple's phase is left out: without an angle sensor the angle it counts from is a convention. So are base
    parameters that are told to be unidentifiable or at a bound.
    """
    out = []
    for row in rows:
        if causes:
            first = row["found"]["causes"][0] if row["found"]["causes"] else None
            if first and (first["kind"], where(first)) == (row["answer"]["kind"], row["answer"]["at"]):
                truths = row["answer"]["parameters"]
                pairs = [(own, truths.get(key)) for key, own in first["parameters"].items() if key != "phase"]
            else:
                pairs = []
        else:
            pairs = [(own, row["answer"]["base"].get(key)) for key, own in row["found"]["parameters"].items()]
        for own, truth in pairs:
            if truth is not None and own["standard_uncertainty"] and not own.get("note"):
                out.append((own["value"] - truth) / own["standard_uncertainty"])
    return out


def covered(rows: list[dict[str, Any]], causes: bool) -> list[bool]:
    """Whether 95 % intervals cover the truth."""
    return [abs(own) <= 1.96 for own in deviations(rows, causes)]


def within(row: dict[str, Any]) -> bool:
    """Whether every sensor's held-out error is within 1.1 times the noise."""
    return all((one["after_holdout"] or 0.0) <= 1.1 * one["noise"] for one in row["found"]["errors"].values())


def confusion(rows: list[dict[str, Any]]) -> tuple[list[str], list[str], np.ndarray]:
    """Counts (hidden, named) over single and clean recordings and those with effects outside the vocabulary."""
    cells: dict[tuple[str, str], int] = {}
    for row in rows:
        if "found" not in row or row["order"]["category"] == "double":
            continue
        hidden = row["order"]["effects"][0] if row["order"]["effects"] else "nothing"
        if row["order"]["category"] == "outside":
            hidden = "outside: " + hidden
        causes = row["found"]["causes"]
        named = causes[0]["kind"] if causes else row["found"]["verdict"]
        if causes and row["found"]["verdict"] == "unexplained" and row["order"]["category"] == "outside":
            named = "unexplained"
        if named == "lag":
            named = ("input" if where(causes[0]).startswith("inputs") else "sensor") + "_lag"
        if row["order"]["category"] == "single" and causes and named == hidden and not right(row):
            named = "right kind, wrong place"
        cells[hidden, named] = cells.get((hidden, named), 0) + 1
    rows_ = sorted({h for h, _ in cells}, key=lambda h: (h.startswith("outside"), h == "nothing", h))
    order = [h for h in rows_ if not h.startswith("outside") and h != "nothing"]
    columns = order + sorted({n for _, n in cells} - set(order))
    return rows_, columns, np.array([[cells.get((h, n), 0) for n in columns] for h in rows_])


CRITERIA: list[tuple[str, str, float, float]] = [
    ("plain_right_first", "plain: kind and place right first", 0.95, 1.0),
    ("subtle_right_first", "subtle: kind and place right first", 0.8, 1.0),
    ("false_alarms", "false alarms on clean recordings", 0.0, 0.02),
    ("outside_told", "outside the vocabulary: unexplained or confidence < 0.5", 0.9, 1.0),
    ("both_found", "both of two found", 0.8, 1.0),
    ("sure_and_right", "right, of causes given with confidence ≥ 0.9", 0.9, 1.0),
    ("coverage_causes", "95 % intervals cover: parameters of causes", 0.9, 0.99),
    ("coverage_base", "95 % intervals cover: base parameters", 0.9, 0.99),
    ("held_out_within_1.1", "right and held-out error ≤ 1.1 × noise in all sensors", 0.9, 1.0),
]


def judged(figures: dict[str, Any]) -> list[tuple[str, str, str, bool | None]]:
    """Each criterion in words: what, how it came out, what is asked for, whether it is met."""
    out = []
    for key, words, low, high in CRITERIA:
        one = figures[key]
        asked = f"≥ {low:.0%}" if high == 1 else f"≤ {high:.0%}" if low == 0 else f"{low:.0%}–{high:.0%}"
        if one["share"] is None:
            out.append((words, "none yet", asked, None))
        else:
            got = f"{one['share']:.1%} of {one['of']}"
            out.append((words, got, asked, bool(low <= one["share"] <= high)))
    return out


def report(rows: list[dict[str, Any]], out: Path, seed: int, planned: int, seconds: float, commit: str) -> None:
    """Write ``results.json`` and ``campaign.png``, and print the criteria."""
    from tests.campaign.picture import picture

    told = {"seed": seed, "date": datetime.date.today().isoformat(), "commit": commit}
    told |= {"planned": planned, "seconds_each": seconds}
    figures = told | summary(rows)
    hidden, named, counts = confusion(rows)
    figures["confusion"] = {h: {n: int(c) for n, c in zip(named, own, strict=True) if c} for h, own in
                            zip(hidden, counts, strict=True)}  # fmt: skip
    (out / "results.json").write_text(json.dumps(figures, indent=1, ensure_ascii=False) + "\n")
    picture(rows, figures, out / "campaign.png")
    print(f"{len(rows)} of {planned} recordings, seed {seed}, {figures['date']}")
    for words, got, asked, met in judged(figures):
        print(f"{'' if met is None else 'met ' if met else 'NOT '}\t{got:>16}\t{asked:>8}\t{words}")
    for line in figures["failed"]:
        print("failed:", line)
