"""A pipe without a writer, a device: refused at once, for reading them would wait forever."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dart_hal.core.errors import RecordingError
from dart_hal.recording.dart.table import read_content
from dart_hal.recording.mcap_records import read_mcap


@pytest.mark.parametrize("read", [read_content, read_mcap],
                         ids=["csv", "mcap"])
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_what_has_no_end_is_refused(read, kind, tmp_path):
    path = Path("/dev/zero")
    if kind == "pipe":
        path = tmp_path / "run.csv"
        os.mkfifo(path)
    with pytest.raises(RecordingError, match="is no file") as caught:
        read(path)
    assert caught.value.remedy
