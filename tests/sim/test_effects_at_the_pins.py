"""Every effect of the catalogue: hidden in the virtual world and observed by the host, or
refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dart_hal.core.errors import ConfigError, UsageError
from dart_hal.core.url import Url
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle.effects import catalogue
from dart_lab.sim.drawn import resolve_car
from dart_lab.sim.esc import Esc
from dart_lab.sim.servo import SteeringServo
from dart_lab.sim.truth import reveal_url, world_of

PLAIN = "sim://?nano=mock"
PLAN = ((-0.04, 0.3, 0.7), (0.6, 0.35, 0.5), (-0.7, 0.45, 0.5), (0.4, 0.0, 0.3))
NOISE = {"edges": 1.0, "gyro": 2.5e-3, "accel_x": 0.05, "accel_y": 0.05}
"""What a car with another draw of noise would read differently, at most."""
WITHOUT_MOCAP = [name for name, of in catalogue().items() if set(of.signals) == {"pose"}]
INJECTED = [name for name in catalogue() if name not in WITHOUT_MOCAP]


def large(name):
    of = catalogue()[name]
    return f"{name}:{of.parameters[0].sizes[2]}"


@pytest.fixture(scope="module")
def plain(driven):
    return driven(PLAIN, PLAN)


def differences(one, other):
    n = min(len(one.t), len(other.t))
    return {c: float(np.max(np.abs(getattr(one, c)[:n] - getattr(other, c)[:n]))) for c in NOISE}


@pytest.mark.parametrize("name", INJECTED)
@pytest.mark.slow
def test_a_host_reads_other_numbers(driven, plain, name):
    found = differences(driven(f"{PLAIN}&effect={large(name)}", PLAN), plain)
    assert any(found[c] > NOISE[c] for c in NOISE), found


@pytest.mark.parametrize("name", catalogue())
def test_at_null_the_car_is_untouched(name):
    nulls = ":".join(f"{q.name}={q.null}" for q in catalogue()[name].parameters)
    drawn = resolve_car(Url.parse(f"sim://?seed=3&effect={name}:{nulls}"))
    assert drawn.true is drawn.base


@pytest.mark.slow
def test_without_an_effect_the_bytes_are_those_of_before(driven, plain):
    """Also with effects at null; the control: the smallest gyro bias."""
    null = driven(f"{PLAIN}&effect=gyro_bias:0,steering_lag:0,encoder_ring:0,mass:0", PLAN)
    small = driven(f"{PLAIN}&effect=gyro_bias:0.005", PLAN)
    assert null.car.raw == plain.car.raw
    assert small.car.raw != plain.car.raw


def test_a_car_without_effects_has_plain_parts(raw_car):
    """So it costs nothing: no servo, speed controller or chain of another kind."""
    world = raw_car(PLAIN).world
    assert (type(world.servo), type(world.esc), world._signal_effects) == (SteeringServo, Esc, None)


@pytest.mark.parametrize("name", WITHOUT_MOCAP)
def test_no_motion_capture_no_effect_on_it(name):
    with pytest.raises(UsageError, match="no motion capture"):
        open_backend(f"{PLAIN}&effect={large(name)}")


@pytest.mark.parametrize("name", [n for n in INJECTED if n not in (
    "battery_fade", "centre_of_mass", "mass", "quadratic_drag", "rolling_resistance")
    and catalogue()[n].stage in ("force", "motion")])
def test_tyres_are_nothing_to_a_car_without_slip(name):
    with pytest.raises(UsageError, match="without slip"):
        open_backend(f"{PLAIN}&physics=kinematic&effect={large(name)}")


@pytest.mark.slow
@pytest.mark.parametrize("name", [
    "mass", "quadratic_drag", "rolling_resistance", "steering_trim", "steering_lag",
    "motor_gain", "encoder_ring", "gyro_bias", "throttle_delay"])
def test_the_rest_acts_without_slip_as_well(driven, name):
    kinematic = f"{PLAIN}&physics=kinematic"
    plan = PLAN[:2]
    found = differences(driven(f"{kinematic}&effect={large(name)}", plan), driven(kinematic, plan))
    assert any(found[c] > NOISE[c] for c in NOISE), found


@pytest.mark.parametrize(("text", "kind", "words"), [
    ("flux_capacitor:1", UsageError, "no effect is called"),
    ("steering_lag", UsageError, "cannot be read"),
    ("steering_lag:fast", UsageError, "cannot be read"),
    ("steering_lag:0.06:0.1", UsageError, "cannot be read"),
    ("steering_lag:seconds=0.06", UsageError, "no parameter 'seconds'"),
    ("steering_lag:60", ConfigError, "out of range"),
    ("steering_lag:nan", ConfigError, "out of range"),
    ("mass:0.1,mass:0.2", UsageError, "given twice"),
    ("clock_offset:-0.05", UsageError, "need the future")])
def test_nonsense_is_refused_in_words(text, kind, words):
    with pytest.raises(kind, match=words):
        open_backend(f"{PLAIN}&effect={text}")


@pytest.mark.slow
def test_effects_go_with_seeds_failures_and_models(driven):
    """A hidden car with two effects, whose IMU dies on the way."""
    url = f"{PLAIN}&seed=5&physics=kinematic&effect=gyro_bias:0.2,encoder_scale:0.3&fail=imu:off@3"
    record, base = driven(url, PLAN), driven(f"{PLAIN}&seed=5&physics=kinematic", PLAN)
    before = record.rows_between(2.5, 2.9)
    assert np.mean(record.gyro[before] - base.gyro[before]) == pytest.approx(0.2, abs=2e-3)
    assert record.counted_distance(0, 9) == pytest.approx(1.3 * base.counted_distance(0, 9),
                                                          rel=0.01)
    assert np.ptp(record.gyro[-30:]) == 0.0 < np.ptp(base.gyro[-30:])


def test_the_ring_of_a_repaired_sensor_is_still_the_bad_one(raw_car):
    world = raw_car(f"{PLAIN}&effect=encoder_ring:0.1&fail=enc:off@0.1+0.1").run(0.5).world
    assert len(world.nano.rings[0].marks) == 18


@pytest.mark.parametrize("seed", [0, 4])
def test_revealed_effects_come_on_top_of_the_car(seed):
    url = f"sim://?seed={seed}&effect=steering_trim:0.02,encoder_ring:missing=0.1:phase=0.25"
    shown = json.loads(json.dumps(reveal_url(Url.parse(url)), allow_nan=False))
    plain = reveal_url(Url.parse(f"sim://?seed={seed}"))
    found = {e["name"]: {k: v["value"] for k, v in e["parameters"].items()}
             for e in shown.pop("effects")}
    assert found == {"steering_trim": {"k": 0.02},
                     "encoder_ring": {"missing": 0.1, "uneven": 0.0, "phase": 0.25}}
    assert plain.pop("effects") == []
    assert shown == plain


def test_the_car_file_shows_nothing_of_it():
    url = f"{PLAIN}&seed=6"
    secret = open_backend(url + "&effect=pwm_clock:0.01,mass:0.2,encoder_scale:0.04")
    assert secret.car_toml == open_backend(url).car_toml
    assert world_of(secret).car.vehicle.body.mass == pytest.approx(
        1.2 * reveal_url(secret.url)["vehicle"]["body"]["mass"]["value"])
