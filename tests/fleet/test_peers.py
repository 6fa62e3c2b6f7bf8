"""The table of the others: age, loss, overtaking, copies, late joining, restarts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.errors import UsageError
from dart_hal.core.url import Url
from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import encode
from dart_hal.fleet.key import RoomKey
from dart_hal.fleet.peers import LOST_AFTER, MAX_SESSIONS, MAX_TRANSIT, Peers
from dart_hal.fleet.transports import Datagram
from dart_hal.fleet.transports.local import open_local
from tests.fleet.rooms import pose_frame

POSE_PERIOD_S = 0.05


class Fed:
    """A line whose datagrams the test hands over, with its own clock."""

    url = "fed://"
    trouble = ""

    def __init__(self):
        self.came = []
        self.line = 0.0

    def stamp(self, now):
        return self.line

    def poll(self, now):
        came = self.came
        self.came = []
        return came

    def answer(self, source):
        pass


@pytest.fixture
def fed_peers():
    return Fed()


def hears(peers, fed_peers, now, *frames, line=None, age=0.0):
    fed_peers.line = now if line is None else line
    fed_peers.came = [Datagram(data, age) for data in frames]
    peers.receive(fed_peers, now)
    return peers.other_poses(now)


def test_a_pose_ages_by_this_cars_clock(fed_peers):
    peers = Peers("blue", 1)
    peer = hears(peers, fed_peers, 10.0, pose_frame(1, x=3.0, age=0.02, sent=10.0))["red"]
    assert (peer.pose.x, peer.lost) == (3.0, False)
    assert peer.age == pytest.approx(0.02)
    assert peers.other_poses(10.4)["red"].age == pytest.approx(0.42)
    assert not peers.other_poses(10.0 + LOST_AFTER - 0.03)["red"].lost
    assert peers.other_poses(10.01 + LOST_AFTER)["red"].lost


def test_the_covariance_grows_by_how_far_it_may_have_gone(fed_peers):
    peers = Peers("blue", 1)
    hears(peers, fed_peers, 0.0, pose_frame(1, speed=2.0, yaw_rate=1.5))
    for age in (0.1, 0.5, 2.0):
        cov = peers.other_poses(age)["red"].pose.cov
        assert cov[0, 0] == pytest.approx(0.01**2 + (2.0 * age + age**2) ** 2)
        assert cov[2, 2] == pytest.approx(0.02**2 + (1.5 * age + 2.5 * age**2) ** 2)
        assert np.all(np.linalg.eigvalsh(cov) > 0.0)
        assert not cov.flags.writeable


def test_a_frame_that_travelled_longer_than_others_is_as_old_as_it_is(fed_peers):
    """The quickest frame needs 30 ms; clocks differ by 1000 s; the third is 200 ms later."""
    peers = Peers("blue", 1)
    for n, late in enumerate((0.0, 0.0, 0.2)):
        sent = POSE_PERIOD_S * n
        peer = hears(peers, fed_peers, 5.0 + sent + late, pose_frame(n, sent=sent),
                     line=1000.0 + sent + 0.03 + late)["red"]
        assert peer.age == pytest.approx(late)


@pytest.mark.parametrize("rate", [0.25, 4.0])
def test_a_car_slower_or_quicker_than_its_computer_sees_right_ages(fed_peers, rate):
    """A car's second lasts 1/rate of the computer's; a frame leaves each 0.05 s of the
    computer's, and is taken at the next look, each 0.01 s of the car's."""
    peers = Peers("blue", 1)
    car = 0.0
    n = 0
    for _ in range(400):
        car += 0.01
        line = car / rate
        frames = []
        while n * POSE_PERIOD_S <= line:
            frames.append(Datagram(pose_frame(n, sent=n * POSE_PERIOD_S), line - n * POSE_PERIOD_S))
            n += 1
        fed_peers.line = line
        fed_peers.came = frames
        peers.receive(fed_peers, car)
        if n > 1:
            oldest = rate * POSE_PERIOD_S + 0.0101  # since the newest frame, and a look
            assert peers.other_poses(car)["red"].age <= oldest
    assert not peers.other_poses(car)["red"].lost
    assert peers.other_poses(car + 1.0)["red"].age == pytest.approx(1.0, abs=oldest)


def test_overtaken_and_repeated_frames_change_nothing(fed_peers):
    peers = Peers("blue", 1)
    order = (0, 1, 3, 3, 2, 5, 1, 4)
    for k, n in enumerate(order):
        peer = hears(peers, fed_peers, POSE_PERIOD_S * k,
                     pose_frame(n, x=float(n), sent=POSE_PERIOD_S * n))["red"]
        assert peer.pose.x == max(order[:k + 1])
    red = peers.senders["red"]
    assert (red.accepted, red.late, red.copies, red.lost) == (6, 2, 2, 0)


def test_lost_frames_are_counted(fed_peers):
    peers = Peers("blue", 1)
    for n in (0, 1, 4, 5, 9):
        hears(peers, fed_peers, POSE_PERIOD_S * n, pose_frame(n, sent=POSE_PERIOD_S * n))
    assert peers.senders["red"].lost == 5


def test_a_restarted_car_counts_from_its_new_session(fed_peers):
    """Its numbers and its line's clock restart; frames of the old session come after it."""
    peers = Peers("blue", 1)
    hears(peers, fed_peers, 10.0, pose_frame(5000, x=1.0, boot=7, sent=10.0))
    peer = hears(peers, fed_peers, 12.0, pose_frame(0, x=2.0, boot=8, sent=0.3))["red"]
    assert (peer.pose.x, peer.age) == (2.0, pytest.approx(0.0))
    peer = hears(peers, fed_peers, 12.1, pose_frame(5001, x=1.0, boot=7, sent=10.1))["red"]
    assert peer.pose.x == 2.0
    assert peers.retired == 1
    assert not peers.namesakes


def test_two_programs_of_one_name_are_reported(fed_peers):
    peers = Peers("blue", 1)
    for n in range(60):
        hears(peers, fed_peers, POSE_PERIOD_S * n, pose_frame(n, boot=7), pose_frame(n, boot=8))
    assert 60 * POSE_PERIOD_S > MAX_TRANSIT
    assert peers.namesakes == {"red"}
    hears(peers, fed_peers, 4.0, pose_frame(1, boot=9, name="blue"))
    assert "blue" in peers.namesakes


def test_own_frames_that_come_back_are_no_peer(fed_peers):
    peers = Peers("blue", 7)
    assert hears(peers, fed_peers, 1.0, pose_frame(1, boot=7)) == {}


def test_a_flood_of_names_does_not_fill_the_memory(fed_peers):
    peers = Peers("blue", 1)
    for n in range(3 * MAX_SESSIONS):
        fed_peers.came = [Datagram(pose_frame(1, name=f"n{n}"), 0.0)]
        peers.receive(fed_peers, 0.001 * n)
    assert len(peers.senders) == MAX_SESSIONS
    assert f"n{3 * MAX_SESSIONS - 1}" in peers.senders


def test_junk_changes_no_peer(fed_peers):
    peers = Peers("blue", 1)
    before = hears(peers, fed_peers, 1.0, pose_frame(1, x=1.0))["red"]
    after = hears(peers, fed_peers, 1.0, b"", b"\0" * 4000, pose_frame(2, x=9.0)[:-3])["red"]
    assert after.pose.x == before.pose.x
    assert peers.decoder.counters.refused == 3


@given(st.lists(st.tuples(st.integers(0, 12), st.sampled_from([7, 8]), st.booleans()),
                max_size=40))
def test_in_any_order_the_newest_frame_of_the_newest_session_counts(frames):
    """Frames of two sessions, overtaking each other, again, and damaged."""
    fed_peers = Fed()
    peers = Peers("blue", 1)
    session = None
    newest = -1
    over = set()
    for k, (seq, boot, good) in enumerate(frames):
        data = pose_frame(seq, x=float(seq + 100 * boot), boot=boot)
        peer = hears(peers, fed_peers, 0.01 * k,
                     data if good else data[:-1] + bytes((data[-1] ^ 1,)))
        if good and boot == session:
            newest = max(newest, seq)
        elif good and boot not in over:
            over.add(session)
            session = boot
            newest = seq
        assert not peer if session is None else peer["red"].pose.x == newest + 100 * session
    assert peers.decoder.counters.refused == sum(not good for _, _, good in frames)


def run(room, seconds=4.0, alive=lambda n: True):
    """Pairs (true age, reported age) of a sender at 20 Hz, looked at 100 Hz through ``room``."""
    out = open_local(Url.parse(room))
    into = open_local(Url.parse(room))
    peers = Peers("blue", 1)
    pairs = []
    sent_at = {}
    for k in range(round(seconds * 100)):
        now = k * 0.01
        if k % 5 == 0 and alive(k // 5):
            sent_at[k // 5] = now
            out.send(pose_frame(k // 5, x=float(k // 5), sent=out.stamp(now)), now)
        peers.receive(into, now)
        peer = peers.other_poses(now).get("red")
        if peer is not None:
            pairs.append((now - sent_at[int(peer.pose.x)], peer.age))
    out.close()
    into.close()
    return np.array(pairs).T, peers


@pytest.mark.parametrize("faults", ["loss=0.5", "jitter=0.3", "loss=0.3&jitter=0.2&twice=0.5"])
def test_ages_are_right_through_loss_delay_and_copies(faults):
    (true, frames), peers = run(f"local://x?seed=3&{faults}")
    assert true.max() > 0.1
    # the first second: no quick frame has come yet
    true = true[100:]
    frames = frames[100:]
    # what the quickest frame of the last 10 s took, and a look of 10 ms, cannot be measured
    assert np.abs(true - frames).max() < 0.035
    assert peers.senders["red"].accepted > 30


def test_a_car_that_goes_silent_is_lost_and_found():
    (true, frames), _ = run("local://x", alive=lambda n: not 20 <= n < 50)
    assert frames.max() == pytest.approx(1.54, abs=0.02)
    assert np.abs(true - frames).max() < 0.011


def test_who_joins_late_knows_all_after_one_message():
    out, early = (open_local(Url.parse("local://late")) for _ in range(2))
    for n in range(10):
        out.send(pose_frame(n), POSE_PERIOD_S * n)
    late = open_local(Url.parse("local://late"))
    peers = Peers("blue", 1)
    peers.receive(late, 0.5)
    assert peers.other_poses(0.5) == {}
    out.send(pose_frame(10, x=1.0), 0.5)
    peers.receive(late, 0.51)
    assert peers.other_poses(0.51)["red"].pose.x == 1.0
    assert peers.senders["red"].lost == 0, "what was sent before it came is no loss"
    for end in (out, early, late):
        end.close()


def test_a_plan_and_a_health_come_with_the_pose(fed_peers):
    peers = Peers("blue", 1)
    plan = encode(m.PLAN, 7, 2, 0.0, ("red", 0.1, "room", 0.05, ((1.0, 2.0, 0.5, 1.5),) * 3))
    health = encode(m.HEALTH, 7, 3, 0.0, ("red", "ARMED", 4, "IMU_STEP CAR_SLIDES", ""))
    peer = hears(peers, fed_peers, 0.0, pose_frame(1), plan, health)["red"]
    assert peer.plan.points.tolist() == [[1.0, 2.0, 0.5, 1.5]] * 3
    assert (peer.plan.step, peer.plan.age) == (pytest.approx(0.05), pytest.approx(0.1))
    assert (peer.health.mode, peer.health.lost) == ("ARMED", 4)
    assert peer.health.doubts == {"IMU_STEP", "CAR_SLIDES"}
    assert peer.health.battery is None


def test_the_voltage_of_a_battery_comes_with_the_health_until_it_is_old(fed_peers):
    peers = Peers("blue", 1)
    health = encode(m.HEALTH, 7, 2, 0.0, ("red", "ARMED", 0, "", ""))
    voltage = encode(m.BATTERY, 7, 3, 0.0, ("red", 7.25))
    peer = hears(peers, fed_peers, 0.0, pose_frame(1), health, voltage)["red"]
    assert peer.health.battery == 7.25
    assert peers.other_poses(0.9)["red"].health.battery == 7.25
    assert peers.other_poses(1.1)["red"].health.battery is None


def test_a_law_of_several_cars_sends_its_own_bytes(fed_peers):
    """For any frames; an overtaken frame does not replace a newer one."""
    peers = Peers("blue", 1)
    for seq, payload in ((1, b"\0\xff"), (3, b"new"), (2, b"old")):
        hears(peers, fed_peers, 0.1 * seq,
              encode(m.COORDINATION, 7, seq, 0.1 * seq, ("red", payload)))
    frames = peers.coordination(0.5)["red"]
    assert (frames.boot, frames.seq, frames.payload) == (7, 3, b"new")
    assert frames.age == pytest.approx(0.2)
    with pytest.raises(UsageError, match="COORDINATION"):
        encode(m.COORDINATION, 7, 1, 0.0, ("red", b"x" * 256))


@pytest.mark.parametrize("key", [None, RoomKey(b"key of the laboratory")])
def test_watcher_without_an_echo_is_reported_after_the_time_that_a_frame_may_travel(fed_peers, key):
    peers = Peers("blue", 1, key)
    for n in range(60):
        now = n * POSE_PERIOD_S
        hears(peers, fed_peers, now, encode(m.BEAT, 7, n, now, ("base",), key))
        assert ("base" in peers.list_ignored(now)) == (now > MAX_TRANSIT), now
