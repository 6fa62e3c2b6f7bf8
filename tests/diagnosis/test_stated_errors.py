"""Parameters that leave their stated errors together are wrong, though each stays within its own.

A delay and a lag of one command are known far better together than each.
"""

from __future__ import annotations

from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from dart_hal.core.config import Quantity, save_model
from dart_hal.core.config.model import Covariance
from dart_hal.recording.dart import read
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import conclude, diagnose
from dart_lab.diagnosis.conclude import KEPT_PARAMETERS
from dart_lab.diagnosis.parameters.claims import _exceeds_stated_error, release_prior
from dart_lab.diagnosis.parameters.sets import GroupFits
from dart_lab.diagnosis.policy import USUAL
from dart_lab.diagnosis.write import DIAGNOSED, extended_model
from dart_lab.identification.evidence.space import Space
from studies.diagnosis import hidden_drive
from studies.identification.coverage import FAST, FRAME, draw_car
from tests.diagnosis.searched import drive

TIMING_PARAMETERS = ("delay.steering_s", "delay.steering_lag_s")
TIMING_STD = 0.03


def exceeds(changes, correlation=None, known=TIMING_PARAMETERS):
    """Judge changes in standard errors; correlation: stated in the file, None: not stated."""
    groups = object.__new__(GroupFits)
    cross = 0.0 if correlation is None else correlation * TIMING_STD**2
    joint = None if correlation is None else Covariance(
        ("motor.d", *TIMING_PARAMETERS),
        ((4.0, 0.0, 0.0), (0.0, TIMING_STD**2, cross), (0.0, cross, TIMING_STD**2)))
    groups._names = {"steering timing": TIMING_PARAMETERS}
    groups.known = dict.fromkeys(known, TIMING_STD)
    groups.policy = USUAL
    groups.full = SimpleNamespace(x=np.array(changes),
                                  space=Space(PAPER, TIMING_PARAMETERS))
    groups.joint = joint
    return _exceeds_stated_error(groups, frozenset({"steering timing"}))


@pytest.mark.parametrize("changes", [(1.9, 1.0), (-1.9, -1.0), (1.0, 1.0)])
def test_a_common_change_is_beyond_a_covariance_but_not_beyond_single_errors(changes):
    assert exceeds(changes, -0.97)
    assert not exceeds(changes), "control: without the covariance each is within its error"


@pytest.mark.parametrize("changes", [(1.5, -1.5), (0.2, 0.1), (0.0, 0.0)])
def test_a_change_within_the_covariance_is_none(changes):
    assert not exceeds(changes, -0.97)


def test_a_single_change_beyond_its_error_counts_with_any_covariance():
    assert exceeds((USUAL.claims.max_stated_stds + 0.1, 0.0))
    assert exceeds((0.0, 0.0), known=()), "a parameter without a stated error has no range"


@pytest.mark.slow
@pytest.mark.parametrize("correlation", [0.0, -0.6, -0.97])
def test_a_right_model_leaves_the_ellipsoid_as_rarely_as_the_single_error(correlation):
    """Drawn from the stated covariance, at most 5 % leave the ellipsoid and 5 % each error."""
    rng = np.random.default_rng(3)
    drawn = rng.multivariate_normal((0.0, 0.0), [[1.0, correlation], [correlation, 1.0]], 2000)
    assert np.mean([exceeds(x, correlation) for x in drawn]) < 0.12


@pytest.mark.parametrize("truth", [0.0, 4.0, 8.0])
def test_error_of_a_changed_parameter_holds_its_truth_although_the_prior_draws_it_back(truth):
    """One parameter is measured with an error of 0.8 of the one that the file states."""
    data_std = 0.8
    normal = np.array([[data_std**-2 + 1.0]])
    space = SimpleNamespace(prior_precision=np.eye(1))
    rng = np.random.default_rng(5)
    drawn = 0
    held = 0
    trials = 500
    for measured in truth + data_std * rng.standard_normal(trials):
        fitted = measured * data_std**-2 / normal[0, 0]
        point = SimpleNamespace(x=np.array([fitted]), normal=normal, space=space)
        (released,), ((variance,),) = release_prior(point, np.linalg.inv(normal), (0,),
                                                    USUAL.prior.max_stated_stds)
        drawn += abs(fitted - truth) > 1.645 * normal[0, 0]**-0.5
        held += abs(fitted - truth) <= 1.645 * np.hypot(variance**0.5, released - fitted)
    assert held / trials >= 0.88
    assert truth == 0.0 or drawn / trials > 0.5, "control: the sampling error alone misses it"


MOTOR_COORDINATES = ("motor.d", "motor.e", "motor.g")
MOTOR_STDS = {"motor.d": 2.0, "motor.e": 0.5, "motor.g": 0.02}


def motor_covariance(correlation):
    """The covariance of d and g, and of e alone."""
    std = np.array(list(MOTOR_STDS.values()))
    matrix = np.diag(std**2)
    matrix[0, 2] = matrix[2, 0] = correlation * std[0] * std[2]
    return Covariance(MOTOR_COORDINATES, tuple(map(tuple, matrix.tolist())))


def test_prior_of_a_fit_has_the_correlations_of_the_file():
    """Motor.g is negative: its coordinate rises while it falls. 5 % are added to the diagonal."""
    space = Space(PAPER, MOTOR_COORDINATES, MOTOR_STDS, joint=motor_covariance(0.8))
    x = np.array([1.0, 0.0, 1.0])
    moved = np.concatenate([x, np.zeros(len(space) - 3)])
    loss = moved @ space.prior_precision @ moved
    assert loss == pytest.approx(x @ np.linalg.solve(
        [[1.05, 0, -0.8], [0, 1.05, 0], [-0.8, 0, 1.05]], x))
    rows = space.prior_root @ moved
    assert rows @ rows == pytest.approx(loss)
    alone = Space(PAPER, MOTOR_COORDINATES[:1], MOTOR_STDS, joint=motor_covariance(0.8))
    assert alone.prior_precision[0, 0] == pytest.approx(1.05 / (1.05**2 - 0.8**2))
    for independent in (Space(PAPER, MOTOR_COORDINATES, MOTOR_STDS),
                        Space(PAPER, MOTOR_COORDINATES, joint=motor_covariance(0.8))):
        assert independent.prior_precision[:3, :3].tolist() == np.eye(3).tolist()


@pytest.mark.slow
def test_what_a_diagnosed_model_states_of_its_errors_is_no_cause_without_a_refit():
    """A motor of 5 % less force; the control: the errors are those of another fit, or tiny."""
    sides = [[drive(("motor_gain", -0.05), seconds=40.0, seed=s)] for s in (5, 6)]
    file, p = find_model("paper")

    def find(std, table):
        numbers = file.values("motor")
        stds = [std * abs(number) for number in numbers.values()]
        together = Covariance(tuple(f"motor.{key}" for key in numbers),
                              tuple(map(tuple, np.diag(np.square(stds)).tolist())))
        stated = msgspec.structs.replace(file, covariance={table: together}, motor={
            key: Quantity(number, one)
            for (key, number), one in zip(numbers.items(), stds, strict=True)})
        return diagnose(stated, p, *sides, refit=False, only=("motor_gain", "gyro_scale"))

    for control in (find(1e-4, DIAGNOSED), find(0.1, "joint")):
        assert [c.effect for c in control.causes] == ["motor_gain"]
        assert KEPT_PARAMETERS not in control.notes
    loose = find(0.1, DIAGNOSED)
    assert loose.causes == ()
    assert "motor_gain" in [one.effect for one in loose.considered]
    assert KEPT_PARAMETERS in loose.notes
    assert loose.verdict == "unexplained"


@pytest.mark.slow
def test_a_diagnosed_model_states_what_its_data_determine_together(tmp_path):
    """A motor that lost a tenth is beyond it, though within the single errors of d and g."""
    file, p = find_model("paper")
    before = [drive(seconds=60.0, seed=3)]
    healthy = diagnose(file, p, before, [drive(seconds=60.0, seed=4)], max_causes=0)
    path = save_model(extended_model(healthy, file, before), tmp_path / "healthy.toml")
    fitted, vehicle = find_model(path)
    together = fitted.covariance[DIAGNOSED]
    assert together.names == tuple(healthy.refitted)
    assert np.sqrt(np.diag(together.matrix)) == pytest.approx(
        [change.std for change in healthy.refitted.values()], rel=1e-5)
    weaker = [[drive(("motor_gain", -0.1), seconds=60.0, seed=s)] for s in (5, 6)]
    (cause,) = diagnose(fitted, vehicle, *weaker, refit=False,
                        only=("motor_gain", "rolling_resistance")).causes
    gain = cause.parameters["k"]
    assert abs(gain.value + 0.1) < 2.0 * gain.std < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("seed", [30, 37])
def test_errors_of_a_tyre_include_its_unknown_shape(tmp_path, monkeypatch, seed):
    """The refit keeps C and E of the model. The car has others, and so another peak force."""
    car = draw_car(np.random.default_rng(seed))
    plan = hidden_drive.Plan(seconds=60.0, fast=FAST)
    train, test = ([read(hidden_drive.write(tmp_path / f"{k}.csv", car, 1000 * seed + k, plan))]
                   for k in range(2))
    file, vehicle = find_model("paper")

    def measure_error() -> float:
        """Return the error of the peak force, in the standard errors that are stated."""
        d = diagnose(file, vehicle, train, test, only=("gyro_scale",), reference=FRAME)
        peak = d.refitted["tyres.front_D"]
        return abs(peak.after - car.tyres.front_D) / peak.std

    assert measure_error() < 2.0
    monkeypatch.setattr(conclude, "include_tyre_shape", lambda final, search, evidence: final)
    assert measure_error() > 4.0, "the control"
