"""The front door: exit codes, one line on standard error, only the result on standard output, help at once."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from matching import cli, commands
from matching.commands import Command
from modelling import toml as tables
from modelling import writing as output
from modelling.errors import InputError


def modes(model):
    """A command for the test.

    Parameters
    ----------
    model : path
        A model.
    """


@pytest.fixture
def answer(monkeypatch):
    """Install a command `modes` that takes MODEL and does what the test says."""

    def install(run, **more):
        command = Command("test", modes, run, out=None, **more)
        monkeypatch.setattr(cli, "COMMANDS", {"modes": command, "match": command})

    return install


def fail_with(error):
    def run(_):
        raise error

    return run


def test_json_prints_the_result_and_nothing_else(answer, capfd):
    def run(arguments):
        print("chatter from Python")
        os.write(1, b"chatter from a solver in C\n")
        return {"model": arguments.model, "value": 0.1}

    answer(run)
    assert cli.main(["modes", "a.toml", "--json"]) == 0
    out, err = capfd.readouterr()
    assert json.loads(out) == {"model": "a.toml", "value": 0.1}
    assert "chatter from Python" in err
    assert "chatter from a solver in C" in err


def test_standard_output_works_again_after_json(answer, capfd):
    answer(fail_with(InputError("a.toml", "is wrong")))
    cli.main(["modes", "a.toml", "--json"])
    os.write(1, b"still here")
    assert capfd.readouterr().out == "still here"


def test_summary_is_printed_for_a_reader(answer, capsys):
    answer(lambda _: {"n": 3}, summary=lambda result: f"{result['n']} modes")
    assert cli.main(["modes", "a.toml"]) == 0
    assert capsys.readouterr().out == "3 modes\n"


def test_result_that_is_not_finite_is_a_fault(answer, capsys):
    answer(lambda _: {"modes": [{"frequency": float("nan")}]})
    assert cli.main(["modes", "a.toml", "--json"]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "modes[0].frequency is nan" in err


def test_bad_input_is_one_line_and_exit_2(answer, capsys):
    answer(fail_with(InputError("a.toml: inertias.motor.J", "is negative\nvery", "give a number above 0 kg·m²")))
    assert cli.main(["modes", "a.toml"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "rigmatch: a.toml: inertias.motor.J: is negative very; give a number above 0 kg·m²\n"


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ([], "COMMAND"),
        (["nonsense"], "invalid choice: 'nonsense'"),
        (["modes"], "required: MODEL"),
        (["modes", "a.toml", "--nonsense"], "--nonsense"),
        (["modes", "a.toml", "b.toml"], "b.toml"),
        (["modes", "a.toml", "--js"], "--js"),
    ],
)
def test_wrong_arguments_are_one_line_and_exit_2(answer, capsys, words, part):
    answer(lambda _: {})
    assert cli.main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert part in err


@pytest.mark.parametrize("words", [["modes", "x", "--out", ""], ["modes", "x", "--out="], ["modes", ""]])
def test_empty_path_does_not_name_the_folder_one_is_in(capsys, words):
    """As ``--out "$UNSET"`` in a shell: nothing is written."""
    assert cli.main(words) == 2
    where = "argument 2" if words[1] == "" else "--out"
    assert capsys.readouterr().err == f"rigmatch: {where}: is empty; give a value; . names the folder you are in\n"


def test_missing_file_that_no_reader_caught(answer, capsys, tmp_path):
    answer(lambda arguments: Path(arguments.model).read_text())
    assert cli.main(["modes", str(tmp_path / "none.toml")]) == 2
    assert capsys.readouterr().err.endswith("none.toml: no such file or directory; give another path\n")
    assert cli.main(["modes", str(tmp_path)]) == 2
    assert "is a directory" in capsys.readouterr().err


def test_fault_says_so_and_shows_the_traceback_only_on_request(answer, capsys, monkeypatch):
    answer(fail_with(ZeroDivisionError("division by zero")))
    assert cli.main(["modes", "a.toml"]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "a fault of rigmatch" in err
    assert "ZeroDivisionError: division by zero at test_cli.py:" in err
    assert cli.main(["modes", "a.toml", "--traceback"]) == 1
    assert "Traceback" in capsys.readouterr().err
    monkeypatch.setenv("RIGMATCH_TRACEBACK", "1")
    assert cli.main(["modes", "a.toml"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_results_do_not_replace_what_the_command_reads(answer, capsys, tmp_path):
    read, named, other = (tmp_path / name for name in ("result.toml", "named.toml", "other.toml"))
    for path in (read, named, other):
        path.write_text("a = 1\n")

    def run(arguments):
        tables.read_toml(named)  # as a case names its models
        output.write_all(arguments.out, {arguments.model.rpartition("/")[2]: "b", "new.txt": "c"})
        return {}

    def further(parser):
        parser.add_argument("--also", nargs="*")
        parser.add_argument("--out")

    answer(run, further=further)
    for words, replaced in ((["result.toml", "--also", str(read)], read), (["named.toml"], named)):
        assert cli.main(["modes", *words, "--out", str(tmp_path)]) == 2
        assert capsys.readouterr().err.startswith(
            f"rigmatch: {replaced}: is read by this command and would be replaced"
        )
        assert replaced.read_text() == "a = 1\n"
    assert not (tmp_path / "new.txt").exists()
    assert cli.main(["modes", "other.toml", "--out", str(tmp_path)]) == 0
    assert other.read_text() == "b"
    output.write_all(tmp_path, {"result.toml": "d"})  # of a program that calls the functions
    assert read.read_text() == "d"


def test_interrupt_is_130(answer):
    answer(fail_with(KeyboardInterrupt()))
    assert cli.main(["modes", "a.toml"]) == 130


def test_every_command_there_is_keeps_the_agreement():
    for name in commands.COMMANDS:
        calls = []
        for example in commands.calls(name):  # as a user would type it
            program, *words = shlex.split(example)
            if program == "rigmatch":
                calls.append(cli.build_parser(words).parse_args(words).command)
        assert calls.count(name) >= 2
        shown = help_of(name)
        assert all(example in shown for example in commands.calls(name))


def help_of(name):
    parser = cli.build_parser([name])
    commands_action = next(action for action in parser._actions if action.dest == "command")
    return commands_action.choices[name].format_help()


def python(code, **environment):
    return subprocess.run(
        [sys.executable, *code], capture_output=True, text=True, env={**os.environ, **environment}, check=False
    )


def test_import_modelling_is_light():
    loaded = python(["-c", "import sys, modelling; print(*sys.modules)"]).stdout.split()
    assert "modelling" in loaded
    assert {"scipy", "sympy", "casadi", "matplotlib", "pint"}.isdisjoint(loaded)


def test_module_call_is_the_same_front_door():
    result = python(["-m", "matching", "--version"])
    assert result.returncode == 0
    assert result.stdout.startswith("rigmatch ")
    result = python(["-m", "matching", "nonsense"])
    assert result.returncode == 2
    assert result.stdout == ""


def with_modes(result, summary, words):
    """Program that runs `words` with a command `modes` of that result and summary (all three as Python)."""
    return (
        "import sys; from matching import api, cli; from matching.commands import Command; "
        f"modes = Command('test', api.load, lambda a: {result}, summary=lambda r: {summary}, out=None); "
        f"cli.COMMANDS = {{'modes': modes}}; sys.exit(cli.main({words}))"
    )


def test_terminal_without_greek_letters():
    code = with_modes("{'unit': 'kg·m²'}", "'kg·m²'", "sys.argv[1:]")
    shown = python(["-c", code, "modes", "m.toml"], PYTHONIOENCODING="ascii")
    assert (shown.returncode, shown.stdout) == (0, "kg\\xb7m\\xb2\n")
    shown = python(["-c", code, "modes", "m.toml", "--json"], PYTHONIOENCODING="ascii")
    assert (shown.returncode, json.loads(shown.stdout)) == (0, {"unit": "kg·m²"})


def test_names_of_files_do_not_move_the_cursor_and_data_stay_as_they_are():
    hostile = "a\x1b[2J\r\u202eb\n\udcffc"
    code = with_modes(repr({"title": hostile}), repr(hostile), "sys.argv[1:]")
    shown = subprocess.run([sys.executable, "-c", code, "modes", "m.toml"], capture_output=True, check=False)
    assert (shown.returncode, shown.stdout.decode()) == (0, "a\ufffd[2J\ufffd\ufffdb\n\ufffdc\n")
    shown = subprocess.run([sys.executable, "-c", code, "modes", "m.toml", "--json"], capture_output=True, check=False)
    assert (shown.returncode, json.loads(shown.stdout)) == (0, {"title": hostile})


def test_reader_gone_early_leaves_no_traceback():
    code = with_modes("{}", "'x' * 1_000_000", "['modes', 'm.toml']")
    shell = f'{sys.executable} -c "$CODE" | head -c 1'
    result = subprocess.run(
        ["bash", "-c", shell], capture_output=True, text=True, env={**os.environ, "CODE": code}, check=False
    )
    assert result.stderr == ""


def completions(line, tmp_path):
    found = tmp_path / "found"
    asked = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(found),
        "_ARGCOMPLETE_IFS": "\n",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    code = "from matching import cli; cli.main([])"
    python(["-c", code], **asked)
    return {word.strip() for word in found.read_text().split("\n")}


def test_tab_completes_commands_and_their_arguments(tmp_path):
    assert completions("rigmatch m", tmp_path) == {"modes", "match", "map"}
    assert completions("rigmatch modes --d", tmp_path) == {"--damped"}
