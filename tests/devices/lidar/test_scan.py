"""Revolutions out of packets: beams, times, rate, and what is missing."""

from __future__ import annotations

from itertools import pairwise
from math import pi, radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.types import Mount, Scan
from dart_hal.devices.lidar.health import LidarHealthMonitor
from dart_hal.devices.lidar.scan import LidarStream
from tests.devices.lidar.x4_bytes import packet, revolution

PERIOD = 0.2e-3
X4_BYTE_TIME = 10 / 128_000


def arrivals(packets, *, skew=0.0, start=10.0, late=None):
    """(bytes, arrival) of packets that leave as soon as their last sample is there."""
    count, free = 0, 0.0
    for k, raw in enumerate(packets):
        count += raw[3]
        free = max(start + (count - 1) * PERIOD * (1.0 + skew), free) + len(raw) * X4_BYTE_TIME
        yield raw, free + (0.0 if late is None else late[k])


def scans_of(packets, **how):
    stream = LidarStream()
    return [s for raw, t in arrivals(packets, **how) for s in stream.feed(raw, t)], stream


def turns(n, beams=606, **how):
    return [raw for _ in range(n) for raw in revolution(beams, **how)]


@pytest.mark.parametrize("beams", [606, 640])
def test_whole_revolutions_with_a_time_for_each_beam(beams):
    found, stream = scans_of(turns(6, beams))
    assert [len(s) for s in found] == [beams] * 5  # the sixth has not ended
    for n, scan in enumerate(found):
        assert scan.rate == pytest.approx(5000.0 / beams, rel=2e-4)
        assert scan.t == pytest.approx(10.0 + PERIOD * (n * beams + np.arange(beams)), abs=2e-6)
        assert scan.arrival > scan.t[-1]
    assert stream.assembler.missing == 0


def test_the_clock_of_the_unit_is_learnt_through_late_arrivals():
    rng, packets = np.random.default_rng(5), turns(160)
    late = rng.exponential(0.004, len(packets))
    late[rng.uniform(size=len(late)) < 0.02] += 0.04
    found, _ = scans_of(packets, skew=4e-4, late=late)
    true = [10.0 + PERIOD * (1.0 + 4e-4) * (n * 606 + np.arange(606)) for n in range(len(found))]
    worst = [np.abs(s.t - t).max() for s, t in zip(found, true, strict=True)]
    assert max(worst[80:]) < 0.5e-3
    by_arrival = [abs(s.arrival - t[-1] - 12 * X4_BYTE_TIME)
                  for s, t in zip(found, true, strict=True)]
    assert max(by_arrival[80:]) > 10.0 * max(worst[80:]), "the control: arrivals would do as well"


def test_a_lost_packet_leaves_the_times_of_the_others_right():
    packets = turns(6)
    damaged = [raw if k != 40 else raw[:20] + b"\x00" + raw[21:]
               for k, raw in enumerate(packets)]
    found, stream = scans_of(damaged)
    assert stream.decoder.broken >= 1
    assert [len(s) for s in found] == [606, 606, 566, 606, 606]
    assert stream.assembler.missing == 40
    for a, b in pairwise(found):
        assert b.start - a.start == pytest.approx(606 * PERIOD, abs=1e-5)


def test_packets_that_vanish_without_a_trace_are_noticed_too():
    packets = turns(6)
    del packets[36:39]
    found, stream = scans_of(packets)
    assert stream.assembler.missing == 120
    assert [len(s) for s in found] == [606, 606, 486, 606, 606]


def test_a_zero_that_is_lost_does_not_join_two_revolutions():
    packets = turns(5)
    zero = [k for k, raw in enumerate(packets) if raw[2] & 1][2]
    del packets[zero]
    found, _ = scans_of(packets)
    assert [len(s) for s in found] == [606, 606, 605, 606]


def test_no_scan_is_made_of_the_rest_of_a_revolution():
    found, _ = scans_of(turns(3)[5:])
    assert [len(s) for s in found] == [606]


def test_after_a_silence_the_assembly_starts_again():
    packets, stream = turns(4), LidarStream()
    for raw, t in arrivals(packets):
        stream.feed(raw, t)
    again = [s for raw, t in arrivals(packets, start=30.0) for s in stream.feed(raw, t)]
    assert [len(s) for s in again] == [606] * 3
    assert again[0].t == pytest.approx(30.0 + PERIOD * np.arange(606), abs=1e-4)


def test_bearing_goes_against_the_angle_unless_the_unit_hangs_upside_down():
    scan = Scan(1.0, 0.9, 8.0, np.array([0.0, 0.01]), np.radians([10.0, 350.0]),
                np.array([2.0, np.nan]))
    assert scan.bearing == pytest.approx([radians(-10.0), radians(10.0)], abs=1e-6)
    hanging = scan.mounted(Mount(x=0.1, yaw=pi, inverted=False, scale=1.01))
    assert hanging.bearing == pytest.approx([radians(190.0 - 360.0), radians(170.0)], abs=1e-6)
    assert hanging.range[0] == pytest.approx(2.02)
    assert np.isnan(hanging.range[1])
    assert hanging.in_car()[0] == pytest.approx(
        [0.1 + 2.02 * np.cos(radians(190.0)), 2.02 * np.sin(radians(190.0))], abs=1e-6)


def test_a_scan_is_frozen_and_refuses_columns_of_other_lengths():
    scan = Scan(1.0, 0.9, 8.0, np.zeros(2), np.zeros(2), np.zeros(2))
    with pytest.raises(ValueError, match="read-only"):
        scan.angle[0] = 1.0
    with pytest.raises(ValueError, match="distance"):
        Scan(1.0, 0.9, 8.0, np.zeros(2), np.zeros(2), np.zeros(3))


def test_a_split_revolution_is_one_turn():
    """Two packets alone, the zero among garbage: nothing is made up."""
    stream = LidarStream()
    assert stream.feed(b"\xaa\x00" + packet(0.0, 0.0, [100.0], starts=True), 1.0) == []
    assert stream.feed(packet(1.0, 20.0, [100.0] * 30), 1.01) == []


pieces = st.tuples(st.integers(0, 23039), st.integers(0, 23039), st.integers(1, 60), st.booleans(),
                   st.floats(0.0, 2.0), st.binary(max_size=4))


@given(st.lists(pieces, max_size=60))
def test_no_packets_raise_and_scans_stay_in_order(found):
    """Whole packets of any angles at any time, with bytes of no packet between them."""
    stream, t, scans = LidarStream(), 0.0, []
    for first, last, n, starts, later, noise in found:
        t += later
        raw = packet(first / 64.0, last / 64.0, [100.0] * n, starts=starts)
        scans += stream.feed(noise + raw, t)
    for scan in scans:
        assert np.isfinite(scan.t).all()
        assert (np.diff(scan.after) > 0.0).all()
        assert np.isfinite(scan.rate)
        assert scan.rate > 0.0
        assert scan.arrival <= t
        list(_messages(scan))
    for a, b in pairwise(scans):
        assert b.arrival >= a.arrival


def _messages(scan):
    watch = LidarHealthMonitor()
    watch.add(scan, 0.0)
    return watch.health().sentences()
