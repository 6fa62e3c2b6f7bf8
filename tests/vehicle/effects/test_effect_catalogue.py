"""Laws of the catalogue: names, documentation, bounds, and how effects are put on a car."""

from __future__ import annotations

import inspect
from dataclasses import replace
from importlib import import_module
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from dart_hal.core.errors import ConfigError, UsageError
from dart_hal.vehicle import PAPER, effects
from dart_hal.vehicle.effect import EFFECT_STAGES, SIGNAL_CHANNELS, PureDelay
from dart_hal.vehicle.effects import (
    add_effects,
    apply,
    catalogue,
    find_effect,
    own_effects,
    parse_effects,
)
from dart_hal.vehicle.flat import names, stack, value, with_values
from dart_lab.pages.effect_page import render_effects

RELEASED = set("""
steering_delay steering_lag steering_rate_limit steering_backlash steering_trim steering_gain
steering_compliance throttle_delay throttle_lag motor_gain battery_fade motor_deadband
motor_saturation pwm_quantisation pwm_clock
rolling_resistance quadratic_drag cornering_drag differential_drag grip front_grip rear_saturation
combined_slip load_transfer roll_compliance yaw_damping lateral_pull road_slope_x road_slope_y
mass yaw_inertia centre_of_mass
encoder_scale encoder_slip encoder_latency encoder_ring gyro_bias gyro_scale gyro_latency imu_pitch
imu_roll imu_lever_arm mocap_latency mocap_offset_x mocap_offset_y mocap_yaw clock_offset
encoder_axle imu_offset_y imu_yaw steering_dead_zone
""".split())  # noqa: SIM905
"""Names that files and reports of a user may hold already. A new effect needs no entry."""
EVERY = pytest.mark.parametrize("effect", catalogue().values(), ids=catalogue())


def test_the_catalogue_is_the_files_of_its_folder():
    files = {path.stem for path in Path(effects.__file__).parent.glob("*.py")} - {"__init__"}
    assert set(own_effects()) == files
    assert list(catalogue()) == sorted(catalogue())


def test_no_released_name_is_gone():
    assert set(catalogue()) >= RELEASED


@EVERY
def test_an_effect_is_documented(effect):
    module = import_module(f"dart_hal.vehicle.effects.{effect.name}")
    assert module.EFFECT is effect, "a file bears the name of its effect"
    assert len(inspect.getdoc(module).splitlines()) >= 3, "the equation is in the docstring"
    assert effect.stage in EFFECT_STAGES
    assert effect.title[0].islower(), "it completes 'the car ...'"
    assert not effect.title.endswith(".")
    for text in (effect.physics, effect.experiment):
        assert text.endswith(".")
        assert len(text) > 40
    assert effect.confused_with
    assert set(effect.confused_with) <= set(catalogue()) - {effect.name}
    for parameter in effect.parameters:
        assert parameter.meaning, "a report describes the parameter"
        assert not parameter.meaning.endswith(".")
    assert effect.vehicle or effect.force or effect.signals
    assert set(effect.signals) <= set(SIGNAL_CHANNELS)


def test_the_page_is_that_of_the_files():
    page = Path(__file__).parents[3] / "docs" / "reference" / "effects.md"
    assert page.read_text(encoding="utf-8") == render_effects(), "dart-hal wire --write"
    assert all(f"### {name}\n" in page.read_text(encoding="utf-8") for name in own_effects())


@EVERY
def test_bounds_hold_the_null_value_and_every_size(effect):
    for q in effect.parameters:
        assert q.low <= q.null <= q.high
        assert q.unit
        assert 0 < q.sizes[0] < q.sizes[1] < q.sizes[2]
        assert q.null + q.sizes[2] <= q.high


@EVERY
def test_values_out_of_bounds_are_refused(effect):
    for q in effect.parameters:
        for bad in (q.low - 0.01, q.high + 0.01, float("nan")):
            with pytest.raises(ConfigError, match=effect.name):
                apply(PAPER, effect.name, **{q.name: bad})
        with pytest.raises(ConfigError, match=effect.name):
            apply(PAPER, effect.name, **{q.name: np.array([q.null, q.high + 1.0])})
        assert value(apply(PAPER, effect.name, **{q.name: q.high}),
                     f"{effect.name}.{q.name}") == q.high


@pytest.mark.parametrize("name", ["quadratic_drag", "cornering_drag", "differential_drag",
                                  "yaw_damping", "steering_lag", "steering_delay",
                                  "steering_compliance", "rear_saturation"])
def test_what_cannot_be_negative_is_not(name):
    with pytest.raises(ConfigError):
        apply(PAPER, name, k=-1e-6)


def test_unknown_names_are_answered_with_near_ones():
    with pytest.raises(UsageError) as caught:
        find_effect("stering_lag")
    assert "steering_lag" in caught.value.remedy
    with pytest.raises(UsageError, match="no parameter 'seconds'"):
        apply(PAPER, "steering_lag", seconds=0.1)


def test_an_effect_is_there_once_and_can_be_replaced():
    p = apply(apply(PAPER, "grip", k=0.1), "grip", k=-0.2)
    assert [(a.name, a.values) for a in p.effects] == [("grip", (-0.2,))]
    assert with_values(p, {"grip.k": 0.3}) == apply(PAPER, "grip", k=0.3)
    assert not PAPER.effects


def test_the_order_of_naming_does_not_matter():
    some = parse_effects("gyro_latency:0.02,clock_offset:0.01,gyro_scale:0.03,yaw_damping:0.01")
    cars = {add_effects(PAPER, order).effects for order in permutations(some)}
    assert len(cars) == 1
    assert [a.name for a in cars.pop()] == ["yaw_damping", "gyro_scale", "clock_offset",
                                            "gyro_latency"]


def test_stages_come_in_the_order_of_the_car():
    p = add_effects(PAPER, parse_effects(",".join(f"{n}:{e.parameters[0].sizes[1]}"
                                       for n, e in catalogue().items())))
    stages = [EFFECT_STAGES.index(a.effect.stage) for a in p.effects]
    assert stages == sorted(stages)
    late = [any(isinstance(s, PureDelay) for s in a.effect.signals.values()) for a in p.effects]
    assert late == sorted(late), "what comes late is late after everything else"


def test_text_gives_effects():
    assert parse_effects("") == ()
    a, b, c = parse_effects("steering_lag:0.06, mocap_offset_x:k=0.003,encoder_ring:0.1:phase=0.2")
    assert (a.name, a.values) == ("steering_lag", (0.06,))
    assert (b.name, b.values) == ("mocap_offset_x", (0.003,))
    assert (c.name, c.values) == ("encoder_ring", (0.1, 0.0, 0.2))


@pytest.mark.parametrize("text", ["steering_lag", "steering_lag:", "steering_lag:fast",
                                  "steering_lag:0.1:0.2", "steering_lag:k=0.1:k=0.2", "lag:0.1",
                                  "steering_lag:T=0.1"])
def test_text_without_content_is_refused(text):
    with pytest.raises(UsageError):
        parse_effects(text)


def test_effects_are_parameters_of_a_stack():
    cars = [apply(PAPER, "grip", k=k) for k in (0.0, 0.1, 0.2)]
    both = stack(cars)
    assert value(both, "grip.k").tolist() == [0.0, 0.1, 0.2]
    assert names(both)[-1] == "grip.k"
    with pytest.raises(UsageError, match="different equations"):
        stack([PAPER, cars[0]])
    assert replace(cars[0], effects=()) == PAPER
