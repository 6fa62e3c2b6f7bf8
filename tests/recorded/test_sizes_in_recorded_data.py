"""Sizes of effects hidden in recorded drives, where the rest of the world is real.

A sensor effect changes what was recorded; a command effect changes the commands in the log, so that
the car did something else with them than what was logged. Neither needs a simulator. The model is
fitted to the same drive without the effect, so what is found is the difference.

The sensors of a recorded car have effects of their own, and no fit of the motion removes them. Such
an effect is hidden twice, with either sign: half the difference of the sizes found is what was
hidden.
"""

from __future__ import annotations

import gzip
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

from dart_hal.recording.dart import Reference, read, with_marker_frames
from dart_hal.recording.dart.model import freeze
from dart_hal.recording.dart.reference import reference_for
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.identification.evaluation import errors, measured, predict, prepare
from dart_lab.identification.shooting import fit

OTHER_FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data" / "other"
ZHENG = Reference(0.21, -0.0117, 0.0, "of that car")
DART = (Path(__file__).parent / "data" / "91_free_driving_16_sept_2024"
        / "car_1_Datarecording_09_16_2024_10_01_01.csv.gz")
HUBER_SIGMA = 2.6
"""Standard errors within which a size lies with 99 % probability."""


@dataclass(frozen=True)
class ChangedDrive:
    """A recorded drive with the model that fits it."""

    recording: object
    model: object
    vehicle: object


def other_laboratory(name):
    path = OTHER_FOLDER / name
    if not path.is_file():
        pytest.skip(f"recordings of other laboratories are absent: no {path}")
    return path


def fitted_drive(file, base, reference):
    """The drive of a file, and the model that ``identify all --joint`` fits to it."""
    from click.testing import CliRunner

    from dart_lab.cli.identify import command

    model = Path(mkdtemp()) / "model.toml"
    frame = f"{reference.lx},{reference.theta},{reference.ly}"
    done = CliRunner().invoke(command, ["all", "--joint", str(file), "--base", str(base),
                                        "--reference", frame, "--out", str(model)])
    assert done.exit_code == 0, done.output
    return ChangedDrive(with_marker_frames([read(file)], reference)[0], *find_model(model))


@lru_cache(maxsize=1)
def zheng():
    """Two minutes of a car of 3.5 kg with motion capture alone."""
    packed = other_laboratory("zheng2022/day1.csv.gz")
    file = Path(mkdtemp()) / "day1.csv"
    file.write_bytes(gzip.decompress(packed.read_bytes()))
    return fitted_drive(file, packed.with_name("base.toml"), ZHENG)


@lru_cache(maxsize=1)
def dart():
    """A minute of free driving with motion capture, wheel encoder and IMU."""
    return fitted_drive(DART, "paper", reference_for(read(DART)))


def with_mocap(r, **changes):
    return replace(r, mocap=replace(r.mocap, **{k: freeze(v) for k, v in changes.items()}))


def with_messages(r, **changes):
    return replace(r, messages=replace(r.messages, **{k: freeze(v) for k, v in changes.items()}))


def turned_marker(r, k):
    return with_mocap(r, yaw=r.mocap.yaw + k)


def shifted_marker(forward, left):
    def shift(r, k):
        yaw = r.mocap.yaw
        return with_mocap(r, x=r.mocap.x + k * (forward * np.cos(yaw) - left * np.sin(yaw)),
                          y=r.mocap.y + k * (forward * np.sin(yaw) + left * np.cos(yaw)))
    return shift


def earlier(values, t, k):
    """A command as it would be in a log of which the car acts k [s] later."""
    return np.interp(t + k, t, values)


def remove_lag(values, t, k):
    """The command whose first-order lag of k [s] is the recorded one."""
    return values + k * np.gradient(values, t)


def steering_earlier(r, k):
    return with_messages(r, steering=earlier(r.messages.steering, r.messages.t, k))


def steering_larger(r, k):
    return with_messages(r, steering=r.messages.steering / (1.0 + k))


def steering_without_lag(r, k):
    return with_messages(r, steering=remove_lag(r.messages.steering, r.messages.t, k))


def throttle_larger(r, k):
    return with_messages(r, throttle=r.messages.throttle / (1.0 + k))


def biased_gyro(r, k):
    return with_messages(r, yaw_rate=r.messages.yaw_rate + k)


def scaled_gyro(r, k):
    return with_messages(r, yaw_rate=r.messages.yaw_rate * (1.0 + k))


def scaled_encoder(r, k):
    return with_messages(r, speed=r.messages.speed * (1.0 + k))


def found_size(drive, name, hide, hidden):
    """Size with its standard error that the diagnosis accepts where this much is hidden."""
    inputs = check_inputs([hide(drive.recording, hidden)], [], drive.vehicle)
    found = diagnose(drive.model, drive.vehicle, inputs.train, inputs.test, refit=False,
                     only=(name,))
    return {c.effect: c for c in found.causes}[name].parameters["k"]


SIZE_CASES = [("mocap_yaw", 0.02, turned_marker), ("mocap_yaw", 0.05, turned_marker),
              ("mocap_yaw", -0.05, turned_marker), ("mocap_yaw", 0.1, turned_marker),
              ("mocap_offset_x", -0.04, shifted_marker(1.0, 0.0)),
              ("steering_delay", 0.1, steering_earlier), ("steering_gain", 0.1, steering_larger),
              ("steering_lag", 0.1, steering_without_lag), ("motor_gain", 0.1, throttle_larger)]
BOTH_SIGNS = [("gyro_bias", 0.05, biased_gyro), ("gyro_scale", 0.2, scaled_gyro),
              ("encoder_scale", 0.04, scaled_encoder), ("mocap_yaw", 0.05, turned_marker),
              ("mocap_offset_y", 0.03, shifted_marker(0.0, 1.0))]


@pytest.mark.parametrize(("name", "hidden", "hide"), SIZE_CASES,
                         ids=[f"{name}-{hidden}" for name, hidden, _ in SIZE_CASES])
@pytest.mark.slow
@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.long_except("mocap_yaw-0.02", "mocap_yaw--0.05", "mocap_offset*", "steering*",
                         "motor*")
def test_hidden_size_is_found_in_a_recorded_drive(name, hidden, hide):
    number = found_size(zheng(), name, hide, hidden)
    assert abs(number.value - hidden) < HUBER_SIGMA * number.std
    # The timing of this car is the least known: its delay has an error of .038 s.
    assert number.std < (0.4 if name == "steering_delay" else 0.35) * abs(hidden)


@pytest.mark.parametrize(("name", "hidden", "hide"), BOTH_SIGNS,
                         ids=[name for name, _, _ in BOTH_SIGNS])
@pytest.mark.slow
@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.long_except("mocap_yaw")
def test_half_the_difference_of_both_signs_is_the_hidden_size(name, hidden, hide):
    more, less = (found_size(dart(), name, hide, sign * hidden) for sign in (1.0, -1.0))
    std = 0.5 * np.hypot(more.std, less.std)
    assert abs(0.5 * (more.value - less.value) - hidden) < HUBER_SIGMA * std
    assert std < 0.35 * hidden


def half_of_zheng(folder, first):
    """One half of the log of the 1:10 car, in time."""
    packed = other_laboratory("zheng2022/day1.csv.gz")
    head, *rows = gzip.decompress(packed.read_bytes()).decode().splitlines()
    middle = len(rows) // 2
    file = folder / f"{first}.csv"
    file.write_text("\n".join([head, *(rows[:middle] if first else rows[middle:])]) + "\n")
    return with_marker_frames([read(file)], ZHENG)[0]


@pytest.mark.parametrize("tested", [False, True], ids=["second half", "first half"])
@pytest.mark.slow
@pytest.mark.long
def test_loss_of_force_at_every_throttle_predicts_the_other_half(tmp_path, monkeypatch, tested):
    """Of a real car whose motor is not that of DART; printed: errors 1 s ahead."""
    start = find_model(other_laboratory("zheng2022/base.toml"))[1]
    train, test = half_of_zheng(tmp_path, not tested), half_of_zheng(tmp_path, tested)
    cases = prepare([test]).cases
    rms = {}
    for added in (False, True):
        if not added:
            monkeypatch.setattr(fit, "_needs_effect", lambda *given: False)
        found = fit.fit_from_recordings([train], start)[0]
        monkeypatch.undo()
        assert ("back_emf.k" in found.nuisance) == added
        error = errors(predict(found.vehicle, cases), measured(cases))[1]
        rms[added] = np.sqrt(np.mean(error**2, axis=1))
        print(added, rms[added])
    speed, _, yaw_rate, position, _ = rms[True] / rms[False]
    assert speed < 0.7
    assert yaw_rate < 0.95
    assert position < 0.9
