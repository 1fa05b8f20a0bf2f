"""The lines of docs/python.md, run as they stand beside the sample frames."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rtsr_cli.api import PLACES

ROOT = Path(__file__).resolve().parents[1]

BLOCK = re.compile(r"^## (.+?)\n.*?^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)

BLOCKS = dict(BLOCK.findall((ROOT / "docs" / "python.md").read_text(encoding="utf-8")))
"""Title -> lines, in the order in which they are run."""


@pytest.fixture(scope="module")
def folder(sample_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds the sample, in which all blocks run."""
    place = tmp_path_factory.mktemp("python")
    (place / "sample_data").symlink_to(sample_root)
    return place


@pytest.mark.parametrize("title", BLOCKS)
def test_the_lines_of_a_call_run(
    title: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if title == "export":
        pytest.importorskip("onnxscript", reason="the extra export is not installed")
    monkeypatch.chdir(folder)
    exec(compile(BLOCKS[title], "docs/python.md", "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out.strip()


def test_every_call_has_its_lines_and_none_is_long() -> None:
    calls = {name for name in PLACES if name.islower()}
    written = "\n".join(BLOCKS.values())
    assert all(re.search(rf"\b{call}\(", written) for call in calls)
    counts = {
        title: len(lines.replace("\n\n", "\n").splitlines()) for title, lines in BLOCKS.items()
    }
    assert max(counts.values()) == 5
