"""The cache of compiled libraries: what is wrong in it is made anew, what others may write to is not loaded."""

import os

import casadi as ca
import pytest
from needs import compiles

from modelling.simulation import compiled as c_library

SOURCE = "double answer(void) { return 42.0; }\n"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    path = tmp_path / "cache"
    monkeypatch.setenv("RIGMATCH_CACHE", str(path))
    c_library.folder.cache_clear()
    yield path
    c_library.folder.cache_clear()


def made(source=SOURCE):
    return c_library.shared(source, "-O1")


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
def test_what_others_may_write_to_is_not_loaded(cache):
    path = made()
    path.chmod(0o666)
    assert made().stat().st_mode & 0o777 == 0o600
    cache.chmod(0o777)
    c_library.folder.cache_clear()
    assert made().parent != cache


@compiles
def test_an_entry_that_cannot_be_loaded_is_made_anew(cache, monkeypatch):
    """Its checksum is right, as where another system with the same compiler wrote it."""
    load, path, failed = c_library.ctypes.CDLL, made(), []

    def fails_once(name):
        if not failed:
            failed.append(name)
            raise OSError("wrong ELF class")
        return load(name)

    monkeypatch.setattr(c_library.ctypes, "CDLL", fails_once)
    library = c_library.library_of(SOURCE, "-O1", ["answer"])
    library.answer.restype = c_library.ctypes.c_double
    assert library.answer() == 42.0
    assert failed == [str(path)]


@compiles
def test_a_whole_entry_is_neither_compiled_nor_written_again(cache, monkeypatch):
    path = made()
    before = path.stat()
    monkeypatch.setattr(c_library, "compile_library", lambda *_: pytest.fail("compiled again"))
    assert made() == path
    assert path.stat().st_ino == before.st_ino


@compiles
def test_what_is_compiled_raises_no_warning():
    x = ca.SX.sym("x", 3)
    smooth = ca.Function("smooth", [x], [ca.fmax(ca.sin(x), x**2), ca.fmin(x[0], x[1])])
    files = {"step.c": c_library.generated(smooth)}
    c_library.compile_library(c_library.compiler(), WARNING_FREE, files, "step.c")
    here = c_library.Path(c_library.__file__).with_name("c")
    driver = "\n".join((here / name).read_text() for name in c_library.DRIVER_FILES)
    c_library.compile_library(c_library.compiler(), WARNING_FREE, {"run.c": driver}, "run.c")


# CasADi writes helpers that not every function needs
WARNING_FREE = ("-Wall", "-Werror", "-Wno-unused-function", "-shared", "-fPIC", "-std=c11")
