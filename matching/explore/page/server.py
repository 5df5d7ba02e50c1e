"""The page's server: on this machine only, with a secret in the address."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import panel as pn
from panel.io.server import get_server
from tornado.web import RequestHandler

from matching.explore.page.drivetrain import DrivetrainTab
from matching.explore.page.elements import WIDE, heading
from matching.explore.page.modes import ModesTab
from matching.explore.workspace import Workspace

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
    if workspace.models:
        modes = ModesTab(workspace)
        drivetrain = DrivetrainTab(workspace, modes.open_model)
        modes.after_keeping = drivetrain.after_change
        tabs = [("Drivetrain", drivetrain.panel()), ("Modes", modes.panel())]
    return pn.Column(heading("rigmatch", 1), pn.Tabs(*tabs, dynamic=True, sizing_mode=WIDE), sizing_mode=WIDE)


def serve(make: Callable[[], Any], port: int = 0) -> tuple[Any, str]:
    """A server that runs, not yet its event loop, and the address of the page."""
    token = secrets.token_urlsafe(TOKEN_BYTES)
    number = port or _free_port()
    pn.extension(raw_css=[STYLE])
    server = get_server(
        {"page": make}, address=HOST, port=number, prefix=f"/{token}", websocket_origin=[f"{HOST}:{number}"],
        title="rigmatch", start=False, show=False, verbose=False, index=None,
        extra_patterns=[("/favicon.ico", NoIcon)],
    )  # fmt: skip
    return server, f"http://{HOST}:{number}/{token}/page"


def _free_port() -> int:
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        return int(taken.getsockname()[1])
