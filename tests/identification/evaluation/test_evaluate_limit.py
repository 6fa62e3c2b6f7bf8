"""Where the kinematic model ends: known for simulated cars, not stated where nothing shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.evaluation import kinematic, kinematic_limit
from dart_lab.identification.evaluation.limit import find_limits
from dart_lab.identification.evaluation.noslip import SLIP_TOLERANCE, crossing
from dart_lab.identification.evaluation.takeover import Gain, Takeover, TakeoverBin
from dart_lab.identification.prediction.windows import find_windows

L_R = PAPER.body.l_r


@pytest.fixture
def ramps(driven):
    """Slow throttle ramps at four held steering commands, driven by a vehicle."""
    def make(p=PAPER):
        return [driven(p, file=f"ramp {s}", seconds=60.0, throttle=0.215, steering=s, speed=0.5,
                       ramp=0.0013) for s in (0.35, -0.35, 0.5, -0.5)]
    return make


@pytest.mark.parametrize(("value", "expected"), [
    ([0.0, 1.0, 3.0], 1.5), ([0.0, 1.0, 1.9], np.nan), ([3.0, 4.0, 5.0], 0.0),
    ([0.0, 3.0, 1.0], np.nan), ([0.0, 3.0, 1.0, 4.0], 2.0 + 1.0 / 3.0),
    ([0.0, np.nan, 4.0], 1.0), ([np.nan] * 3, np.nan)])
def test_crossing_is_where_it_is_passed_for_good(value, expected):
    at = np.arange(len(value), dtype=float)
    found = crossing(at, np.array(value), 2.0)
    assert found == pytest.approx(expected, nan_ok=True)


@pytest.mark.slow
def test_slip_of_a_linear_rear_tyre_is_found(ramps):
    """In steady turns the rear slips by m l_f a / (l C_r)."""
    b, tyre = PAPER.body, PAPER.tyres
    per = b.mass * b.l_f / b.wheelbase / tyre.rear_cornering_stiffness
    slip, _ = find_limits(ramps(), L_R)
    assert slip.value == pytest.approx(SLIP_TOLERANCE / per, rel=0.08)
    assert slip.low <= slip.value <= slip.high
    assert slip.is_supported
    assert slip.recordings == 4


@pytest.mark.slow
def test_the_mounting_angle_is_not_slip(ramps):
    def turned(case, angle):
        g = case.grid
        c, s = np.cos(angle), np.sin(angle)
        return replace(case, grid=replace(g, v_x=c * g.v_x - s * g.v_y,
                                          v_y=s * g.v_x + c * g.v_y))

    cases = ramps()
    straight = find_limits(cases, L_R)[0].value
    assert find_limits([turned(c, 0.02) for c in cases], L_R)[0].value == pytest.approx(straight,
                                                                                       rel=0.03)


@pytest.mark.slow
def test_a_car_without_slip_has_no_limit_and_none_is_stated(ramps):
    limit = kinematic_limit(PAPER, ramps(kinematic(PAPER)))
    assert np.isnan(limit.slip.value)
    assert np.isnan(limit.curvature.value)
    assert not limit.slip.is_supported
    words = limit.sentences()
    assert "no limit in lateral acceleration is stated" in words[0]
    assert "no limit in speed is stated" in words[1]
    assert limit.to_json()["holds_to"]["speed"]["supported"] is False


@pytest.mark.slow
def test_loss_of_curvature_is_found_at_its_speed(empty):
    def case(k, slow=0.35):
        n = 9000
        v = np.linspace(slow, 2.5, n)
        g = replace(empty(n), v_x=v, omega=k / (1.0 + (v / 5.0)**2) * v, steering=np.full(n, k))
        return driven_case(f"{k}", g)

    def driven_case(file, g):
        from dart_lab.identification.evaluation import Case
        return Case(file, g, find_windows(g))

    _, loss = find_limits([case(k) for k in (0.6, 0.9, -1.2, 1.5)], L_R)
    usual = 1.0 / (1.0 + (0.575 / 5.0)**2)
    assert loss.value == pytest.approx(5.0 * np.sqrt(1.0 / (0.95 * usual) - 1.0), rel=0.01)
    accel, speed = loss.spread()
    assert speed < 0.02 < 0.2 < accel, "this law goes by speed, and the spread shows it"


def test_one_recording_gives_no_interval(ramps):
    slip, _ = find_limits(ramps()[:1], L_R)
    assert np.isfinite(slip.value)
    assert np.isnan(slip.low)
    assert not slip.is_supported


@pytest.mark.slow
def test_the_right_dynamic_model_takes_over_and_a_wrong_one_is_not_reported_to(ramps):
    limit = kinematic_limit(PAPER, ramps())
    found = {(t.channel, t.by): t for t in limit.takeover}
    assert found["vy", "lateral_acceleration"].taken_from <= 1.5
    assert found["yaw_rate", "lateral_acceleration"].taken_from <= 2.5
    rolling = kinematic_limit(PAPER, ramps(kinematic(PAPER)))
    assert all(np.isnan(t.taken_from) for t in rolling.takeover)
    assert "better in none of" in rolling.sentences()[2]


@pytest.mark.slow
def test_bins_that_are_better_are_not_denied_where_the_top_is_thin(ramps):
    """A picture with shaded bins with "nothing better" would contradict itself."""
    limit = kinematic_limit(PAPER, ramps())
    good, thin, even = (Gain(0.5, 0.3, 0.7, 9, "recordings"),
                        Gain(0.8, np.nan, np.nan, 2, "recordings"),
                        Gain(0.1, -0.1, 0.3, 9, "recordings"))

    def describe_limit(*gains):
        bins = tuple(TakeoverBin(k, k + 1.0, 99, 1.0, 0.5, g) for k, g in enumerate(gains))
        return replace(limit, takeover=(Takeover("vy", "speed", bins),)).sentences()[2]

    assert "better in 2 of 3 bins" in describe_limit(good, good, thin)
    assert "above these too few recordings for an interval" in describe_limit(good, good, thin)
    assert "above these the interval holds 0 as well" in describe_limit(good, even)
    assert "better in none of 2 bins" in describe_limit(even, thin)
    assert "from 1 m/s" in describe_limit(thin, good)


def test_edges_need_certainty_all_the_way():
    def bins(*lows):
        return tuple(TakeoverBin(k, k + 1.0, 99, 1.0, 1.0, Gain(low + 0.1, low, low + 0.2, 9, "x"))
                     for k, low in enumerate(lows))

    t = Takeover("vy", "speed", bins(-0.1, -0.05, 0.1, -0.02, 0.2, 0.3))
    assert (t.holds_to, t.taken_from) == (2.0, 4.0)
    certain = Takeover("vy", "speed", bins(0.1, 0.2))
    assert np.isnan(certain.holds_to)
    assert certain.taken_from == 0.0
    few = Takeover("vy", "speed", (replace(bins(0.1)[0],
                                           gain=Gain(0.5, np.nan, np.nan, 1, "x")),))
    assert np.isnan(few.holds_to)
    assert np.isnan(few.taken_from)


@pytest.mark.slow
def test_the_legend_explains_only_what_is_drawn(ramps):
    pytest.importorskip("matplotlib")
    from dart_lab.identification.evaluation.picture_limit import draw_limit

    limit = kinematic_limit(PAPER, ramps())

    def legend(gain):
        bins = (TakeoverBin(0.0, 1.0, 99, 1.0, 1.0, gain),)
        figure = draw_limit(replace(limit, takeover=(Takeover("vy", "speed", bins),)))
        return {t.get_text() for axes in figure.axes[2:] for t in axes.get_legend().get_texts()}

    both = {"kinematic", "dynamic"}
    assert legend(Gain(0.5, 0.3, 0.7, 9, "x")) == both | {"dynamic better, 95 %"}
    assert legend(Gain(-0.5, -0.7, -0.3, 9, "x")) == both | {"kinematic better, 95 %"}
    assert legend(Gain(0.0, -0.2, 0.2, 9, "x")) == both
