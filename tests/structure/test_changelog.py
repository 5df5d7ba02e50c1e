"""The changelog keeps the sections of Keep a Changelog, in its order."""

import re
from pathlib import Path

CHANGELOG = Path(__file__).parents[2] / "CHANGELOG.md"
SECTIONS = ["Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"]


def test_sections_stand_once_and_in_one_order():
    for version in re.split(r"^## ", CHANGELOG.read_text(encoding="utf-8"), flags=re.M)[1:]:
        named = re.findall(r"^### (.+)$", version, flags=re.M)
        assert named == [section for section in SECTIONS if section in named]
