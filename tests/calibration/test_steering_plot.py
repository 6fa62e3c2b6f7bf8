"""The figure is written, in the requested format, from a true result."""

from __future__ import annotations

import pytest

from dart_hal.calibration.plot import plot_steering
from dart_hal.calibration.steering import calibrate_steering
from dart_hal.core.errors import UsageError

pytest.importorskip("matplotlib")


@pytest.fixture
def result(bench):
    return calibrate_steering(bench(), dry_run=True)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "magic"), [("a.png", b"\x89PNG"), ("b.svg", b"<?xml")])
def test_figure_in_the_format_of_its_suffix(result, tmp_path, name, magic):
    path = plot_steering(result, tmp_path / "new" / name)
    assert path.read_bytes().startswith(magic)


@pytest.mark.slow
def test_unknown_format_is_refused(result, tmp_path):
    with pytest.raises(UsageError, match="format"):
        plot_steering(result, tmp_path / "a.txt")


@pytest.mark.slow
def test_import_of_the_room_does_not_load_matplotlib():
    import subprocess
    import sys

    code = ("import sys, dart_hal.calibration.plot, dart_hal.calibration.steering; "
            "print([m for m in ('matplotlib', 'scipy') if m in sys.modules])")
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
