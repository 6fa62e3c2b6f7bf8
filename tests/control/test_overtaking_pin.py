"""An emulated car that detects another one by its own lidar: pulses at its ESC, contacts."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.car.others import Others
from dart_hal.cli.follow import follow, make_follower, track_cars
from dart_hal.control.follow import Rules
from dart_hal.control.tracks import track_named
from dart_hal.control.traffic import TrafficWait
from dart_hal.core.url import Url
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.arena import enter_arena
from dart_lab.sim.truth import room_of_car, world_of
from studies.control.lidar_figures import grid_of

VICON = track_named("racetrack_vicon_2")
# s: duration of a drive from its first motion on.
DURATION = 9.0


def drive_behind(folder, *, detect, tracker):
    """Return the traffic rules, contacts, and (t, us) at the ESC of a drive of at most 9 s, with
    another car at rest 5 m ahead."""
    at = f"{VICON.x[0]},{VICON.y[0]},{VICON.heading[0]}"
    backend = open_backend(f"sim://?seed=0&nano=mock&lidar=1&map=hall&world=pin-{detect}&at={at}")
    x, y, yaw, _ = VICON.interpolate(5.0)
    place = enter_arena(Url.parse(f"sim://?world=pin-{detect}&at={x},{y},{yaw}"), "other")
    pulses = []
    world_of(backend).watchers.append(lambda channel, pulse: pulses.append(
        (pulse[1], 1e6 * (pulse[1] - pulse[0]))) if channel == 1 else None)
    chart = grid_of(room_of_car(backend), folder)
    with Car.over(backend, cars=folder, poses=f"lidar:{chart}") as car:
        follower = make_follower(car, VICON, 1.0, tracker, Rules(duration=DURATION), None)
        others = Others(None, follower, track_cars(car)) if detect else None
        follow(car, follower, (), others)
        car.stop()
        contacts = len(backend.contacts())
    place.leave()
    return others and others.traffic, contacts, np.array(pulses)


@pytest.mark.slow
@pytest.mark.parametrize("tracker", ["lqr", "mpcc"])
def test_behind_a_car_that_rests_in_its_scans_the_esc_gets_neutral(tmp_path, tracker):
    traffic, contacts, pulses = drive_behind(tmp_path, detect=True, tracker=tracker)
    assert contacts == 0
    assert traffic.wait is TrafficWait.BEHIND
    assert traffic.room < inf
    t, width = pulses.T
    pull = width - 1500.0
    assert pull[t < t[-1] - 4.0].max() > 50.0
    assert np.abs(pull[(t > t[-1] - 1.5) & (t < t[-1] - 0.5)]).max() < 5.0


@pytest.mark.slow
def test_control_without_detection_the_cars_touch(tmp_path):
    _, contacts, pulses = drive_behind(tmp_path, detect=False, tracker="lqr")
    assert contacts > 0
    assert pulses[-50:, 1].size
