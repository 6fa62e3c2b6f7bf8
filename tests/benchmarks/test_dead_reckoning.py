"""Dead reckoning where the beat of the IMU's clock meets the bends: the cars that it led astray."""

from __future__ import annotations

import pytest
from bench_room import score_dead_reckoning, simulate_drive
from scipy.stats import chi2


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "bend"), [(5, 7.0), (14, 7.0), (9, 5.0), (10, 5.0)])
@pytest.mark.long_except("5-7.0")
def test_a_minute_at_1_m_per_s_is_within_one_percent(seed: int, bend: float) -> None:
    """Without looks at the gyro 0.6, 1.5, 3.0 and 3.1 %, normalised error squared 14 to 18."""
    share, honest = score_dead_reckoning(simulate_drive(seed, 60.0, "", True, bend))
    assert share < 0.01
    assert honest < chi2.ppf(0.975, 3)
