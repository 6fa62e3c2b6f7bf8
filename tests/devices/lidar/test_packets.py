"""Packets of an X4: the manual's layout, and what is no packet."""

from __future__ import annotations

from math import degrees

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dart_hal.devices.lidar.packets import LidarDecoder, parallax
from tests.devices.lidar.decoder_checks import check_portions, list_contents
from tests.devices.lidar.x4_bytes import packet, revolution


def test_a_packet_computed_by_hand():
    """FSA 0x6FBD and LSA 0x79BD are 14302/64 = 223.46875 and 15582/64 = 243.46875 deg; samples
    of 1000 and 8000 mm (0x0FA0, 0x7D00) lie atan(-0.11857) = -6.7622 and atan(-0.13765) =
    -7.8374 deg further. CS = 55AA ^ 6FBD ^ 0FA0 ^ 7D00 ^ 0200 ^ 79BD = 330A."""
    raw = bytes.fromhex("AA55 00 02 BD6F BD79 0A33 A00F 007D")
    (got,) = LidarDecoder().feed(raw)
    assert (got.starts, got.hertz, got.size, got.behind) == (False, None, 14, 0)
    assert degrees(got.first) == pytest.approx(223.46875, abs=1e-9)
    assert np.degrees(got.angle) == pytest.approx([223.46875 - 6.7622, 243.46875 - 7.8374],
                                                  abs=1e-4)
    assert got.distance.tolist() == [1.0, 8.0]


def test_the_packet_that_starts_a_revolution_has_its_frequency():
    with_rate, without = LidarDecoder().feed(packet(0.5, 0.5, [0.0], starts=True, hertz=7.9)
                                        + packet(0.5, 0.5, [1500.0], starts=True))
    assert (with_rate.starts, with_rate.hertz, without.hertz) == (True, 7.9, None)
    assert np.isnan(with_rate.distance).all()
    assert degrees(with_rate.angle[0]) == pytest.approx(0.5)  # no point, nothing to correct


def test_angles_go_on_across_360():
    (got,) = LidarDecoder().feed(packet(359.0, 1.0, [0.0] * 5))
    assert np.degrees(got.angle) == pytest.approx([359.0, 359.5, 360.0, 360.5, 361.0])


def test_a_point_where_laser_and_axis_cross_is_where_the_unit_points():
    assert parallax(np.array([0.1553]))[0] == pytest.approx(0.0, abs=1e-12)
    assert parallax(np.array([0.1]))[0] > 0.0 > parallax(np.array([0.2]))[0]


def test_answers_are_distinguished_from_packets():
    decoder = LidarDecoder()
    info = bytes.fromhex("A55A 14000000 04") + bytes([6, 5, 1, 3, *range(10), *range(6)])
    health = bytes.fromhex("A55A 03000000 06 00 0000")
    stream = bytes.fromhex("A55A 05000040 81")
    got = decoder.feed(info + health + stream + packet(1.0, 9.0, [500.0] * 3))
    assert len(got) == 1
    assert decoder.answers[0x04].text() == (
        "model 6, firmware 1.5, hardware 3, serial number 0123456789012345")
    assert decoder.answers[0x06].text() == "health good"
    assert 0x81 in decoder.answers
    assert (decoder.broken, decoder.skipped) == (0, 0)


@given(st.binary(max_size=300))
@example(b"\xaa\x55\x00\x00\xaa\x55")
@example(b"\xa5\x5a\x00\x00\x00\x00\x99")
@example(b"\xaa")
def test_no_bytes_raise_and_each_is_counted_once(data):
    decoder = LidarDecoder()
    got = decoder.feed(data)
    known = sum(p.size for p in got)
    answers = sum(7 + len(a.content) for a in decoder.answers.values())
    held = len(decoder._rest)
    assert decoder.skipped + known + held + answers <= len(data)
    if not decoder.answers:
        assert decoder.skipped + known + held == len(data)


@given(st.lists(st.integers(1, 97), min_size=1, max_size=60), st.integers(0, 2**32 - 1))
def test_portions_do_not_matter(cuts, seed):
    rng = np.random.default_rng(seed)
    stream = bytearray(b"".join(revolution(120, hertz=8.0)))
    for _ in range(4):
        stream[rng.integers(len(stream))] ^= 1 << rng.integers(8)
    check_portions(LidarDecoder, stream, cuts)


@given(st.binary(max_size=200).filter(lambda b: b"\xaa" not in b and b"\xa5" not in b))
def test_it_finds_the_packets_behind_garbage(garbage):
    clean = revolution(90)
    decoder = LidarDecoder()
    got = decoder.feed(garbage + b"".join(clean))
    assert list_contents(got) == list_contents(LidarDecoder().feed(b"".join(clean)))
    assert decoder.skipped == len(garbage)


@given(st.integers(10, 89), st.integers(0, 7))
def test_any_flipped_bit_breaks_its_packet_and_no_other(place, bit):
    packets = [packet(10.0, 30.0, [900.0] * 40), packet(31.0, 50.0, [901.0] * 40),
               packet(51.0, 70.0, [902.0] * 40)]
    damaged = bytearray(packets[1])
    damaged[place] ^= 1 << bit
    decoder = LidarDecoder()
    got = decoder.feed(packets[0] + bytes(damaged) + packets[2])
    assert [p.distance[0] for p in got] == [0.9, 0.902]
    assert decoder.broken >= 1


def test_without_the_check_the_damage_would_pass():
    """The negative control: the same bytes with a check made for them are a packet."""
    damaged = packet(31.0, 50.0, [901.0] * 39 + [1901.0])
    assert len(LidarDecoder().feed(damaged)) == 1
