"""MockNano speaks the protocol, and never pretends to be the firmware."""

from __future__ import annotations

import itertools

import pytest

from dart_hal.wire import messages as m
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.decoder import FrameDecoder
from dart_lab.sim.mock_nano import LATCH_TO_UART, MockNano
from dart_lab.sim.mock_supervisor import MockSupervisor, OutputState


class Talk:
    """A MockNano with a decoder and a host side of its own."""

    def __init__(self, **options):
        self.nano = MockNano(**options)
        self.decoder = FrameDecoder(UP)
        self.frames, self.ends = [], []
        self.seq = 0

    def run(self, seconds, beat=None):
        until = self.nano.now + seconds
        due = self.nano.now
        while self.nano.now < until:
            if beat is not None and self.nano.now >= due:
                due += 0.02
                self.send(m.HEARTBEAT, beat)
            self.nano.run(min(until, due) if beat is not None else until)
            for data, t in self.nano.read():
                for frame in self.decoder.feed(data):
                    self.frames.append(frame)
                    self.ends.append(t)
        return self

    def send(self, message, values):
        self.nano.write(encode(message, self.seq, values))
        self.seq += 1

    def frames_named(self, name):
        return [f.as_dict() for f in self.frames if f.message.name == name]

    def ask(self, message, values, reply, seconds=0.1):
        self.frames.clear()
        self.send(message, values)
        return self.run(seconds).frames_named(reply)


def beat(token=0, mode=0):
    return (1, 15000, 15000, token, mode, 0)


def test_states_that_it_is_a_mock():
    talk = Talk().run(1.0)
    assert all(h["build"] & 0x04 for h in talk.frames_named("HELLO"))
    mock = 1 << m.STATE_FLAGS.index("MOCK")
    assert all(s["flags"] & mock for s in talk.frames_named("STATE"))


def test_states_at_100_hz_without_a_gap():
    talk = Talk().run(3.0)
    stamps = [s["t_ck"] for s in talk.frames_named("STATE")]
    assert len(stamps) in (299, 300)
    assert {b - a for a, b in itertools.pairwise(stamps)} == {20_000}
    c = talk.decoder.counters
    assert (c.crc, c.cobs, c.length, c.unknown, c.gaps) == (0, 0, 0, 0, 0)


def test_frames_take_their_time_on_the_line():
    talk = Talk().run(0.2)
    for frame, end in zip(talk.frames, talk.ends, strict=True):
        if frame.message.name == "STATE":
            latch = frame.as_si()["t_ck"]
            assert end - latch == pytest.approx(LATCH_TO_UART + 44 * 20e-6, abs=25e-6)


def test_boot_states_hello_three_times_and_on_request():
    talk = Talk().run(0.5)
    assert len(talk.frames_named("HELLO")) == 3
    (hello,) = talk.ask(m.HELLO_REQ, (m.PROTO, m.SCHEMA, 1), "HELLO")
    assert (hello["proto"], hello["schema"], hello["req_seq"]) == (m.PROTO, m.SCHEMA, 0)
    assert talk.frames_named("DIAG")


def test_reset_restarts_with_the_next_boot_count():
    talk = Talk()
    talk.nano.set_wheel(10.0)
    talk.run(1.0)
    first = talk.frames_named("HELLO")[0]
    talk.frames.clear()
    talk.nano.reset("watchdog")
    talk.run(0.3)
    second = talk.frames_named("HELLO")[0]
    assert second["boot_count"] == first["boot_count"] + 1
    assert second["boot_nonce"] != first["boot_nonce"]
    assert second["reset_cause"] == 0x18
    assert talk.frames_named("STATE")[0]["enc_count"] <= 2
    assert talk.frames_named("STATE")[0]["t_ck"] == 2_000


def test_clock_error_shows_in_the_ticks():
    fast, true = Talk(clock_error=0.003).run(10.0), Talk().run(10.0)
    assert fast.frames_named("STATE")[-1]["t_ck"] - true.frames_named("STATE")[-1]["t_ck"] == 60_000


def test_pong_carries_the_stamps_of_the_mcu():
    talk = Talk().run(1.0015)
    sent = talk.nano.now
    (pong,) = talk.ask(m.TIME_PING, (7, 123_456), "TIME_PONG")
    assert (pong["ping_id"], pong["host_us"]) == (7, 123_456)
    assert pong["rx_ck"] / 2e6 == pytest.approx(sent + 12 * 20e-6, abs=1e-6)
    end = talk.ends[[f.message.name for f in talk.frames].index("TIME_PONG") - len(talk.frames)]
    assert pong["tx_ck"] / 2e6 == pytest.approx(end - 22 * 20e-6, abs=1e-6)


@pytest.mark.parametrize(("ident", "value", "status", "expected"), [
    (1, 10, 0, 10), (1, 99, 2, 20), (77, 1, 1, 0)])
def test_parameters(ident, value, status, expected):
    talk = Talk().run(0.5)
    (reply,) = talk.ask(m.PARAM_SET, (ident, 0, value), "PARAM_VALUE")
    assert (reply["status"], reply["value"]) == (status, expected)
    (again,) = talk.ask(m.PARAM_GET, (ident,), "PARAM_VALUE")
    assert again["value"] == expected


def test_ring_b_is_reported_once_it_is_enabled():
    talk = Talk().run(0.3)
    talk.ask(m.PARAM_SET, (3, 0, 1), "PARAM_VALUE")
    talk.nano.set_wheel(10.0)
    talk.run(1.0)
    state = talk.frames_named("STATE")[-1]
    assert state["enc2_count"] == pytest.approx(state["enc_count"] / 2, abs=1)


@pytest.mark.parametrize("rate", [5.0, 30.0, 80.0])
def test_edges_frames_hold_successive_intervals(rate):
    talk = Talk().run(0.3)
    talk.nano.set_wheel(rate)
    talk.run(0.5)
    replies = talk.ask(m.EDGES_REQ, (10,), "EDGES", 2.0)
    assert len(replies) == 10
    for reply in replies:
        assert reply["interval"] == pytest.approx([2e6 / rate / 20] * 8, abs=1.01)


def test_imu_takes_its_time_and_is_never_invented():
    talk = Talk()
    for _ in range(2000):
        talk.nano.set_imu((0.0, 0.0, 1.0), (0.0, 2.0, 0.0))
        talk.run(1e-3)
    states = talk.frames_named("STATE")
    assert not states[0]["flags"] & 1
    assert states[0]["imu_age"] == 65535
    assert states[-1]["flags"] & 1
    assert (states[-1]["gyro"][2], states[-1]["lin_acc"][1]) == (900, 200)
    assert states[-1]["imu_age"] == 1625


def test_a_dead_imu_leaves_the_last_sample_and_its_age():
    talk = Talk()
    for k in range(3000):
        if k == 2000:
            talk.nano.set_i2c("dead")
        talk.nano.set_imu((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
        talk.run(1e-3)
    last = talk.frames_named("STATE")[-1]
    assert not last["flags"] & 1
    assert last["flags"] & 2
    assert last["gyro"][2] == 900
    assert last["imu_age"] == 65535


def test_damaged_requests_are_counted_and_nothing_else():
    talk = Talk().run(0.3)
    data = bytearray(encode(m.PARAM_SET, 0, (1, 0, 10)))
    data[4] ^= 0x10
    talk.nano.write(bytes(data))
    talk.run(0.5)
    assert talk.nano.params[1] == 20
    assert talk.frames_named("DIAG")[-1]["rx_crc"] == 1


def test_output_goes_live_and_trips_without_beats():
    talk = Talk().run(0.3)
    token = talk.nano.nonce
    talk.run(0.7, beat(token, 0))
    assert talk.nano.supervisor.state is OutputState.LINKED
    talk.run(0.1, beat(token, 1))
    assert talk.nano.supervisor.state is OutputState.LIVE
    live = 1 << m.STATE_FLAGS.index("OUTPUT_LIVE")
    assert talk.frames_named("STATE")[-1]["flags"] & live
    talk.run(0.13)
    assert talk.nano.supervisor.state is OutputState.TRIPPED
    assert talk.frames_named("STATE")[-1]["flags"] & (1 << m.STATE_FLAGS.index("TRIPPED"))


def test_another_boot_s_token_never_arms():
    talk = Talk().run(0.3)
    talk.run(2.0, beat(talk.nano.nonce ^ 1, 1))
    assert talk.nano.supervisor.state is OutputState.IDLE
    assert talk.frames_named("STATE")[-1]["flags"] & (1 << m.STATE_FLAGS.index("BEAT_OK"))


def good_beats(s, t, seconds, mode):
    for k in range(int(seconds / 0.02)):
        s.check(t + 0.02 * k)
        s.beat(t + 0.02 * k, 7, mode)
    return t + seconds


def test_third_trip_in_a_minute_locks():
    s, t = MockSupervisor(7), 0.0
    for _ in range(3):
        t = good_beats(s, t, 0.6, 0)
        t = good_beats(s, t, 0.1, 1)
        assert s.state is OutputState.LIVE
        t += 0.2
        s.check(t)
    assert s.state is OutputState.LOCKED
    good_beats(s, t, 2.0, 0)
    assert s.state is OutputState.LOCKED


def test_tripped_needs_half_a_second_of_disarmed_beats():
    s = MockSupervisor(7)
    t = good_beats(s, 0.0, 0.6, 0)
    t = good_beats(s, t, 0.1, 1) + 0.2
    s.check(t)
    t = good_beats(s, t, 1.0, 1)
    assert s.state is OutputState.TRIPPED
    good_beats(s, t, 0.6, 0)
    assert s.state is OutputState.LINKED
