"""A run as a Recording: speeds without lag, commands where they were, at any rate."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.car.runs import read_run
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of

START, END = 3.0, 4.5


def recorded(folder, seconds, command):
    """(path, world): a run of the simulated car by command(s since its start), and that car."""
    path, backend = folder / "run.mcap", open_backend("sim://?seed=0&nano=mock")
    world = world_of(backend)
    with Car.over(backend, cars=folder, record=path) as car:
        car.arm()
        begin = None
        for state in car.states(duration=seconds):
            begin = state.t if begin is None else begin
            car.drive(**command(state.t - begin))
    return path, world


@pytest.fixture(scope="module")
def pulled(tmp_path_factory):
    """A pull of 1.5 s that rolls out."""
    return recorded(tmp_path_factory.mktemp("pull"), 6.0, lambda t: {
        "throttle": 0.3 if START - 2.5 < t < END - 2.5 else 0.0})


@pytest.mark.parametrize("every", [1, 2, 5, 10])
@pytest.mark.slow
def test_speed_is_the_mean_of_the_step_and_not_older(pulled, every):
    path, world = pulled
    m = read_run(path, every).messages
    window = 0.01 * every
    true = np.array([(world.truth(t).distance - world.truth(t - window).distance) / window
                     for t in m.t.tolist()])
    moving = true > 0.3
    assert moving.sum() > 100 // every
    error = (m.speed - true)[moving]
    slope = np.gradient(true, m.t)[moving]
    lag = -float(error @ slope) / float(slope @ slope)
    assert abs(lag) < 2e-3  # State.speed is 11 ms old and more
    assert np.sqrt(np.mean(error**2)) < 0.012


@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.slow
def test_neutral_is_zero_and_jumps_keep_their_time(pulled, every):
    path, _ = pulled
    fine, m = read_run(path, 1).messages, read_run(path, every).messages
    pulls = m.throttle > 0.0
    assert (m.throttle[~pulls] == 0.0).all()
    assert np.abs(m.throttle[pulls] - 0.3).max() < (0.011 if every == 1 else 0.005)  # dithering
    rise = fine.t[np.flatnonzero(np.diff(fine.throttle) > 0.1)]
    fall = fine.t[np.flatnonzero(np.diff(fine.throttle) < -0.1)]
    for times, sign in ((rise, 1.0), (fall, -1.0)):
        found = np.flatnonzero(sign * np.diff(m.throttle) > 0.1)
        assert len(found) == 1
        assert m.t[found[0]] == pytest.approx(times[0], abs=1e-6)
        assert m.t[found[0] + 1] - m.t[found[0]] < 0.015


@pytest.mark.slow
def test_thinning_changes_how_many_messages_not_what_they_state(pulled):
    path, _ = pulled
    coarse, fine = read_run(path).messages, read_run(path, 2).messages
    assert len(fine) > 4 * len(coarse)
    both = np.interp(coarse.t, fine.t, np.convolve(fine.speed, np.full(5, 0.2), mode="full")
                     [:len(fine)])
    assert np.abs(both - coarse.speed)[5:].max() < 0.08


@pytest.fixture(scope="module")
def woven(tmp_path_factory):
    """A weave of 1 Hz at 1 m/s."""
    return recorded(tmp_path_factory.mktemp("weave"), 5.0, lambda t: {
        "throttle": 0.3, "steering": 0.2 * np.sin(2.0 * np.pi * t)})


@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.slow
def test_yaw_rate_is_the_mean_of_the_step_and_not_older(woven, every):
    path, world = woven
    m = read_run(path, every).messages
    window = 0.01 * every
    true = np.array([(world.truth(t).yaw - world.truth(t - window).yaw) / window
                     for t in m.t.tolist()])
    moving = m.speed > 0.5
    assert moving.sum() > 200 // every
    error = (m.yaw_rate - true)[moving]
    slope = np.gradient(true, m.t)[moving]
    lag = -float(error @ slope) / float(slope @ slope)
    assert abs(lag) < 5e-3  # of the 10 ms half are the wait for a sample, 0 to 10 in this car
