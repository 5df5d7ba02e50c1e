"""The commands of `rigmatch`, one module each; none is imported before it is called for.

A command's module has

- `HELP`: a paragraph on what the command does, and `EXAMPLES`: two calls or more, shown by `rigmatch COMMAND --help`;
  they work as typed, one after the other, in the program's folder after `make run` (a long test runs them all),
- `add_arguments(parser)`: its arguments, except `--json` and `--traceback`, which every command has,
- `run(arguments) -> dict`: does it, writes files by `modelling.writing.output.write_all`, returns the result object,
- optionally `checked(arguments) -> dict`: what `--check` reads beside model, case, budget and recordings, by file,
- optionally `summary(result) -> str`: the same for a reader at a terminal, printed unless `--json` is given.
"""

from importlib.util import find_spec

ONE_LINE = {
    "modes": "modes of a model with energy shares and symmetry",
    "show": "drawing of a drivetrain, or of vehicle and rig of a case",
    "match": "tune loop, residual vehicle and adapters until the rig reproduces the vehicle's response",
    "map": "response error that a match reaches, over two quantities",
    "simulate": "run a model on recorded inputs",
    "diagnose": "find what a model lacks, from recordings",
    "uncertainty": "measurement uncertainty budget after the GUM",
    "fidelity": "partial and total XiL fidelity",
    "tolerance": "spread of a match over the tolerances of the bed",
    "excite": "plan the recording that identifies what a match depends on",
    "identify": "vehicle and bed from recordings: a case with their values and uncertainties",
    "verify": "judge recordings of the controlled bed beside vehicle and prediction",
    "commission": "the whole way onto the bed: match, run, verify, excite, record, diagnose, match again",
    "export": "write the tuned residual vehicle as an FMU",
    "explore": "models, cases, recordings and budgets in the browser",
    "new": "write a commented case to start from",
}


def available() -> dict[str, str]:
    """Commands whose module is there, with one line of help each, in the order to show them."""
    return {name: line for name, line in ONE_LINE.items() if find_spec(f"{__name__}.{name}")}
