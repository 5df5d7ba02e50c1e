"""The page's server: on this machine only, with a secret in the address."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import panel as pn
from panel.io.server import get_server
from tornado.web import RequestHandler

from matching.explore.files.workspace import Workspace
from matching.explore.page.drivetrain import DrivetrainTab
from matching.explore.page.elements import WIDE, heading
from matching.explore.page.match import match_tab
from matching.explore.page.measurement import measurement_tab
from matching.explore.page.modes import ModesTab
from matching.explore.page.running import RESULTS
from matching.explore.page.validity import validity

HOST = "127.0.0.1"
TOKEN_BYTES = 24
STYLE = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")


class NoIcon(RequestHandler):
    """Browsers ask for an icon; there is none."""

    def get(self) -> None:
        """No content."""
        self.set_status(204)


def page(workspace: Workspace) -> Any:
    """The whole page."""
    tabs: list[tuple[str, Any]] = []
    late: dict[int, tuple[Any, Callable[[], Any]]] = {}
    if workspace.models:
        modes = ModesTab(workspace)
        drivetrain = DrivetrainTab(workspace, modes.open_model)
        modes.after_keeping = drivetrain.after_change
        tabs = [("Drivetrain", drivetrain.panel()), ("Modes", modes.panel())]
    for title, make in (("Match", match_tab), ("Measurement", measurement_tab), ("Validity", validity)):
        place = pn.Column(sizing_mode=WIDE)
        late[len(tabs)] = place, partial(make, workspace)
        tabs.append((title, place))
    shown = pn.Tabs(*tabs, dynamic=True, sizing_mode=WIDE)

    def fill(number: int) -> None:
        """Make a tab when it is first opened."""
        if number in late:
            place, make = late.pop(number)
            place[:] = [make()]

    shown.param.watch(lambda event: fill(event.new), "active")
    fill(shown.active)
    return pn.Column(heading("rigmatch", 1), shown, sizing_mode=WIDE)


def serve(make: Callable[[], Any], out: Path, port: int = 0) -> tuple[Any, str]:
    """A server that runs, not yet its event loop, and the address of the page."""
    token = secrets.token_urlsafe(TOKEN_BYTES)
    number = port or _free_port()
    out.mkdir(parents=True, exist_ok=True)
    pn.extension("filedropper", raw_css=[STYLE])
    server = get_server(
        {"page": make}, address=HOST, port=number, prefix=f"/{token}", websocket_origin=[f"{HOST}:{number}"],
        title="rigmatch", start=False, show=False, verbose=False, index=None,
        extra_patterns=[("/favicon.ico", NoIcon)], static_dirs={RESULTS: str(out.absolute())},
    )  # fmt: skip
    return server, f"http://{HOST}:{number}/{token}/page"


def _free_port() -> int:
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        return int(taken.getsockname()[1])
