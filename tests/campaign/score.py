"""What a campaign's answers are worth: right, false, sure of it, covered."""

from typing import Any

SINGLE = ("plain", "subtle", "wrong_plain", "wrong_subtle", "wrong_noise", "slow")  # one effect is hidden
ALARM = 0.5  # confidence from which a cause outside the vocabulary is an alarm
SURE = 0.9
BEYOND_CHANCE = 1.02  # ratio of pooled unseen errors
SAME_LAW = {"saturating_actuator": "saturation"}  # hidden as no kind of the vocabulary, which has the same law by now


def where(cause: dict[str, Any]) -> str:
    """The place of a named cause; of a shared one as the truth plant writes it."""
    return cause["at"] if isinstance(cause["at"], str) else "+".join(cause["at"])


def matches(cause: dict[str, Any], answer: dict[str, Any]) -> bool:
    """Whether a named cause is a hidden one or equivalent to it."""
    good = {(SAME_LAW.get(answer["kind"], answer["kind"]), answer["at"])}
    good |= {(one["kind"], one["at"]) for one in answer.get("equivalent_causes", [])}
    good |= {(answer["kind"], at) for at in answer.get("equivalent", [])}
    if answer["kind"] == "clock_offset" and answer["parameters"].get("offset", 0.0) > 0:
        good.add(("sensor_delay", answer["at"]))  # a logger that is late reads late
    return (cause["kind"], where(cause)) in good


def right(row: dict[str, Any]) -> bool:
    """Whether the first cause is the hidden one, or one that the recording cannot tell from it."""
    causes = row["found"]["causes"]
    return bool(causes) and matches(causes[0], row["answer"])


def hidden(cause: dict[str, Any], row: dict[str, Any]) -> bool:
    """Whether a named cause is one of those hidden in a recording or its background, or equivalent to one."""
    behind = {(SAME_LAW.get(kind, kind), at) for kind, at in row["answer"]["background"]}
    return (cause["kind"], where(cause)) in behind or any(matches(cause, one) for one in row["answer"]["causes"])


def all_found(row: dict[str, Any]) -> bool:
    """Whether every hidden cause is among the named ones, or another that the recording cannot tell from it."""
    named = row["found"]["causes"]
    return all(any(matches(cause, one) for cause in named) for one in row["answer"]["causes"])


def confidences(rows: list[dict[str, Any]]) -> list[tuple[float, bool]]:
    """Confidence of every named cause, and whether it is hidden and in the vocabulary."""
    return [
        (cause["confidence"], hidden(cause, row) and (not row["answer"]["outside"] or _has_law(row["answer"])))
        for row in rows
        for cause in row["found"]["causes"]
    ]


def _has_law(answer: dict[str, Any]) -> bool:
    """Whether the vocabulary has the law of an effect that was hidden as one of none."""
    return answer["kind"] in SAME_LAW


def component(place: str) -> set[str]:
    """The components that a place is of: inertias.body of inertias.body.J, both sensors of a shared cause."""
    return {".".join(one.split(".")[:2]) for one in place.split("+")}


def place_confidences(rows: list[dict[str, Any]]) -> list[tuple[float, bool]]:
    """Confidence in the place of every named cause, and whether something hidden is there, of whatever kind, or where
    the recording cannot tell it from there."""
    out = []
    for row in rows:
        there = [component(at) for _, at in row["answer"]["background"]]
        for one in row["answer"]["causes"]:
            there += [component(at) for at in (one["at"], *one.get("equivalent", []))]
            there += [component(same["at"]) for same in one.get("equivalent_causes", [])]
        for cause in row["found"]["causes"]:
            out.append((cause["there"], any(component(where(cause)) & own for own in there)))
    return out


def deviations(rows: list[dict[str, Any]]) -> list[float]:
    """Errors of the parameters of first causes named right, in their standard uncertainties.

    A ripple's phase is left out: without an angle sensor the angle it counts from is a convention.
    """
    out = []
    for row in rows:
        first, answer = (row["found"]["causes"] or [None])[0], row["answer"]
        if first and (first["kind"], where(first)) == (answer["kind"], answer["at"]):
            for key, own in first["parameters"].items():
                truth = answer["parameters"].get(key)
                if key != "phase" and truth is not None and own["standard_uncertainty"] and not own.get("note"):
                    out.append((own["value"] - truth) / own["standard_uncertainty"])
    return out


def table(every: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts by category: [good, of]."""
    made = [row for row in every if "found" in row]

    def of(category: str) -> list[dict[str, Any]]:
        return [row for row in made if row["answer"]["category"] == category]

    def counted(flags: list[bool]) -> list[int]:
        return [sum(flags), len(flags)]

    out: dict[str, Any] = {"failed": [f"{row['number']} {row['failed']}" for row in every if "failed" in row]}
    for category in SINGLE:
        out[f"{category}: right first"] = counted([right(row) for row in of(category)])
    loops = [row for row in made if row["answer"].get("closed_loop") and row["answer"]["category"] in SINGLE]
    out["closed loop among these: right first"] = counted([right(row) for row in loops])
    for category in ("two", "three"):
        out[f"{category}: all found"] = counted([all_found(row) for row in of(category)])
    for category in ("perfect", "wrong_clean"):
        named = [[cause for cause in row["found"]["causes"] if not hidden(cause, row)] for row in of(category)]
        out[f"{category}: any cause that is not there"] = counted([bool(causes) for causes in named])
    outside = [row for row in of("outside") if not _has_law(row["answer"])]
    sure = [max((c["confidence"] for c in row["found"]["causes"]), default=0.0) for row in outside]
    out[f"outside: confidence over {ALARM}"] = counted([one > ALARM for one in sure])
    caused = [row for row in made if row["found"]["causes"]]
    gains = [row["found"]["gain"] for row in caused]
    worse = [gain["nrmse_after"] > BEYOND_CHANCE * gain["nrmse_before"] for gain in gains]
    out["causes named, unseen error higher"] = counted(worse)
    intervals = deviations([row for row in made if not row["answer"]["background"]])
    out["95 % intervals cover"] = counted([abs(one) <= 1.96 for one in intervals])
    wrong = [one["confidence"] for row in caused for one in row["found"]["causes"] if not hidden(one, row)]
    out[f"wrong causes of confidence over {SURE}"] = counted([one > SURE for one in wrong])
    times = sorted(row["seconds"] for row in made)
    out["processor seconds: median, most, all"] = [times[len(times) // 2], times[-1], sum(times)] if times else None
    return out


def confusion(rows: list[dict[str, Any]]) -> tuple[list[str], list[str], list[list[int]]]:
    """Counts (hidden, named first) over recordings with one effect, none, or one outside the vocabulary."""
    cells: dict[tuple[str, str], int] = {}
    for row in rows:
        answer, causes = row["answer"], row["found"]["causes"]
        if answer["category"] in ("two", "three"):
            continue
        truth = _kind(answer["causes"][0]) if answer["causes"] else "nothing"
        if answer["category"] == "outside":
            truth = "outside: " + truth
        named = _kind(causes[0]) if causes else row["found"]["verdict"]
        if causes and named == truth and not right(row):
            named = "right kind, wrong place"
        cells[truth, named] = cells.get((truth, named), 0) + 1
    truths = sorted({h for h, _ in cells}, key=lambda h: (h.startswith("outside"), h == "nothing", h))
    columns = [h for h in truths if not h.startswith("outside") and h != "nothing"]
    columns += sorted({n for _, n in cells} - set(columns))
    return truths, columns, [[cells.get((h, n), 0) for n in columns] for h in truths]


def _kind(cause: dict[str, Any]) -> str:
    """Kind of a cause, with the place where two share a name."""
    kind = str(cause["kind"])
    return f"{kind} of {where(cause).split('.')[0]}" if kind in ("lag", "gain_drift") else kind
