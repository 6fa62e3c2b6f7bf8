"""Each bench runs, with tiny sizes; what does not depend on time must hold even so."""

from __future__ import annotations

import bench_calibration
import bench_clock
import bench_decode
import bench_emulation
import bench_encoder
import bench_firmware
import bench_import
import bench_recording
import pytest
from figures import Figure

from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links import bridge
from dart_hal.devices.links.image import find_image
from dart_lab.sim.ring import GEAR_REVOLUTION

TINY = 0.02


@pytest.fixture(scope="module", autouse=True)
def emulator():
    try:
        bridge.load()
        find_image()
    except EmulatorMissing as why:
        pytest.skip(why.what)


def by_name(figures: list[Figure]) -> dict[str, Figure]:
    names = {f.name: f for f in figures}
    assert len(names) == len(figures), "two figures of one name"
    return names


@pytest.mark.emulator
@pytest.mark.slow
def test_encoder():
    rows = by_name(bench_encoder.figures(TINY))
    assert len(rows) == 7
    assert all(f.ok for f in rows.values()), [f for f in rows.values() if not f.ok]


@pytest.mark.emulator
def test_counts_show_when_edges_are_missed():
    """With the glitch rule on, 40 k edges/s must not come through."""
    given, counted = bench_encoder.count([40e3], 0.05, (20, 0), {})
    assert given[0] > 1900
    assert counted[0] < 0.5 * given[0]


@pytest.mark.slow
@pytest.mark.emulator
def test_speed_error_shows_a_wrong_ring(monkeypatch):
    monkeypatch.setattr(bench_encoder, "GEAR_REVOLUTION", 1.002 * GEAR_REVOLUTION)
    assert bench_encoder.speed_error(1.0, 0.5).ok is False


@pytest.mark.slow
def test_decode():
    rows = by_name(bench_decode.figures(TINY))
    assert min(f.value for f in rows.values()) == rows["decode: byte loop"].value


def test_recording():
    cpu, size = bench_recording.figures(TINY)
    assert 0 < cpu.value < 100
    assert 100 < size.value < 200, "kB, of 100 States and what comes with them"


@pytest.mark.slow
def test_import():
    (cpu,) = bench_import.figures(0.2)
    assert cpu.value > 0.0
    assert cpu.high == 1.0


@pytest.mark.emulator
@pytest.mark.slow
def test_emulation():
    rows = by_name(bench_emulation.figures(TINY))
    assert rows["different byte streams by read slice"].ok
    assert rows["of it: firmware in simavr"].value > 0
    assert sum(f.name.startswith("times real time") for f in rows.values()) == 4


@pytest.mark.slow
@pytest.mark.emulator
def test_another_drive_gives_another_stream():
    first, other = (bench_emulation.rx_hash(0.01, 0.1, f"sim://?seed={n}") for n in (7, 8))
    assert first != other


@pytest.mark.emulator
@pytest.mark.slow
def test_clock():
    rows = by_name(bench_clock.figures(TINY))
    assert len(rows) == 4
    assert all(f.value < 2.0 for f in rows.values())


@pytest.mark.emulator
@pytest.mark.slow
def test_clock_errors_are_detected():
    """A zero that is 1 ms off shows as 1 ms of error."""
    zero = bench_clock.tick_zero()
    right, _ = bench_clock.errors_of("none", zero, 3.0, 0.5)
    wrong, _ = bench_clock.errors_of("none", zero + 1e-3, 3.0, 0.5)
    assert bench_clock.p99(right) < 0.1e-3
    assert bench_clock.p99(wrong) == pytest.approx(1e-3, abs=0.1e-3)


@pytest.mark.emulator
def test_state_on_the_wire():
    assert set(bench_firmware.state_sizes(0.2)) == {44}


def test_budgets_are_read_as_the_firmware_prints_them():
    rows = bench_firmware.parse(
        "flash                                         17000 B      <= 16384  OVER\n"
        "RAM never touched                               600 B      >= 500    ok\n"
        "  INT0 105\n")
    assert [(f.name, f.value, f.unit, f.ok) for f in rows] == [
        ("firmware: flash", 17000, "B", False), ("firmware: RAM never touched", 600, "B", True)]


@pytest.mark.long
@pytest.mark.emulator
def test_calibration():
    rows = by_name(bench_calibration.figures(TINY))
    assert rows["calibrate steering: time of the car"].value > 5
