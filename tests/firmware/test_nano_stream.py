"""The ELF in simavr: the stream, the encoder, the handshake, the line."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from firmware_rig import BOARD_ID, FLAG, Rig, crc16, eeprom_image

from dart_hal.wire import codec, messages

pytestmark = pytest.mark.emulator
Make = Callable[..., Rig]
VECTORS = json.loads((Path(__file__).parents[1] / "wire/vectors.json").read_text())


@pytest.mark.slow
def test_state_comes_at_100_hz_without_a_gap(nano: Make) -> None:
    rig = nano()
    rig.run(5.0)
    ticks = [s["t_ck"] for s in rig.states()]
    assert len(ticks) >= 499  # the first slot begins 11 ms after the reset
    steps = [b - a for a, b in itertools.pairwise(ticks)]
    assert max(abs(s - 20_000) for s in steps) <= 1000  # 0.5 ms
    assert sum(steps) / len(steps) == pytest.approx(20_000, abs=1)  # no drift
    c = rig.decoder.counters
    assert (c.crc, c.cobs, c.length, c.gaps) == (0, 0, 0, 0)
    assert not any(s["flags"] & FLAG["SLOT_OVERRUN"] for s in rig.states())


def test_hello_comes_three_times_at_boot(nano: Make) -> None:
    rig = nano()
    rig.run(0.5)
    hellos = [(t, v) for t, n, v in rig.frames if n == "HELLO"]
    assert [round(b[0] - a[0], 2) for a, b in itertools.pairwise(hellos)] == [0.1, 0.1]
    hello = hellos[0][1]
    assert hello["schema"] == messages.SCHEMA
    assert hello["proto"] == messages.PROTO
    assert (hello["board_id"], hello["boot_count"]) == (BOARD_ID, 5)
    nonce = crc16(BOARD_ID.to_bytes(4, "little") + (5).to_bytes(2, "little"))
    assert hello["boot_nonce"] == nonce
    assert hello["clock_hz"] == messages.TICKS_PER_SECOND
    assert hello["build"] == 0
    assert rig.raw.startswith(b"\0")  # ends anything that the reset has left on the line


def test_hello_on_request_echoes_the_sequence_and_sends_diag(nano: Make) -> None:
    rig = nano()
    rig.run(0.6)
    rig.seq = 77
    rig.send("HELLO_REQ", proto=1, flags=1)
    got = {n: v for _, n, v in rig.run(0.05)}
    assert got["HELLO"]["req_seq"] == 77
    assert got["DIAG"]["rx_ok"] == 1


@pytest.mark.parametrize("edge_min_us", [0, 100])
@pytest.mark.parametrize("rate", [0.05, 7.3, 120.0, -60.0])
@pytest.mark.slow
def test_edge_counts_are_exact(nano: Make, edge_min_us: int, rate: float) -> None:
    rig = nano(eeprom=eeprom_image(edge_min_us=edge_min_us))
    rig.run(0.2)
    before = rig.nano.edges(0)
    rig.nano.set_wheel(rate)
    rig.run(3.0)
    rig.nano.set_wheel(0)
    rig.run(0.05)
    edges = rig.nano.edges(0)
    assert rig.state()["enc_count"] == edges
    assert edges - before == pytest.approx(60 * abs(rate),
                                                                               abs=2)
    assert rig.decoder.counters.gaps == 0


def test_both_rings_at_once(nano: Make) -> None:
    rig = nano(eeprom=eeprom_image(ring_b=1))
    rig.nano.set_ring(1, [(i + 0.5) / 10 for i in range(10)])
    rig.run(0.2)
    rig.nano.set_wheel(100)
    rig.run(2.0)
    rig.nano.set_wheel(0)
    rig.run(0.05)
    state = rig.state()
    assert state["enc_count"] == rig.nano.edges(0)
    assert state["enc2_count"] == rig.nano.edges(1)
    assert state["flags"] & FLAG["ENC2_PRESENT"]
    assert rig.hello()["caps"] & 1


def test_ring_b_is_silent_unless_fitted(nano: Make) -> None:
    rig = nano()
    rig.nano.set_ring(1, [(i + 0.5) / 10 for i in range(10)])
    rig.nano.set_wheel(50)
    rig.run(0.5)
    assert (rig.state()["enc2_count"], rig.state()["enc2_t_ck"]) == (0, 0)
    assert not rig.state()["flags"] & FLAG["ENC2_PRESENT"]


def test_edge_times_and_intervals(nano: Make) -> None:
    rig = nano()
    rig.run(0.2)
    rig.nano.set_wheel(10)  # an edge each 5 ms
    start = rig.now
    rig.run(2.0)
    states = rig.states(start + 0.1)
    assert {s["enc_dt_ck"] for s in states} <= set(range(9978, 10_023))  # 10.2 us of blocking
    for a, b in itertools.pairwise(states):
        edges = b["enc_count"] - a["enc_count"]
        assert abs(b["enc_t_ck"] - a["enc_t_ck"] - 10_000 * edges) <= 22


def test_a_slow_wheel_has_the_long_interval_flag(nano: Make) -> None:
    rig = nano()
    rig.nano.set_wheel(1.0)  # 50 ms per edge
    rig.run(1.0)
    assert rig.state()["enc_dt_ck"] == 65535


@pytest.mark.slow
def test_edges_separated_by_a_stamp_wrap_pass_the_glitch_rule(nano: Make) -> None:
    rig = nano()
    rig.run(0.2)
    rig.nano.set_wheel(1 / 20 / 0.0327745)  # 32.7745 ms: 6.5 us after the 16-bit wrap
    rig.run(3.0)
    rig.nano.set_wheel(0)
    rig.run(0.03)
    assert rig.state()["enc_count"] == rig.nano.edges(0) > 80
    assert not any(s["flags"] & FLAG["ENC_REJECT"] for s in rig.states())


def test_noise_is_refused_and_reported(nano: Make) -> None:
    rig = nano()
    rig.run(0.2)
    rig.nano.set_wheel(1000)  # 20 k edges/s
    rig.run(0.05)
    rig.nano.set_wheel(0)
    rig.run(0.6)
    assert any(s["flags"] & FLAG["ENC_REJECT"] for s in rig.states())
    assert any(n == "EVENT" and v["code"] == 5 for _, n, v in rig.frames)
    assert rig.state()["enc_count"] <= 0.05 / 100e-6 + 1
    rig.send("HELLO_REQ", proto=1, flags=1)
    diag = next(v for _, n, v in rig.run(0.1) if n == "DIAG")
    assert diag["edges_rejected"] > 300


def test_negative_control_without_the_rule_noise_counts(nano: Make) -> None:
    rig = nano(eeprom=eeprom_image(edge_min_us=0))
    rig.run(0.2)
    rig.nano.set_wheel(1000)
    rig.run(0.05)
    rig.nano.set_wheel(0)
    rig.run(0.05)
    assert rig.state()["enc_count"] == rig.nano.edges(0) > 900


def test_edges_frames_are_successive(nano: Make) -> None:
    rig = nano()
    rig.run(0.5)
    rig.nano.set_wheel(25)  # 500 edges/s
    rig.send("EDGES_REQ", frames=12)
    rig.run(1.0)
    got = [v for _, n, v in rig.frames if n == "EDGES"]
    assert len(got) == 12
    assert [b["first_count"] - a["first_count"] for a, b in itertools.pairwise(got)] \
        == [8] * 11
    assert all(abs(i - 4000) <= 22 for v in got for i in v["interval"])


def test_capture_measures_a_servo_pulse(nano: Make) -> None:
    rig = nano()
    rig.run(0.5)
    rig.send("CAPTURE_REQ", frames=5)
    for _ in range(7):
        rig.nano.set_pin("D8", True)
        rig.run(0.0015)
        rig.nano.set_pin("D8", False)
        rig.run(0.0185)
    got = next(v for _, n, v in rig.frames if n == "CAPTURE")
    assert got["frames"] == 5
    assert abs(got["last_rise"] - got["first_rise"] - 200_000) <= 4
    assert abs(got["high_sum"] - 15_000) <= 10
    assert got["high_max"] - got["high_min"] <= 4


def test_capture_of_a_silent_channel_ends(nano: Make) -> None:
    rig = nano()
    rig.run(0.5)
    answer = rig.ask("CAPTURE_REQ", "CAPTURE", seconds=0.5, frames=5)
    assert answer["frames"] == answer["high_sum"] == 0


def clock_offset(rig: Rig) -> float:
    """World ticks minus device ticks, by one edge at a known time (INT0 stamps 2.5 late)."""
    start = rig.now
    rig.nano.set_wheel(1)
    rig.run(0.04)
    assert rig.state()["enc_count"] == 1
    return (start + 0.025) * 2e6 - rig.state()["enc_t_ck"] + 2.5


@pytest.mark.slow
def test_pong_has_the_time_of_its_first_byte(nano: Make) -> None:
    rig = nano()
    rig.run(0.5)
    offset = clock_offset(rig)
    rig.nano.set_wheel(77)  # interrupts in between
    errors = []
    waits = []
    for n in range(60):
        rig.run(0.0137)
        sent = rig.now
        rig.send("TIME_PING", ping_id=n, host_us=5 * n)
        arrived, pong = next((t, v) for t, name, v in rig.run(0.03) if name == "TIME_PONG")
        assert (pong["ping_id"], pong["host_us"]) == (n, 5 * n)
        waits.append(pong["rx_ck"] + offset - (sent + 12 * 20e-6) * 2e6)
        errors.append((arrived - 22 * 20e-6) * 2e6 - pong["tx_ck"] - offset)
    # Ticks of 0.5 us. An interrupt that is in the way adds up to 12 us.
    assert all(-6 <= w <= 30 for w in waits), (min(waits), max(waits))
    assert all(-8 <= e <= 26 for e in errors), (min(errors), max(errors))
    assert abs(sorted(errors)[30]) <= 5
    assert sorted(waits)[30] <= 8


@pytest.mark.slow
def test_boot_frames_equal_the_reference_codec(nano: Make) -> None:
    """ELF against Python: every frame of a busy run, encoded again, is the same bytes."""
    rig = nano()
    rig.nano.set_wheel(20)
    rig.nano.set_imu((0.1, -0.2, 0.3), (1, -2, 3))
    rig.run(0.4)
    for _ in range(5):
        rig.send("TIME_PING", ping_id=9)
        rig.send("PARAM_GET", id=3)
        rig.send("EDGES_REQ", frames=2)
        rig.run(0.3)
    names = set()
    for block in rig.raw.split(b"\0"):
        if not block:
            continue
        frame = rig.decoder.__class__().feed(block + b"\0")[0]
        names.add(frame.message.name)
        if not frame.message.variable:
            assert codec.encode(frame.message, frame.seq, frame.as_dict()) == block + b"\0"
    assert {"HELLO", "STATE", "DIAG", "EVENT", "TIME_PONG", "PARAM_VALUE", "EDGES", "LOG"} <= names


def test_every_golden_vector_to_the_nano_is_accepted(nano: Make) -> None:
    rig = nano()
    rig.run(0.5)
    down = [v for v in VECTORS["frames"] if messages.BY_NAME[v["message"]].dir == "down"
            and v["message"] != "REBOOT"]
    assert len(down) >= 7
    for vector in down:
        rig.nano.write(bytes.fromhex(vector["wire"]))
        rig.run(0.02)
    rig.send("HELLO_REQ", proto=1, flags=1)
    diag = next(v for _, n, v in rig.run(0.3) if n == "DIAG" and v["rx_ok"])
    assert diag["rx_ok"] == len(down) + 1
    assert (diag["rx_crc"], diag["rx_len"]) == (0, 0)


@pytest.mark.slow
def test_a_flood_at_full_rate_costs_neither_beats_nor_slots(nano: Make) -> None:
    rig = nano()
    rig.run(0.5)
    noise = bytes((i * 37 + 11) % 255 + 1 for i in range(988))
    start = rig.now
    for _ in range(50):  # 20 ms of line each: 12 + 988 bytes
        rig.send("TIME_PING", ping_id=1)
        rig.nano.write(noise[:-1] + b"\0")
        rig.run(0.02)
    states = rig.states(start)
    assert len(states) >= 99
    assert rig.nano.uart_stats().overrun == 0
    assert sum(n == "TIME_PONG" for _, n, _ in rig.frames) >= 45
    assert any(s["flags"] & FLAG["RX_ERROR"] for s in states)
    assert not any(s["flags"] & FLAG["SLOT_OVERRUN"] for s in states)


@pytest.mark.slow
def test_the_other_baud_is_tried_after_3_s_of_garbage(nano: Make) -> None:
    rig = nano(host_baud=115_200)
    for _ in range(80):
        rig.send("HELLO_REQ", proto=1)
        rig.run(0.05)
    assert rig.nano.uart_stats().baud == pytest.approx(115_200, rel=0.03)
    rig.run(0.2)
    count = len(rig.states())
    rig.run(1.0)
    assert len(rig.states()) - count == pytest.approx(100, abs=2)


@pytest.mark.slow
def test_the_baud_is_kept_while_frames_arrive(nano: Make) -> None:
    rig = nano()
    for _ in range(400):
        rig.send("PARAM_GET", id=1)
        rig.nano.write(b"\x55" * 9 + b"\0")
        rig.run(0.01)
    assert rig.nano.uart_stats().baud == pytest.approx(500_000)
