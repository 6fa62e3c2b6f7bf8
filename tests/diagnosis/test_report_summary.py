"""The box at the top, problems of the data, and findings in words that fit their size."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.vehicle.effects import catalogue
from dart_lab.diagnosis.error_summaries import LateCommands
from dart_lab.diagnosis.report import page
from dart_lab.diagnosis.report.along import ResidualRows, means_along
from dart_lab.diagnosis.report.data_problems import NOT_FITTED, data_problems, valid_sizes
from dart_lab.diagnosis.report.explain import describe_cause, describe_claim, heading, is_small
from dart_lab.diagnosis.report.findings import list_findings
from dart_lab.diagnosis.report.patterns import NEXT_STEPS, Pattern, next_step
from dart_lab.diagnosis.report.summary import (
    headline,
    median_warnings,
    motion_warnings,
    summary_lines,
    tone,
)
from dart_lab.diagnosis.report.words import change, signed_title
from dart_lab.diagnosis.result import Claim, ParameterEstimate, QuantityChange, Unexplained
from dart_lab.diagnosis.servo import TYRE_CAUTION
from dart_lab.diagnosis.unexplained.features import FEATURE_UNITS
from dart_lab.report.numbers import describe_change, significant
from tests.diagnosis import made_by_hand as made

DEAD = "encoder dead: always 0 while the mocap shows the car driving"
FROZEN = "false lock of the mocap (pose at rest, encoder turns): 20.91 s, 29% of the recording"
CLOCKS = ("the car acts 100 ms before its commands are in the recording, at the edge of what is "
                  "allowed: the clocks of command and sensors differ. Synchronise the clocks")
LATE_FINDING = LateCommands(0.21, 0.062, 34.2, ())


def claim(old, new, std, **changes):
    base = Claim("motor", "motor", (), 1.0, {"pull": QuantityChange(old, new, std, "N")},
                 (1.03, 1.01, 1.05), (), "Drive steps.", made.CONSTANT)
    return replace(base, **changes)


@pytest.mark.parametrize(("new", "std", "small"), [
    (2.90, 0.02, True), (2.90, 0.001, True), (3.2, 0.3, True), (3.2, 0.02, False)])
def test_a_change_below_two_standard_errors_or_two_per_cent_is_a_small_correction(new, std,
                                                                                  small):
    c = claim(2.88, new, std)
    assert is_small(c) == small
    assert ("small correction" in describe_claim(c)["What"]) == small
    assert ("was wrong" in describe_claim(c)["What"]) != small


def test_a_change_is_stated_in_per_cent_and_standard_errors_and_its_gain_forwards():
    assert change(QuantityChange(2.0, 2.2, 0.05, "N")) == (
        "2 -> 2.200 +- 0.050 N (+10 %, 4 standard errors)")
    assert "standard" not in change(QuantityChange(2.0, 2.2, math.nan, "N"))
    gain = describe_claim(claim(2.0, 2.2, 0.05))["Gain"]
    assert "fall by 3 % (90 % interval 1 % to 5 %)" in gain
    assert "rise by 3 %" in describe_claim(claim(2.0, 2.2, 0.05, cost=(0.97, 0.9, 1.0)))["Gain"]


def test_a_ratio_is_stated_as_a_change():
    assert describe_change(0.996, 0.994, 0.999) == "0.4 % smaller [-0.6 %, -0.1 %]"
    assert describe_change(1.5, math.nan, math.nan) == "50 % larger"


def test_refit_causes_sensors_and_the_first_step_have_a_line_each():
    d = made.diagnosis()
    lines = summary_lines(d)
    assert [line.partition(":")[0] for line in lines] == [
        "Parameters", "Cause", "Sensors", "First"]
    assert "steering_lag" in lines[1]
    assert "gyro_scale" not in lines[1]
    assert "not how the model predicts the motion" in lines[2]
    assert "friction.a" not in lines[0]
    assert "motor.d 28.9 -> 71.30 +- 0.51 N (+147 %, 83 standard errors)" in lines[0]
    assert "friction.a" in summary_lines(made.diagnosis("parameters_only", 0, False))[0]
    wrong = summary_lines(replace(d, claims=(claim(2.0, 3.0, 0.05),)))[0]
    assert wrong.startswith("Parameters: wrong: motor.")


def test_what_is_left_is_a_multiple_of_the_noise_floor():
    d = made.diagnosis()
    error = d.stages[-1].horizons["1.0"]["pooled"]["vx"]
    lines = summary_lines(replace(d, noise_floor={"vx": error / 1.4}))
    assert "Left: errors of 1.4 (speed) times the noise floor." in lines


@pytest.mark.slow
def test_a_problem_of_the_data_comes_first():
    d = made.diagnosis()
    assert "problem" not in summary_lines(d)[-1]
    loop = replace(d, notes=("not candidates, because the motor has a speed loop: pwm_clock",))
    assert "problem" not in summary_lines(loop)[-1]
    # A caution of the method is shown, and is nothing that a user solves.
    tyres = replace(d, notes=(TYRE_CAUTION,))
    assert summary_lines(tyres)[-1] == summary_lines(d)[-1]
    assert "do not rely on" in page(tyres).lower()
    both = replace(d, notes=(CLOCKS, "b.csv: the encoder is dead"),
                   late_commands=LATE_FINDING,
                   files={"b.csv": {"why": [DEAD]}, "c.csv": {"why": [FROZEN, "other"]}})
    assert summary_lines(both)[-1].startswith("First: solve the first of 4 problems of the data: "
                                              "the car acts 100 ms before")
    problems = data_problems(both)
    assert problems[0].startswith("The car acts 100 ms")
    assert "Check the radio link" in problems[1]
    assert problems[2].startswith(f"E{DEAD[1:]}, in b. Check plug")
    assert problems[3].startswith("False lock of the mocap")
    text = page(both)
    places = [text.index(words) for words in ("verdict bad", "Before you rely on the numbers",
                                              "The car acts 100 ms", 'class="pair"')]
    assert places == sorted(places)
    assert "Before you rely" not in page(d)


def test_parameters_that_were_not_fitted_are_a_problem_of_the_model():
    assert NOT_FITTED in page(replace(made.diagnosis(causes=1), refitted={}))
    assert NOT_FITTED not in page(made.diagnosis(causes=1))


def test_a_substitute_is_marked_and_not_counted_as_a_cause():
    d = made.diagnosis("partly_explained", 1, False)
    changing = replace(d, causes=(replace(d.causes[0], constancy=made.CHANGES),))
    assert heading(changing.causes[0]).startswith("Substitute: the car")
    assert heading(d.causes[0]).startswith("The car")
    assert "one substitute (of no constant size)" in headline(changing)
    assert "cause of the catalogue" not in headline(changing)
    assert "one cause of the catalogue" in headline(d)
    assert 'class="cause found"' in page(d)
    assert 'class="cause found"' not in page(changing)
    assert "its size changes with speed (p = 0.001), so" in describe_cause(changing, 0)["What"]
    either = replace(changing.causes[0], constancy=replace(made.CHANGES, others=("throttle",)))
    assert "speed (p = 0.001), or with throttle (these go together in the data), so" in (
        describe_cause(replace(d, causes=(either,)), 0)["What"])


def test_words_follow_the_sign_of_a_size():
    cause = made.diagnosis(causes=1).causes[0]
    weak, strong = (replace(cause, effect="motor_gain", parameters={
        "k": ParameterEstimate(k, 0.01, "relative")}) for k in (-0.3, 0.3))
    assert signed_title(weak) == "has a weaker motor than the model"
    assert signed_title(strong) == "has a stronger motor than the model"
    assert signed_title(cause) == cause.title


def test_every_title_with_two_directions_has_signed_titles():
    for effect in catalogue().values():
        first = effect.parameters[0]
        if " or " in effect.title and first.low < first.null < first.high:
            assert len(set(effect.signed_titles)) == 2, effect.name
        assert not any(" or " in words for words in effect.signed_titles)


def test_sizes_from_broken_data_do_not_count():
    d = made.diagnosis(causes=1)
    sizes = {"19/a.csv": (3.98, 0.1), "b": (0.9, 0.1), "c": (1.1, 0.1), "d": (0.45, 0.1)}
    files = {"d": {"role": "train", "windows": 1}, "c": {"role": "train", "windows": 2}}
    d = replace(d, causes=(replace(d.causes[0], sizes=sizes),), files=files)
    assert list(valid_sizes(d, d.causes[0])) == ["19/a.csv", "b", "c"]
    d = replace(d, files={**files, "19/a.csv": {"why": [DEAD]}})
    assert list(valid_sizes(d, d.causes[0])) == ["b", "c"]
    text = describe_cause(d, 0)["Why"]
    assert "2 of 2 training recordings need it; sizes are 90 % to 110 %" in text
    assert "2 without valid data left out" in text


def test_of_four_recordings_the_middle_half_is_stated():
    d = made.diagnosis(causes=1)
    sizes = {str(i): (size, 0.1) for i, size in enumerate((0.1, 0.9, 1.0, 1.1, 4.0))}
    text = describe_cause(replace(d, causes=(replace(d.causes[0], sizes=sizes),)), 0)["Why"]
    assert "the middle half of the sizes is 90 % to 110 % of the fitted one" in text


def test_a_typical_error_that_grows_is_stated():
    d = made.diagnosis(causes=1)
    assert median_warnings(d) == []

    def stage(base_stage, rmse, median):
        return replace(base_stage,
                       horizons={"1.0": {"pooled": {"vx": rmse}, "median": {"vx": median}}})

    first, *middle, last = d.stages
    middle = [stage(one, 0.2, 0.09) for one in middle]
    worse = replace(d, stages=(stage(first, 0.211, 0.068), *middle, stage(last, 0.137, 0.103)),
                    ctrv={"1.0": {"pooled": {"vx": 1.0}, "median": {"vx": 0.05}}})
    assert median_warnings(worse) == [
        "The large errors shrink (speed RMSE 0.211 -> 0.137) but the typical one grows (median "
        "0.068 -> 0.103).",
        "In the median, constant velocity predicts better than every model: speed 0.05 against "
        "0.068 m/s."]
    within = replace(worse, stages=(worse.stages[0], *middle, stage(last, 0.137, 0.074)), ctrv={})
    assert median_warnings(within) == []


def test_colour_follows_the_meaning_of_the_verdict():
    explained = replace(made.diagnosis("explained", 1, False), considered=())
    assert tone(explained) == "found"
    only = replace(made.diagnosis("parameters_only", 0, False), claims=(claim(2.0, 2.01, 0.05),))
    assert tone(only) == "good"
    assert tone(replace(only, claims=(claim(2.0, 3.0, 0.05),))) == "found"
    assert tone(made.diagnosis("unexplained", 0, True)) == "bad"


def test_text_and_picture_of_a_pattern_show_the_same_means():
    d = made.diagnosis("unexplained", 0, True)
    pattern = Pattern(d, d.unexplained[0], ResidualRows(d.evidence, d.extended))
    means = pattern.found.after
    assert pattern.found.column.after == pytest.approx(0.5)
    for value in (np.nanmax(means.mean), np.nanmin(means.mean)):
        assert f"{value:+.2g} m/s at speed" in pattern.sentences()["What"]
    assert "test recordings" in pattern.caption()
    assert "Size" not in pattern.sentences()
    error = d.stages[-1].horizons["1.0"]["pooled"]["vx"]
    floor = Pattern(replace(d, noise_floor={"vx": error / 1.06}), d.unexplained[0],
                    ResidualRows(d.evidence, d.extended)).sentences()["Size"]
    assert f"6 % above the noise floor ({significant(error)} against" in floor


def test_every_variable_of_a_pattern_has_a_next_step():
    known = {name for names, _ in NEXT_STEPS for name in names}
    assert known >= {*FEATURE_UNITS, "recording"}
    assert "Check floor" in next_step(Unexplained("v_x", "", ("x",), 0.01, 0.5))
    assert "no variable that is known" in next_step(Unexplained("v_x", "", (), 0.01, 0.5))


def test_a_part_of_a_variable_without_rows_interrupts_the_line():
    rng = np.random.default_rng(0)
    x = rng.uniform(0.0, 1.0, 2000)
    block = np.arange(2000) // 20
    assert np.isfinite(means_along(x, x, block).x).all()
    with_gap = x[(x < 0.3) | (x > 0.7)]
    means = means_along(with_gap, with_gap, block[:len(with_gap)])
    assert np.isnan(means.x).sum() == 1
    gap = int(np.flatnonzero(np.isnan(means.x))[0])
    assert means.x[gap - 1] < 0.3
    assert means.x[gap + 1] > 0.7


def test_hash_and_frame_of_a_recording_are_folded_and_no_dict_is_printed():
    d = made.diagnosis()
    use = {"role": "test", "windows": 3, "sha256": "ab" * 32, "reference": {"lx": 0.1},
           "why": ["w"]}
    text = page(replace(d, files={"a.csv": use}))
    row = text.partition("<td class=\"s\">a.csv</td>")[2].partition("</tr>")[0]
    assert row.index("<details>") < row.index("ab" * 32)
    assert "{" not in row
    assert "lx 0.1" in row


def test_the_verdict_states_no_counts_of_a_single_recording():
    d = made.diagnosis()
    assert "1 recording better" not in " ".join([*summary_lines(d), describe_cause(d, 0)["Gain"]])


def test_every_effect_names_known_variables_in_which_it_acts():
    for effect in catalogue().values():
        assert effect.acts_along, effect.name
        assert set(effect.acts_along) <= set(FEATURE_UNITS), effect.name


def test_first_lines_state_which_cause_improves_no_prediction_of_the_motion():
    both = motion_warnings(made.diagnosis())
    assert both == ["gyro_scale improves no prediction of the motion."]
    assert motion_warnings(made.diagnosis(causes=1)) == []
    d = made.diagnosis()
    alone = replace(d, causes=d.causes[1:])
    assert motion_warnings(alone) == ["No cause improves a prediction of the motion: what is "
                                      "gained there comes from the refit."]


def test_first_lines_state_where_constant_velocity_is_better():
    d = made.diagnosis(causes=1)
    (line,) = motion_warnings(replace(d, ctrv=d.stages[-1].horizons, stages=(
        *d.stages[:-1], replace(d.stages[-1], horizons=d.stages[0].horizons))))[-1:]
    assert line.startswith("Constant velocity predicts better than the model: speed (")
    assert page(d).index("In sentences") > page(d).index('class="bars"')


def test_a_finding_is_one_line_with_size_share_and_status():
    d = replace(made.diagnosis(), claims=(claim(2.0, 3.0, 0.05), claim(2.88, 2.9, 0.02)))
    lines = [finding.line for finding in list_findings(d)]
    assert lines[0] == ("wrong parameter: motor; pull 2 -> 3.000 +- 0.050 N; removes 3 % (1 % to "
                        "5 %) of the motion error")
    assert lines[1] == ("accepted: turns its wheels more slowly (steering_lag); 118.7 +- 4.3 ms; "
                        "removes 41 % (36 % to 47 %) of the yaw rate error")
    assert lines[-1].startswith("small correction: motor")
    worse = replace(d.causes[0], gain=replace(d.causes[0].gain, test=-0.62, low=-1.09, high=-0.26))
    (line,) = [finding.line for finding in list_findings(replace(d, causes=(worse,)))
               if "steering_lag" in finding.line]
    assert line.endswith("raises the yaw rate error by 62 % (26 % to 109 %)")
    text = page(d)
    for finding in list_findings(d):
        assert f'href="#{finding.anchor}"' in text
