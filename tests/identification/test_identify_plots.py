"""What the pictures take from recordings, and from a fit made the paper's way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dart_hal.car.runs import read_any
from dart_hal.vehicle import PAPER, make_friction
from dart_lab.identification.paper import fit_as_paper
from dart_lab.identification.paper.evidence import collect_paper_data
from dart_lab.identification.plots import (
    collect_data,
    complete_fits,
    draw,
    figures,
    style,
    why_missing,
)
from dart_lab.identification.plots.from_recordings import CONSTANT_TIME, PlottedMotion

EXCERPT = Path(__file__).resolve().parents[1] / "recorded" / "data"


@pytest.fixture(scope="module")
def made():
    return fit_as_paper(EXCERPT)


def test_a_command_counts_as_held_after_its_time():
    t = 0.1 * np.arange(30)
    command = np.where(t < 1.05, 0.2, 0.3)
    motion = PlottedMotion("x", t, *(np.zeros(30) for _ in range(5)))
    held = motion.is_constant(command)
    assert held.tolist() == [bool(h) for h in np.where(
        t < 1.05, t > CONSTANT_TIME + 1e-9, t > 1.1 + CONSTANT_TIME + 1e-9)]


@pytest.mark.slow
def test_the_paper_s_pictures_show_the_very_rows_of_the_fits(made):
    evidence = collect_paper_data(made)
    for name, data in (("friction", evidence.friction.force), ("motor", evidence.motor.force),
                       ("steering", evidence.steering.angle),
                       ("tyres_front", evidence.tyres.front_force)):
        assert len(data) == made.fits[name].n
    assert evidence.step.throttle.max() > 0.3  # the step is in the picture


@pytest.mark.slow
def test_recordings_give_forces_of_the_right_sign_and_size(made):
    recordings, _ = read_any([EXCERPT / "19_step_input_data", EXCERPT / "30_step_steering_data",
                              EXCERPT / "50_tire_model_data"])
    evidence = collect_data(recordings, made.fits)
    fast = evidence.friction.v > 0.5
    expected = make_friction(PAPER.friction, np)(evidence.friction.v[fast])
    assert np.median(evidence.friction.force[fast] - expected) == pytest.approx(0.0, abs=0.2)
    for low, high in ((-1.0, -0.5), (0.5, 1.0)):  # + = left
        side = (evidence.steering.command >= low) & (evidence.steering.command <= high)
        assert np.sign(np.median(evidence.steering.angle[side])) == np.sign(low)
    tyres = evidence.tyres
    assert np.corrcoef(tyres.rear_slip, tyres.rear_force)[0, 1] > 0.8
    assert np.abs(tyres.front_slip).max() < np.radians(40.0)  # rad, not deg


@pytest.mark.slow
def test_rows_without_a_yaw_rate_cost_only_themselves(made):
    """As in our own runs, whose first messages have none."""
    recordings, _ = read_any([EXCERPT / "19_step_input_data"])
    whole = next(r for r in recordings if "15_28_11" in r.path.name)
    rate = whole.messages.yaw_rate.copy()
    rate[:5] = np.nan
    cut = replace(whole, messages=replace(whole.messages, yaw_rate=rate))
    expected, found = (len(collect_data([r], made.fits).friction.v) for r in (whole, cut))
    assert expected > 20
    assert expected - 5 <= found <= expected
    none = replace(whole, messages=replace(whole.messages, yaw_rate=np.full_like(rate, np.nan)))
    evidence = collect_data([none], made.fits)
    assert evidence.friction is None
    assert why_missing(evidence, made.fits)["friction"] == "no usable stretch in these recordings"


@pytest.mark.slow
def test_what_a_joint_fit_held_comes_from_the_base(made):
    tyres = made.fits["tyres"]
    half = replace(tyres, parameters={n: tyres.parameters[n] for n in (
        "front_D", "front_B", "rear_cornering_stiffness")})
    full = complete_fits({"tyres": half, "friction": made.fits["friction"]}, PAPER)
    assert full["tyres"].parameters["front_D"] == tyres.parameters["front_D"]
    assert full["tyres"].parameters["front_C"].value == PAPER.tyres.front_C
    assert not full["tyres"].parameters["front_C"].identifiable
    assert full["friction"] is made.fits["friction"]


@pytest.mark.slow
def test_a_curve_of_many_sessions_is_reported(made):
    fit = made.fits["friction"]
    assert style.label(fit) == "fit"
    pooled = replace(fit, details={"sessions": 10.0})
    assert style.label(pooled) == "fit, mean of 10 sessions"


@pytest.mark.slow
def test_only_what_was_fitted_is_drawn(made, tmp_path):
    pytest.importorskip("matplotlib")
    evidence = collect_paper_data(made)
    pictures = draw(figures(evidence, {"steering": made.fits["steering"]}), tmp_path)
    assert [p.name for p in pictures] == ["steering.png"]
