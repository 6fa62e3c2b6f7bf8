"""The noise is what is left without the causes: else a cause has little weight where it shows."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.flat import value
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import conclude, diagnose
from dart_lab.diagnosis.search.forward import ForwardSearch
from dart_lab.diagnosis.search.selection import Settings, label_point_rows
from dart_lab.identification.objective import covariance
from tests.diagnosis.searched import drive, evidence, search, size_of

NOISE_SIGMA = 2.6
"""Standard errors within which a size lies with 99 % probability."""


def found_and_error(recording, name):
    of_recording = evidence(recording)
    point = ForwardSearch(of_recording, PAPER, Settings(names=(name,))).run().point
    errors = point.space.standard_errors(
        point.x, covariance(point, label_point_rows(of_recording, point).block))
    return value(point.vehicle, f"{name}.k"), errors[f"{name}.k"]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "hidden"), [("mocap_yaw", 0.03), ("mass", 0.2), ("grip", -0.2)])
def test_size_of_a_large_cause_is_not_shrunk(name, hidden):
    """By a noise with the cause inside they were found at 78, 81 and 86 % of their size."""
    found, error = found_and_error(drive((name, hidden)), name)
    assert abs(found - hidden) < NOISE_SIGMA * error
    assert error < 0.1 * abs(hidden)


@pytest.mark.slow
def test_noise_with_the_cause_inside_shrinks_it(monkeypatch):
    """The control: measured once, at the model as it was."""
    measured = ForwardSearch._measure_training_noise
    first = {}

    def once(self, vehicle, timing):
        return first.setdefault(id(self), measured(self, vehicle, timing))

    monkeypatch.setattr(ForwardSearch, "_measure_training_noise", once)
    found, error = found_and_error(drive(("mocap_yaw", 0.03)), "mocap_yaw")
    assert found < 0.03 - NOISE_SIGMA * error


@pytest.mark.parametrize("refit", [False, True])
@pytest.mark.slow
def test_effects_of_the_base_move_with_a_refit_only(refit):
    """A rate limit that is free stretches until no lag is missing."""
    base = apply(PAPER, "steering_rate_limit", k=0.1)
    found = search(drive(("steering_lag", 0.12), seconds=24.0), p=base, names=("steering_lag",),
                   max_causes=0, refit=refit)
    assert (size_of(found, "steering_rate_limit") == 0.1) is not refit


@pytest.mark.slow
@pytest.mark.parametrize("impossible", ["grip", ""])
def test_cause_that_is_left_out_does_not_shape_the_noise(impossible, monkeypatch):
    """With causes of sensors alone the noise of the motion is that of the base."""
    base = []
    used = []
    select_noise = conclude.select_noise
    mounted = conclude.fit_mounting

    def spy_on_base(effects, noise, base_noise):
        base.append(base_noise)
        return select_noise(effects, noise, base_noise)

    def spy_on_use(search, evidence, point, noise):
        used.append(noise)
        return mounted(search, evidence, point, noise)

    monkeypatch.setattr(conclude, "select_noise", spy_on_base)
    monkeypatch.setattr(conclude, "fit_mounting", spy_on_use)
    monkeypatch.setattr(conclude, "impossible_size",
                        lambda fit, name: "no car has it" if name == impossible else "")
    train, test = (drive(("gyro_scale", 0.05), ("grip", -0.2), seconds=40.0, seed=s)
                   for s in (3, 4))
    file, p = find_model("paper")
    found = diagnose(file, p, [train], [test], refit=False, only=("gyro_scale", "grip"))
    accepted = {"gyro_scale", "grip"} - {impossible}
    assert {c.effect for c in found.causes} == accepted
    assert np.array_equal(used[-1].motion, base[-1].motion) is bool(impossible)
