"""The documents: links lead somewhere, tables can be read, figures have a script."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "benchmarks/README.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
README_LINES = 140
TABLE_COLUMNS = 12

LINK = re.compile(r"\]\(([^)\s]+)\)")
SCRIPT = re.compile(r"benchmarks/\w+\.py")
MODULE = re.compile(r"(?<![\w/])(?:rtsr_cli/)?((?:api|commands|core|models)/[\w/]+\.py)\b")
CODE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


def prose(document: Path) -> str:
    """A document without its blocks of code."""
    return CODE.sub("", document.read_text(encoding="utf-8"))


def anchors(document: Path) -> set[str]:
    """Names that a page gives its headings."""
    titles = re.findall(r"^#+ (.+)$", prose(document), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def name(document: Path) -> str:
    return str(document.relative_to(ROOT))


@pytest.mark.parametrize("document", DOCUMENTS, ids=name)
def test_relative_links_lead_to_files_and_headings(document):
    for link in LINK.findall(prose(document)):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (document.parent / path).resolve() if path else document
        assert target.exists(), f"{link}: no such file"
        assert not anchor or anchor in anchors(target), f"{link}: no such heading"


@pytest.mark.parametrize("document", DOCUMENTS, ids=name)
def test_tables_can_be_read(document):
    for line in prose(document).splitlines():
        if line.startswith("|"):
            assert len(re.findall(r"(?<!\\)\|", line)) - 1 <= TABLE_COLUMNS, line


@pytest.mark.parametrize("document", DOCUMENTS, ids=name)
def test_scripts_that_documents_name_exist(document):
    for script in SCRIPT.findall(document.read_text(encoding="utf-8")):
        assert (ROOT / script).is_file(), script


@pytest.mark.parametrize("document", DOCUMENTS, ids=name)
def test_modules_that_documents_name_exist(document):
    for module in MODULE.findall(document.read_text(encoding="utf-8")):
        assert (ROOT / "rtsr_cli" / module).is_file(), module


def test_the_readme_is_short():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= README_LINES


def test_every_document_can_be_reached_from_the_readme():
    reached, waiting = set(), [ROOT / "README.md"]
    while waiting:
        document = waiting.pop()
        reached.add(document)
        for link in LINK.findall(prose(document)):
            target = (document.parent / link.partition("#")[0]).resolve()
            if target.suffix == ".md" and target.is_file() and target not in reached:
                waiting.append(target)
    assert set(DOCUMENTS) <= reached


@pytest.mark.parametrize(
    ("script", "figures", "document"),
    [
        ("results_text.py", "results/systems.csv", "results.md"),
        ("vrs_text.py", "results", "vrs.md"),
    ],
)
def test_tables_say_what_the_files_of_figures_say(script, figures, document, tmp_path):
    written = tmp_path / document
    kept = (ROOT / "docs" / document).read_text(encoding="utf-8")
    written.write_text(kept, encoding="utf-8")
    command = [ROOT / "benchmarks" / script, ROOT / "docs" / figures, "--output", written]
    subprocess.run([sys.executable, *map(str, command)], check=True, capture_output=True)
    assert written.read_text(encoding="utf-8") == kept
