"""`rigmatch uncertainty` and `rigmatch fidelity` as a user calls them."""

import json
from pathlib import Path

import pytest
from result_schema import check_schema

from matching.cli import main

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_uncertainty_writes_table_json_and_figures(tmp_path, capsys):
    assert (
        main(
            [
                "uncertainty",
                str(EXAMPLES / "gum" / "mass.toml"),
                "--out",
                str(tmp_path),
                "--draws",
                "50000",
                "--wanted",
                "0.13 mg",
            ]
        )
        == 0
    )
    shown = capsys.readouterr().out
    assert "deviation = 1.23" in shown  # first order is not good enough here (JCGM 101, 9.3)
    assert "1.38" in shown.split("% in ")[1].split(" (Monte Carlo)")[0]
    answer = json.loads((tmp_path / "uncertainty.json").read_text())
    assert answer["measurands"][0]["standard_uncertainty"] == pytest.approx(0.05385, abs=1e-5)
    shares = [row["share"] for row in answer["measurands"][0]["budget"]]
    assert shares == sorted(shares, reverse=True)
    assert sum(shares) > 1  # stated by Monte Carlo: an air density that is known takes the weight's density along
    assert list(answer["inverse"][0]["alone"][0]) == ["m_reference"]
    check_schema("uncertainty", answer)
    assert {path.name for path in tmp_path.iterdir()} == {
        "uncertainty.json",
        "uncertainty.txt",
        "uncertainty.html",
        "contributions.svg",
        "ishikawa.svg",
    }


def test_json_alone_on_standard_output(tmp_path, capsys):
    assert (
        main(
            [
                "uncertainty",
                str(EXAMPLES / "gum" / "impedance.toml"),
                "--out",
                str(tmp_path),
                "--draws",
                "50000",
                "--json",
            ]
        )
        == 0
    )
    answer = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in answer["measurands"]] == ["R", "X", "Z"]
    assert (tmp_path / "X_ishikawa.svg").exists()


def test_names_with_slashes_and_dollars_and_values_of_any_size(tmp_path, capsys):
    path = tmp_path / "budget.toml"
    path.write_text(
        """
        title = "$\\\\frac{$ of $x_{$"
        [measurands]
        "../T/n" = { formula = "x - a" }
        "..|T|n" = { formula = "x + a" }
        "T$\\\\frac{$" = { formula = "a" }
        [inputs]
        x = { value = -1e99, uncertainty = 0.1 }
        a = { value = 2, uncertainty = 0.1 }
        """
    )
    assert main(["uncertainty", str(path), "--out", str(tmp_path / "out"), "--draws", "20000"]) == 0
    assert "-1e+99" in capsys.readouterr().out
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert {"___T_n_ishikawa.svg", "___T_n_2_ishikawa.svg", "T__frac___ishikawa.svg"} <= names


def test_fidelity_writes_table_json_and_figures(tmp_path, capsys):
    assert main(["fidelity", str(EXAMPLES / "fidelity" / "tab2.toml"), "--out", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert "R_XiL = 88.54 %, without uncertainty" in shown  # no "u = 0.00 %" beside the note that none was stated
    assert "u = 0.00 %" not in shown
    check_schema("fidelity", answer := json.loads((tmp_path / "fidelity.json").read_text()))
    assert (
        main(
            [
                "fidelity",
                str(EXAMPLES / "fidelity" / "tab2.toml"),
                "--out",
                str(tmp_path),
                "--arithmetic",
                "published",
                "--json",
            ]
        )
        == 0
    )
    answer = json.loads(capsys.readouterr().out)
    assert f"{100 * answer['R_XiL']:.2f}" == "76.75"
    assert any("divided by 6" in note for note in answer["notes"])
    assert (tmp_path / "delay.svg").exists()
    check_schema("fidelity", answer)


@pytest.mark.parametrize(
    ("command", "content", "words"),
    [
        (
            "uncertainty",
            '[measurand]\nformula = "open(1)"\n[inputs.x]\nvalue = 1\n',
            "'open' is no function of mathematics",
        ),
        ("uncertainty", "x = [", "is not TOML"),
        ("fidelity", "[weights]\nsystem_dynamics = 0.5\n[system_dynamics.a]\nnrmse_fidelity = 1\n", "must sum to 1"),
        ("fidelity", "typo = 1\n", "'typo' does not exist"),
        (
            "fidelity",
            "f_max = 30\n[weights]\nsystem_dynamics = 1\n[system_dynamics.t]\nnrmse_fidelity = 1\ndelay = -1e30\n",
            "-1e+30 s is no delay of a test bed",
        ),
    ],
)
def test_bad_input_is_one_line_and_no_output(tmp_path, capsys, command, content, words):
    path = tmp_path / "bad.toml"
    path.write_text(content)
    assert main([command, str(path), "--out", str(tmp_path / "out")]) == 2
    caught = capsys.readouterr()
    assert caught.out == ""
    assert words in caught.err
    assert caught.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "extra", [["--draws", "5"], ["--seed", "-1"], ["--wanted", "abc"], ["--wanted", "1 kg*m"], ["--wanted", "-1"]]
)
def test_bad_options(tmp_path, capsys, extra):
    assert main(["uncertainty", str(EXAMPLES / "gum" / "mass.toml"), "--out", str(tmp_path / "out"), *extra]) == 2
    assert capsys.readouterr().err.count("\n") == 1
