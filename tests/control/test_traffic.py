"""Other cars on a path: passed, waited for, or none of its business."""

from __future__ import annotations

from math import cos, inf, pi, sin
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.car import Car, Fleet, join
from dart_hal.car.others import Others
from dart_hal.control import traffic as law
from dart_hal.control.follow import Follower, Phase, Rules
from dart_hal.control.mpc.planner import PlanOutcome
from dart_hal.control.paths import Path
from dart_hal.control.plant import plant_of
from dart_hal.control.traffic import NearbyCar, PathTraffic, TrafficWait
from dart_hal.core.types import Pose, pose_cov
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from studies.control.follow_figures import write_files
from studies.control.light_follow import LATER, light_drive, plant_by
from tests.control.test_mpc import TRACK

pytestmark = pytest.mark.usefixtures("armed_esc")

REAR = 0.09
LONG_STRAIGHT = Path([(9.0, 0.0)], closed=False)


def place_car(s, offset, turn=0.0, *, path=TRACK, std=0.0, **of):
    """A car whose middle is there."""
    spot = path.interpolate(s)
    yaw = spot.heading + turn
    x = spot.x - offset * sin(spot.heading)
    y = spot.y + offset * cos(spot.heading)
    return NearbyCar("red", Pose(x - REAR * cos(yaw), y - REAR * sin(yaw), yaw,
                                 pose_cov(std, std)), **{"speed": 0.0, "age": 0.0, "lost": False,
                                                         **of})


def judge_traffic(*others, s=1.0, speed=1.0, passes=True, path=TRACK):
    found = PathTraffic(path, 0.3, REAR, passes)
    found.judge(0.0, s, speed, others)
    return found


@pytest.mark.parametrize("turn", [0.0, pi / 2, pi])
def test_one_in_the_middle_is_waited_for(turn):
    """Its disc, the own front, and the air between."""
    found = judge_traffic(place_car(3.0, 0.02, turn))
    assert (found.wait, found.who, found.obstacles) == (TrafficWait.BEHIND, "red", ())
    assert found.room == pytest.approx(2.0 - REAR - law.BODY_RADIUS - 0.15 - law.STOP_GAP, abs=0.01)
    assert 0.5 < found.speed < 1.5


@pytest.mark.parametrize(("offset", "passed"), [(0.2, True), (-0.3, True), (0.45, False)])
def test_a_car_off_the_middle_is_passed_or_nothing(offset, passed):
    found = judge_traffic(place_car(3.0, offset, speed=0.5))
    assert (found.wait, found.speed) == (TrafficWait.FREE, inf)
    assert [o.offset for o in found.obstacles] == pytest.approx([offset] * passed, abs=0.01)
    assert [o.speed for o in found.obstacles] == [0.5] * passed


def test_a_tracker_that_passes_no_car_waits():
    assert judge_traffic(place_car(3.0, 0.2), passes=False).wait is TrafficWait.BEHIND


def test_a_silent_car_stays_where_it_was_and_is_not_passed():
    found = judge_traffic(place_car(3.0, 0.2, speed=2.0, age=60.0, lost=True))
    assert (found.wait, found.obstacles) == (TrafficWait.LOST, ())
    assert found.room < 2.0


def test_a_possible_car_limits_the_speed_at_once_and_is_not_passed():
    found = judge_traffic(place_car(2.2, 0.2, confirmed=False))
    assert (found.wait, found.obstacles) == (TrafficWait.UNCONFIRMED, ())
    assert 0.0 < found.speed < 0.9
    found.judge(0.1, 1.0, 1.0, [place_car(2.2, 0.2)])
    assert (found.wait, found.speed) == (TrafficWait.FREE, inf), "the control: once confirmed"
    assert judge_traffic(place_car(2.2, 0.45, confirmed=False)).wait is TrafficWait.FREE


@pytest.mark.parametrize(("travel", "wait"), [(0.7, TrafficWait.FREE),
                                              (0.0, TrafficWait.UNCONFIRMED)])
def test_a_possible_car_where_a_known_one_is_expected_is_that_car(travel, wait):
    """The report of the known car is 0.5 s old; its place is compared by the centres."""
    known = place_car(1.6, 0.2, speed=2.0 * travel, age=0.5)
    possible = place_car(2.2, 0.2, pi, confirmed=False)
    assert judge_traffic(known, possible).wait is wait


def test_one_that_is_heard_is_where_it_has_driven_since():
    still = judge_traffic(place_car(2.5, 0.0))
    on = judge_traffic(place_car(2.5, 0.0, speed=1.0, age=0.3))
    assert on.room == pytest.approx(still.room + 0.3, abs=0.01)


def test_between_its_data_it_follows_the_bend():
    """After 1 s at 1 m/s along a circle of 1 m its tangent is 0.46 m off the path."""
    circle = Path([(2.0 * pi, 1.0)], closed=True)
    found = judge_traffic(place_car(1.0, 0.0, path=circle, speed=1.0, age=1.0, speed_std=0.1),
                          s=0.5, passes=False, path=circle)
    later = judge_traffic(place_car(2.0, 0.0, path=circle), s=0.5, passes=False, path=circle)
    assert found.room == pytest.approx(later.room, abs=0.01)


def test_doubt_of_its_speed_takes_room_and_lengthens_the_obstacle():
    exact = judge_traffic(place_car(3.0, 0.0)).room
    assert judge_traffic(place_car(3.0, 0.0, along_std=0.2)).room == pytest.approx(exact - 0.4)
    assert judge_traffic(place_car(3.0, 0.2, speed_std=0.1)).obstacles[0].spread == 0.2


def test_one_that_is_lost_beside_the_car_remains_an_obstacle():
    """The car stops, and does not steer back into it; one that was never passed is no obstacle."""
    found = judge_traffic(place_car(1.2, 0.2))
    assert found.obstacles
    found.judge(0.1, 1.0, 1.0, [place_car(1.2, 0.2, lost=True)])
    assert len(found.obstacles) == 1
    assert (found.speed, found.wait) == (0.0, TrafficWait.LOST)
    assert judge_traffic(place_car(1.2, 0.2, lost=True)).obstacles == ()


def test_noise_does_not_end_a_passage_that_has_begun():
    """In a lane of 0.3 m, 0.12 m off the path suffice to be passed, 0.115 m do not."""
    found = judge_traffic(place_car(1.5, 0.142))
    assert found.wait is TrafficWait.FREE
    found.judge(0.1, 1.0, 1.0, [place_car(1.5, 0.137)])
    assert found.wait is TrafficWait.FREE
    assert judge_traffic(place_car(1.5, 0.137)).wait is TrafficWait.BEHIND


def test_doubt_of_its_place_takes_room():
    exact = judge_traffic(place_car(3.0, 0.0)).room
    assert judge_traffic(place_car(3.0, 0.0, std=0.1)).room == pytest.approx(exact - 0.2,
                                                                             abs=0.01)


def test_cars_behind_in_the_next_lane_and_beyond_the_end_are_ignored():
    """x = 3 and x = 4.5 are lanes of the track at a distance of 1.5 m."""
    assert judge_traffic(place_car(0.6, 0.0)).wait is TrafficWait.FREE
    assert judge_traffic(place_car(3.0, 1.5)).wait is TrafficWait.FREE
    past = NearbyCar("red", Pose(11.0, 0.0, 0.0), 0.0, 0.0, False)
    assert judge_traffic(past, s=8.5, path=LONG_STRAIGHT).wait is TrafficWait.FREE


def test_a_car_over_the_start_of_a_lap_counts():
    assert judge_traffic(place_car(TRACK.length + 0.5, 0.0),
                         s=TRACK.length - 1.0).wait is TrafficWait.BEHIND


def test_it_stops_before_the_room_ends_and_starts_for_more_than_that():
    found = judge_traffic(place_car(1.6, 0.0))
    assert found.speed == 0.0
    found.judge(1.0, 1.0, 0.0, [place_car(1.75, 0.0)])
    assert found.speed == 0.0
    found.judge(2.0, 1.0, 0.0, [place_car(3.0, 0.0)])
    assert found.speed > 0.5
    assert found.seconds[TrafficWait.BEHIND] == pytest.approx(2.0)


class TrafficDrive:
    """Two emulated cars of one world on a straight. ``lead(t)``: speed [m/s] of the one ahead,
    None: its program has ended. ``rows``: t, true x of both, at each State; ``pulses``: t, us at
    the ESC of the own car; times from when the cars are armed. cars: a folder for their
    calibrations."""

    def __init__(self, lead, *, offset=0.0, room="", tracker="mpcc", seconds=9.0, blind=False,
                 cars=None):
        self.pulses = []
        rows = []
        backends = []
        for seed, x, y in ((1, 0.0, 0.0), (2, 2.5, offset)):
            backends.append(open_backend(f"sim://?seed={seed}&nano=mock&mocap=1&world=traffic&"
                                         f"at={x},{y},0"))
        worlds = [world_of(backend) for backend in backends]
        worlds[0].watchers.append(lambda channel, pulse: self.pulses.append(
            (pulse[1], 1e6 * (pulse[1] - pulse[0]))) if channel == 1 else None)
        for seed in (1, 2) if cars else ():
            write_files(f"sim://?seed={seed}&nano=mock&mocap=1", seed, cars)
        with Fleet([Car.over(backend, cars=cars) for backend in backends]) as fleet:
            own, other = fleet.cars
            fleet.members = tuple(join(car, f"local://traffic{room}", name=name)
                                  for car, name in zip(fleet.cars, ("own", "red"), strict=True))
            self.follower = Follower(LONG_STRAIGHT, plant_of(own.files), 1.0, tracker,
                                     Rules(here=True))
            self.others = Others(fleet.members[0], self.follower)
            fleet.arm()
            begun = own.now
            for states in fleet.states(duration=seconds):
                motion = states[0].estimate.predict(own.now)
                if not blind:
                    self.others.update(motion)
                steering, speed = self.follower.answer(motion)
                if self.follower.phase is Phase.ENDED:
                    break
                own.drive_speed(steering=steering, speed=speed)
                ahead = lead(own.now - begun)
                if ahead is None:
                    fleet.members[1].close()
                else:
                    other.drive_speed(steering=0.0, speed=ahead)
                rows.append((own.now - begun, worlds[0].truth().x, 2.5 + worlds[1].truth().x))
            self.contacts = fleet.contacts
        self.rows, self.pulses = np.array(rows), np.array(self.pulses) - (begun, 0.0)

    def max_pull(self, since, until):
        """Most us above neutral at the ESC between two times [s]."""
        t, width = self.pulses.T
        return float((width[(t > since) & (t < until)] - 1500.0).max())


def standing_pose(t):
    return 0.0


@pytest.mark.slow
@pytest.mark.parametrize("tracker", ["mpcc", "lqr"])
def test_a_car_at_rest_in_the_lane_is_waited_for(tracker):
    """At rest at neutral, with air; the follower is not stuck, and named is whom it waits for."""
    drive = TrafficDrive(standing_pose, tracker=tracker)
    assert not drive.contacts
    assert drive.follower.why == ""
    assert (drive.others.traffic.wait, drive.others.traffic.who) == (TrafficWait.BEHIND, "red")
    t, own, red = drive.rows.T
    assert 0.40 < red[-1] - own[-1] < 0.85
    assert drive.max_pull(t[-1] - 3.0, t[-1]) < 5.0
    assert drive.max_pull(0.0, 3.0) > 50.0


@pytest.mark.slow
def test_without_reports_it_drives_into_the_other_car():
    """The control."""
    assert TrafficDrive(standing_pose, blind=True, seconds=5.0).contacts


@pytest.mark.slow
def test_it_starts_again_behind_one_that_goes_on():
    drive = TrafficDrive(lambda t: 0.0 if t < 5.0 else 0.6)
    t, own, red = drive.rows.T
    assert not drive.contacts
    assert own[-1] - own[t < 5.0][-1] > 0.8
    assert (red - own).min() > 0.40
    assert drive.max_pull(4.5, 5.0) < 5.0


@pytest.mark.slow
def test_a_car_off_the_middle_is_passed(tmp_path):
    drive = TrafficDrive(standing_pose, offset=0.25, cars=tmp_path)
    assert not drive.contacts
    assert set(drive.follower.tracker.mpcc.outcomes.elements()) == {PlanOutcome.SOLVED}
    assert drive.rows[-1, 1] > 4.5
    assert drive.others.traffic.seconds[TrafficWait.BEHIND] == 0.0


@pytest.mark.slow
def test_it_is_not_passed_where_its_marker_is_unknown():
    """15 cm, twice, are no way."""
    drive = TrafficDrive(standing_pose, offset=0.25, seconds=5.0)
    assert not drive.contacts
    assert drive.others.traffic.wait is TrafficWait.BEHIND


@pytest.mark.slow
def test_one_that_falls_silent_is_waited_for_where_it_was():
    """It drives on, unheard: its place is unknown, so the own car waits behind its last place."""
    drive = TrafficDrive(lambda t: 0.6 if t < 2.0 else None)
    assert drive.others.traffic.wait is TrafficWait.LOST
    t, own, red = drive.rows.T
    assert own[-1] < red[t < 2.0][-1] - 0.3
    assert drive.max_pull(t[-1] - 2.0, t[-1]) < 5.0
    assert drive.others.traffic.seconds[TrafficWait.LOST] > 3.0


@pytest.mark.slow
@pytest.mark.parametrize("room", ["?loss=0.5&seed=1", "?delay=0.05&jitter=0.1&twice=0.2&seed=1"])
def test_through_loss_and_disorder_no_car_is_touched(room):
    """Frames that are lost, late, overtaken or come twice."""
    drive = TrafficDrive(lambda t: 0.6 if t < 4.0 else 0.0, room=room)
    assert not drive.contacts
    assert (drive.rows[:, 2] - drive.rows[:, 1]).min() > 0.40
    assert drive.rows[-1, 1] > 1.0


def test_another_frame_ends_the_drive():
    reports = {"red": SimpleNamespace(frame="start")}
    follower = Follower(LONG_STRAIGHT, plant_by(LATER), 1.0)
    others = Others(SimpleNamespace(other_poses=lambda: reports), follower)

    def each(t, follower, motion):
        others.update(motion)
        return motion

    light_drive(follower, each=each, seconds=5.0)
    assert follower.why == "red sends poses in the frame 'start', this car in 'room'"
    assert not follower.good
