"""Laws of the steering map and of the error feedback."""

from __future__ import annotations

from itertools import accumulate

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dart_hal.core.config import SteeringTable
from dart_hal.core.errors import NotMonotone
from dart_hal.devices.actuation import Quantiser, steering_map
from dart_hal.devices.actuation.pchip import Pchip
from dart_hal.devices.actuation.quantiser import count_us, prescale_for
from tests.devices.actuation.pwm_world import car_files

steps = st.lists(st.floats(0.01, 1.0), min_size=2, max_size=15)


@st.composite
def curves(draw: st.DrawFn) -> Pchip:
    dx, sign = draw(steps), draw(st.sampled_from((1.0, -1.0)))
    dy = draw(st.lists(st.floats(0.01, 1.0), min_size=len(dx), max_size=len(dx)))
    x = [1000 + 100 * v for v in accumulate(dx, initial=0.0)]
    return Pchip(x, [sign * v for v in accumulate(dy, initial=-1.0)])


@given(curves(), st.floats(0, 1))
def test_the_inverse_of_the_map_is_its_inverse(curve: Pchip, u: float) -> None:
    x = curve.x[0] + u * (curve.x[-1] - curve.x[0])
    y = curve(x)
    assert curve(curve.inverse(y)) == pytest.approx(y, abs=1e-12)
    assume(abs(curve.slope(x)) > 1e-6)
    assert curve.inverse(y) == pytest.approx(x, abs=1e-6)


@given(curves(), st.floats(0, 1), st.floats(0, 1))
def test_the_map_never_turns_back(curve: Pchip, u: float, v: float) -> None:
    a, b = sorted(curve.x[0] + w * (curve.x[-1] - curve.x[0]) for w in (u, v))
    sign = 1 if curve.y[-1] > curve.y[0] else -1
    assert sign * (curve(b) - curve(a)) >= -1e-12


@given(curves())
def test_the_map_goes_through_its_points(curve: Pchip) -> None:
    assert [curve(x) for x in curve.x] == pytest.approx(list(curve.y), abs=1e-12)


@given(curves(), st.floats(0, 1))
def test_the_map_is_the_pchip_that_scipy_computes(curve: Pchip, u: float) -> None:
    from scipy.interpolate import PchipInterpolator

    x = curve.x[0] + u * (curve.x[-1] - curve.x[0])
    other = PchipInterpolator(curve.x, curve.y)
    assert curve(x) == pytest.approx(float(other(x)), abs=1e-9)
    assert curve.slope(x) == pytest.approx(float(other.derivative()(x)), abs=1e-8)


@pytest.mark.parametrize(("x", "y"), [([1, 2, 3], [1, 3, 2]), ([1, 3, 2], [1, 2, 3]),
                                      ([1, 2], [1, 1]), ([1], [1]), ([1, 2], [1, 2, 3])])
def test_points_that_turn_back_make_no_map(x, y) -> None:
    with pytest.raises(NotMonotone):
        Pchip(x, y)


def test_without_a_calibration_the_papers_map_is_used_and_reported() -> None:
    """Angles of the paper's map at -1, -0.5, 0, 0.5, 1, from its five numbers."""
    paper = steering_map(car_files().config, None)
    assert not paper.calibrated
    assert [paper.angle_of(s) for s in (-1, -0.5, 0, 0.5, 1)] == pytest.approx(
        [-0.350532, -0.250762, 0.011022, 0.228342, 0.307543], abs=1e-6)
    assert paper.pulse(paper.angle_of(0.3)) == pytest.approx(1560 + 375 * 0.3, abs=1e-6)


def test_a_measured_map_that_falls_with_the_pulse_steers_the_same_way() -> None:
    table = SteeringTable(pulse_us=(1200.0, 1500.0, 1800.0), angle_rad=(0.3, 0.0, -0.3),
                          std_rad=(0.01, 0.01, 0.01))
    falling = steering_map(car_files().config, table)
    assert falling.calibrated
    assert falling.pulse(0.15) < 1500 < falling.pulse(-0.15)
    assert (falling.lowest, falling.highest) == (-0.3, 0.3)
    assert falling.pulse(9.0) == 1200.0


COUNT = count_us(121, 25e6)


def test_one_count_is_4_88_us_at_prescale_121() -> None:
    assert prescale_for(50.0) == 121
    assert pytest.approx(4.88) == COUNT


@given(st.lists(st.floats(1000, 2000), min_size=1, max_size=200),
       st.floats(24e6, 27e6))
def test_no_pulse_is_more_than_one_count_off(pulses: list[float], hertz: float) -> None:
    quantiser = Quantiser(count_us(121, hertz))
    for pulse in pulses:
        assert abs(quantiser.step(pulse) * quantiser.count - pulse) <= quantiser.count + 1e-9


@given(st.floats(1000, 2000), st.integers(0, 100))
def test_the_mean_over_a_second_is_within_a_twentieth_of_a_us(pulse: float,
                                                              first_count: int) -> None:
    quantiser = Quantiser(COUNT)
    for _ in range(first_count):
        quantiser.step(pulse)
    sent = [quantiser.step(pulse) * COUNT for _ in range(100)]
    assert abs(sum(sent) / 100 - pulse) < 0.05
    one = [quantiser.step(pulse) * COUNT for _ in range(50)]
    assert abs(sum(one) / 50 - pulse) < 0.1


@given(st.floats(1000, 2000))
def test_peek_returns_what_step_returns(pulse: float) -> None:
    quantiser = Quantiser(COUNT)
    for _ in range(5):
        assert quantiser.peek(pulse) == quantiser.step(pulse)


def test_rounding_without_feedback_would_miss_the_mean() -> None:
    """The negative control of the law above: 1500 us is 1.84 us off for ever."""
    assert abs(Quantiser(COUNT).rest(1500.0) * COUNT - 1500.0) > 1.8
