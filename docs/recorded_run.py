"""The recorded run that plays in the handbook, on the live page as static files.

    python docs/recorded_run.py          # drives the emulated car anew, writes docs/live/run.json

The build copies the page's own files and the run into ``live/`` beside the handbook's pages.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

from dart_hal import Car
from dart_lab.live import view

RUN = Path(__file__).parent / "live" / "run.json"
URL = "sim://?seed=3&nano=mock&lidar=1&map=track"
LAP = ("follow", "racetrack_vicon_2", "--speed", "1.3", "--tracker", "mpcc", "--poses",
       "lidar?start=2.25,0,0", "--waive", "CALIBRATION_MISSING", "--url", URL)
ROWS, SCANS, POINTS = 2, 5, 2
"""One in so many is kept: 50 rows and 2 scans of some 250 points a second, a lap in 300 kB."""


def thinned(run: dict[str, Any]) -> dict[str, Any]:
    """A run of ``run_of`` with fewer rows, scans and points, the same in form."""
    scans = [(n // ROWS, [v for k in range(0, len(points), 2 * POINTS) for v in points[k:k + 2]])
             for n, points in run["scans"][::SCANS]]
    rows = run["rows"][::ROWS]
    return {**run, "url": URL, "rows": rows, "scans": [(n, p) for n, p in scans if n < len(rows)]}


def copy(folder: Path) -> None:
    """The page with the run into ``folder``: ``index.html?run=run.json``."""
    room = Path(view.__file__).parent
    shutil.copytree(room / "page", folder, dirs_exist_ok=True)
    shutil.copytree(room / "vendor", folder / "vendor", dirs_exist_ok=True)
    shutil.copy(RUN, folder)


def connect(app: Any) -> None:
    """Into what Sphinx has built as HTML."""
    def built(app: Any, error: Exception | None) -> None:
        if error is None and app.builder.format == "html":
            copy(Path(app.outdir) / "live")

    app.connect("build-finished", built)


def main() -> None:
    """Drive a lap, write the run."""
    from dart_hal.cli.main import cli
    from dart_lab.live.view.player import run_of, save

    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "lap.mcap"
        cli.main([*LAP, "--record", str(record)], "dart-hal", standalone_mode=False)
        with Car.open(f"replay://{record}") as car:
            save(thinned(run_of(car)), RUN)


if __name__ == "__main__":
    main()
