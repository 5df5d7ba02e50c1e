"""Live reports: pages that commands wrote, kept packed in `docs/reports`, unpacked into the site as they are."""

import lzma
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKED = ROOT / "docs" / "reports"
UNPACKED = ROOT / "docs" / "reference" / "reports"  # what stands in it, lies in the root of the site
CARDS = {
    "match": ("A match", "`rigmatch match` of the case that `rigmatch new` writes: verdict, order, evidence."),
    "diagnosis": ("A diagnosis", "`rigmatch diagnose` of a recording: free play that the model lacks."),
    "commissioning": ("A commissioned bed", "`rigmatch commission` of a simulated bed: one round, as predicted."),
}


def unpack() -> Path:
    """Write the reports as pages, and return their folder."""
    UNPACKED.mkdir(parents=True, exist_ok=True)
    for name in CARDS:
        page = lzma.decompress((PACKED / f"{name}.html.xz").read_bytes())
        path = UNPACKED / f"report_{name}.html"
        if not path.exists() or path.read_bytes() != page:
            path.write_bytes(page)
    return UNPACKED


def report_cards() -> str:
    """A card a report; it leads to the page as the command wrote it."""
    return "".join(
        f":::{{grid-item-card}} {title}\n:link: ../report_{name}.html\n:link-type: url\n"
        f":img-top: ../gallery/report_{name}.png\n\n{text}\n:::\n\n"
        for name, (title, text) in CARDS.items()
    )
