"""Nodes of an RPLidar: the layout of its protocol, answers, damage, portions, revolutions."""

from __future__ import annotations

from math import degrees

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dart_hal.devices.lidar.models import RPLIDAR
from dart_hal.devices.lidar.rplidar import (
    MOTOR_REQUEST,
    MOTOR_STOP_REQUEST,
    SYNC_NODES,
    RplidarDecoder,
)
from dart_hal.devices.lidar.scan import LidarStream
from tests.devices.lidar.decoder_checks import check_portions
from tests.devices.lidar.rplidar_bytes import (
    HEALTH_ANSWER,
    INFO_ANSWER,
    RATE_ANSWER,
    SCAN_DESCRIPTOR,
    node,
    stream,
)


def nodes_of(packets):
    """(start, angle, distance) of each node, without the cuts into packets."""
    return [(p.starts and k == 0, float(a), float(np.nan_to_num(d, nan=-1.0)))
            for p in packets for k, (a, d) in enumerate(zip(p.angle, p.distance, strict=True))]


def scans_of(raw, period=508e-6, size=40):
    """Scans of bytes that arrive at the pace of the samples, in portions, and their stream."""
    lidar = LidarStream(RPLIDAR)
    scans = [s for k in range(0, len(raw), size)
             for s in lidar.feed(raw[k:k + size], 5.0 + (k + size) / 5 * period)]
    return scans, lidar


def test_a_node_computed_by_hand():
    """Quality 15, no start; 90 deg are 5760 = 0x1680 counts; 1000 mm are 4000 = 0x0FA0."""
    raw = bytes.fromhex("3E 01 2D A0 0F")
    assert raw == node(90.0, 1000.0)
    (got,) = RplidarDecoder().feed(SCAN_DESCRIPTOR + raw)
    assert degrees(got.angle[0]) == pytest.approx(90.0)
    assert got.distance.tolist() == [1.0]
    assert not got.starts


def test_no_return_is_no_distance_and_a_start_begins_a_packet():
    raw = node(359.0, 0.0) + node(0.1, 500.0, start=True) + node(1.1, 0.0)
    first, second = RplidarDecoder().feed(SCAN_DESCRIPTOR + raw)
    assert (first.starts, second.starts) == (False, True)
    assert np.isnan(first.distance).all()
    assert second.distance[0] == 0.5
    assert np.isnan(second.distance[1])


def test_answers_are_distinguished_from_nodes():
    decoder = RplidarDecoder()
    got = decoder.feed(INFO_ANSWER + HEALTH_ANSWER + RATE_ANSWER + SCAN_DESCRIPTOR + stream(1))
    assert len(nodes_of(got)) == 361
    assert decoder.answers[0x04].text().startswith("model 24, firmware 1.29, hardware 7")
    assert decoder.answers[0x06].text() == "health 2, error 4660"
    assert decoder.sample_period == pytest.approx(508e-6)
    assert (decoder.broken, decoder.skipped) == (0, 0)


def test_requests_with_content_end_with_their_check():
    for request in (MOTOR_REQUEST, MOTOR_STOP_REQUEST):
        assert np.bitwise_xor.reduce(np.frombuffer(request, "u1")) == 0


def test_a_stream_that_runs_already_is_found_without_its_descriptor():
    decoder = RplidarDecoder()
    assert nodes_of(decoder.feed(stream(1)[3:])) == nodes_of(
        RplidarDecoder().feed(SCAN_DESCRIPTOR + stream(1)))[1:]
    assert decoder.skipped == 2


@pytest.mark.parametrize("period", [508e-6, 250e-6])
def test_whole_revolutions_by_the_period_that_the_unit_states(period):
    rate = RATE_ANSWER[:7] + round(1e6 * period).to_bytes(2, "little") + b"\x00\x01"
    found, lidar = scans_of(rate + SCAN_DESCRIPTOR + stream(8), period)
    assert [len(s) for s in found] == [360] * 8
    for scan in found:
        assert np.diff(scan.after) == pytest.approx(period, rel=5e-3)
        assert scan.rate == pytest.approx(1.0 / (360 * period), rel=5e-3)
    assert np.diff([s.start for s in found[1:]]) == pytest.approx(360 * period, rel=2e-2)
    assert lidar.assembler.missing == 0


def test_angles_that_go_back_at_an_edge_stay_in_one_revolution():
    raw = b"".join(node((k % 360 + (-4.0 if k % 360 in (90, 200, 201) else 0.0)) % 360.0, 1500.0,
                        start=k % 360 == 0) for k in range(4 * 360 + 1))
    found, lidar = scans_of(SCAN_DESCRIPTOR + raw)
    assert [len(s) for s in found] == [360] * 4
    assert lidar.decoder.broken == 0


def test_lost_bytes_cost_their_nodes_alone():
    raw = stream(6)
    found, lidar = scans_of(SCAN_DESCRIPTOR + raw[:5 * 800 + 2] + raw[5 * 802:])
    assert lidar.decoder.broken == 1
    assert lidar.decoder.skipped == 2
    assert sorted(len(s) for s in found) == [358, 360, 360, 360, 360, 360]
    assert lidar.assembler.missing == 2


def test_a_head_at_rest_is_no_stream():
    decoder = RplidarDecoder()
    assert decoder.feed(node(20.0, 500.0) * 200) == []
    assert decoder.feed(b"\x55" * 500) == []


@given(st.binary(max_size=300))
@example(b"\xa5\x5a\x05\x00\x00\x40\x81" * 3)
@example(b"\xa5\x5a\x14")
@example(b"\xa5")
def test_no_bytes_raise_and_each_is_counted_once(data):
    decoder = RplidarDecoder()
    got = decoder.feed(data)
    held = len(decoder._rest)
    assert decoder.packets == len(nodes_of(got))
    if not decoder.answers:
        assert decoder.skipped + 5 * decoder.packets + held == len(data)
    assert decoder.skipped + 5 * decoder.packets + held <= len(data)


@given(st.lists(st.integers(1, 97), min_size=1, max_size=60), st.integers(0, 2**32 - 1),
       st.integers(0, 6))
def test_portions_do_not_matter(cuts, seed, damages):
    rng = np.random.default_rng(seed)
    raw = bytearray(INFO_ANSWER + SCAN_DESCRIPTOR + stream(1))
    for _ in range(damages):
        raw[rng.integers(len(raw))] ^= 1 << rng.integers(8)
        del raw[rng.integers(len(raw))]
    check_portions(RplidarDecoder, raw, cuts, nodes_of)


@given(st.integers(0, 2**32 - 1))
def test_random_bytes_are_no_nodes_and_the_stream_after_them_is_found(seed):
    """Within two chains of the start: a few random bytes may join the first nodes."""
    garbage = np.random.default_rng(seed).integers(0, 256, 400, dtype=np.uint8).tobytes()
    decoder = RplidarDecoder()
    assert decoder.feed(garbage) == []
    got = nodes_of(decoder.feed(stream(1)))
    clean = nodes_of(RplidarDecoder().feed(stream(1)))[2 * SYNC_NODES:]
    assert got[-len(clean):] == clean
    assert decoder.skipped >= len(garbage) - 2 * SYNC_NODES * 5


@given(st.integers(100, 200), st.sampled_from([(0, 0), (0, 1), (1, 0)]))
def test_a_flipped_check_bit_breaks_its_node_and_no_other(place, check):
    raw = bytearray(SCAN_DESCRIPTOR + stream(1))
    raw[7 + 5 * place + check[0]] ^= 1 << check[1]
    decoder = RplidarDecoder()
    got = nodes_of(decoder.feed(bytes(raw)))
    assert len(got) == 360
    assert decoder.broken == 1
    assert decoder.skipped == 5
    assert not any(abs(degrees(angle) - place) < 0.5 for _, angle, _ in got)


def test_control_without_the_checks_the_damage_would_pass():
    """A flipped bit of the distance, which no check covers, changes one beam."""
    raw = bytearray(SCAN_DESCRIPTOR + stream(1))
    raw[7 + 5 * 150 + 4] ^= 1
    got = nodes_of(RplidarDecoder().feed(bytes(raw)))
    assert len(got) == 361
    assert sum(d != 2.0 for _, _, d in got) == 1
