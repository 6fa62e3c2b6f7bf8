"""The lidar's bytes: a lidar that turns and measures is reported as such, others are not."""

from __future__ import annotations

import math
import struct
import sys

import pytest

from tests.common import ROOT

sys.path[:0] = [str(ROOT / "hardware")]

import see_lidar  # noqa: E402 - found through the line above


def packet(first: bool, begin: float, end: float, ranges: list[float]) -> bytes:
    """As the data sheet has it: angles in deg, ranges in m."""
    kind = int(first)
    count = len(ranges)
    fsa = int(begin * 64) << 1 | 1
    lsa = int(end * 64) << 1 | 1
    samples = [round(r * 4000) for r in ranges]
    check = 0x55AA ^ (kind | count << 8) ^ fsa ^ lsa
    for s in samples:
        check ^= s
    return see_lidar.HEADER + struct.pack(f"<BBHHH{count}H", kind, count, fsa, lsa, check, *samples)


def turn(distance: float, share: float = 1.0) -> bytes:
    """One turn of 360 points, `share` of which see something."""
    data = packet(True, 0, 0, [distance])
    for k in range(9):
        ranges = [distance if share * 100 > (17 * n) % 100 else 0.0 for n in range(40)]
        data += packet(False, 40 * k, 40 * k + 39, ranges)
    return data


def test_a_packet_is_read():
    got = see_lidar.packets(b"\x00\xaa" + packet(False, 350, 10, [1.0, 0.0, 0.5]))
    assert len(got) == 1
    assert got[0].ranges == (1.0, 0.0, 0.5)
    assert [math.degrees(a) for a in got[0].angles] == pytest.approx([350, 0, 10], abs=0.02)


def test_a_damaged_packet_is_left_out():
    data = bytearray(turn(0.5))
    data[30] ^= 1
    assert len(see_lidar.packets(bytes(data))) == len(see_lidar.packets(turn(0.5))) - 1


def test_a_lidar_that_delivers():
    good, text = see_lidar.verdict(see_lidar.packets(turn(0.5) * 14), 2.0)
    assert good
    assert text == ("7.0 turns and 2520 points per second, 100 % saw something; "
                    "straight ahead 0.50 m")


@pytest.mark.parametrize(("data", "output"), [
    (b"", "nothing readable came"), (b"\x00\xff" * 400, "nothing readable came"),
    (turn(0.5) * 2, "1.0 turns"), (turn(0.5, share=0.1) * 14, "12 % saw something")])
def test_a_lidar_that_does_not(data, output):
    good, text = see_lidar.verdict(see_lidar.packets(data), 2.0)
    assert not good
    assert output in text


def test_a_port_that_is_not_there_names_what_to_type(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["see_lidar.py", "/dev/ttyNONE"])
    assert see_lidar.main() == 2
    assert "try ls /dev/ttyUSB*" in capsys.readouterr().err
