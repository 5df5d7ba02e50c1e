"""What stands in a file that is not TOML: the message names the line, the cause and the cure."""

import pytest

from modelling.errors import InputError
from modelling.toml import read_toml

ROTOR = "[inertias.rotor]\n"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (ROTOR + "J = 0.02 kg*m^2\n", 'line 2: 0.02 kg\\*m\\^2 is a number with a unit.*write "0.02 kg\\*m\\^2"'),
        (ROTOR + "J = 0.02kg·m²  # dyno\n", 'write "0.02 kg·m²"'),
        (ROTOR + "J = { value = 3 kg*m^2, tolerance = 0.1 }\n", 'write "3 kg\\*m\\^2"'),
        (ROTOR + "J = 5 %\n", 'write "5 %"'),
        ('vehicle = "C:\\Users\\me\\v.toml"\n', "line 1: a backslash between double quotes.*single quotes"),
        (ROTOR + "J: 1\n", "line 2: a key is followed by a colon; write J = 1"),
        (ROTOR + "J =\n", "line 2: J has no value"),
        (ROTOR + "J = 1\nJ = 2\n", "line 3: J is there twice"),
        ("[inertias.rotor\nJ = 1\n", r"line 1: a heading is not closed; write \[inertias.rotor\]"),
        ("[[effects]]\nkind = backlash\n", 'line 2: backlash is text, which needs quotes; write "backlash"'),
        ("[loop]\nx = True\n", "line 2: True is no value of TOML; write true or false"),
        ("// rig\n" + ROTOR + "J = 1\n", "line 1: a comment begins with #"),
        ("title = \u201crig\u201d\n", "line 1: has typographic quotes"),
        ('{"status": "matched", "limits": []}\n', "is JSON, where a model or case file .TOML. is expected"),
        (ROTOR + "J = 1,5\n", "decimal comma"),
    ],
)  # fmt: skip
def test_the_cause_is_named(tmp_path, text, line):
    (tmp_path / "m.toml").write_text(text)
    with pytest.raises(InputError, match=line):
        read_toml(tmp_path / "m.toml")


def test_a_file_that_an_editor_of_windows_wrote_is_read(tmp_path):
    (tmp_path / "m.toml").write_bytes(b"\xef\xbb\xbf[inertias.rotor]\r\nJ = 0.02\r\n")
    assert read_toml(tmp_path / "m.toml") == {"inertias": {"rotor": {"J": 0.02}}}
    (tmp_path / "m.toml").write_text(ROTOR, encoding="utf-16")
    with pytest.raises(InputError, match="saved as UTF-16; save the file as UTF-8"):
        read_toml(tmp_path / "m.toml")
