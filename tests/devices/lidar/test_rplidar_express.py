"""Packets of an RPLidar's express scan: layout, answers, damage, portions, revolutions, times."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dart_hal.devices.lidar.models import RPLIDAR_EXPRESS, recognise
from dart_hal.devices.lidar.rplidar_express import EXPRESS_REQUEST, ExpressDecoder
from dart_hal.devices.lidar.scan import LidarStream
from tests.devices.lidar.decoder_checks import check_portions, list_contents
from tests.devices.lidar.express_bytes import EXPRESS_ANSWER, arrival, packet, stream
from tests.devices.lidar.rplidar_bytes import HEALTH_ANSWER, INFO_ANSWER, RATE_ANSWER

STEP_DEG = 360.0 / 704


def scans_of(packets, lidar=None):
    """Scans of packets that arrive one by one; a lost one is None."""
    lidar = lidar or LidarStream(RPLIDAR_EXPRESS)
    return [scan for k, raw in enumerate(packets) if raw is not None
            for scan in lidar.feed(raw, arrival(k))]


def test_the_request_is_that_of_the_protocol():
    check = 0
    for byte in EXPRESS_REQUEST[:-1]:
        check ^= byte
    assert EXPRESS_REQUEST[-1] == check
    assert EXPRESS_REQUEST[1] == 0x82


def test_samples_of_a_packet_need_the_start_of_the_next():
    """Offsets are subtracted; 0x3F is 7.875 deg. Distances of 14 bits."""
    samples = [(16383, 0), (1, 63), (0, 1), (1000, 16)] * 8
    decoder = ExpressDecoder()
    assert decoder.feed(packet(10.0, samples, new=True)) == []
    (got,) = decoder.feed(packet(26.0, samples))
    offsets = np.array([offset for _, offset in samples]) / 8.0
    assert np.degrees(got.angle) == pytest.approx((10.0 + 0.5 * np.arange(32) - offsets) % 360.0)
    assert got.distance[:2].tolist() == [16.383, 0.001]
    assert np.isnan(got.distance[2::4]).all()
    assert np.degrees([got.first, got.last]) == pytest.approx([10.0, 25.5])
    assert not got.starts


def test_a_packet_across_zero_is_two_of_which_the_second_starts():
    decoder = ExpressDecoder()
    decoder.feed(packet(352.0, [(2000, 0)] * 32, new=True))
    first, second = decoder.feed(packet(8.0, [(2000, 0)] * 32))
    assert (first.starts, second.starts) == (False, True)
    assert (len(first.angle), len(second.angle)) == (16, 16)
    assert np.degrees(second.angle[0]) == pytest.approx(0.0)


def test_answers_are_found_before_the_packets():
    """The mark of an answer has the form of the first two bytes of a packet."""
    decoder = ExpressDecoder()
    raw = INFO_ANSWER + HEALTH_ANSWER + RATE_ANSWER + EXPRESS_ANSWER + b"".join(stream(1))
    assert len(decoder.feed(raw)) == len(stream(1)) - 1
    assert set(decoder.answers) == {0x04, 0x06, 0x15, 0x82}
    assert decoder.sample_period == 254e-6
    assert (decoder.broken, decoder.skipped) == (0, 0)


def test_it_is_recognised_and_is_no_standard_scan():
    assert recognise(b"".join(stream(1))) is RPLIDAR_EXPRESS


@pytest.mark.parametrize("offset", [0, 20])
def test_whole_revolutions_with_a_time_for_each_beam(offset):
    found = scans_of(stream(6, offset=offset))
    assert len(found) >= 4
    for scan in found:
        assert len(scan) == 704
        assert scan.rate == pytest.approx(1.0 / (704 * 254e-6), rel=1e-3)
        assert np.diff(scan.after) == pytest.approx(254e-6, rel=1e-3)
        expected = (STEP_DEG * np.arange(704) - offset / 8.0) % 360.0
        assert np.degrees(scan.angle) == pytest.approx(expected, abs=0.02)
    assert [s.start for s in found] == pytest.approx(
        [5.0 + 704 * 254e-6 * (k + 1) for k in range(len(found))], abs=1e-4)


def test_control_without_the_next_packet_the_times_would_be_late():
    lidar = LidarStream(RPLIDAR_EXPRESS)
    feed = lidar.decoder.feed
    lidar.decoder.feed = lambda data: [p._replace(later=0) for p in feed(data)]
    late = scans_of(stream(6), lidar)
    assert late[-1].start - scans_of(stream(6))[-1].start == pytest.approx(32 * 254e-6, abs=1e-4)


@pytest.mark.parametrize("damaged", [True, False])
def test_a_lost_packet_leaves_the_times_of_the_others_right(damaged):
    """With it, the samples of the one before are lost: the end of their angles is not known."""
    packets = stream(8)
    packets[60] = bytes(84) if damaged else None
    lidar = LidarStream(RPLIDAR_EXPRESS)
    scans = scans_of(packets, lidar)
    assert sorted({len(s) for s in scans}) == [640, 704]
    assert lidar.assembler.missing == 64
    assert np.diff([s.start for s in scans]) == pytest.approx(
        [704 * 254e-6] * (len(scans) - 1), abs=1e-4)


def test_a_motor_that_speeds_up_goes_on_after_one_lost_packet():
    decoder = ExpressDecoder()
    starts = [0.0, 0.0, 5.0, 15.0, 25.0, 35.0]
    got = [len(decoder.feed(packet(start, [(2000, 0)] * 32))) for start in starts]
    assert got == [0, 1, 1, 0, 1, 1]


@given(st.binary(max_size=400))
@example(b"\xa5\x5a" * 60)
@example(EXPRESS_ANSWER[:3])
def test_no_bytes_raise_and_each_is_counted_once(data):
    decoder = ExpressDecoder()
    decoder.feed(data)
    taken = len(data) - decoder.skipped - 84 * decoder.packets - len(decoder._rest)
    assert taken >= 0
    assert taken == 0 or decoder.answers


@given(st.lists(st.integers(1, 130), min_size=1, max_size=40), st.integers(0, 2**32 - 1))
def test_portions_do_not_matter(cuts, seed):
    rng = np.random.default_rng(seed)
    raw = bytearray(b"".join(stream(1)))
    for _ in range(3):
        raw[rng.integers(len(raw))] ^= 1 << rng.integers(8)
    check_portions(ExpressDecoder, raw, cuts,
                   lambda packets: (list_contents(packets), [p.lost for p in packets]))


@given(st.integers(2, 83), st.integers(0, 7))
def test_a_flipped_bit_breaks_its_packet(place, bit):
    """And that before it, which lacks its end; no wrong distance comes out."""
    packets = [packet(16.0 * k, [(900 + k, 0)] * 32) for k in range(5)]
    damaged = bytearray(packets[2])
    damaged[place] ^= 1 << bit
    decoder = ExpressDecoder()
    got = decoder.feed(b"".join([*packets[:2], bytes(damaged), *packets[3:]]))
    assert [float(p.distance[0]) for p in got] == [0.9, 0.903]
    assert [p.lost for p in got] == [False, True]
    assert decoder.broken >= 1
