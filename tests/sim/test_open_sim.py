"""Opening ``sim://``: which Nano, which reasons, which clock."""

from __future__ import annotations

import pytest

from dart_hal.core.errors import EmulatorMissing, LinkLost, UsageError
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.mock_nano import MockNano
from dart_lab.sim.truth import truth, world_of


@pytest.fixture
def no_emulator(monkeypatch, tmp_path):
    """A machine on which the bridge was not built."""
    monkeypatch.setenv("DART_HAL_EMULATOR", str(tmp_path / "libdartemu.so"))
    return str(tmp_path)


def test_mock_takes_over_and_states_exactly_why(no_emulator):
    backend = open_backend("sim://")
    assert isinstance(world_of(backend).nano, MockNano)
    (notice,) = backend.notices
    assert no_emulator in notice
    assert "MockNano instead of the firmware" in notice
    assert "make firmware" in notice


def test_asking_for_the_firmware_refuses_instead(no_emulator):
    with pytest.raises(EmulatorMissing):
        open_backend("sim://?nano=avr")


def test_asking_for_the_mock_needs_no_notice(no_emulator):
    assert open_backend("sim://?nano=mock").notices == ()


@pytest.mark.emulator
def test_default_is_the_firmware():
    backend = open_backend("sim://")
    if backend.notices:
        pytest.skip(backend.notices[0])
    assert type(world_of(backend).nano).__name__ == "EmulatedNano"
    backend.close()


def test_a_backend_in_virtual_time():
    backend = open_backend("sim://?nano=mock&seed=4")
    assert backend.virtual
    assert (backend.car, backend.clock.now()) == ("sim-4", 0.0)
    assert backend.link.read(0.05) is not None
    backend.close()
    with pytest.raises(LinkLost):
        backend.link.read(0.1)
    with pytest.raises(LinkLost):
        backend.link.write(b"\x00")


def test_coarse_ticks_are_for_the_kinematic_car():
    with pytest.raises(UsageError, match="too coarse"):
        open_backend("sim://?nano=mock&tick=10")


@pytest.mark.slow
def test_coarse_ticks_give_nearly_the_same_run(raw_car):
    cars = [raw_car(f"sim://?nano=mock&physics=kinematic&tick={t}").arm().drive(0.3, 0.3, 5.0)
            for t in (1, 10)]
    fine, coarse = (c.truth for c in cars)
    assert (coarse.x, coarse.y) == pytest.approx((fine.x, fine.y), abs=0.05)
    counts = [c.states()[-1]["enc_count"] for c in cars]
    assert counts[1] == pytest.approx(counts[0], rel=0.01)


def test_truth_is_for_simulated_cars_only():
    class Other:
        link = object()
        url = type("U", (), {"text": "serial:///dev/null"})

    with pytest.raises(UsageError):
        truth(Other())
