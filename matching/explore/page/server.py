"""The page's server: on this machine only, with a secret in the address."""

from __future__ import annotations

import asyncio
import secrets
import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Event, Thread
from typing import Any

import panel as pn
from panel.io.server import get_server
from tornado.web import RequestHandler

from matching.explore.files.workspace import Workspace
from matching.explore.page.drivetrain import DrivetrainTab
from matching.explore.page.elements import WIDE, heading, paragraph
from matching.explore.page.match import MatchTab, without_case
from matching.explore.page.measurement import measurement_tab
from matching.explore.page.modes import ModesTab
from matching.explore.page.running import RESULTS
from matching.explore.page.validity import validity
from matching.explore.page.widgets.tab_bar import TabBar
from modelling.common import escape

HOST = "127.0.0.1"
TOKEN_BYTES = 24
BEGIN_SECONDS = 60.0  # at most, until the page can be opened
FRAME_PX = 900  # height in a notebook
SHOWN_FIRST_MS = 30  # until the browser has drawn that a tab is being prepared
STYLE = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")


class NoIcon(RequestHandler):
    """Browsers ask for an icon; there is none."""

    def get(self) -> None:
        """No content."""
        self.set_status(204)


def page(workspace: Workspace) -> Any:
    """The whole page."""
    makers = _makers(workspace)
    names, made = list(makers), dict[str, Any]()
    bar, content = TabBar(names=names, sizing_mode=WIDE), pn.Column(sizing_mode=WIDE)

    def show(number: int) -> None:
        """Put a tab's content on the page; it is made when it is first opened, and until then the page says so."""
        name, server_page = names[number], pn.state.curdoc
        if name in made or server_page is None or not made:
            put(number)
            return
        content[:] = [paragraph(f"{name} is being prepared …")]
        server_page.add_timeout_callback(partial(put, number), SHOWN_FIRST_MS)

    def put(number: int) -> None:
        """The content itself, unless another tab was opened meanwhile."""
        name = names[number]
        if number == bar.active:
            if name not in made:
                made[name] = makers[name]()
            content[:] = [made[name]]

    bar.param.watch(lambda event: show(event.new), "active")
    show(0)
    return pn.Column(heading("rigmatch", 1), bar, content, sizing_mode=WIDE)


def _makers(workspace: Workspace) -> dict[str, Callable[[], Any]]:
    """What makes the content of each tab; a change of a model is told to the tabs that are there."""
    opened: list[MatchTab] = []
    makers: dict[str, Callable[[], Any]] = {}
    if workspace.models:
        modes = ModesTab(workspace)

        def entered() -> None:
            modes.open_model()
            for tab in opened:
                tab.models_changed()

        def kept() -> None:
            drivetrain.after_change()
            for tab in opened:
                tab.models_changed()

        def taken() -> None:
            drivetrain.after_change()
            modes.open_model()

        drivetrain = DrivetrainTab(workspace, entered)
        modes.after_keeping = kept
        makers = {"Drivetrain": drivetrain.panel, "Modes": modes.panel}

    def match() -> Any:
        if workspace.case is None:
            return without_case()
        opened.append(MatchTab(workspace, workspace.case, taken))
        return opened[0].panel()

    return makers | {
        "Match": match,
        "Measurement": partial(measurement_tab, workspace),
        "Validity": partial(validity, workspace),
    }


def serve(make: Callable[[], Any], out: Path, port: int = 0) -> tuple[Any, str]:
    """A server that runs, not yet its event loop, and the address of the page; ``make`` has to be a Python function.

    Panel shows what any other callable (``functools.partial``) prints as, instead of calling it.
    """
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


class Explorer:
    """A page that is served to this machine until :meth:`stop`, or the end of the program.

    Attributes
    ----------
    address : str
        Of the page, with a secret in it.
    """

    def __init__(self, workspace: Workspace, port: int = 0):
        self.address = ""
        self._begun = Event()
        self._fault: BaseException | None = None
        self._server: Any = None
        self._thread = Thread(target=self._run, args=(workspace, port), name="rigmatch explore", daemon=True)
        self._thread.start()
        self._begun.wait(BEGIN_SECONDS)
        if self._fault is not None:
            raise self._fault

    def _run(self, workspace: Workspace, port: int) -> None:
        asyncio.set_event_loop(asyncio.new_event_loop())
        try:
            self._server, self.address = serve(lambda: page(workspace), workspace.out, port)
            self._server.start()
        except BaseException as fault:  # raised where the explorer was asked for
            self._fault = fault
            return
        finally:
            self._begun.set()
        self._server.io_loop.start()
        self._server.stop()

    def stop(self) -> None:
        """End the server."""
        if self._thread.is_alive():
            self._server.io_loop.add_callback(self._server.io_loop.stop)
            self._thread.join(BEGIN_SECONDS)

    def wait(self) -> None:
        """Wait until somebody else ends the server, e.g. by Ctrl-C: a program would end without it."""
        while self._thread.is_alive():
            self._thread.join(1.0)

    def __repr__(self) -> str:
        return f"explorer at {self.address}"

    def _repr_html_(self) -> str:
        frame = f'<iframe src="{escape.html(self.address)}" style="width:100%;height:{FRAME_PX}px;border:0"></iframe>'
        return f'{frame}<p><a href="{escape.html(self.address)}" target="_blank">Open in a window</a></p>'


def _free_port() -> int:
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        return int(taken.getsockname()[1])
