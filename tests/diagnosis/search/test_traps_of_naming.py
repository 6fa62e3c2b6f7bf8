"""What once led to a wrong name, on the side of the names: timing, bounds, relatives, batteries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.effects import apply, catalogue
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.search import forward as searching
from dart_lab.diagnosis.search.scan import Trial, ladder, scan
from dart_lab.identification.evidence import readings
from dart_lab.identification.evidence.readings import rest_residuals
from dart_lab.identification.evidence.space import Space
from studies.diagnosis.known_frame import read
from studies.diagnosis.stranger_files import Habits, record
from tests.diagnosis.searched import car, drive, evidence, fit_start, names, search, size_of

TIMING = ("steering_delay", "steering_lag", "steering_rate_limit", "throttle_delay",
          "throttle_lag", "encoder_latency", "gyro_latency", "clock_offset", "mocap_latency",
          "yaw_inertia")
TWO = [{"steering_lag": 0.06, "throttle_lag": 0.08}, {"steering_delay": 0.04, "gyro_latency": 0.04},
       {"steering_lag": 0.06, "encoder_latency": 0.03},
       {"steering_delay": 0.08, "throttle_delay": 0.06}]


# 8: after a correction of time its aliases come along

@pytest.mark.parametrize("two", [TWO[0], *(pytest.param(t, marks=pytest.mark.long)
                                           for t in TWO[1:])], ids="+".join)
@pytest.mark.slow
def test_two_delays_are_those_two_and_no_third(two):
    found = search(drive(*two.items(), seconds=50.0, seed=6), names=TIMING)
    assert sorted(names(found)) == sorted(two)
    for name, k in two.items():
        assert size_of(found, name) == pytest.approx(k, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["clock_offset", "gyro_latency"])
def test_a_car_at_rest_reads_the_same_a_little_later(monkeypatch, name):
    """Messages are no series of samples: to shift them by parts of one averages neighbours, and
    less noise looks like a cause."""
    at_rest = evidence(drive()).drives[0]
    assert at_rest.at_rest.sum() > 5
    late = apply(PAPER, name, k=0.013)
    as_it_is = rest_residuals(at_rest, PAPER, has_mocap=True)
    assert np.array_equal(rest_residuals(at_rest, late, has_mocap=True), as_it_is, equal_nan=True)
    monkeypatch.setattr(readings, "split_final_delay", lambda p, channel: (p, 0.0))
    assert np.nanmax(np.abs(rest_residuals(at_rest, late, has_mocap=True) - as_it_is)) > 0.0


@pytest.mark.parametrize(("needed", "left"), [(None, ["steering_lag"]),
                                              pytest.param(0.0, ["steering_delay", "steering_lag"],
                                                           marks=pytest.mark.long)])
@pytest.mark.slow
def test_what_the_right_name_makes_superfluous_is_dropped(monkeypatch, needed, left):
    """A delay that was named for a lag goes when the lag comes; without the way back it stays."""
    if needed is not None:
        monkeypatch.setattr(searching, "CERTAIN_RATIO", needed)
    rounds = []

    def scan_that_first_forgets(*args, **how):
        rounds.append(1)
        return [t for t in scan(*args, **how) if len(rounds) > 1 or t.effect != "steering_lag"]

    monkeypatch.setattr(searching, "scan", scan_that_first_forgets)
    found = search(drive(("steering_lag", 0.06), seed=8), names=(*TIMING, "grip", "gyro_bias"))
    assert sorted(names(found)) == left


@pytest.mark.slow
def test_the_gain_of_a_cause_counts_from_the_fit_without_it():
    """Named second and left alone: its gain, and what it is like, are those of the first round."""
    found = search(drive(("yaw_damping", 0.03), seconds=60.0, seed=14))
    one, = found.accepted
    gains = {t.effect: t.gain for t in found.ranking}
    assert one.gain > 0.8 * gains[one.effect]


# 9: bounds and signs

@pytest.mark.parametrize("name", list(catalogue()))
def test_no_size_that_is_tried_is_out_of_bounds(name):
    for q in catalogue()[name].parameters:
        near, far = ladder(q)
        assert near
        assert all(q.low <= k <= q.high for k in (*near, *far))


@pytest.mark.slow
def test_no_rollout_within_the_bounds_runs_away():
    of_drive = evidence(drive(seconds=20.0))
    for name, of in catalogue().items():
        for q in of.parameters:
            for k in (q.low, q.high):
                r = of_drive.residuals(apply(PAPER, name, **{q.name: k})).motion
                assert np.isfinite(r).all(), (name, k)
                assert np.abs(r).max() < 15.0, (name, k)


@pytest.mark.slow_except("differential*")
@pytest.mark.parametrize(("name", "k"), [("yaw_damping", -0.2), ("differential_drag", -0.5),
                                         ("quadratic_drag", -2.0)])
def test_with_the_other_sign_it_would(name, k):
    """The negative control: what resists, turned round, as large as its bound."""
    of_drive = evidence(drive(seconds=20.0))
    spun = replace(PAPER, effects=(ActiveEffect(catalogue()[name], (k,)),))
    with np.errstate(all="ignore"):
        assert not np.isfinite(of_drive.residuals(spun).motion).all()


def push_with_speed(newton):
    """Air that pushes the car the faster it is, which no drag does."""
    def act(f, now):
        f[4] += newton * now.v * now.v
    return act


@pytest.mark.slow
def test_what_pushes_is_no_negative_drag(tmp_path):
    strange = car()
    strange.force.append(push_with_speed(0.15))
    of_drive = evidence(read(record(tmp_path / "a.csv", strange, Habits(), 40.0, 3)))
    noise, point = fit_start(of_drive)
    trial, = scan(of_drive, point, ["quadratic_drag"])
    assert trial.gain == 0.0
    _, forced = fit_start(of_drive, apply(PAPER, "quadratic_drag"), noise=noise)
    assert forced.vehicle.friction.q == PAPER.friction.q, "the fit stays on its side"
    resisted = evidence(drive(("quadratic_drag", 0.2)))
    trial, = scan(resisted, fit_start(resisted)[1], ["quadratic_drag"])
    assert trial.gain > 50.0


def test_a_point_never_leaves_its_bounds():
    space = Space(apply(PAPER, "yaw_damping"), ("motor.d",), {"motor.d": 0.3})
    assert space.split(space.low)[0].effects[0].values[0] >= 0.0
    assert space.split(space.high)[0].motor.d == pytest.approx(PAPER.motor.d + 3.5 * 0.3, rel=1e-3)


# 10: relatives

@pytest.fixture
def twins(monkeypatch):
    """A catalogue with a second grip that is written twice as large, and one without."""
    known = dict(catalogue())
    grip = known["grip"]
    q = grip.parameters[0]
    half = replace(q, low=2 * q.low, high=2 * q.high, sizes=tuple(2 * s for s in q.sizes))
    twin = replace(grip, name="twin", parameters=(half,),
                   vehicle=lambda p, k: grip.vehicle(p, 0.5 * k))
    known["twin"] = twin
    everywhere = ("dart_lab.diagnosis.search.scan", "dart_lab.diagnosis.search.forward",
                  "dart_lab.diagnosis.conclude", "dart_hal.vehicle.effects")
    for place in everywhere:
        monkeypatch.setattr(f"{place}.catalogue", lambda: known)
    return known


@pytest.mark.slow
def test_two_names_for_one_thing_are_confounded(twins):
    found = search(drive(("grip", -0.2)), names=("grip", "twin", "motor_gain", "gyro_bias"))
    one, = found.accepted
    assert {one.effect, *one.confounders} == {"grip", "twin"}


@pytest.mark.slow
def test_one_that_explains_much_less_is_not_confounded():
    found = search(drive(("grip", -0.2)), names=("grip", "mass", "motor_gain", "gyro_bias"))
    one, = found.accepted
    assert (one.effect, one.confounders) == ("grip", ())


@pytest.mark.slow
def test_relatives_stay_confounded_with_another_cause_present(twins):
    found = search(drive(("grip", -0.2), ("gyro_bias", 0.03)),
                   names=("grip", "twin", "gyro_bias", "gyro_scale"))
    like = {n.effect: set(found.add_confounders(n).confounders) for n in found.accepted}
    assert len(like) == 2
    assert like.pop("gyro_bias") == set()
    (name, relatives), = like.items()
    assert {name, *relatives} == {"grip", "twin"}


# 11: the level of a battery belongs to a recording

BIAS_LEVELS = (-0.1, -0.03, 0.03, 0.1)


def diagnose_drives(train, test, **how):
    model, vehicle = find_model("paper")
    return diagnose(model, vehicle, train, test, refit=False, **how)


@pytest.mark.slow
def test_levels_that_differ_are_no_friction_and_are_reported():
    """Nothing of the car explains them; that they differ from recording to recording does."""
    drives = [drive(("motor_gain", k), seconds=20.0, seed=20 + i) for i,
              k in enumerate(BIAS_LEVELS)]
    d = diagnose_drives(drives, [drive(seconds=20.0, seed=50)])
    assert d.verdict == "unexplained"
    assert d.causes == ()
    assert ("v_x", "recording") in [(u.channel, u.along[0]) for u in d.unexplained]


@pytest.mark.slow
def test_a_level_that_all_have_is_named():
    drives = [drive(("motor_gain", -0.1), seconds=20.0, seed=20 + i) for i in range(4)]
    found = search(*drives, names=("motor_gain", "rolling_resistance", "quadratic_drag",
                                   "battery_fade", "mass"))
    assert names(found) == ["motor_gain"]
    assert size_of(found, "motor_gain") == pytest.approx(-0.1, abs=0.02)


@pytest.mark.slow
def test_a_battery_that_runs_down_is_that_and_no_drag():
    """Steps of the throttle, up and down: speed and time do not go together."""
    found = search(drive(("battery_fade", -0.15), seconds=80.0, seed=61),
                   names=("battery_fade", "motor_gain", "rolling_resistance", "quadratic_drag"))
    assert names(found)[:1] == ["battery_fade"]
    assert size_of(found, "battery_fade") == pytest.approx(-0.15, rel=0.35)


# 12: a car at rest shows at once what driving hides

def tilt_imu(k, rest):
    return evidence(drive(*([("imu_pitch", k)] if k else []), seconds=30.0, seed=10,
                          habits=Habits(moving=not rest)))


def pitch(of_drive) -> Trial:
    trial, = scan(of_drive, fit_start(of_drive)[1], ["imu_pitch"])
    return trial


@pytest.mark.slow
def test_a_tilt_shows_in_two_seconds_of_standstill_and_not_in_thirty_of_driving():
    at_rest, driving = (pitch(tilt_imu(0.03, rest)) for rest in (True, False))
    assert at_rest.values["k"] == pytest.approx(0.03, rel=0.1)
    assert at_rest.gain > 5.0 * max(driving.gain, 1.0)
    assert names(search(drive(("imu_pitch", 0.03), seconds=30.0, seed=10),
                        names=("imu_pitch", "imu_roll", "road_slope_x"))) == ["imu_pitch"]


@pytest.mark.slow
def test_a_level_imu_has_no_tilt():
    trial = pitch(tilt_imu(0.0, rest=True))
    assert trial.gain < 3.0
    assert abs(trial.values.get("k", 0.0)) < 3e-3


@pytest.mark.slow
def test_only_a_car_at_rest_counts_as_resting():
    assert tilt_imu(0.0, rest=True).sensor_at_rest.sum() > 10
    assert not tilt_imu(0.0, rest=False).sensor_at_rest.any()
