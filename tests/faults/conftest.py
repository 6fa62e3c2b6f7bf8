"""The fault table is a package in this folder; ``run.py`` starts it from a terminal."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
