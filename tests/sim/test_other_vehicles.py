"""``sim://?vehicle=``: a model.toml, with its effects, is the true car."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.config import save_model
from dart_hal.core.errors import ConfigError, UsageError
from dart_hal.core.url import Url
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle import SETS, UPSTREAM_2024
from dart_hal.vehicle.effects import add_effects, parse_effects
from dart_hal.vehicle.file import model_of
from dart_lab.sim.hidden import hidden_car
from dart_lab.sim.light import LightCar
from dart_lab.sim.truth import reveal_url, world_of

CIRCLE = ((0.3, 0.3, 6.0),)


@pytest.fixture
def filed(tmp_path):
    """``filed(vehicle, effects)``: the path of its model.toml."""
    def write(p, effects=""):
        model = model_of(add_effects(p, parse_effects(effects)))
        return save_model(model, tmp_path / "extended.toml")

    return write


@pytest.mark.parametrize("name", SETS)
@pytest.mark.slow
def test_a_shipped_set_circles_as_in_the_light_simulation(driven, name):
    """Two simulations of one vehicle settle at the same speed and turn."""
    record = driven(f"sim://?nano=mock&vehicle={name}", CIRCLE)
    world = record.car.world
    light = LightCar(name)
    light.advance(world.esc.throttle, world.servo.command, 600)
    truth = world.truth()
    assert truth.v_x == pytest.approx(light.state[3], rel=0.01)
    assert truth.yaw_rate == pytest.approx(light.state[5], rel=0.01)
    if name == "upstream-2024":                     # the others are near the nominal car
        plain = driven("sim://?nano=mock", CIRCLE).car.world.truth()
        assert truth.v_x != pytest.approx(plain.v_x, rel=0.03)


@pytest.mark.slow
def test_an_extended_file_circles_as_in_the_light_simulation(driven, filed):
    path = filed(UPSTREAM_2024, "quadratic_drag:0.2,steering_trim:0.02,yaw_damping:0.03,"
                                "encoder_scale:0.04,gyro_scale:0.06")
    record = driven(f"sim://?nano=mock&vehicle={path}", CIRCLE)
    light, base = LightCar(path), LightCar(UPSTREAM_2024)
    for car in (light, base):
        car.advance(record.car.world.esc.throttle, record.car.world.servo.command, 600)
    reading = light.read()
    found = np.mean(record.speed[-20:]), np.mean(record.gyro[-20:])
    assert found == pytest.approx((reading.speed, reading.yaw_rate), rel=0.015)
    assert base.read().speed > 1.1 * reading.speed


@pytest.mark.slow
def test_delays_and_lags_of_the_file_are_those_of_servo_and_motor(driven, filed):
    turn = ((-0.04, 0.3, 3.0), (0.4, 0.3, 1.0))
    quick = UPSTREAM_2024
    slow = replace(quick, delay=replace(quick.delay, steering_s=0.2, throttle_s=0.1))
    soon, late = (driven(f"sim://?nano=mock&vehicle={v}", turn)
                  for v in ("upstream-2024", filed(slow)))
    first = [s.t[np.argmax(s.edges > 0)] for s in (soon, late)]
    assert first[1] - first[0] == pytest.approx(0.1 - quick.delay.throttle_s, abs=0.011)
    turned = [s.t[np.argmax(s.gyro > 0.5)] for s in (soon, late)]
    assert turned[1] - turned[0] == pytest.approx(0.2 - quick.delay.steering_s, abs=0.025)


def test_electronics_stay_those_of_the_seed(filed):
    path = filed(UPSTREAM_2024, "mass:0.1")
    drawn, seed = world_of(open_backend(f"sim://?nano=mock&seed=4&vehicle={path}")).car, 4
    plain = hidden_car(seed)
    assert (drawn.esc.neutral_us, drawn.ring_a, drawn.imu, drawn.oscillator_hz) == (
        plain.esc.neutral_us, plain.ring_a, plain.imu, plain.oscillator_hz)
    assert drawn.servo.backlash == plain.servo.backlash
    assert drawn.servo.curve == UPSTREAM_2024.steering
    assert drawn.vehicle.body.mass == pytest.approx(1.1 * UPSTREAM_2024.body.mass)


def test_a_kinematic_file_rolls_without_slip(filed):
    rolling = replace(SETS["paper"], kind="kinematic")
    world = world_of(open_backend(f"sim://?nano=mock&tick=10&vehicle={filed(rolling)}"))
    assert type(world.motion).__name__ == "KinematicMotion"


def test_effects_of_file_and_url_are_revealed_together(filed):
    url = f"sim://?vehicle={filed(UPSTREAM_2024, 'gyro_bias:0.02')}&effect=mass:0.1"
    shown = json.loads(json.dumps(reveal_url(Url.parse(url)), allow_nan=False))
    assert [e["name"] for e in shown["effects"]] == ["mass", "gyro_bias"]
    assert shown["vehicle"]["body"]["mass"]["value"] == UPSTREAM_2024.body.mass
    assert shown["vehicle"]["delay"]["steering_lag_s"]["value"] == (
        UPSTREAM_2024.delay.steering_lag_s)


def test_what_only_a_motion_capture_sees_is_left_out_with_a_notice(filed):
    path = filed(UPSTREAM_2024, "mocap_yaw:0.01,mass:0.1")
    backend = open_backend(f"sim://?nano=mock&vehicle={path}")
    assert "mocap_yaw" in backend.notices[0]
    assert [e["name"] for e in reveal_url(backend.url)["effects"]] == ["mass"]


def test_nonsense_of_a_vehicle_is_refused(filed, tmp_path):
    path = filed(UPSTREAM_2024, "mass:0.1")
    with pytest.raises(UsageError, match="given twice"):
        open_backend(f"sim://?nano=mock&vehicle={path}&effect=mass:0.2")
    with pytest.raises(UsageError, match="no model is called"):
        open_backend(f"sim://?nano=mock&vehicle={tmp_path / 'nothing.toml'}")
    broken = tmp_path / "broken.toml"
    broken.write_text(path.read_text().replace("mass = 1", "mass = 1000"))
    with pytest.raises(ConfigError):
        open_backend(f"sim://?nano=mock&vehicle={broken}")
