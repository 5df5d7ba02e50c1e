"""The lock pins everything by hash and names no place to download from."""

import re
from pathlib import Path

LOCK = (Path(__file__).parents[2] / "requirements.lock").read_text(encoding="utf-8")


def test_every_requirement_is_pinned_by_hash():
    lines = [line for line in LOCK.replace("\\\n", " ").splitlines() if line and not line.startswith("#")]
    assert len(lines) > 100
    for line in lines:
        assert re.fullmatch(r"[a-z0-9-]+==[0-9][0-9a-z.]*( ; [^#]+?)?(\s+--hash=sha256:[0-9a-f]{64})+", line), line


def test_no_place_to_download_from():
    assert not re.search(r"://|index-url|find-links", LOCK)
