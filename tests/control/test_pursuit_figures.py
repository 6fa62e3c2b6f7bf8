"""The published pure pursuit drives as an independent implementation of it did."""

from __future__ import annotations

import pytest

from studies.control.pursuit_figures import lap


@pytest.mark.parametrize(("speed", "predicted", "rms", "largest"), [
    (1.0, 0.165, 0.047, 0.089), (1.5, 0.165, 0.045, 0.086), (2.0, 0.165, 0.033, 0.074),
    (1.0, 0.0, 0.029, 0.053), (1.5, 0.0, 0.043, 0.106), (2.0, 0.0, 0.212, 0.554)])
@pytest.mark.slow_except("1.0-0.165-*", "2.0-0.0-*")
@pytest.mark.long_except("1.5-0.165-*")
def test_within_ten_percent(speed, predicted, rms, largest):
    assert lap(speed, 2.0, predicted) == pytest.approx((rms, largest), rel=0.1)
