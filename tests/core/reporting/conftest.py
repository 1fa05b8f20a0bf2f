"""Invented evaluations for the tests of the report."""

from __future__ import annotations

import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest

FAKE = Path(__file__).with_name("fake.py")


@pytest.fixture(scope="session")
def fake() -> SimpleNamespace:
    """The functions of fake.py."""
    return SimpleNamespace(**runpy.run_path(str(FAKE)))


@pytest.fixture(scope="session")
def page(fake: SimpleNamespace) -> str:
    """Three methods, two shots, 60 frames."""
    from rtsr_cli.core.reporting.report import html_report

    moments = [fake.moment("yard/stroll", 12, "worst by FLIP"), fake.moment("hall/turn", 40, "2.")]
    return html_report(fake.evaluation(), moments, [fake.strip("yard/stroll", 210)])
