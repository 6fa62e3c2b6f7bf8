"""Which parameters were wrong: exactly those that were altered, in quantities of the car."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.core.config.car import Geometry, SizeErrors
from dart_hal.vehicle import PAPER, SpeedLoop
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.flat import names
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_hal.vehicle.motor import make_motor
from dart_hal.vehicle.sizes import SIZES, set_sizes
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.conclude import _verdict
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.parameters.claims import _pair_groups, _raises_errors
from dart_lab.diagnosis.parameters.cost import group_cost, loss_ratio
from dart_lab.diagnosis.parameters.groups import GROUPS, holding_throttle, list_quantities
from dart_lab.diagnosis.parameters.sets import GroupFits, Posterior
from dart_lab.diagnosis.parameters.unseen import RecordingLosses
from dart_lab.diagnosis.policy import USUAL
from dart_lab.diagnosis.report.claimed import PICTURES, _measure_curve, pictures
from dart_lab.diagnosis.report.explain import describe_claim
from dart_lab.diagnosis.report.page import page
from dart_lab.diagnosis.result import Claim, Constancy, QuantityChange
from dart_lab.diagnosis.run import select_free_sizes
from dart_lab.identification.evidence.drive import prepare_drive
from dart_lab.identification.evidence.noise import Noise, estimate_noise
from dart_lab.identification.evidence.residuals import Evidence, Residuals
from dart_lab.identification.evidence.space import MessageTiming
from studies.diagnosis.hidden_drive import Plan, write
from studies.diagnosis.known_frame import read
from tests.diagnosis.scaled_drive import CAR_SIZES

CLAIM_SECONDS = 60.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("claims")


@cache
def answer(folder, **factors):
    """The diagnosis of a car whose parameters are other than the paper's, by factors."""
    groups = {}
    for name, factor in factors.items():
        group, key = name.split("__")
        part = groups.get(group, getattr(PAPER, group))
        groups[group] = replace(part, **{key: getattr(part, key) * factor})
    car = replace(PAPER, **groups)
    train, test = (read(write(folder / f"{seed}.csv", car, seed, Plan(seconds=CLAIM_SECONDS)))
                   for seed in (21, 22))
    file, p = find_model("paper")
    sides = check_inputs([train], [test], p)
    return diagnose(file, p, sides.train, sides.test, max_causes=0)


@pytest.mark.slow
@pytest.mark.parametrize(("factors", "groups"), [
    ({"tyres__front_D": 1.25}, {"front tyre"}), ({"motor__d": 0.8}, {"motor"}),
    ({"delay__steering_s": 1.3}, {"steering timing"}),
    ({"tyres__rear_cornering_stiffness": 0.8, "motor__d": 1.2}, {"rear tyre", "motor"})])
def test_exactly_the_altered_groups_are_claimed(folder, factors, groups):
    found = answer(folder, **factors)
    assert {c.group for c in found.claims} == groups
    assert found.verdict == "parameters_only"
    for c in found.claims:
        assert c.probability > 0.9
        assert c.cost[0] > 1.0
        assert c.to_json()["quantities"]


@pytest.mark.slow
def test_of_an_exact_model_nothing_is_claimed(folder):
    found = answer(folder)
    assert found.claims == ()
    assert found.verdict == "nothing_wrong"


@pytest.mark.slow
def test_wrong_size_of_car_toml_is_a_finding_about_car_toml(folder):
    """The yaw inertia is 60 % larger than a car.toml states; nothing else is wrong."""
    body = replace(PAPER.body, yaw_inertia=1.6 * PAPER.body.yaw_inertia)
    train, test = (read(write(folder / f"inertia_{seed}.csv", replace(PAPER, body=body), seed,
                              Plan(seconds=CLAIM_SECONDS))) for seed in (21, 22))
    sizes = {key: getattr(PAPER.body, key) for key in SIZES}
    file = set_sizes(find_model("paper")[0], Geometry(**sizes, std=SizeErrors(
        wheelbase=0.001, l_f=0.002, mass=0.02, yaw_inertia=0.0006)))
    sides = check_inputs([train], [test], vehicle_of(file))
    found = diagnose(file, vehicle_of(file), sides.train, sides.test)
    assert found.causes == ()
    (c,) = found.claims
    assert describe_claim(c)["What"].startswith("Your yaw inertia of car.toml was wrong")
    inertia = c.quantities["yaw inertia"]
    assert inertia.after == pytest.approx(1.6 * inertia.before, rel=0.15)
    assert found.refitted["body.mass"].after == pytest.approx(PAPER.body.mass, abs=0.04)
    assert found.refitted["body.yaw_inertia"].std == pytest.approx(inertia.std, rel=0.1), (
        "the file states the same error as the report")
    assert found.verdict == "parameters_only"


def test_effect_that_is_the_same_as_a_free_size_is_not_looked_for():
    stated = {"body.mass": 0.02, "body.l_f": 0.002, "body.wheelbase": 0.001}
    sizes, names = select_free_sizes(stated, ())
    assert sizes == stated
    assert set(catalogue()) - set(names) == {"mass", "centre_of_mass"}
    assert select_free_sizes(stated, ("grip", "mass")) == (stated, ("grip",))
    assert select_free_sizes(stated, ("mass",)) == ({}, ("mass",)), "it was asked for"
    assert select_free_sizes({"body.wheelbase": 0.001}, ()) == ({"body.wheelbase": 0.001}, ())
    assert select_free_sizes({}, ("grip",)) == ({}, ("grip",))


@pytest.mark.slow
def test_the_new_value_is_that_of_the_car(folder):
    (c,) = answer(folder, tyres__front_D=1.25).claims
    peak = c.quantities["peak side force over load"]
    assert peak.after == pytest.approx(1.25 * peak.before, rel=0.03)
    assert abs(peak.after - 1.25 * peak.before) < 4.0 * peak.std
    assert "front tyres were wrong" in describe_claim(c)["What"]


def test_of_two_confounded_groups_the_deciding_drive_is_stated():
    drive = "Coast down straight on. Steps of the throttle."
    one = Claim("motor", "motor", (), 1.0, {}, (1.2, 1.1, 1.3), (), drive,
                Constancy(1.0, "", (), 0.0, (0.01, 0.1)))
    alone = describe_claim(one)
    assert "distinguish" not in alone["Why"]
    assert alone["Next"].startswith("To confirm it: coast down straight on. Steps")
    both = describe_claim(replace(one, group="drive force"))
    assert "do not distinguish friction and motor" in both["Why"]
    assert both["Next"].startswith("To distinguish them: coast down straight on. Steps")


LOOP_CAR = replace(PAPER, motor=SpeedLoop(gain=8.0, max_force=6.0))


@pytest.mark.parametrize(("car", "motor"), [(PAPER, {"motor.d", "motor.e", "motor.g"}),
                                            (LOOP_CAR, {"motor.gain", "motor.max_force"})])
def test_every_parameter_that_a_refit_moves_is_of_one_group(car, motor):
    free = [n for n in names(car) if not n.startswith(("body.", "tyres.front_C"))]
    of = [sum(bool(g.select((n,))) for g in GROUPS.values()) for n in free]
    assert set(of) <= {0, 1}
    assert {n for n, k in zip(free, of, strict=True) if k} >= motor | {
        "friction.a", "steering.s0", "delay.steering_s", "delay.throttle_lag_s",
        "tyres.front_D", "tyres.rear_cornering_stiffness"}


@pytest.mark.parametrize("group", GROUPS)
def test_quantities_are_numbers_of_a_car_with_such_a_motor(group):
    for unit, quantity in GROUPS[group].quantities.values():
        assert np.isfinite(quantity(LOOP_CAR if group == "speed loop" else PAPER)), unit


def test_the_holding_throttle_is_where_motor_and_friction_are_equal():
    slow, fast = (holding_throttle(speed)(PAPER) for speed in (1.0, 1.5))
    assert slow < fast
    for throttle, speed in ((slow, 1.0), (fast, 1.5)):
        left = make_motor(PAPER.motor)(throttle, speed) + make_friction(PAPER.friction)(speed)
        assert abs(left) < 0.02, "N; a step of the table is a thousandth of the throttle"
    assert holding_throttle(9.0)(PAPER) == 1.0, "faster than it can drive"
    command = holding_throttle(1.0)(LOOP_CAR)
    left = make_motor(LOOP_CAR.motor)(command, 1.0) + make_friction(LOOP_CAR.friction)(1.0)
    assert abs(left) < 1e-12


@pytest.mark.slow
def test_a_claim_is_drawn_old_new_and_as_the_car_drives(folder):
    """The car's own points, measured where no fit has been, lie on the new curve."""
    found = answer(folder, tyres__front_D=1.25)
    (c,) = found.claims
    front = next(k for k in PICTURES if k.title == "Front tyres")
    points = _measure_curve(front, found)
    known = np.isfinite(points.error)
    new, old = (np.abs(front.curve(p, points.x) - points.mean)[known]
                for p in (found.extended, found.stages[0].vehicle))
    assert np.median(new) < 0.3 * np.median(old)
    (drawn,) = pictures(c, found)
    assert drawn.count("<polyline") == 2
    assert "the car on the test recordings" in drawn
    assert "Parameters that were wrong" in page(found)


def test_a_delay_is_no_curve():
    for kind in PICTURES:
        assert not any("delay.steering_s".startswith(n) for n in kind.names)


def test_a_group_is_claimed_where_its_cost_is_significant():
    policy = USUAL.claims
    assert _raises_errors((1.20, 1.05, 1.40), False, policy)
    assert not _raises_errors((1.20, 0.95, 1.50), False, policy)
    assert _raises_errors((1.20, 0.95, 1.50), True, policy)
    assert not _raises_errors((0.90, 0.80, 1.00), True, policy)
    assert _raises_errors((1.05, np.nan, np.nan), False, policy)


def test_a_spin_that_no_model_follows_does_not_hide_what_a_group_costs():
    """Errors half as large again without the group, and six of 200 windows wild with it or not."""
    motion = np.random.default_rng(1).normal(size=(200, 2))
    wild = np.arange(200) % 33 == 5
    point = SimpleNamespace(noise=Noise(np.eye(2), np.ones(4), np.ones(6)), vehicle=None,
                            timing=None)

    def make_residuals(factor):
        r = Residuals(np.where(wild[:, None], 30.0, factor * motion), np.zeros((0, 4)))
        ten = np.repeat(np.arange(20), 10)
        out = RecordingLosses(SimpleNamespace(
            residuals=lambda *model: r, blocks=lambda seconds: (ten, np.zeros(0, dtype=int)),
            motion_drive=np.zeros(200, dtype=int), sensor_drive=np.zeros(0, dtype=int),
            sensor_still=np.zeros(0, dtype=bool)), point, USUAL)
        out._noise = point.noise
        out._fit_timing = lambda *fit: None
        return out.motion(point)

    losses = {frozenset(): make_residuals(1.5), frozenset({"motor"}): make_residuals(1.0)}
    loss_ratio, low, _ = group_cost(losses.__getitem__, frozenset({"motor"}), "motor")
    assert loss_ratio > USUAL.claims.min_error_ratio
    assert low > 1.0


@pytest.mark.slow
def test_how_old_the_commands_of_a_fit_were_costs_nothing_on_other_recordings(folder):
    recording = read(write(folder / "ages.csv", PAPER, 24, Plan(seconds=20.0)))
    drive = prepare_drive(recording, PAPER.body.l_r)
    evidence = Evidence([drive], PAPER.body.l_r)

    def measure_loss(age, fitted=True):
        sizes = estimate_noise(evidence.residuals(PAPER, MessageTiming()), evidence.blocks())
        point = SimpleNamespace(vehicle=PAPER, timing=MessageTiming(command_age=age), noise=sizes)
        out = RecordingLosses(evidence, point, USUAL)
        if not fitted:
            out._noise = sizes
            out._fit_timing = lambda *fit: point.timing
        return out.motion(point).sum()

    assert measure_loss(0.06, fitted=False) > 2.0 * measure_loss(0.0, fitted=False)
    assert measure_loss(0.06) == pytest.approx(measure_loss(0.0), rel=0.02)
    assert measure_loss(0.06) <= 1.02 * measure_loss(0.0, fitted=False)


def test_of_two_times_one_is_wrong_and_the_data_do_not_decide():
    steering, throttle, both = (frozenset(g) for g in (
        {"steering timing"}, {"throttle timing"}, {"steering timing", "throttle timing"}))
    either = Posterior(tuple(sorted(both)), (steering, throttle), np.array([0.5, 0.5]))
    assert _pair_groups(either) == [both]
    certain = Posterior(tuple(sorted(both)), (steering, both), np.array([0.5, 0.5]))
    assert _pair_groups(certain) == []
    late = replace(PAPER, delay=replace(PAPER.delay, throttle_s=0.05))
    before, later = (list_quantities("command timing", PAPER)["steering later than throttle"][1](p)
                     for p in (PAPER, late))
    assert later == pytest.approx(before - 50.0)


def test_no_command_is_younger_than_its_message_in_place_of_a_delay():
    """A throttle delay and the age of commands that move the residuals equally."""
    names = ("delay.throttle_s", "age", "late", "gyro")
    slopes = np.array([[1.0, -0.99, 0.0, 0.0], [0.0, 0.14, 0.0, 0.0]])
    point = SimpleNamespace(x=np.array([2.0, 0.0, 0.0, 0.0]), normal=slopes.T @ slopes
                            + 1e-3 * np.eye(4), vehicle=PAPER, space=SimpleNamespace(
        names=names, low=np.array([-9.0, -9.0, -9.0, -9.0]), high=np.full(4, 9.0)))
    of = object.__new__(GroupFits)
    of.full, of.all_groups = point, frozenset({"throttle timing"})
    of._names = {"throttle timing": ("delay.throttle_s",)}
    assert of.rise(frozenset()) < 0.5  # a negative age would do nearly the same
    point.space.low[1] = 0.0
    assert of.rise(frozenset()) == pytest.approx(4.0, abs=0.01)
    assert of.rise(of.all_groups) == 0.0


@pytest.mark.parametrize(("change", "later", "verdict"), [
    (0.05, 2.0, "parameters_only"), (0.4, 2.0, "unexplained"), (0.4, 1.02, "parameters_only")])
def test_a_parameter_whose_size_changes_does_not_explain(change, later, verdict):
    """As of a motor that grows hot: one number of it is no number of the car. Of what moved by 2 %
    a part is next to nothing."""
    claimed = Claim("motor", "motor", (), 1.0, {"pull": QuantityChange(1.0, later, 0.01, "N")},
                    (1.2, 1.1, 1.3), (), "",
                    Constancy(0.001, "time", (), change, (0.01, 0.1)))
    explains = verdict == "parameters_only"
    assert _verdict(None, None, (), (), {}, (claimed,), ()) == verdict
    assert ("The change is not constant" in describe_claim(claimed)["Why"]) != explains
    assert (claimed.to_json()["constancy"]["changes_with"] is None) == explains
    constant = Constancy(1.0, "", (), 0.0, (0.01, 0.1))
    cause = SimpleNamespace(gain=SimpleNamespace(high=0.5), constancy=constant)
    assert (_verdict(None, None, (cause,), (), {}, (claimed,), ()) == "explained") == explains


@pytest.mark.slow
def test_the_interval_of_a_cost_knows_how_few_its_stretches_are():
    """Four stretches of a random ratio: within the interval in 0.9 of 2000 draws, and too narrow
    by the bootstrap quantiles of so few, which is the control."""
    rng = np.random.default_rng(3)
    inside = narrow = 0
    for _ in range(2000):
        base = rng.normal(100.0, 5.0, 4)
        more = base * rng.normal(1.3, 0.1, 4)
        _, low, high = loss_ratio(base, more)
        inside += low <= np.sqrt(1.3) <= high
        picks = rng.integers(0, 4, (200, 4))
        drawn = np.sqrt(more[picks].sum(axis=1) / base[picks].sum(axis=1))
        narrow += np.quantile(drawn, 0.05) <= np.sqrt(1.3) <= np.quantile(drawn, 0.95)
    assert inside / 2000 == pytest.approx(0.9, abs=0.03)
    assert narrow / 2000 < 0.8


@pytest.mark.parametrize(("size", "speed"), [("1:43", 0.5), ("1:10", 1.0), ("1:1", 4.0)])
def test_quantities_are_stated_at_speeds_that_a_car_of_that_size_drives(size, speed):
    car = CAR_SIZES[size].scale(PAPER)
    unit, resistance = list_quantities("friction", car)[f"resistance at {speed:g} m/s"]
    assert unit == "N"
    assert resistance(car) == pytest.approx(-float(make_friction(car.friction)(speed)))
    assert f"pull at throttle 0.25, {2 * speed:g} m/s" in list_quantities("motor", car)
    assert f"throttle that holds {speed:g} m/s" in list_quantities("drive force", car)
