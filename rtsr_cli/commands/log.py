"""What commands say to a person."""

from __future__ import annotations

import logging

LOG = logging.getLogger("rtsr")
"""`-q` and `-v` set its level, `--json` takes its place."""
