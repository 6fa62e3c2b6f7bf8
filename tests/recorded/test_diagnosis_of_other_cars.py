"""A diagnosis of recordings of another laboratory ends without a warning of the numerics."""

from __future__ import annotations

import gzip

import pytest

from dart_hal.recording.dart import read, with_marker_frames
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.result import VERDICTS
from tests.recorded.test_sizes_in_recorded_data import other_laboratory


@pytest.mark.slow
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_sensors_that_were_never_read_cause_no_warning(tmp_path):
    """Means of channels without a value were computed, once for each."""
    base = other_laboratory("f1tenth_upenn2022/base.toml")
    files = []
    for name in ("ds3", "ds4"):
        file = tmp_path / f"{name}.csv"
        file.write_bytes(gzip.decompress(base.with_name(f"{name}.csv.gz").read_bytes()))
        files.append(file)
    model, vehicle = find_model(base)
    train, test = with_marker_frames([read(file) for file in files])
    assert diagnose(model, vehicle, [train], [test]).verdict in VERDICTS
