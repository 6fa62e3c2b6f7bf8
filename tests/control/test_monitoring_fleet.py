"""A team of emulated cars in a room that loses messages: spread, at a distance, and safe when one
of them falls silent, by the pulses at their ESCs."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.control.monitoring.kuramoto import disagreement
from dart_hal.control.monitoring.monitor import MonitorMode
from dart_lab.sim.truth import world_of
from studies.control.monitoring_figures import NINE, OMEGA, SLOW, TEAM, driven, nine

NEUTRAL_PULSE_S = 1.5e-3
NEAR = 5e-6
"""s, s."""
DIES = 5.0
LASTS = 18.0
SAFE = 4.5
"""s after which no car drives on: 3 s of the plan that was sent last, and a stop."""


class Death:
    """The first car's program hangs; every pulse at the ESCs of the others."""

    def __init__(self) -> None:
        self.pulses = [[], []]
        self.worlds = []

    def __call__(self, fleet, team) -> None:
        if not self.worlds:
            self.worlds = [world_of(car._engine.backend) for car in fleet.cars[1:]]
            for world, pulses in zip(self.worlds, self.pulses, strict=True):
                world.watchers.append(lambda channel, pulse, pulses=pulses:
                                      pulses.append(pulse) if channel == 1 else None)
        if fleet.cars[0].now > DIES and team[0].mode is not MonitorMode.ENDED:
            team[0].follower.stop("it hangs")
            fleet.members[0].close()

    def forward(self, since) -> float:
        """s of the last pulse that drives a car on, after ``since`` s of its world."""
        return max((fall - since for pulses in self.pulses for rise, fall in pulses
                    if fall > since and fall - rise > NEUTRAL_PULSE_S + NEAR), default=0.0)


@pytest.mark.long
def test_three_cars_spread_while_messages_are_lost():
    drive = driven(1, "kinematic", 0.3, 8.0)
    assert drive.contacts == 0
    assert drive.least > TEAM.distances().min_distance - 1.0
    assert drive.settled < 0.25
    assert drive.modes[MonitorMode.YIELDING] < 0.01 * drive.modes.total()


@pytest.mark.parametrize(("plant", "loss"), [("paper", 0.5), ("named", 0.3)])
@pytest.mark.long
def test_they_keep_their_places(plant, loss):
    drive = driven(4, plant, loss, 20.0)
    assert drive.contacts == 0
    assert drive.settled < 0.05
    assert drive.error().max() < 0.15
    assert all(robot.rate == pytest.approx(OMEGA, rel=0.05) for robot in drive.team)
    assert drive.targets(TEAM.sensing_radius + drive.error().max()).max() == 0.0, "nowhere to hide"
    late = drive.targets(0.7 * TEAM.sensing_radius)
    assert 0.5 < late.max() < TEAM.bound(OMEGA), "100 of 100 moving targets, not all at once"
    assert np.isinf(drive.targets(0.5 * TEAM.sensing_radius)).any(), "control"


@pytest.mark.slow
def test_when_one_falls_silent_the_others_stop_without_contact():
    death = Death()
    drive = driven(1, "paper", 0.3, LASTS, each=death)
    assert drive.contacts == 0
    assert {str(robot.mode) for robot in drive.team[1:]} == {"ALONE"}
    assert 0.5 < death.forward(DIES) < SAFE


@pytest.mark.slow
def test_without_the_guard_they_drive_into_it():
    """The control: the same drive."""
    death = Death()
    drive = driven(1, "paper", 0.3, LASTS + 6.0, each=death, guard=False)
    assert drive.contacts > 0
    assert death.forward(DIES) > SAFE


@pytest.mark.long
def test_nine_cars_keep_the_published_curve():
    """Scaled to what a car can drive: 28 x 62 m, a lap of 600 m, by a motion capture."""
    drive = nine()
    assert drive.contacts == 0
    assert drive.least > NINE.distances().min_distance - 1.0
    assert disagreement(drive.X[-1], NINE.p) < disagreement(drive.X[0], NINE.p) + 0.005
    speeds = np.linalg.norm(drive.true[-1] - drive.true[-21], axis=-1)
    rates = np.array([robot.rate for robot in drive.team])
    assert np.abs(speeds - NINE.curve.rate(drive.X[-11]) * rates).max() < 0.1
    assert rates == pytest.approx(SLOW[0], rel=0.25)
    assert np.abs(speeds - speeds.mean()).max() > 0.2, "control: slower in bends than between them"
    assert drive.modes[MonitorMode.YIELDING] == 0
    assert drive.modes[MonitorMode.ALONE] < 0.03 * drive.modes.total(), "until all were heard"


@pytest.mark.long
@pytest.mark.emulator
def test_on_the_firmware():
    drive = driven(1, "paper", 0.3, 20.0, nano="avr")
    assert drive.contacts == 0
    assert drive.settled < 0.05
    assert drive.error().max() < 0.15
