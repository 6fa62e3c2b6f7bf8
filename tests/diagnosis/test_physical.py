"""Sizes of causes are stated with what the parameter is, in a unit that a reader knows."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from dart_hal.vehicle.effects import catalogue
from dart_lab.diagnosis.report.physical import EXAMPLES, SCALES, describe_size
from dart_lab.diagnosis.result import ParameterEstimate

PLAIN_UNITS = {"rad/s", "N", "N m", "turn", "step"}
"""Units that a reader knows as they are."""


def size(effect, **values):
    known = {q.name: q for q in catalogue()[effect].parameters}
    return describe_size(SimpleNamespace(effect=effect, parameters={
        name: ParameterEstimate(value, std, known[name].unit)
        for name, (value, std) in values.items()}))


@pytest.mark.parametrize(("effect", "value", "std", "text"), [
    ("steering_lag", 0.119, 0.004, "additional time constant of the steering 119.0 +- 4.0 ms"),
    ("mass", 0.102, 0.004, "change of the mass +10.20 +- 0.40 %"),
    ("motor_gain", -0.08, 0.01, "change of the motor force -8.0 +- 1.0 %"),
    ("steering_backlash", 0.1, 0.002,
     "play of the road wheels from end to end 0.1000 +- 0.0020 rad (5.73 deg)"),
    ("cornering_drag", 2.89, 0.06,
     "drag per radian of steering angle 2.890 +- 0.060 N/rad (1.01 N at 0.35 rad)"),
    ("rear_saturation", 0.25, 0.01,
     "inverse of the largest side force of the rear tyres 0.250 +- 0.010 1/N (4 N)"),
    ("load_transfer", 0.4, 0.03, "share of the side force that 1 g moves to the rear axle "
                                 "40.0 +- 3.0 %"),
    ("mocap_offset_x", -0.008, 0.001,
     "distance of the marker ahead of its stated position -8.0 +- 1.0 mm"),
    ("road_slope_x", 0.0981, 0.0, "downhill acceleration along x of the room 0.0981 m/s2 "
                                  "(a slope of 1 cm in 1 m)")])
def test_size_is_stated_with_its_meaning(effect, value, std, text):
    assert size(effect, k=(value, std)) == text


def test_a_phase_is_left_to_the_tables():
    text = size("encoder_ring", missing=(0.05, 0.001), uneven=(0.1, 0.01), phase=(0.2, 0.01))
    assert "part of a turn without marks 0.0500" in text
    assert "closest marks" not in text


def test_no_example_divides_by_a_size_of_zero():
    assert size("rear_saturation", k=(0.0, 0.1)).endswith("0.00 +- 0.10 1/N")


def test_every_unit_of_the_catalogue_is_known():
    units = {q.unit for effect in catalogue().values() for q in effect.parameters}
    assert units <= {*SCALES, *EXAMPLES, *PLAIN_UNITS}
