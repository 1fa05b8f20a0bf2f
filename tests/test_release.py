"""What is released: a wheel and a source distribution of this tree, held to what they promise."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from email.message import Message
from email.parser import Parser
from importlib.util import find_spec
from pathlib import Path

import pytest

import rtsr_cli

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NAME = f"rtsr-{rtsr_cli.__version__}"

TAKEN_ALONG = ("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE", "CHANGELOG.md")
"""Files of the tree that a build looks at."""

LARGEST_BYTES = 20 << 20
"""Of either file: 9 MB are weights."""

SETUPTOOLS = 77
"""The first that knows `license = "MIT"`."""

BUILD = """
import sys
import setuptools.build_meta as backend
out, *kinds = sys.argv[1:]
for kind in kinds:
    getattr(backend, "build_" + kind)(out)
"""


def run(*command: object, cwd: Path | None = None) -> str:
    environment = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "PYTHONHOME"}}
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, env=environment, capture_output=True, text=True,
        check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def can_build() -> bool:
    if find_spec("setuptools") is None:
        return False
    version = run(sys.executable, "-c", "import setuptools; print(setuptools.__version__)")
    return int(version.partition(".")[0]) >= SETUPTOOLS


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the wheel and the source distribution, built of a copy of the tree."""
    if not can_build():
        pytest.skip(f"setuptools {SETUPTOOLS} or newer is not installed (it is in rtsr[dev])")
    tree, out = tmp_path_factory.mktemp("tree"), tmp_path_factory.mktemp("dist")
    dropped = shutil.ignore_patterns("__pycache__", "*.pyc")
    for folder in ("rtsr_cli", "tests", "benchmarks", "examples"):
        shutil.copytree(ROOT / folder, tree / folder, ignore=dropped)
    for name in (*TAKEN_ALONG, "CONTRIBUTING.md", "constraints.txt"):
        shutil.copy(ROOT / name, tree)
    run(sys.executable, "-c", BUILD, out, "wheel", "sdist", cwd=tree)
    return out


def list_package() -> set[str]:
    return {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "rtsr_cli").rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }


def names_of(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def metadata_of(wheel: Path) -> Message:
    with zipfile.ZipFile(wheel) as archive:
        text = archive.read(f"{NAME}.dist-info/METADATA").decode()
    return Parser().parsestr(text)


def wheel_of(built: Path) -> Path:
    return built / f"{NAME}-py3-none-any.whl"


def test_a_wheel_holds_the_package_and_what_describes_it(built: Path) -> None:
    described = {
        f"{NAME}.dist-info/{name}"
        for name in (
            "METADATA", "WHEEL", "RECORD", "entry_points.txt", "top_level.txt", "licenses/LICENSE",
        )
    }  # fmt: skip
    assert names_of(wheel_of(built)) == list_package() | described
    assert wheel_of(built).stat().st_size < LARGEST_BYTES


def test_a_source_distribution_holds_what_builds_the_package(built: Path, tmp_path: Path) -> None:
    path = built / f"{NAME}.tar.gz"
    assert path.stat().st_size < LARGEST_BYTES
    with tarfile.open(path) as archive:
        names = {name.removeprefix(f"{NAME}/") for name in archive.getnames()}
        archive.extractall(tmp_path, filter="data")
    files = {name for name in names if (tmp_path / NAME / name).is_file()}
    own = {name for name in files if not name.startswith("rtsr.egg-info/")}
    beside = {"setup.cfg", "PKG-INFO", "CONTRIBUTING.md", "constraints.txt"}
    assert own == list_package() | set(TAKEN_ALONG) | beside
    run(sys.executable, "-c", BUILD, tmp_path, "wheel", cwd=tmp_path / NAME)
    assert names_of(tmp_path / wheel_of(built).name) == names_of(wheel_of(built))


def test_the_metadata_are_those_of_the_project(built: Path) -> None:
    metadata = metadata_of(wheel_of(built))
    assert metadata["Name"] == "rtsr"
    assert metadata["Version"] == rtsr_cli.__version__ == PROJECT["version"]
    assert metadata["License-Expression"] == "MIT"
    assert metadata["Requires-Python"] == PROJECT["requires-python"]
    assert metadata["Description-Content-Type"] == "text/markdown"
    assert metadata.get_payload() == (ROOT / "README.md").read_text(encoding="utf-8")
    assert metadata.get_all("Classifier") == PROJECT["classifiers"]
    assert set(metadata.get_all("Provides-Extra")) == set(PROJECT["optional-dependencies"])
    required = [r for r in metadata.get_all("Requires-Dist") if "extra ==" not in r]
    assert required == PROJECT["dependencies"]


def test_a_wheel_runs_where_nothing_of_the_tree_is(built: Path, tmp_path: Path) -> None:
    if find_spec("pip") is None:
        pytest.skip("pip is not installed")
    venv.create(tmp_path / "env", with_pip=False)
    programs = tmp_path / "env" / ("Scripts" if os.name == "nt" else "bin")
    python = programs / "python"
    install = ("--no-deps", "--no-index", "--no-compile", "--disable-pip-version-check")
    run(sys.executable, "-m", "pip", "--python", python, "install", *install, wheel_of(built))
    # what rtsr needs is where it is here, behind the environment's own packages
    where = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip()
    (Path(where) / "needs.pth").write_text(sysconfig.get_path("purelib") + "\n")
    found = run(python, "-c", "import rtsr_cli; print(rtsr_cli.__file__)", cwd=tmp_path)
    assert Path(found.strip()).is_relative_to(where)
    assert run(programs / "rtsr", "--version", cwd=tmp_path).split()[-1] == rtsr_cli.__version__
    listed = run(programs / "rtsr", "systems", "--card", "gather", cwd=tmp_path)
    assert "## Weights `gather-4x.safetensors`" in listed


def test_what_was_tested_is_pinned() -> None:
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {pin.partition("==")[0].lower() for pin in pins if "==" in pin}
    extras = [n for names in PROJECT["optional-dependencies"].values() for n in names]
    wanted = {r.partition(">=")[0].lower() for r in (*PROJECT["dependencies"], *extras)}
    own = {f"rtsr[{name}]" for name in PROJECT["optional-dependencies"]}
    assert wanted - pinned <= own
