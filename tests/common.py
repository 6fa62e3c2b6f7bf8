"""Paths, URLs and numbers that tests of several folders use."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HOST = ROOT / "host"
HARDWARE = ROOT / "hardware"
WIRING = HARDWARE / "wiring"
EXCERPT = ROOT / "tests" / "recorded" / "data"

# Simulated cars on the mock of the Nano; the number is the seed.
MOCK_URL = "sim://?nano=mock"
MOCK_1_URL = "sim://?seed=1&nano=mock"
MOCK_2_URL = "sim://?seed=2&nano=mock"
MOCK_3_URL = "sim://?seed=3&nano=mock"
MOCK_4_URL = "sim://?seed=4&nano=mock"
MOCK_7_URL = "sim://?seed=7&nano=mock"
KINEMATIC_URL = "sim://?nano=mock&physics=kinematic"
KINEMATIC_1_URL = "sim://?nano=mock&physics=kinematic&seed=1"
KINEMATIC_3_URL = "sim://?seed=3&nano=mock&physics=kinematic"
MAPPED_ROOM_URL = "sim://?seed=0&nano=mock&lidar=1&map=room"
SEEDED_URL = "sim://?nano=mock&seed="

# Pulse at the ESC, and how far a neutral one may be from it.
NEUTRAL_US = 1500.0
NEUTRAL_TOLERANCE_US = 5.0

# Gates that a simulated car without a calibration does not pass.
WAIVED_GATES = ("CALIBRATION_MISSING", "PWM_CLOCK_UNCALIBRATED")

# For processes on a busy computer.
PROCESS_TIMEOUT_S = 30.0
