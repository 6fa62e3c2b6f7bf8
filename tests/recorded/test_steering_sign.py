"""A steering column with the wrong sign is found; the remedy is to turn the column over."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.core.errors import OtherCar
from dart_hal.recording.check import check
from dart_hal.recording.dart import read, with_marker_frames
from dart_hal.recording.dart.steering_sign import correlate_steering
from dart_hal.vehicle.sets import PAPER
from dart_lab.diagnosis.inputs import check_inputs
from tests.recorded.simulated_recording import simulate_recording, table_of, write_table


@pytest.mark.parametrize("schema", ["A", "B", "C"])
@pytest.mark.slow_except("C")
def test_reversed_steering_is_cautioned_in_every_schema(tmp_path, schema):
    table = table_of(simulate_recording(3, seconds=30.0)[0], "C" if schema == "C" else "B")
    if schema == "A":
        table = {name: v[::10] for name, v in table.items() if not name.startswith("vicon")}
    right = read(write_table(table, tmp_path / "right.csv"))
    table["steering"] = -table["steering"]
    wrong = read(write_table(table, tmp_path / "wrong.csv"))
    assert right.schema == wrong.schema == schema
    assert correlate_steering(right) > 0.6
    assert correlate_steering(wrong) < -0.6
    assert not any(n.kind == "steering_reversed" for n in right.notes), "negative control"
    note = next(n for n in wrong.notes if n.kind == "steering_reversed")
    assert "turn the column over" in note.why
    assert any(f.kind == "steering_reversed" and f.serious for f in check(wrong).findings)


def test_steering_that_has_nothing_to_do_with_the_turns_is_not_cautioned(tmp_path):
    table = table_of(simulate_recording(3, seconds=30.0)[0])
    table["steering"] = np.random.default_rng(0).uniform(-0.9, 0.9, len(table["steering"]))
    assert not any(n.kind == "steering_reversed"
                   for n in read(write_table(table, tmp_path / "noise.csv")).notes)


@pytest.mark.slow
def test_diagnose_names_the_remedy_for_a_reversed_column(tmp_path):
    table = table_of(simulate_recording(3, seconds=60.0)[0], "B")
    table["steering"] = -table["steering"]
    wrong = with_marker_frames([read(write_table(table, tmp_path / "wrong.csv"))])
    with pytest.raises(OtherCar) as caught:
        check_inputs(wrong, [], PAPER)
    assert "multiply their column 'steering' by -1" in caught.value.remedy
