"""Five simulated minutes of the soak; `make soak` runs two hours with the firmware.

The negative controls: a host that counts lost frames wrong, a pulse that stays
above neutral, memory and threads that grow.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

sys.path.append(str(Path(__file__).parent))
import soak
from soak import CYCLE, QUIET_S, Pins, Report, plan

from dart_hal.core.errors import EmulatorMissing
from dart_hal.wire.ledger import SequenceTracker
from dart_lab.sim.failures import parse_failure
from dart_lab.sim.world import THROTTLE_CHANNEL

MINUTES = 5


@pytest.fixture(autouse=True)
def the_world_forgets_no_truth_of_other_tests(monkeypatch):
    monkeypatch.setattr("dart_lab.sim.world._MAX_RECORDS", soak.KEPT)


def check(report):
    assert not report.broken, report.text()
    assert report.faults > 0.85 * report.seconds
    assert report.arms > report.seconds / 40
    assert report.trips > report.arms / 2
    assert report.driven > 0.1 * 100 * report.seconds
    assert report.lost > 0
    assert report.damaged > 0


@pytest.mark.slow
def test_five_minutes_without_the_firmware():
    check(soak.soak(60.0 * MINUTES, "mock", "mux"))


@pytest.mark.long
@pytest.mark.emulator
@pytest.mark.parametrize("cutoff", ["mux", "oe"])
def test_five_minutes_with_the_firmware(cutoff):
    try:
        report = soak.soak(60.0 * MINUTES, "avr", cutoff)
    except EmulatorMissing as missing:
        pytest.skip(f"no emulator: {missing.what}")
    check(report)


def test_one_fault_a_second_with_time_to_arm_in_between():
    faults = [parse_failure(f) for f in plan(7, 3600.0, "avr")]
    assert plan(7, 3600.0, "avr") == plan(7, 3600.0, "avr") != plan(8, 3600.0, "avr")
    assert len(faults) >= 0.99 * 3600.0
    assert len({(f.target, f.kind) for f in faults}) > 12
    assert all(f.start % CYCLE >= QUIET_S or (f.target, f.kind) == ("mcu", "reset") for f in faults)


@pytest.mark.slow
def test_a_host_that_counts_lost_frames_wrong_is_found(monkeypatch):
    right = SequenceTracker.add_frame

    def wrong(self, ident, seq, payload):
        before = self.lost
        right(self, ident, seq, payload)
        self.lost = before + (self.lost - before) // 2

    monkeypatch.setattr(SequenceTracker, "add_frame", wrong)
    report = soak.soak(60.0, "mock", seed=2)
    assert "frames lost" in report.broken[0][1]


@pytest.mark.slow
def test_pulses_that_outlive_their_command_are_found(monkeypatch):
    """Allowed to end a fifth of a second before the last live moment, any drive breaks it."""
    monkeypatch.setattr(soak, "HOLD", {"mux": -0.25})
    report = soak.soak(30.0, "mock")
    assert "above neutral" in report.broken[0][1]
    assert report.seconds < 30.0


@pytest.mark.parametrize(("mode", "rise", "us", "breaks"), [
    ("ARMED", 1.1, 1600.0, False), ("ARMED", 1.5, 1600.0, True), ("TRIPPED", 1.15, 1600.0, True),
    ("TRIPPED", 1.02, 1600.0, False), ("TRIPPED", 1.5, 1504.0, False),
    ("DISARMED", 9.0, 1400.0, False)])
def test_the_law_of_the_pin(mode, rise, us, breaks):
    throttle = SimpleNamespace(neutral_us=1500.0)
    car = SimpleNamespace(mode="ARMED", causes=(), files=SimpleNamespace(
        config=SimpleNamespace(throttle=throttle)))
    report = Report("")
    pins = Pins(car, 0.14, report)
    pins.commanded = 1.0
    pins(THROTTLE_CHANNEL, (1.0, 1.0016))
    car.mode = mode
    pins(THROTTLE_CHANNEL, (rise, rise + us * 1e-6))
    assert bool(report.broken) is breaks


@pytest.mark.parametrize("field", ["memory", "handles"])
def test_growth_is_found(field):
    report = Report("", memory=[50_000] * 4, handles=[(1, 0, 6)] * 4)
    soak._judge(report)
    assert not report.broken
    grown = {"memory": [50_000, 51_000, 53_000, 55_000], "handles": [(1, 0, 6), (2, 0, 6)]}
    setattr(report, field, grown[field])
    soak._judge(report)
    assert report.broken
