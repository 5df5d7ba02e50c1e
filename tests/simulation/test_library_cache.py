"""The cache of compiled libraries: what is wrong in it is made anew, what others may write to is not loaded."""

import errno
import os
import subprocess
import sys
import tempfile
import time

import casadi as ca
import pytest
from needs import compiles

from modelling.errors import InputError, of_the_machine
from modelling.simulation import compiled as c_compiler
from modelling.simulation import compiled as c_library
from modelling.simulation import compiled as library_cache

SOURCE = "double answer(void) { return 42.0; }\n"
LOAD = """
import ctypes
from modelling.simulation.integrator import c_compiler, library_cache
made = c_compiler.compile_library(c_compiler.compiler(), ["-shared"], {{"a.c": {0!r}}}, "a.c")
path = library_cache.keep(32 * "a", made)
assert path == library_cache.kept(32 * "a")
answer = ctypes.CDLL(str(path)).answer
answer.restype = ctypes.c_double
print(answer(), path.parent)
"""


@pytest.fixture
def cache(tmp_path, monkeypatch):
    path = tmp_path / "cache"
    monkeypatch.setenv("RIGMATCH_CACHE", str(path))
    monkeypatch.setattr(library_cache, "_KEPT_UNTIL_THE_END", [])
    for kept in (library_cache.folder, library_cache._folder_of_this_process, c_compiler._warn):
        kept.cache_clear()
    yield path
    for folder in library_cache._KEPT_UNTIL_THE_END:
        folder.cleanup()
    for kept in (library_cache.folder, library_cache._folder_of_this_process, c_compiler._warn):
        kept.cache_clear()


def made(source=SOURCE):
    return c_library.shared(source, lambda: source, "-O1")


@compiles
@pytest.mark.parametrize("damage", ["truncated", "zeroed", "garbage", "empty", "one_bit"])
def test_a_damaged_entry_is_made_anew(cache, damage):
    path = made()
    content = path.read_bytes()
    wrong = {
        "truncated": content[: len(content) // 2],
        "zeroed": bytes(len(content)),
        "garbage": b"\x7fELF" + os.urandom(5000),
        "empty": b"",
        "one_bit": content[:-1] + bytes([content[-1] ^ 1]),
    }
    path.write_bytes(wrong[damage])
    assert made() == path
    assert path.read_bytes() == content
    assert [each.name for each in cache.iterdir()] == [path.name]


@compiles
def test_a_whole_entry_is_neither_compiled_nor_written_again(cache):
    path = made()
    before = path.stat()
    assert c_library.shared(SOURCE, lambda: pytest.fail("compiled again"), "-O1") == path
    assert path.stat().st_ino == before.st_ino


@compiles
def test_what_others_may_write_to_is_not_loaded(cache):
    path = made()
    path.chmod(0o666)
    again = made()
    assert again.stat().st_mode & 0o777 == 0o600
    assert again.stat().st_ino != os.stat(cache).st_ino
    cache.chmod(0o777)
    library_cache.folder.cache_clear()
    assert made().parent not in (cache, cache.parent)
    cache.chmod(0o700)
    cache.parent.chmod(0o777)  # whoever may rename the cache may put another in its place
    library_cache.folder.cache_clear()
    assert made().parent != cache
    cache.parent.chmod(0o700)


@compiles
@pytest.mark.skipif(os.geteuid() != 0, reason="only root may give files away")
def test_files_of_another_user_are_not_loaded(cache):
    path = made()
    os.chown(path, 12345, 12345)
    assert made().stat().st_uid == 0
    os.chown(cache, 12345, 12345)
    library_cache.folder.cache_clear()
    assert made().parent != cache


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root may give files away")
def test_a_cache_in_a_folder_of_another_user_is_not_used(cache):
    library_cache.folder()
    assert library_cache.only_mine(cache)
    os.chown(cache.parent, 12345, 12345)  # who may rename the cache, and put another in its place
    assert not library_cache.only_mine(cache)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root may give files away")
def test_a_cache_in_a_folder_that_a_group_may_write_to_is_not_used_unless_the_group_is_the_users_alone(cache):
    library_cache.folder()
    cache.parent.chmod(0o770)
    assert library_cache.only_mine(cache)  # root's group
    os.chown(cache.parent, 0, 12345)
    assert not library_cache.only_mine(cache)
    cache.parent.chmod(0o750)
    assert library_cache.only_mine(cache)


@compiles
def test_a_link_is_not_loaded(cache, tmp_path):
    path = made()
    other = tmp_path / "other.so"
    path.rename(other)
    path.symlink_to(other)
    assert not made().is_symlink()


@compiles
def test_a_full_disk_is_no_fault_and_leaves_nothing(cache, monkeypatch):
    library_cache.folder()
    synced = os.fsync

    def full(handle):
        if os.readlink(f"/proc/self/fd/{handle}").startswith(str(cache)):
            raise OSError(28, "No space left on device")
        synced(handle)

    monkeypatch.setattr(os, "fsync", full)
    path = made()
    assert path.parent != cache
    assert made() == path  # found again in the folder of this process
    assert list(cache.iterdir()) == []
    monkeypatch.setattr(tempfile, "mkstemp", lambda **_: full(os.open(cache, os.O_RDONLY)))
    assert made("double other(void) { return 1.0; }") is None


@compiles
@pytest.mark.parametrize("home", ["missing", "file"])
def test_without_a_home_it_works_and_leaves_nothing_in_the_temporary_folder(tmp_path, home):
    (tmp_path / "file").touch()
    (tmp_path / "temporary").mkdir()
    where = os.environ | {
        "HOME": str(tmp_path / "file" / "nowhere" if home == "file" else "/proc/nowhere"),
        "TMPDIR": str(tmp_path / "temporary"), "PYTHONPATH": os.pathsep.join(sys.path), "XDG_CACHE_HOME": "",
    }  # fmt: skip
    where.pop("RIGMATCH_CACHE", None)
    call = [sys.executable, "-c", LOAD.format(SOURCE)]
    done = subprocess.run(call, env=where, capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"42.0 {tmp_path / 'temporary'}")
    assert list((tmp_path / "temporary").iterdir()) == []


def test_unfinished_entries_of_the_dead_are_removed(cache):
    library_cache.folder()
    old, new = cache / ".new-old", cache / ".new-new"
    for path in (old, new):
        path.touch()
    os.utime(old, (time.time() - 2 * library_cache.STALE_SECONDS,) * 2)
    library_cache.keep("a" * 32, b"content")
    assert not old.exists()
    assert new.exists()


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="groups are not asked for here")
@pytest.mark.parametrize("nobody", ["pwd.getpwuid", "grp.getgrgid"])
def test_a_user_or_group_without_a_name_has_no_group_of_its_own(nobody, cache, monkeypatch):
    """As in a container that runs under any number: no error, and what nobody else may write to is its own."""

    def unknown(number):
        raise KeyError(number)

    cache.mkdir(mode=0o700)
    monkeypatch.setattr(f"modelling.simulation.integrator.library_cache.{nobody}", unknown)
    library_cache._private_group.cache_clear()
    try:
        assert library_cache._private_group() is None
        assert library_cache.only_mine(cache)
    finally:
        library_cache._private_group.cache_clear()


def test_a_compiler_that_takes_too_long_is_ended_where_there_are_no_groups_of_processes(tmp_path, monkeypatch):
    """As on Windows: what it would have written later is not."""
    monkeypatch.delattr(os, "killpg")
    late = tmp_path / "late"
    script = f"import time; time.sleep(3); open({str(late)!r}, 'w')"
    with pytest.raises(c_compiler.CompilerFault, match=r"no end after 0\.5 s"):
        c_compiler._run([sys.executable, "-I", "-S", "-c", script], str(tmp_path), 0.5)
    assert not late.exists()


WRONG = {
    "fails": ("echo 'x.c:1: error: no licence' >&2; exit 1", "error: no licence"),
    "makes_nothing": ("exit 0", "it made no library"),
    "makes_garbage": ('while [ "$1" != -o ]; do shift; done; head -c 9000 /dev/zero > "$2"', "wrong answers"),
    "wrong_code": ('cp "$(dirname "$0")/wrong.so" made.so', "wrong answers"),
    "hangs": ("sleep 100 & sleep 100", "no end after 0.5 s"),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_compiler_that_does_not_work_is_noticed(what, cache, tmp_path, monkeypatch):
    script, said = WRONG[what]
    compiler = tmp_path / "cc"
    compiler.write_text(f"#!/bin/sh\n[ \"$1\" = --version ] && echo 'cc {what}' && exit\n{script}\n")
    compiler.chmod(0o755)
    if what == "wrong_code":
        if c_compiler.compiler() is None:
            pytest.skip("no C compiler here")
        wrong = "double trial(double x, int n) { return x + n; }"
        (tmp_path / "wrong.so").write_bytes(
            c_compiler.compile_library(c_compiler.compiler(), c_compiler.TRIAL_FLAGS, {"a.c": wrong}, "a.c")
        )
    if what == "hangs":
        monkeypatch.setattr(c_compiler, "TRIAL_SECONDS", 0.5)
    monkeypatch.setattr(c_library, "compiler", lambda: str(compiler))
    x = ca.SX.sym("x")
    function = ca.Function("twice", [x], [2 * x])
    with pytest.warns(c_compiler.CompilerWarning, match=said):
        assert c_library.external(function) is function
    with pytest.raises(InputError, match=f"does not work: .*{said}"):
        c_compiler.check(str(compiler))
    assert list(cache.iterdir()) == []


@compiles
def test_what_is_compiled_raises_no_warning():
    x = ca.SX.sym("x", 3)
    smooth = ca.Function("smooth", [x], [ca.fmax(ca.sin(x), x**2), ca.fmin(x[0], x[1])])
    files = {"step.c": c_library.generated(smooth)}
    c_compiler.compile_library(c_compiler.compiler(), WARNING_FREE, files, "step.c")
    here = c_library.Path(c_library.__file__).with_name("c")
    driver = "\n".join((here / name).read_text() for name in c_library.DRIVER_FILES)
    c_compiler.compile_library(c_compiler.compiler(), WARNING_FREE, {"run.c": driver}, "run.c")


# CasADi writes helpers that not every function needs
WARNING_FREE = ("-Wall", "-Werror", "-Wno-unused-function", "-shared", "-fPIC", "-std=c11")


def test_a_compiler_without_room_is_an_error_of_the_machine(tmp_path):
    """Not a fault of the sources: the command says that the disk is full."""
    compiler = tmp_path / "cc"
    compiler.write_text(f"#!/bin/sh\necho 'a.c: fatal error: {os.strerror(errno.ENOSPC)}' >&2\nexit 1\n")
    compiler.chmod(0o755)
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)) as full:
        c_compiler.compile_library(str(compiler), [], {"a.c": ""}, "a.c")
    assert "no space is left" in str(of_the_machine(full.value))


def test_too_many_open_files_are_an_error_of_the_machine_and_no_fault_of_the_compiler(tmp_path, monkeypatch):
    """Nothing else would work either: one line, not a note and a line."""

    def full(*_, **__):
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr(c_compiler.subprocess, "Popen", full)
    with pytest.raises(OSError, match=os.strerror(errno.EMFILE)) as fault:
        c_compiler.works(str(tmp_path / "cc"))
    assert "too many files are open" in str(of_the_machine(fault.value))


@compiles
def test_a_library_that_a_compiler_leaves_cut_off_is_not_kept(cache, tmp_path, monkeypatch):
    """It passes the trial, and says that all is well."""
    compiler = tmp_path / "cc"
    cut = 'case "$*" in *step.c*) head -c 9000 made.so > short && mv short made.so;; esac'
    compiler.write_text(f'#!/bin/sh\n{c_compiler.compiler()} "$@" || exit 1\n[ "$1" = --version ] || {cut}\n')
    compiler.chmod(0o755)
    monkeypatch.setattr(c_library, "compiler", lambda: str(compiler))
    assert c_compiler.fault_of(str(compiler)) == ""
    assert made() is None
    assert list(cache.iterdir()) == []
