"""The system of docs/add-a-system.md, put together from the page as it stands there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import rtsr_cli
from rtsr_cli import models
from rtsr_cli.core.files.exr import read_header
from rtsr_cli.core.network.cost import count_parameters
from rtsr_cli.core.network.weights import read_weights
from rtsr_cli.models import SystemRow, load_system

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "add-a-system.md").read_text(encoding="utf-8")

BLOCKS = re.findall(r"^## \d\. (.+?)\n.*?^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
"""(heading, code) of every step."""

FILES = {
    found[1]: code
    for heading, code in BLOCKS
    if (found := re.search(r"`(sharpened/\w+\.py)`", heading))
}

(ROW,) = (code for heading, code in BLOCKS if "`ROWS`" in heading)

CONFORMANCE = """
import sys
import pytest
from rtsr_cli import models
from rtsr_cli.models import SystemRow

models.__path__.append(sys.argv[1])
models.ROWS = (*models.ROWS, {row})
sys.exit(pytest.main(sys.argv[2:]))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What would be `rtsr_cli/models/`, with the page's folder in it."""
    place = tmp_path_factory.mktemp("models")
    for name, code in FILES.items():
        path = place / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(code, encoding="utf-8")
    return place


@pytest.fixture
def _added(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The page's system among the package's."""
    row = eval(ROW, {"SystemRow": SystemRow})
    monkeypatch.setattr(models, "__path__", [*models.__path__, str(folder)])
    monkeypatch.setattr(models, "ROWS", (*models.ROWS, row))
    yield
    for name in [name for name in sys.modules if name.startswith("rtsr_cli.models.sharpened")]:
        del sys.modules[name]


def test_the_page_shows_a_folder_of_the_usual_shape() -> None:
    names = {"__init__", "config", "inputs", "network", "loss"}
    assert FILES.keys() == {f"sharpened/{name}.py" for name in names}


def test_the_system_keeps_the_rules_for_all(folder: Path) -> None:
    tests = "tests/models/test_systems.py"
    chosen = ["-q", "-p", "no:cacheprovider", "-k", "sharpened", tests]
    result = subprocess.run(
        [sys.executable, "-P", "-c", CONFORMANCE.format(row=ROW), str(folder), *chosen],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(Path(rtsr_cli.__file__).parents[1])},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    passed = re.search(r"(\d+) passed", result.stdout)
    assert passed and int(passed[1]) >= 14, result.stdout


@pytest.mark.usefixtures("_added")
def test_it_is_trained_and_upscales_by_the_lines_of_the_page(
    sample_root: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "sample_data").symlink_to(sample_root)
    monkeypatch.chdir(tmp_path)
    (lines,) = (code for heading, code in BLOCKS if heading == "Train and run")
    exec(compile(lines, "docs/add-a-system.md", "exec"), {"__name__": "__main__"})
    assert "TrainingDone" in capsys.readouterr().out
    frames = sorted((tmp_path / "out").rglob("*.exr"))
    assert len(frames) == 6
    assert {read_header(path).attributes["rtsr:system"] for path in frames} == {"sharpened"}
    weights = read_weights(tmp_path / "run" / "best.safetensors")
    assert (weights.system, weights.scale) == ("sharpened", 4)
    assert any(bool(tensor.any()) for name, tensor in weights.tensors.items() if "layers.2" in name)


@pytest.mark.usefixtures("_added")
def test_its_network_is_as_small_as_it_looks() -> None:
    system = load_system("sharpened")
    network = system.build(system.config(), 4)
    assert count_parameters(network) == (27 + 1) * 16 + (144 + 1) * 3
