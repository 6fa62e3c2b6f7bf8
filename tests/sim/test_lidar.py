"""The simulated lidar: what it sees is where it is, with every fault that the URL can state."""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians, tau

import numpy as np
import pytest

from dart_hal.core.errors import UsageError
from dart_hal.core.types import Mount
from dart_hal.devices.lidar.packets import LidarDecoder
from dart_lab.sim.lidar.maps import RoomMap, box
from dart_lab.sim.lidar.params import NOMINAL, LidarParams, hidden_lidar, parse_lidar
from dart_lab.sim.lidar.unit import LidarUnit, SimLidar

EXACT = LidarParams(noise=0.0, dropout=0.0, jitter=0.0)
HALL = RoomMap("hall", box(3.0, 2.0, 0.0, 8.0, 6.0), np.empty((0, 4)), (3.0, 2.0, 0.0))


def resting_pose(t):
    return np.zeros((len(t), 3))


def spinning(rate):
    def poses(t):
        return np.column_stack((np.zeros(len(t)), np.zeros(len(t)), rate * t))
    return poses


def scans(poses=resting_pose, room=HALL, params=EXACT, seconds=1.0, others=()):
    """Scans as the host makes them, with the true mount."""
    lidar = SimLidar(LidarUnit(poses, room, params, 1))
    lidar.unit.others += others
    return [s.mounted(params.mount) for s in lidar.poll(seconds)]


def in_room(poses, room=HALL):
    """``PoseAt`` in the room's frame, for rooms whose start is not turned."""
    def room_pose(t):
        x, y, yaw = poses(t).T
        return x + room.start[0], y + room.start[1], yaw
    return room_pose


def off_walls(points, room=HALL):
    """Distance of points (n, 2) from the walls of the hall [m]; NaN points left out."""
    (x0, x1), (y0, y1) = ((room.lines[:, [0, 2]].min(), room.lines[:, [0, 2]].max()),
                          (room.lines[:, [1, 3]].min(), room.lines[:, [1, 3]].max()))
    x, y = points[~np.isnan(points).any(axis=1)].T
    return np.minimum.reduce([abs(x - x0), abs(x - x1), abs(y - y0), abs(y - y1)])


@pytest.mark.parametrize("params", [
    EXACT, replace(EXACT, yaw=0.7, y=0.05), replace(EXACT, clockwise=0.0, yaw=pi),
    replace(EXACT, scale=1.012), replace(EXACT, rate=8.25), replace(EXACT, ripple=0.01)])
def test_points_lie_on_the_walls(params):
    """Within the rounding of an angle (1/64 deg) and of the manual's correction (0.02 deg)."""
    found = scans(params=params)
    assert len(found) >= 6
    for scan in found:
        assert np.isfinite(scan.range).all()
        assert off_walls(scan.points(in_room(resting_pose))).max() < 0.006


@pytest.mark.slow_except("changes2-rplidar-exp*")
@pytest.mark.parametrize(("kind", "beams"), [("ld19", 450), ("rplidar", 358),
                                             ("rplidar-express", 716)])
@pytest.mark.parametrize("changes", [{}, {"clockwise": 0.0, "yaw": 0.7}, {"lost": 0.05}])
def test_points_of_other_models_lie_on_the_walls(kind, beams, changes):
    """Also with damaged bytes, except that no check covers the distances of an RPLidar."""
    params = replace(NOMINAL[kind], noise=0.0, dropout=0.0, jitter=0.0, **changes)
    found = scans(params=params, seconds=3.0)
    assert len(found) >= 10
    assert max(len(s) for s in found) == beams
    for scan in found:
        off = off_walls(scan.points(in_room(resting_pose)))
        assert np.quantile(off, 0.95) < 0.006
        if kind != "rplidar" or "lost" not in changes:
            assert off.max() < 0.006


@pytest.mark.parametrize("kind", ["ld19", "rplidar", "rplidar-express"])
@pytest.mark.parametrize("seed", [0, 2])
def test_other_models_see_a_straight_wall_from_a_car_that_turns(kind, seed):
    straight, crooked = bent(hidden_lidar(seed, kind), seconds=3.0)
    assert straight < 0.025
    assert crooked > 2.0 * straight


@pytest.mark.slow
def test_other_models_state_their_noise_and_range():
    for kind in ("ld19", "rplidar", "rplidar-express"):
        nominal = NOMINAL[kind]
        reach = np.concatenate([s.range for s in scans(params=nominal, seconds=6.0)])
        assert np.isnan(reach).mean() == pytest.approx(nominal.dropout, abs=0.005)
        big = RoomMap("big", box(0.0, 0.0, 0.0, 30.0, 30.0), np.empty((0, 4)), (0.0, 0.0, 0.0))
        assert all(np.isnan(s.range).all() for s in scans(room=big, params=nominal))


def test_a_wrong_mount_is_detected():
    """The control of the test above."""
    scan = scans(params=replace(EXACT, yaw=0.05))[2].mounted(Mount(x=0.13))
    assert off_walls(scan.points(in_room(resting_pose))).max() > 0.05
    mirrored = scans()[2].mounted(Mount(x=0.13, inverted=False))
    assert abs(mirrored.bearing + scans()[2].bearing).max() < 1e-6


def bent(params, rate=3.0, seconds=2.0):
    """rms [m] of a wall 1.5 m from a car that turns, by each beam's pose, and by one pose."""
    wall = RoomMap("wall", np.array(((-9.0, 1.5, 9.0, 1.5),)), np.empty((0, 4)), (0.0, 0.0, 0.0))
    poses, by_beam, by_scan = spinning(rate), [], []
    for scan in scans(poses, wall, params, seconds)[4:]:
        room_pose = in_room(poses, wall)
        near = np.abs(scan.range) < 3.0
        by_beam.append((scan.points(room_pose)[near] - (0.0, 1.5))[:, 1])
        middle = np.full(len(scan), scan.t.mean())
        by_scan.append((scan.points(lambda t, middle=middle,
                                    room_pose=room_pose: room_pose(middle))[near]
                        - (0.0, 1.5))[:, 1])
    return [float(np.sqrt(np.mean(np.concatenate(r) ** 2))) for r in (by_beam, by_scan)]


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_next_to_a_car_that_turns_a_wall_is_straight_by_the_pose_of_each_beam(seed):
    straight, crooked = bent(hidden_lidar(seed))
    assert straight < 0.02
    assert crooked > 3.0 * straight, "one pose for all does as well: nothing is shown"


@pytest.mark.slow
def test_noise_dropouts_and_limits_are_what_is_stated():
    params = replace(EXACT, noise=0.015, dropout=0.03)
    found = scans(params=params, seconds=6.0)
    reach = np.concatenate([s.range for s in found])
    assert np.isnan(reach).mean() == pytest.approx(0.03, abs=0.005)
    points = np.concatenate([s.points(in_room(resting_pose)) for s in found])
    near_edge = points[np.abs(points[:, 0] - 3.0) < 1.0]
    y = near_edge[near_edge[:, 1] > 3.0][:, 1]
    assert y.std() == pytest.approx(0.015, abs=0.001)
    big = RoomMap("big", box(0.0, 0.0, 0.0, 30.0, 30.0), np.empty((0, 4)), (0.0, 0.0, 0.0))
    assert all(np.isnan(s.range).all() for s in scans(room=big))
    tight = RoomMap("tight", box(0.13, 0.0, 0.0, 0.2, 0.2), np.empty((0, 4)), (0.0, 0.0, 0.0))
    assert all(np.isnan(s.range[s.range < 0.119]).all() for s in scans(room=tight))


def test_glass_gives_nothing_back_and_hides_what_is_behind():
    pane = np.array(((5.0, 1.0, 5.0, 3.0),))
    scan = scans(room=RoomMap("glass", HALL.lines, pane, HALL.start))[1]
    ahead = np.abs(scan.bearing) < radians(20.0)
    assert np.isnan(scan.range[ahead]).all()
    assert np.isfinite(scan.range[np.abs(scan.bearing) > radians(40.0)]).all()


def test_another_car_is_detected_where_it_is_when_the_beam_passes():
    def other(t):
        return box(4.5, 1.0 + 1.0 * t, 0.0, 0.2, 0.2)

    near = [s.points(in_room(resting_pose)) for s in scans(others=(other,), seconds=1.5)]
    for points, scan in zip(near, scans(seconds=1.5), strict=True):
        hit = points[off_walls(points) > 0.1]
        assert len(hit) > 3
        t = scan.t[off_walls(points) > 0.1].mean()
        assert hit[:, 1].mean() == pytest.approx(1.0 + t, abs=0.12)


def test_bytes_come_at_the_pace_of_the_line_with_right_checks():
    unit = LidarUnit(resting_pose, HALL, replace(EXACT, rate=8.25), 1)
    came = unit.chunks(2.0)
    decoder = LidarDecoder()
    beams = [len(p.angle) for data, _ in came for p in decoder.feed(data)]
    assert (decoder.broken, decoder.skipped) == (0, 0)
    assert sum(beams) == pytest.approx(2.0 * 5000, abs=650)
    gaps = np.diff([t for _, t in came])
    wire = np.array([len(data) for data, _ in came[1:]]) * 10 / 128000
    assert (gaps >= wire - 1e-12).all()
    turn = [len(s) for s in scans(params=replace(EXACT, rate=8.25))]
    assert set(turn) == {606}


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.slow
def test_the_host_knows_when_each_beam_was_taken(seed):
    """To 0.3 ms, 1 mrad of a car that turns at 3 rad/s, though arrivals swing by 4 ms."""
    params = replace(hidden_lidar(seed), jitter=4e-3)
    t = np.arange(80_000) * 0.2e-3 * (1.0 + params.skew)
    turned = tau * params.rate * t
    turned += params.ripple * np.sin(turned)
    found = scans(params=params, seconds=12.0)
    true = [t[np.argmax(turned >= tau * n)] for n in range(1, len(found) + 1)]
    error = np.abs([s.start - begin for s, begin in zip(found, true, strict=True)])
    assert error[8:].max() < 0.3e-3
    late = [s.arrival - s.t[-1] for s in found]
    assert np.ptp(late) > 2e-3, "the control: arrivals give the time as well"


def test_damaged_bytes_cost_their_packet_alone():
    found = scans(params=replace(EXACT, lost=0.05), seconds=4.0)
    lengths = [len(s) for s in found]
    assert min(lengths) < 620 < max(lengths)
    for scan in found:
        assert off_walls(scan.points(in_room(resting_pose))).max() < 0.006


def test_same_seed_same_bytes_and_another_seed_others():
    params = hidden_lidar(4)
    one, two, other = (b"".join(d for d, _ in LidarUnit(resting_pose, HALL, params, s).chunks(0.5))
                       for s in (4, 4, 5))
    assert one == two != other


@pytest.mark.parametrize("text", ["2", "colour=1", "sick", "ld19,x4", "noise=0,ld19",
                                  "rate=x", "rate=8,rate=8", "rate=99", "noise"])
def test_what_makes_no_sense_is_refused(text):
    with pytest.raises(UsageError):
        parse_lidar(text, 1)


def test_what_is_not_stated_is_hidden_in_the_seed():
    assert parse_lidar("0", 1) is None
    assert parse_lidar("1", 7) == hidden_lidar(7) != hidden_lidar(8)
    assert parse_lidar("ld19", 7) == hidden_lidar(7, "ld19")
    assert parse_lidar("rplidar,rate=6", 7) == replace(hidden_lidar(7, "rplidar"), rate=6.0)
    assert parse_lidar("x4", 7) == hidden_lidar(7)
    assert parse_lidar("noise=0", 7) == replace(hidden_lidar(7), noise=0.0)


def mixed_beams(params):
    """Beams that end in front of a wall and behind the board before it, where nothing is."""
    board = np.array(((0.0, 1.0, 1.0, 1.0),))
    room = RoomMap("board", np.vstack((HALL.lines, board)), HALL.glass, (0.5, 0.0, 0.0))
    ends = np.vstack([scan.points(in_room(resting_pose, room)) for scan in scans(room=room,
                                                                            params=params)])
    inside = (ends[:, 1] > 1.1) & (ends[:, 1] < 4.9) & (ends[:, 0] > -0.9) & (ends[:, 0] < 6.9)
    return int(inside.sum())


def test_a_beam_that_an_edge_parts_ends_where_nothing_is():
    """The control has no width."""
    assert mixed_beams(replace(EXACT, spot=0.01)) > 3
    assert mixed_beams(EXACT) == 0
