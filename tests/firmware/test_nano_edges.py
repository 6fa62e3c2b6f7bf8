"""The edge interrupt, written in assembly, against EdgeCounter::edge() in C++."""

from __future__ import annotations

import ctypes as c
import random
from collections.abc import Callable

import pytest
from firmware_rig import FLAG, Rig, eeprom_image

from dart_hal.wire.messages import PARAM_BY_NAME

pytestmark = pytest.mark.emulator
Make = Callable[..., Rig]
GAPS_US = (25, 60, 90, 110, 150, 400, 3_000, 12_000, 32_768, 33_000, 65_540, 98_310)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("edge_min_us", [0, 100, 2000])
@pytest.mark.slow
def test_both_take_and_refuse_the_same_edges(core: c.CDLL, nano: Make, seed: int,
                                             edge_min_us: int) -> None:
    draw = random.Random(seed)
    times = []
    t = 0.001
    for _ in range(120):  # one turn of a ring whose marks have the distance of the gaps
        times.append(t)
        t += draw.choice(GAPS_US) * 1e-6
    rig = nano(eeprom=eeprom_image(edge_min_us=edge_min_us))
    rig.nano.set_ring(0, [at / (t + 1) for at in times])
    rig.run(0.1)
    rig.nano.set_wheel(1 / (t + 1))
    rig.run(t + 0.5)
    rig.nano.set_wheel(0)
    core.counter_new(0, edge_min_us * 2)
    refreshed = 0
    for n, at in enumerate(times):
        ticks = round(at * 2e6)
        while refreshed + 7000 <= ticks:
            refreshed += 7000
            core.counter_refresh(refreshed & 0xFFFF)
        core.counter_edge(ticks & 0xFFFF, (n + 1) & 1)
    rig.send("HELLO_REQ", proto=1, flags=1)
    diag = next(v for _, n, v in rig.run(0.1) if n == "DIAG")
    model = (c.c_uint16 * 10)()
    core.counter_get(model)
    assert (rig.state()["enc_count"], diag["edges_rejected"]) == (model[0], model[1])
    assert model[0] > 20
    assert (model[1] > 0) == (edge_min_us > 0)


@pytest.mark.slow
def test_a_storm_of_interrupts_loses_nothing(nano: Make) -> None:
    """5000 edges/s on both rings, IMU with stretching, host traffic both ways."""
    rig = nano(eeprom=eeprom_image(ring_b=1, safety_out=2))
    rig.nano.set_ring(1, [(i + 0.3) / 20 for i in range(20)])
    rig.run(0.5)
    rig.nano.set_wheel(250)
    token = rig.hello()["boot_nonce"]
    start = rig.now
    for n in range(100):
        rig.nano.set_imu((0.01 * n, 0.2, 0.3), (1, 2, 0.01 * n))
        rig.send("HEARTBEAT", arm_token=token, mode=1, flags=1)
        rig.send("TIME_PING", ping_id=n)
        rig.send("PARAM_GET", id=n % 10 + 1)
        rig.run(0.02)
    rig.nano.set_wheel(0)
    rig.run(0.6)
    assert rig.state()["enc_count"] == rig.nano.edges(0) > 9900
    assert rig.state()["enc2_count"] == rig.nano.edges(1)
    bad = FLAG["SLOT_OVERRUN"] | FLAG["TX_DROPPED"] | FLAG["RX_ERROR"] | FLAG["ENC_REJECT"]
    assert not any(s["flags"] & bad for s in rig.states(start))
    diags = [v for t, n, v in rig.frames if n == "DIAG" and t > start]
    assert max(d["loop_max_us"] for d in diags) <= 8000
    assert diags[-1]["uart_overrun"] == 0
    assert diags[-1]["rx_seq_gap"] == 0
    assert rig.decoder.counters.gaps == 0


def test_a_new_glitch_rule_holds_at_once_on_both_rings(nano: Make) -> None:
    """Edges each 1 ms, and then a shortest interval of 1.5 ms: every second one is too early."""
    rig = nano(eeprom=eeprom_image(edge_min_us=0, ring_b=1))
    rig.nano.set_ring(1, [(i + 0.3) / 20 for i in range(20)])
    rig.run(0.5)
    rig.nano.set_wheel(50)
    rig.run(0.2)
    assert not rig.state()["flags"] & FLAG["ENC_REJECT"]
    answer = rig.ask("PARAM_SET", "PARAM_VALUE", id=PARAM_BY_NAME["edge_min_us"].id, value=1500)
    assert answer["status"] == 0
    first = rig.state()
    rig.run(0.2)
    last = rig.state()
    for count in ("enc_count", "enc2_count"):
        assert (last[count] - first[count]) % 65536 < 150    # of 200


def test_a_preset_of_the_simulator_is_read(nano: Make) -> None:
    from dart_lab.sim.eeprom import make_eeprom
    rig = nano(eeprom=make_eeprom(0x12345678, {}))
    rig.run(0.3)
    assert rig.hello()["board_id"] == 0x12345678
