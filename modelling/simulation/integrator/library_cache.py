"""Where compiled libraries are kept: only what was written here, whole, is loaded again.

An entry ``KEY-DIGEST.so`` carries two checksums: of all that it was made from, and of its content. It is written beside
its place, forced to the disk and moved there in one step; before it is loaded its content is compared with its name,
and what is wrong is removed, to be made anew. Folder and entries belong to this user and nobody else may write to them.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import stat
import tempfile
import time
from pathlib import Path

try:
    import grp
    import pwd
except ImportError:  # Windows, where groups are not asked for
    pass

SUFFIX, UNFINISHED = ".so", ".new-"
DIGITS = 32  # of a checksum, hexadecimal
STALE_SECONDS = 3600.0  # after which an unfinished entry is nobody's any more
OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH


@functools.cache
def folder() -> Path:
    """``RIGMATCH_CACHE`` or the user's cache; one of this process alone where that is missing or open to others."""
    for path in _candidates():
        with contextlib.suppress(OSError):
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            if os.access(path, os.W_OK | os.X_OK) and only_mine(path):
                return path
    return _folder_of_this_process()


def _candidates() -> list[Path]:
    if wanted := os.environ.get("RIGMATCH_CACHE"):
        return [Path(wanted).absolute()]
    caches = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA", "")
    with contextlib.suppress(RuntimeError):  # nobody knows where home is
        home = Path(caches) if os.path.isabs(caches) else Path.home() / ".cache"
        return [home / "rigmatch"]
    return []


@functools.cache
def _folder_of_this_process() -> Path:
    _KEPT_UNTIL_THE_END.append(tempfile.TemporaryDirectory(prefix="rigmatch-"))
    return Path(_KEPT_UNTIL_THE_END[-1].name)


_KEPT_UNTIL_THE_END: list[tempfile.TemporaryDirectory] = []


def only_mine(path: Path) -> bool:
    """Whether a folder or file is this user's, nobody else may write to it, and nobody may put another in its place."""
    if not hasattr(os, "getuid"):  # Windows: what lies in the user's profile is the user's
        return path.resolve().is_relative_to(Path.home())
    status = path.lstat()
    if status.st_uid != os.getuid() or status.st_mode & OTHERS_MAY_WRITE:
        return False
    above = [folder.stat() for folder in path.resolve().parents]
    if any(each.st_uid not in (0, os.getuid()) for each in above):  # who has a folder may rename what lies in it
        return False
    return all(each.st_mode & stat.S_ISVTX or not _open_to_others(each) for each in above)


def _open_to_others(status: os.stat_result) -> bool:
    """Whether anybody but root and this user may write to a folder: the user's private group is nobody else."""
    if status.st_mode & stat.S_IWOTH:
        return True
    return bool(status.st_mode & stat.S_IWGRP) and status.st_gid not in (0, _private_group())


@functools.cache
def _private_group() -> int | None:
    """The group that has the user's name and no other member, as most Linux systems make one for each user."""
    with contextlib.suppress(KeyError):
        user, group = pwd.getpwuid(os.getuid()), grp.getgrgid(os.getgid())
        if group.gr_name == user.pw_name and set(group.gr_mem) <= {user.pw_name}:
            return group.gr_gid
    return None


def kept(key: str) -> Path | None:
    """The entry of a key if there is one that is whole; others are removed."""
    library = None
    for place in dict.fromkeys((folder(), _folder_of_this_process())) if _KEPT_UNTIL_THE_END else (folder(),):
        for path in sorted(place.glob(f"{key}-*{SUFFIX}")):
            if library is None and _is_whole(path):
                library = path
            elif library is None:
                with contextlib.suppress(OSError):
                    path.unlink()
    return library


def keep(key: str, content: bytes) -> Path | None:
    """Keep a library under a key; None where neither the cache nor the temporary folder has room for it."""
    name = f"{key}-{_digest(content)}{SUFFIX}"
    with contextlib.suppress(OSError):
        return _written(folder() / name, content)
    with contextlib.suppress(OSError):
        return _written(_folder_of_this_process() / name, content)
    return None


def _written(target: Path, content: bytes) -> Path:
    _remove_stale(target.parent)
    handle, name = tempfile.mkstemp(prefix=UNFINISHED, dir=target.parent)  # nobody else may read or write it
    try:
        with open(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, target)
    except BaseException:
        os.unlink(name)
        raise
    return target


def _remove_stale(place: Path) -> None:
    for path in place.glob(f"{UNFINISHED}*"):
        with contextlib.suppress(OSError):  # another process has finished or removed it
            if time.time() - path.stat().st_mtime > STALE_SECONDS:
                path.unlink()


def _is_whole(path: Path) -> bool:
    try:
        return only_mine(path) and path.is_file() and path.stem.partition("-")[2] == _digest(path.read_bytes())
    except OSError:
        return False


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:DIGITS]
