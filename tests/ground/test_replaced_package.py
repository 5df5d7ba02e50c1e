"""Another distribution is also called ``matching``: where it hides or overwrites ours, one line says so."""

import os
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
COMMAND = "import sys, rigmatch; sys.exit(rigmatch.main())"
USE = "import rigmatch as rm; rm.load('vehicle.toml')"


def python(code: str, *words: str, path: Path) -> subprocess.CompletedProcess[str]:
    """Run code with a folder first on ``sys.path`` and the checkout after it."""
    surroundings = os.environ | {"PYTHONPATH": f"{path}{os.pathsep}{ROOT}"}
    return subprocess.run([sys.executable, "-P", "-c", code, *words], capture_output=True, text=True, env=surroundings)


def foreign_package(folder: Path, name: str, content: str) -> Path:
    (folder / name).mkdir(parents=True)
    (folder / name / "__init__.py").write_text(content)
    return folder


@pytest.mark.parametrize("name", ["matching", "modelling"])
@pytest.mark.parametrize("content", ["__version__ = '1.4.3'\n", "raise RuntimeError('needs a graph library')\n"])
def test_a_foreign_package_first_on_the_path_is_named_in_one_line(tmp_path: Path, name: str, content: str) -> None:
    foreign_package(tmp_path, name, content)
    done = python(COMMAND, "--version", path=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"rigmatch: the package {name!r} in {tmp_path / name} is not rigmatch's")
    used = python(USE, path=tmp_path)
    assert used.returncode == 1
    assert used.stderr.splitlines()[-1] == f"ImportError: {done.stderr.strip()}"


def test_without_a_foreign_package_the_command_answers(tmp_path: Path) -> None:
    done = python(COMMAND, "--version", path=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("rigmatch ")


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Wheel and source archive of this checkout, built offline."""
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", str(folder)], cwd=ROOT, check=True, capture_output=True
    )
    (wheel,), (source,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, source


def test_both_archives_hold_the_public_face_and_its_packages(archives: tuple[Path, Path]) -> None:
    wheel, source = archives
    with zipfile.ZipFile(wheel) as file:
        names = file.namelist()
    assert {"rigmatch.py", "matching/cli.py", "modelling/__init__.py"} <= set(names)
    assert {name.split("/")[0].split("-")[0] for name in names} == {"rigmatch.py", "rigmatch", "matching", "modelling"}
    with tarfile.open(source) as packed:
        inside = {name.split("/", 1)[1] for name in packed.getnames() if "/" in name}
    assert {"rigmatch.py", "matching/cli.py", "modelling/__init__.py", "README.md", "pyproject.toml"} <= inside


def foreign_wheel(folder: Path) -> Path:
    """A wheel of a distribution ``matching`` that holds one package of that name."""
    path = folder / "matching-1.4.3-py3-none-any.whl"
    info = "matching-1.4.3.dist-info"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("matching/__init__.py", "__version__ = '1.4.3'\n")
        file.writestr(f"{info}/METADATA", "Metadata-Version: 2.1\nName: matching\nVersion: 1.4.3\n")
        file.writestr(
            f"{info}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        file.writestr(f"{info}/RECORD", f"matching/__init__.py,,\n{info}/METADATA,,\n{info}/WHEEL,,\n{info}/RECORD,,\n")
    return path


def test_installed_over_ours_it_is_noticed_until_rigmatch_is_installed_again(
    archives: tuple[Path, Path], tmp_path: Path
) -> None:
    bare = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    venv.EnvBuilder(with_pip=False).create(tmp_path / "venv")
    folder = tmp_path / "venv" / ("Scripts" if os.name == "nt" else "bin")

    def pip(*words: str) -> None:
        installer = [sys.executable, "-m", "pip", "--python", str(tmp_path / "venv"), "--disable-pip-version-check"]
        subprocess.run([*installer, *words], env=bare, check=True, capture_output=True)

    def version() -> subprocess.CompletedProcess[str]:
        program = shutil.which("rigmatch", path=str(folder))
        assert program
        return subprocess.run([program, "--version"], env=bare, capture_output=True, text=True, cwd=tmp_path)

    ours = ["install", "--no-index", "--no-deps", "--force-reinstall", str(archives[0])]
    pip(*ours)
    assert version().returncode == 0
    pip("install", "--no-index", "--no-deps", str(foreign_wheel(tmp_path)))
    done = version()
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "the package 'matching'" in done.stderr
    pip("uninstall", "--yes", "matching")
    pip(*ours)
    assert version().returncode == 0
