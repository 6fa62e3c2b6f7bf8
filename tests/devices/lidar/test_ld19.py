"""Packets of an LD19: the manual's example, damage, portions, and revolutions."""

from __future__ import annotations

from math import degrees

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dart_hal.devices.lidar.ld19 import Ld19Decoder
from dart_hal.devices.lidar.models import LD19
from dart_hal.devices.lidar.scan import LidarStream
from tests.devices.lidar.decoder_checks import check_portions, list_contents
from tests.devices.lidar.ld19_bytes import packet, stream

# The packet that the development manual explains byte by byte.
MANUAL_PACKET = bytes.fromhex(
    "54 2C 68 08 AB 7E E0 00 E4 DC 00 E2 D9 00 E5 D5 00 E3 D3 00 E4 D0 00 E9 CD 00 E4 CA 00 E2"
    "C7 00 E9 C5 00 E5 C2 00 E5 C0 00 E5 BE 82 3A 1A 50")


def scans_of(raw, size=47, lidar=None):
    """Scans of bytes that arrive at the pace of the line, in portions."""
    lidar = lidar or LidarStream(LD19)
    return [s for k in range(0, len(raw), size)
            for s in lidar.feed(raw[k:k + size], 5.0 + (k + size) / 47 * 12 / 4500)]


def test_the_packet_of_the_manual():
    (got,) = Ld19Decoder().feed(MANUAL_PACKET)
    assert degrees(got.first) == pytest.approx(324.27)
    assert degrees(got.last) == pytest.approx(334.70)
    assert got.distance[:3].tolist() == [0.224, 0.220, 0.217]
    assert np.diff(np.degrees(got.angle)) == pytest.approx([(334.70 - 324.27) / 11] * 11)
    assert not got.starts


def test_no_return_is_no_distance():
    (got,) = Ld19Decoder().feed(packet(10.0, 18.8, [0, 1500] * 6))
    assert np.isnan(got.distance[::2]).all()
    assert (got.distance[1::2] == 1.5).all()


def test_a_packet_across_zero_is_two_of_which_the_second_starts():
    first, second = Ld19Decoder().feed(packet(356.0, 4.8, [1000] * 12, speed=3600))
    assert (first.starts, second.starts) == (False, True)
    assert second.hertz == 10.0
    assert len(first.angle) + len(second.angle) == 12
    assert degrees(first.last) == pytest.approx(359.2)
    assert degrees(second.first) == pytest.approx(0.0, abs=1e-6)


def test_whole_revolutions_with_a_time_for_each_beam():
    found = scans_of(stream(8))
    assert [len(s) for s in found] == [450] * len(found)
    assert len(found) >= 6
    for scan in found:
        assert scan.rate == pytest.approx(10.0, rel=1e-3)
        assert np.diff(scan.after) == pytest.approx(1 / 4500, rel=1e-3)
        assert np.degrees(scan.angle) == pytest.approx(0.2 + 0.8 * np.arange(450), abs=0.02)
    starts = [s.start for s in found]
    assert np.diff(starts) == pytest.approx([0.1] * (len(found) - 1), abs=1e-4)


def test_a_lost_packet_leaves_the_times_of_the_others_right():
    raw = stream(8)
    lidar = LidarStream(LD19)
    scans = scans_of(raw[:60 * 47] + bytes(47) + raw[61 * 47:], lidar=lidar)
    assert sorted({len(s) for s in scans}) == [438, 450]
    assert lidar.assembler.missing == 12
    assert np.diff([s.start for s in scans]) == pytest.approx([0.1] * (len(scans) - 1), abs=1e-4)


def test_a_zero_that_is_lost_does_not_join_two_revolutions():
    raw = stream(8)
    zero = 450 // 12 * 47  # the packet that contains the second zero
    scans = scans_of(raw[:3 * zero] + raw[3 * zero + 2 * 47:])
    assert max(len(s) for s in scans) == 450


@given(st.binary(max_size=300))
@example(b"\x54\x2c" * 40)
@example(b"\x54")
def test_no_bytes_raise_and_each_is_counted_once(data):
    decoder = Ld19Decoder()
    decoder.feed(data)
    assert decoder.skipped + 47 * decoder.packets + len(decoder._rest) == len(data)


@given(st.lists(st.integers(1, 97), min_size=1, max_size=60), st.integers(0, 2**32 - 1))
def test_portions_do_not_matter(cuts, seed):
    rng = np.random.default_rng(seed)
    raw = bytearray(stream(1))
    for _ in range(4):
        raw[rng.integers(len(raw))] ^= 1 << rng.integers(8)
    check_portions(Ld19Decoder, raw, cuts)


@given(st.binary(max_size=200).filter(lambda b: b"\x54" not in b))
def test_it_finds_the_packets_after_garbage(garbage):
    decoder = Ld19Decoder()
    got = decoder.feed(garbage + stream(1))
    assert list_contents(got) == list_contents(Ld19Decoder().feed(stream(1)))
    assert decoder.skipped == len(garbage)


@given(st.integers(2, 46), st.integers(0, 7))
def test_any_flipped_bit_breaks_its_packet_and_no_other(place, bit):
    packets = [packet(10.0 + 9.6 * k, 18.8 + 9.6 * k, [900 + k] * 12) for k in range(3)]
    damaged = bytearray(packets[1])
    damaged[place] ^= 1 << bit
    decoder = Ld19Decoder()
    got = decoder.feed(packets[0] + bytes(damaged) + packets[2])
    assert [float(p.distance[0]) for p in got] == [0.9, 0.902]
    assert decoder.broken >= 1


def test_control_the_same_damage_passes_with_a_check_made_for_it():
    assert len(Ld19Decoder().feed(packet(19.6, 28.4, [901] * 11 + [1901]))) == 1
