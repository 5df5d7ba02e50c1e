"""`rigmatch explore`: models, cases, recordings, budgets in the browser."""

import argparse
from typing import Any

HELP = """Open files in the browser: the drivetrain to click and change, modes and responses that follow a slider,
matches, recordings, budgets. FILE is a model, a case, a recording, a budget or a fidelity case; without any the starter
case is opened, as `rigmatch new` writes it to DIR. The page is served to this machine only, at an address with a secret
in it, until Ctrl-C. Files are changed only by Save; results are written to DIR."""
EXAMPLES = (
    "rigmatch explore examples/road_to_rig/case.toml",
    "rigmatch explore examples/from_recordings/rig.toml examples/from_recordings/bed.csv --no-browser",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Files to open, place to write to."""
    from matching.arguments import count

    parser.add_argument("files", metavar="FILE", nargs="*", help="model, case, recording, budget or fidelity case")
    parser.add_argument(
        "--out", metavar="DIR", default="out/explore", help="directory for results (default: %(default)s)"
    )
    parser.add_argument("--port", metavar="N", type=count(0), default=0, help="port to serve at (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="print the address and open no browser")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Serve the page until it is interrupted; the result object says where it was.

    Raises
    ------
    InputError
        If a file cannot be read, or the packages of the explorer are not installed.
    """
    import signal
    import sys
    import webbrowser
    from pathlib import Path

    from matching.explore.files.workspace import opened, required_packages, starter

    required_packages()
    workspace = opened(arguments.files or [starter(Path(arguments.out))], arguments.out)
    print("preparing the page …", file=sys.stderr, flush=True)

    from bokeh.settings import settings

    from matching.explore.page.server import page, serve

    settings.resources = "server"  # the page needs no internet, whatever BOKEH_RESOURCES says
    interrupt = signal.getsignal(signal.SIGINT)
    server, address = serve(lambda: page(workspace), workspace.out, arguments.port)
    signal.signal(signal.SIGINT, interrupt)  # with Panel's own the command would end as if it had answered
    print(f"{address}\nCtrl-C ends it", file=sys.stderr, flush=True)
    if not arguments.no_browser:
        server.io_loop.add_callback(webbrowser.open, address)
    server.start()
    try:
        server.io_loop.start()
    finally:
        server.stop()
    return {"address": address}
