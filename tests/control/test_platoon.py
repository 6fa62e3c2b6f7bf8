"""The laws of a platoon: gains to the digit, the safe rule on random scenarios, each with what
happens without it."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.control.platoon.detector import AttackDetector
from dart_hal.control.platoon.follower import Gap, PlatoonFollower, PlatoonMode
from dart_hal.control.platoon.gains import DART, STABLE, TRUCK, tune
from dart_hal.control.platoon.hearing import PredecessorReport, ReportFilter
from dart_hal.control.platoon.safe import (
    PendingCommands,
    SafetyMargins,
    integrate_motion,
    safe_acceleration,
)
from dart_hal.control.platoon.stability import peak_gain
from dart_hal.core.errors import UsageError
from studies.control.platoon_loop import Line, Scenario, drive, published, random_scenario

AS_PUBLISHED = {"rule": False, "compensated": False, "detects": False}
UNREADY = SafetyMargins(m=0.02)
NOISY = Line(noise=0.02, rate=8.0, wrong=0.03)
CAREFUL = SafetyMargins(e_g=0.05, e_v=0.03, m=0.02)


def worst(seeds, gains, dt=0.1, delay=0.1, line=None, margins=UNREADY, lasts=50.0, trust=1.0,
          **how):
    """Smallest gap [m] of each scenario, 5 followers."""
    out = []
    for seed in seeds:
        rng = np.random.default_rng([seed, 3])
        scenario = random_scenario(rng, gains, 5, lasts)
        lossy = replace(line, loss=rng.uniform(0.0, 0.5)) if line is not None else None
        gaps, _ = drive(
            scenario,
            lambda: PlatoonFollower(gains, dt, delay, margins, trust=trust, **how),
            5,
            lasts,
            dt=dt,
            delay=delay,
            line=lossy,
            rng=rng,
        )
        out.append(gaps.min())
    return np.array(out)


# -- gains and the published table --------------------------------------------------------------


@pytest.mark.parametrize(("gains", "k", "c", "h"), [
    (DART, 3.453287197231834, 4.834602076124567, 0.21042084168336672),
    (TRUCK, 0.7452239771646051, 2.637699545406491, 0.3787575150300601)])
def test_the_published_gains_to_the_digit(gains, k, c, h):
    assert gains.k == pytest.approx(k, abs=1e-12)
    assert gains.c == pytest.approx(c, abs=1e-12)
    assert gains.h == pytest.approx(h, abs=1e-12)


def test_gains_of_no_platoon_are_refused():
    with pytest.raises(UsageError, match="v_d 2"):
        tune(0.5, 2.0, -1.0, 1.0, 1.4)


def lie(t):
    return 1000.0


@pytest.mark.parametrize(("forward", "wave", "lied", "braked"), [
    ("", 0.290, 0.500, 0.290), ("all", 0.316, -19.4, -43.8), ("limited", 0.316, 0.025, -0.075)])
def test_the_published_law_in_the_published_steps(forward, wave, lied, braked):
    def least(**what):
        return published(DART, 9, 0.1, 50.0, forward=forward, **what).min()

    assert least(drive=lambda t: 0.8 * sin(2 * pi * t / 10)) == pytest.approx(wave, abs=6e-4)
    assert least(told=lie) == pytest.approx(lied, abs=6e-4)
    assert least(told=lie, brakes=25.0) == pytest.approx(braked, abs=0.06 if braked < -1 else 6e-4)


def test_no_collision_holds_for_small_steps_only():
    gaps = {dt: published(DART, 3, dt, 40.0, told=lie, brakes=25.0).min() for dt in (0.1, 0.01)}
    assert gaps[0.1] == pytest.approx(-0.075, abs=1e-3)
    assert gaps[0.01] == pytest.approx(0.0055, abs=1e-3)


# -- the safe rule -----------------------------------------------------------------------------


@given(gap=st.floats(0.0, 3.0), speed=st.floats(0.0, 1.4), lead_speed=st.floats(0.0, 1.4),
       dt=st.sampled_from([0.02, 0.05, 0.1]), brake=st.floats(0.5, 3.0), more=st.floats(1.0, 2.0))
def test_what_the_rule_allows_leaves_a_stop(gap, speed, lead_speed, dt, brake, more):
    margins = SafetyMargins(brake, more * brake, m=0.02)
    u = safe_acceleration(gap, 0.0, speed, lead_speed, dt, margins)
    if u == -inf or u < -brake:
        return
    way, w = integrate_motion(speed, u, dt)
    assert gap - way - w**2 / (2 * brake) + lead_speed**2 / (2 * more * brake) >= 0.02 - 1e-9
    way, w = integrate_motion(speed, u + 0.5, dt)
    if speed + u >= 0.0:
        assert gap - way - w**2 / (2 * brake) + lead_speed**2 / (2 * more * brake) < 0.02, "control"


@pytest.mark.slow
def test_the_rule_keeps_the_margin_at_every_delay_and_the_published_law_does_not():
    for delay in (0.1, 0.2):
        how = {"seeds": range(3), "gains": DART, "delay": delay, "lasts": 25.0, **AS_PUBLISHED}
        assert worst(**how).min() < 0.0, "control"
        assert worst(**{**how, "rule": True}).min() >= 0.02 - 1e-9


def test_a_brake_that_is_weaker_than_reported_ends_in_contact():
    scenario = Scenario(brakes=(12.0, inf), attacks={0: lie})

    def least(b_s):
        margins = SafetyMargins(b_s, 1.0, m=0.02)
        return min(
            drive(
                scenario,
                lambda: PlatoonFollower(
                    DART, 0.1, 0.1, margins, trust=1.0, detects=False, compensated=False
                ),
                1,
                16.0,
                dt=0.1,
                delay=0.1,
                line=Line(brake=(0.9, 1.0)),
                rng=np.random.default_rng(seed),
            )[0].min()
            for seed in range(8)
        )

    assert least(0.9) >= 0.02 - 1e-9
    assert least(1.0) < 0.0, "control"


@pytest.mark.slow
@pytest.mark.parametrize(("dt", "delay"), [(0.1, 0.0), (0.1, 0.1), (0.1, 0.2), (0.05, 0.1)])
@pytest.mark.long_except("0.1-0.1")
def test_more_scenarios_without_noise(dt, delay):
    ruled = worst(range(100, 140), DART, dt, delay, **{**AS_PUBLISHED, "rule": True})
    assert ruled.min() >= 0.02 - 1e-9
    assert worst(range(100, 140), DART, dt, delay, **AS_PUBLISHED).min() < 0.0, "control"


@pytest.mark.long
@pytest.mark.parametrize("gains", [DART, STABLE], ids=["published", "stable"])
def test_150_scenarios_with_noise_and_loss(gains):
    assert worst(range(150), gains, line=NOISY, margins=CAREFUL, trust=0.5).min() > 0.0
    bare = worst(range(150), DART, line=NOISY, margins=CAREFUL, trust=0.5, **AS_PUBLISHED)
    assert (bare <= 0.0).sum() > 30, "control"


@pytest.mark.slow
def test_noise_and_loss_end_in_no_contact():
    how = {"seeds": range(4), "gains": DART, "line": NOISY, "margins": CAREFUL, "trust": 0.5,
           "lasts": 25.0}
    assert worst(**how).min() > 0.0
    assert worst(**how, **AS_PUBLISHED).min() < 0.0, "control"


def test_trucks_on_their_own_scale():
    def least(**how):
        scenario = Scenario(brakes=(25.0, inf), attacks={0: lie})
        margins = SafetyMargins(7.848, 7.848, m=0.5)
        return drive(scenario, lambda: PlatoonFollower(TRUCK, 0.1, 0.1, margins, trust=1.0,
                                                       **{**AS_PUBLISHED, **how}), 3, 40.0,
                     dt=0.1, delay=0.1)[0].min()

    assert least(rule=True) >= 0.5 - 1e-6
    assert least() < -1.0, "control"
    gaps = [published(TRUCK, 3, 0.1, 60.0, told=lie, brakes=brakes).min() for brakes in (inf, 25.0)]
    assert gaps == [pytest.approx(1.0, abs=1e-3), pytest.approx(-1.5, abs=1e-3)]


# -- string stability ---------------------------------------------------------------------------


def test_disturbances_fade_along_the_string_at_delays_up_to_a_fifth_of_a_second():
    for delay in (0.0, 0.1, 0.2):
        assert peak_gain(STABLE, 0.05, delay, age=0.05) <= 1.005
        assert peak_gain(STABLE, 0.1, delay) <= 1.005
        assert peak_gain(STABLE, 0.1, delay, age=0.1) <= 1.005
    assert peak_gain(replace(STABLE, share=0.5), 0.1, 0.2, age=0.1) > 1.04, "control"
    assert peak_gain(DART, 0.1, 0.1, feed_forward=False) > 1.03, "control: the published headway"
    assert peak_gain(STABLE, 0.05, 0.1, age=0.05, compensated=False) > 1.5, "control"


@pytest.mark.slow
def test_the_peak_is_what_a_wave_does():
    gains = replace(STABLE, share=0.0)
    dt = 0.05
    period = 8.0

    def swing(gains, delay, **how):
        wave = Scenario(lambda t: 0.1 * sin(2 * pi * t / period))
        gaps, _ = drive(
            wave,
            lambda: PlatoonFollower(gains, dt, delay, UNREADY, trust=1.0, rule=False, **how),
            4,
            60.0,
            dt=dt,
            delay=delay,
        )
        return np.ptp(gaps[-round(2 * period / dt):], axis=0)

    fading = swing(gains, 0.1)
    assert (np.diff(fading) < 0.0).all()
    assert np.diff(swing(gains, 0.2, compensated=False)).max() > 0.0, "control"


# -- attack and loss ----------------------------------------------------------------------------


@pytest.mark.slow
def test_a_lie_is_found_and_no_wave_is_taken_for_one():
    def followers(attacks):
        scenario = Scenario(lambda t: 0.8 * sin(2 * pi * t / 6), attacks=attacks)
        return drive(
            scenario,
            lambda: PlatoonFollower(STABLE, 0.05, 0.1, UNREADY),
            3,
            30.0,
            dt=0.05,
            delay=0.1,
            line=replace(NOISY, loss=0.3),
        )[1]

    square = {1: lambda t: 1.0 if t % 20.0 < 10.0 else -1.0}
    assert [f.detector.attacked for f in followers(square)] == [False, True, False]
    assert not any(f.detector.attacked for f in followers({})), "control"
    attacked = followers(square)[1]
    assert attacked.mode is PlatoonMode.ACC
    assert attacked.why == "it does not drive its reported acceleration"


def test_a_reported_speed_that_the_lidar_does_not_see_is_not_believed():
    def drives(added, detects=True):
        scenario = Scenario(brakes=(12.0, inf), speeds={1: lambda t: added if t > 10.0 else 0.0})
        return drive(
            scenario,
            lambda: PlatoonFollower(STABLE, 0.05, 0.1, CAREFUL, detects=detects),
            3,
            16.0,
            dt=0.05,
            delay=0.1,
            line=replace(NOISY, loss=0.3),
        )

    gaps, followers = drives(0.3)
    assert gaps.min() > 0.0
    assert [f.distrusts for f in followers] == [False, True, False]
    assert followers[1].why == "its position does not match its reported speed"
    assert drives(0.3, detects=False)[0].min() < 0.0, "control"
    assert not any(f.distrusts for f in drives(0.0)[1]), "control"


def test_the_detector_needs_more_than_five_samples_in_a_row():
    detector = AttackDetector(0.1)
    found = [detector.update(1.0, 1.0, 0.0, 1.0) for _ in range(20)]
    assert found.index(True) == 10
    assert not any(AttackDetector(0.1).update(1.0, 1.0, 0.3, 0.3) for _ in range(50)), "control"


def test_messages_that_do_not_count_are_counted():
    hearing = ReportFilter()
    for message, now in (
        (PredecessorReport(10.0, 1.0, 0.0), 10.0),
        (PredecessorReport(10.0, 1.0, 0.0), 10.05),
        (PredecessorReport(9.9, 0.5, 0.0), 10.05),
        (PredecessorReport(10.1, 1.0, 0.1), 10.1),
        (PredecessorReport(50.0, 1.0, 0.0), 110.0),
        (PredecessorReport(111.0, 1.0, 0.0), 110.0),
        (PredecessorReport(109.9, float("nan"), 0.0), 110.0),
        (PredecessorReport(110.0, 101.0, 0.0), 110.0),
    ):
        hearing.take(message, now)
    assert dict(hearing.counts) == {"TAKEN": 2, "AGAIN": 1, "OVERTAKEN": 1, "OLD": 1, "EARLY": 1,
                                    "IMPOSSIBLE": 2}
    assert hearing.newest == PredecessorReport(10.1, 1.0, 0.1)


def run(follower, seconds, gap=0.6, speed=1.0, report=lambda t: None):
    """Accelerations of a follower with a constant gap and what is reported."""
    out = []
    for k in range(round(seconds / follower.dt)):
        t = k * follower.dt
        message = report(t)
        if message is not None:
            follower.hearing.take(message, t)
        out.append(follower.answer(t, speed, Gap(t, gap, 0.0) if gap is not None else None))
    return np.array(out)


def test_a_neighbour_that_never_answers_leaves_acc():
    follower = PlatoonFollower()
    run(follower, 2.0)
    assert follower.mode is PlatoonMode.ACC
    assert follower.why.startswith("no report")
    assert follower.counts["ACC"] == 40


def test_a_message_of_a_minute_ago_is_as_none():
    late = PlatoonFollower()
    silent = PlatoonFollower()
    message = run(late, 1.0, report=lambda t: PredecessorReport(t - 60.0, 1.4, 1.0))
    assert (message == run(silent, 1.0)).all()
    assert late.hearing.counts["OLD"] == 20
    assert (
        message != run(PlatoonFollower(), 1.0, report=lambda t: PredecessorReport(t, 1.4, 1.0))
    ).any(), "control"


def test_without_a_gap_it_brakes_to_rest():
    follower = PlatoonFollower()
    u = run(follower, 1.0, gap=None, report=lambda t: PredecessorReport(t, 1.0, 0.5))
    assert (u == follower.gains.u_min).all()
    assert follower.mode is PlatoonMode.STOP


class Held(PlatoonFollower):
    """The control: the gap goes on by the last reported speed, as if silence were no news."""

    def _predict_gap(self, t, speed):
        super()._predict_gap(t, speed)
        self._gap_deficit = 0.0


@pytest.mark.parametrize("dt", [0.1, 0.05])
@pytest.mark.slow_except("0.1")
def test_in_silence_the_gap_is_the_one_that_a_full_brake_leaves(dt):
    """Gaps are exact, but come each 0.4 s; 60 % of the messages are lost."""
    def least(make):
        scenario = Scenario(brakes=(4.0, 7.0), attacks={0: lie})
        return min(drive(scenario, lambda: make(DART, dt, 0.1, UNREADY, trust=1.0,
                                                **{**AS_PUBLISHED, "rule": True}), 2, 8.0, dt=dt,
                         delay=0.1, line=Line(rate=2.5, loss=0.6), rng=np.random.default_rng(seed)
                         )[0].min() for seed in range(6))

    assert least(PlatoonFollower) >= 0.02 - 1e-9
    assert least(Held) < 0.0, "control"


def test_silence_is_taken_for_a_full_brake():
    follower = PlatoonFollower(margins=SafetyMargins(m=0.02))
    u = run(
        follower, 2.0, gap=0.5, report=lambda t: PredecessorReport(t, 1.0, 0.0) if t < 0.5 else None
    )
    assert u[8] > -0.6, "heard: the linear law, which is nearer than it likes"
    assert u[-1] == follower.gains.u_min, "from 1 m/s it needs 0.5 m to rest"


def test_what_is_under_way_is_driven_before_what_is_requested():
    underway = PendingCommands(0.1, 0.05)
    underway.send(-1.0)
    assert underway.predict(1.0) == pytest.approx((0.05 + 0.5 * (1.0 + 0.95) * 0.05, 0.95))
    underway.send(1.0)
    assert underway.predict(0.02)[1] == pytest.approx(0.05), "it is at rest before it starts"
