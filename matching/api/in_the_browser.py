"""The explorer, from a program or a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matching.api.files import File

if TYPE_CHECKING:
    from matching.explore.page.server import Explorer


def explore(*files: File, out: File = "out/explore", port: int = 0, browser: bool = False) -> Explorer:
    """Open models, cases, recordings, budgets in the browser, or inside a notebook as the last line of a cell.

    Parameters
    ----------
    files : paths
        What is opened; without any the starter case.
    out : path
        Folder for results.
    port : int
        To serve at; by default a free one.
    browser : bool
        Open the page in the browser at once.

    Returns
    -------
    Explorer
        ``address`` of the page, for this machine only; ``stop()`` ends it, ``wait()`` keeps a program alive. A notebook
        shows the page itself.

    Raises
    ------
    InputError
        If a file cannot be read, or the packages of the explorer are not installed.

    Examples
    --------
    >>> explorer = rm.explore("examples/road_to_rig/case.toml")  # doctest: +SKIP
    >>> explorer.stop()  # doctest: +SKIP
    """
    import webbrowser
    from pathlib import Path

    from matching.explore.files.workspace import opened, required_packages, starter

    required_packages()
    workspace = opened([str(file) for file in files] or [starter(Path(out))], str(out))
    from matching.explore.page.server import Explorer

    explorer = Explorer(workspace, port)
    if browser:
        webbrowser.open(explorer.address)
    return explorer
