"""Exit codes beside 0 (all done) and click's 2 (usage)."""

from __future__ import annotations

FAILED = 1
"""Some frames failed and the rest are done, or a demand is missed."""

REFUSED = 3
"""The input is refused."""
