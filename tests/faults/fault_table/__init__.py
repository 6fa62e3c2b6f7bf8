"""The fault table: every fault, its limit at the ESC pin, and the layer that keeps it."""

import sys
from pathlib import Path

for room in ("firmware", "wire"):  # firmware_rig, wire_samples
    sys.path.append(str(Path(__file__).resolve().parents[2] / room))
