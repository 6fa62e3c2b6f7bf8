"""Golden test: one scenario through the emulated firmware and through MockNano.

The two differ in what MockNano does not have: the time from reset to the
first count of the timer, the phase of the slots, the start of the IMU. These
three are read off the firmware and given to the mock; everything else must
agree by itself.
"""

from __future__ import annotations

import math
from statistics import median

import pytest

from dart_hal.core.errors import EmulatorMissing
from dart_hal.wire import messages as m
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.decoder import FrameDecoder
from dart_lab.sim.eeprom import make_eeprom
from dart_lab.sim.mock_nano import MockNano
from dart_lab.sim.ring import uneven_ring

pytestmark = pytest.mark.emulator

SECONDS = 6.0
REQUESTS = {2.5031: (m.TIME_PING, (9, 77)), 3.0: (m.EDGES_REQ, (3,)), 3.5: (m.PARAM_GET, (4,)),
            3.6: (m.PARAM_SET, (4, 0, 99_999)), 4.0: (m.HELLO_REQ, (1, m.SCHEMA, 0))}


def scenario(nano):
    """Frames with their end times; the gear speeds up, stops, and turns back."""
    import numpy as np

    nano.set_ring(0, uneven_ring(20, np.random.default_rng(3)).edges)
    decoder, frames = FrameDecoder(UP), []
    requests = sorted(REQUESTS.items())
    for tick in range(int(SECONDS * 1000)):
        t = tick * 1e-3
        nano.set_wheel(wheel(t))
        noise = 0.05 * math.sin(1.7 * tick)     # a quiet IMU would count as stuck
        nano.set_imu((0.0, 0.1, math.sin(t)), (math.cos(2 * t), -0.5, noise))
        while nano.now < t + 1e-3:
            due = requests[0][0] if requests else math.inf
            nano.run(min(t + 1e-3, due) if due > nano.now else t + 1e-3)
            if requests and nano.now >= due:
                message, values = requests.pop(0)[1]
                nano.write(encode(message, len(requests), values))
            for data, at in nano.read():
                frames += [(f, at) for f in decoder.feed(data)]
    assert decoder.counters.damaged == 0
    assert decoder.counters.gaps == 0
    return frames


def wheel(t):
    if t < 1.0:
        return 0.0
    return 40.0 * math.sin(0.9 * (t - 1.0)) if t < 5.0 else -5.0


def frames_named(frames, name):
    return [f.as_dict() for f, _ in frames if f.message.name == name]


@pytest.fixture(scope="module")
def both():
    from dart_hal.devices.links.emulator import EmulatedNano

    try:
        nano = EmulatedNano(eeprom=make_eeprom(5))
    except EmulatorMissing as missing:
        pytest.skip(f"no emulator: {missing.what}")
    firmware = scenario(nano)
    nano.close()
    phase = frames_named(firmware, "STATE")[1]["t_ck"] % 20_000
    states = frames_named(scenario(MockNano(eeprom=make_eeprom(5))), "STATE")
    raw = {s["enc_count"]: s["enc_t_ck"] for s in states}
    late = median(raw[s["enc_count"]] - s["enc_t_ck"] for s in frames_named(firmware, "STATE")
                  if s["enc_count"] in raw)
    mock = scenario(MockNano(eeprom=make_eeprom(5), slot_phase=phase, timer_start=late * 0.5e-6))
    return firmware, mock


def paired(both):
    """STATE of the same slot, from the second on (the first one is late)."""
    firmware, mock = ({s["t_ck"] // 20_000: s for s in frames_named(frames, "STATE")[1:]}
                      for frames in both)
    common = sorted(set(firmware) & set(mock))
    assert len(common) >= 0.99 * SECONDS * 100
    return [(firmware[slot], mock[slot]) for slot in common]


@pytest.mark.slow
def test_slots_are_latched_within_the_longest_interrupt(both):
    late = [r["t_ck"] - s["t_ck"] for r, s in paired(both)]
    assert min(late) >= -22
    assert max(late) <= 400
    assert sum(x > 40 for x in late) <= 0.10 * len(late)


def test_counts_are_equal(both):
    """An edge within 11 us of the latch may fall on either side of it."""
    for real, mock in paired(both):
        if real["enc_count"] != mock["enc_count"]:
            newest = max(real["enc_t_ck"], mock["enc_t_ck"])
            assert abs(newest - real["t_ck"]) <= 22 + abs(real["t_ck"] - mock["t_ck"])
    assert paired(both)[-1][0]["enc_count"] > 1000


def test_stamps_are_within_11_us(both):
    stamps = [(r["enc_t_ck"], m["enc_t_ck"]) for r, m in paired(both)
              if r["enc_count"] == m["enc_count"]]
    assert len(stamps) > 500
    assert max(abs(a - b) for a, b in stamps) <= 22


def test_intervals_agree(both):
    pairs = [(r["enc_dt_ck"], m["enc_dt_ck"]) for r, m in paired(both)
             if r["enc_count"] == m["enc_count"]]
    assert max(abs(a - b) for a, b in pairs) <= 22
    assert any(a == 65535 for a, _ in pairs)


def test_imu_values_agree_within_a_sample(both):
    """The BNO055 samples on its own clock: up to one period (10 ms) and 2 LSB of difference."""
    compared = 0
    for real, mock in paired(both):
        if real["flags"] & mock["flags"] & 1:
            compared += 1
            for name, slope in (("gyro", 900 * 1.0), ("lin_acc", 100 * 2.0)):
                worst = max(abs(a - b) for a, b in zip(real[name][:2], mock[name][:2],
                                                       strict=True))
                assert worst <= slope * 0.010 + 2
            assert abs(real["gyro"][2] - mock["gyro"][2]) <= 900 * 0.010 + 2
    assert compared > 300


def test_frames_end_at_nearly_the_same_time(both):
    """The mock's constant from latch to line represents the firmware's frame builder."""
    ends = [[(f.as_dict()["t_ck"] // 20_000, t) for f, t in frames if f.message.name == "STATE"]
            for frames in both]
    mock = dict(ends[1])
    late = [t - mock[ck] for ck, t in ends[0] if ck in mock]
    assert abs(median(late)) < 0.2e-3        # a fifth of the frame itself


def test_replies_agree(both):
    firmware, mock = both
    for name, fields in (("TIME_PONG", ("ping_id", "host_us")),
                         ("PARAM_VALUE", ("id", "status", "req_seq", "value")),
                         ("EDGES", ())):
        real, made = frames_named(firmware, name), frames_named(mock, name)
        assert len(real) == len(made) > 0, name
        assert [[r[f] for f in fields] for r in real] == [[r[f] for f in fields] for r in made]


def test_edge_intervals_agree(both):
    firmware, mock = (
        {e["first_count"] + k: i for e in frames_named(frames, "EDGES") for k,
         i in enumerate(e["interval"])}
        for frames in both)
    common = set(firmware) & set(mock)
    assert len(common) >= 8
    assert max(abs(firmware[k] - mock[k]) for k in common) <= 22


def test_identity_agrees_but_for_what_marks_the_mock(both):
    real, made = (frames_named(frames, "HELLO")[0] for frames in both)
    differing = {k for k in real if real[k] != made[k]}
    assert differing <= {"fw_version", "build", "git", "bootloader"}
    assert made["build"] & 4
    assert not real["build"] & 4


def test_flags_differ_only_by_the_mark_of_the_mock(both):
    mock_bit = 1 << m.STATE_FLAGS.index("MOCK")
    real, made = zip(*[(r["flags"], s["flags"]) for r, s in paired(both)[-200:]], strict=True)
    names = [n for k, n in enumerate(m.STATE_FLAGS)
             if any((r ^ s) & ~mock_bit & (1 << k) for r, s in zip(real, made, strict=True))]
    assert names == []
