"""Damaged and hostile files through every reader; `benchmarks/faults.py` runs for longer.

RTSR_FUZZ_SECONDS makes it run for so long (30 by default), RTSR_FUZZ_SEED with other cases.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "faults.py"
SECONDS, LONGEST_IN_CI = 30.0, 60.0


@pytest.fixture(scope="module")
def faults() -> ModuleType:
    """The script as a module: one set of cases, for a minute here and for hours there."""
    spec = importlib.util.spec_from_file_location("rtsr_faults", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_no_fault_ends_in_a_traceback_another_exit_code_or_a_file_outside_of_out(
    faults: ModuleType, tmp_path: Path
) -> None:
    seconds = float(os.environ.get("RTSR_FUZZ_SECONDS", SECONDS))
    if os.environ.get("CI"):
        seconds = min(seconds, LONGEST_IN_CI)
    seed = int(os.environ.get("RTSR_FUZZ_SEED", "1"))
    report = faults.run_faults(tmp_path, seconds=seconds, seed=seed)
    assert report.failures == []
    refused = sum(count for (_, code), count in report.counts.items() if code)
    assert sum(report.counts.values()) > refused > 0


def test_a_case_is_the_same_each_time(faults: ModuleType) -> None:
    cases = [faults.list_cases(3, None) for _ in range(2)]
    first, again = ([next(listed) for _ in range(40)] for listed in cases)
    assert first == again
    assert {kind for kind, _ in first} == set(faults.KINDS)
