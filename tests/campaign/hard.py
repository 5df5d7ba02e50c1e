"""What the answers of the second campaign are worth."""

from typing import Any

from tests.campaign.score import both, right, where

SURE = 0.8  # confidence from which a wrong answer counts


def hard_summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares by category and of all, each with the number of recordings behind it."""
    made = [row for row in rows if "found" in row]
    categories = sorted({row["order"]["category"] for row in made})
    return {
        "recordings": len(rows),
        "failed": [row["failed"] for row in rows if "failed" in row],
        "all": figures(made),
        **{name: figures([row for row in made if row["order"]["category"] == name]) for name in categories},
    }


def figures(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Right first (and all causes found), wrong though sure, worse on unseen data than the base model."""
    hidden = [row for row in rows if row["answer"]["causes"]]
    return {
        "of": len(rows),
        "right_first": share([first_right(row) for row in hidden]),
        "all_found": share([both(row) for row in hidden]),
        "wrong_and_sure": share([wrong_and_sure(row) for row in rows]),
        "unseen_worse": share([unseen_worse(row) for row in rows]),
    }


def share(flags: list[bool]) -> float | None:
    return sum(flags) / len(flags) if flags else None


def first_right(row: dict[str, Any]) -> bool:
    """Whether the first cause is hidden in the recording, or one that it cannot tell from that."""
    return any(right(row | {"answer": one}) for one in row["answer"]["causes"])


def wrong_and_sure(row: dict[str, Any]) -> bool:
    """Whether a cause of high confidence is neither hidden nor in the background."""
    behind = {(kind, at) for kind, at in row["answer"].get("background", [])}
    for cause in row["found"]["causes"]:
        good = any(right({"found": {"causes": [cause]}, "answer": one}) for one in row["answer"]["causes"])
        if cause["confidence"] > SURE and not good and (cause["kind"], where(cause)) not in behind:
            return True
    return False


def unseen_worse(row: dict[str, Any]) -> bool:
    """Whether all sensors together err more on unseen data than by the base model."""
    gain = row["found"]["gain"]
    return gain["nrmse_after"] > gain["nrmse_before"] * (1 + 1e-6)
