"""The benchmark on the real car: its black box, its wins and its regression gate."""

from __future__ import annotations

import bench_real_car
import numpy as np
import pytest

from dart_hal.car.runs import read_any
from dart_hal.vehicle.load import find_model
from dart_lab.identification.evaluation.cases import prepare
from dart_lab.identification.evaluation.prediction import errors, measured, predict
from tests.common import EXCERPT


def fold(name, refit, best):
    return {"held_out": name, "rmse": {"refit": [refit] * 5, "best predictor": [best] * 5}}


def test_gate_compares_recordings_by_name():
    reference = [fold("a", 1.0, 0.5), fold("b", 1.0, 2.0)]
    assert bench_real_car.compare([fold("b", 1.0, 2.0)], reference) == pytest.approx(1.0)
    worse = bench_real_car.compare([fold("b", 1.0, 2.1), fold("a", 1.0, 0.5)], reference)
    assert worse == pytest.approx(1.05**0.5)
    assert worse > bench_real_car.MAX_WORSE


def test_gate_refuses_recording_that_reference_lacks():
    with pytest.raises(KeyError):
        bench_real_car.compare([fold("c", 1.0, 1.0)], [fold("a", 1.0, 1.0)])


@pytest.mark.long
def test_neural_residual_starts_at_the_bicycle_and_learns():
    pytest.importorskip("jax", reason="needs the extra bench")
    import neural_residual

    vehicle = find_model("paper")[1]
    cases = prepare(read_any([EXCERPT])[0]).cases
    wrong = errors(predict(vehicle, cases), measured(cases))[1]
    windows = neural_residual.make_windows(vehicle, cases)
    scales = neural_residual.make_scales(windows)
    untrained = neural_residual.make_network()
    found = neural_residual.compute_errors(vehicle, untrained, scales, cases)
    assert found == pytest.approx(np.sqrt(np.mean(wrong**2, axis=1)), rel=1e-3)

    trained, losses = neural_residual.train(vehicle, windows, steps=20)
    assert min(losses) > 0.0
    assert np.mean(losses[-5:]) < 0.9 * losses[0]
    assert neural_residual.compute_errors(vehicle, trained, scales, cases)[2] < found[2]


@pytest.mark.parametrize("part", [("--recordings", "3"), ("--together", "1")])
def test_gate_refuses_part_of_the_recordings(part, capsys):
    with pytest.raises(SystemExit):
        bench_real_car.main(["nowhere", "--check", *part])
    assert "--check compares all recordings" in capsys.readouterr().err


def test_recordings_that_were_never_used_train_no_model():
    names = (*bench_real_car.HELD_OUT, *bench_real_car.TRAINING_ONLY)
    never_used = [name.removeprefix("other/") for name in bench_real_car.NEVER_USED]
    recordings = {name: name for name in (*names, *never_used)}
    work = bench_real_car.splits(recordings, len(bench_real_car.HELD_OUT), 3, neural=False)
    assert [title for title, _ in work] == ["held out"] * 4 + ["split by day", "never used"]
    for title, (train, test, _) in work:
        assert not set(train) & {*test, *never_used}
        assert set(test) <= set(names) or (title, test) == ("never used", never_used)
    assert set(work[-1][1][0]) == set(names)
