"""The published parameter sets of DART, under the names that ``--model`` takes.

``paper``: the values of the paper's own code, exact. ``paper-printed``: what
its table has. ``upstream-2024``: a later set of the same authors. They were
fitted on different recordings; none of them is the truth of any car. The
files are in ``published/`` and state the source of each number.
"""

from __future__ import annotations

import math
from pathlib import Path

from dart_hal.core.config import load_model
from dart_hal.vehicle.file import vehicle_from
from dart_hal.vehicle.parameters import Vehicle

PER_DEGREE = 180.0 / math.pi
"""The paper's tyre values are per degree of slip angle; files hold them per rad."""
FOLDER = Path(__file__).parent / "published"


def _load_published(name: str) -> Vehicle:
    return vehicle_from(load_model(FOLDER / f"{name}.toml"))


PAPER = _load_published("paper")
PAPER_PRINTED = _load_published("paper-printed")
UPSTREAM_2024 = _load_published("upstream-2024")
SETS = {v.name: v for v in (PAPER, PAPER_PRINTED, UPSTREAM_2024)}
