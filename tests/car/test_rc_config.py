"""``[rc]`` of car.toml, and what the position of a stick means."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.car import Car
from dart_hal.car.rc import RcOverride, scale_stick
from dart_hal.core.config.car import CarConfig, Geometry, RcChannel, RcConfig
from dart_hal.core.errors import ConfigError
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of

DEAD_BAND_US = 50.0


@pytest.mark.parametrize(("channel", "pulse_us", "position"), [
    (RcChannel(), 1500.0, 0.0), (RcChannel(), 1550.0, 0.0), (RcChannel(), 1450.0, 0.0),
    (RcChannel(), 2000.0, 1.0), (RcChannel(), 1000.0, -1.0), (RcChannel(), 2100.0, 1.0),
    (RcChannel(), 1775.0, 0.5), (RcChannel(low_us=2000.0, high_us=1000.0), 1000.0, 1.0),
    (RcChannel(low_us=2000.0, high_us=1000.0), 2000.0, -1.0),
    (RcChannel(low_us=1100.0, center_us=1400.0), 1100.0, -1.0)])
def test_position_of_a_stick(channel, pulse_us, position):
    assert scale_stick(pulse_us, channel, DEAD_BAND_US) == pytest.approx(position)


@given(st.floats(800.0, 2200.0), st.floats(800.0, 2200.0), st.booleans())
def test_position_is_monotone_and_in_its_range(one, other, reverse):
    channel = RcChannel(low_us=2000.0, high_us=1000.0) if reverse else RcChannel()
    low, high = (scale_stick(p, channel, DEAD_BAND_US) for p in sorted((one, other)))
    assert min(low, high) >= -1.0
    assert max(low, high) <= 1.0
    assert (low >= high) if reverse else (low <= high)


@pytest.mark.parametrize("table", [
    "[rc]\ndead_band_us = 5.0", "[rc]\nmode_us = 300.0", "[rc]\nsticks = 2",
    "[rc.throttle]\nlow_us = 700.0", "[rc.steering]\nhigh_us = nan",
    "[rc.steering]\nlow_us = 1400.0", "[rc.throttle]\nlow_us = 1900.0\nhigh_us = 2150.0"])
def test_a_wrong_table_is_refused(table):
    backend = open_backend("sim://?nano=mock")
    backend.car_toml += f"\n{table}\n"
    with pytest.raises(ConfigError, match=r"\brc\b"):
        Car.over(backend)


@pytest.mark.slow_except("*ue")
@pytest.mark.parametrize(("table", "reads"), [("[rc]", True), ("[rc]\nenabled = false", False),
                                              ("", False)])
def test_only_a_car_with_a_receiver_reads_it(table, reads):
    backend = open_backend("sim://?nano=mock&rc=1")
    backend.car_toml = backend.car_toml.replace("[rc]", table)
    with Car.over(backend) as car:
        for _ in car.states(duration=0.3):
            pass
        assert (car._engine.driver.rc is not None) == reads
        assert not car.answers("RC")


@pytest.mark.parametrize(("state_ck", "present"), [
    (1_000_000_000, True), (1_000_090_000, True), (999_980_000, True), (1_000_110_001, False),
    (2000, False), (3_200_000_000, False)])
def test_a_pulse_counts_while_its_age_is_small(state_ck, present):
    """Later, slightly earlier, and after the Nano's clock has restarted or run on for long."""
    override = RcOverride(CarConfig(
        name="a", rc=RcConfig(), geometry=Geometry(wheelbase=0.175, l_f=0.1, l_r=0.075, mass=2.0)))
    override.add({"t_ck": 1_000_000_000, "pulse": (3000, 3800, 0), "age": (9, 10, 255)}, 1.0)
    assert override.has_signal(state_ck) == present
    override.step(1.0, state_ck, armed=True)
    assert override.has_signal(1_000_000_000) == present, "a lost pulse does not come back"


@pytest.mark.slow
def test_a_replay_has_the_override(tmp_path):
    run = tmp_path / "run.mcap"
    backend = open_backend("sim://?nano=mock&physics=kinematic&rc=1")
    with Car.over(backend, record=run) as car:
        for _ in car.states(duration=1.0):
            pass
        car.arm()
        world_of(backend).receiver.pulses_us[1] = 1700.0
        live = [(s.seq, s.applied) for s in car.states(duration=0.3)]
    assert live[-1][1].throttle > 0.3
    assert "RC_OVERRIDE" in live[-1][1].limited
    with Car.open(f"replay://{run}") as again:
        replayed = {s.seq: s.applied for s in again.states()}
        assert again.rc_pulses == pytest.approx((1500.0, 1700.0, 0.0), abs=2.0)
    assert [replayed[seq] for seq, _ in live] == [applied for _, applied in live]
