"""Hypothesis profiles, and the folders that tests read."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).resolve().parents[1]

settings.register_profile("local", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True, database=None, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")


@pytest.fixture(scope="session")
def sample_root() -> Path:
    """Frames that come with the project."""
    return ROOT / "sample_data"


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Rendered sequences that lie beside the project on some machines."""
    folder = ROOT.parent / "shared" / "data"
    if not (folder / "manifest.json").is_file():
        pytest.skip("the rendered sequences (shared/data beside the project) are not here")
    return folder
