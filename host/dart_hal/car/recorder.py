"""Recording of an open car: bytes both ways, commands, pulses, who it was."""

from __future__ import annotations

from pathlib import Path

from dart_hal.car.engine import Engine
from dart_hal.config import CarFiles
from dart_hal.recording.bus import RecordedBus
from dart_hal.recording.run import RunWriter

FILES = ("car.toml", "calibration.toml", "model.toml")


def keep_old(path: str | Path) -> Path | None:
    """Move a file that stands in the way of a new recording to run.1.mcap, run.2.mcap, ...

    Returns its new name, None when there was none.
    """
    path = Path(path)
    if not path.is_file():
        return None
    number = 1
    while (kept := path.with_suffix(f".{number}{path.suffix}")).exists():
        number += 1
    return path.rename(kept)


def start_recording(engine: Engine, files: CarFiles, path: str | Path) -> RunWriter:
    """Begin an MCAP file of this run; ``engine`` writes into it from now on."""
    texts = {name: (files.folder / name).read_text(encoding="utf-8")
             for name in FILES if (files.folder / name).is_file()}
    backend = engine.backend
    if backend.car_toml is not None:
        texts["car.toml"] = backend.car_toml
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    writer = RunWriter(path, url=backend.url.text, car=files.config.name, start=engine.now,
                       files=texts)
    engine.hooks.recorder = writer
    engine.recorder = writer
    engine.listeners.append(writer.state)
    if engine.poses is not None:
        engine.poses.record = writer.pose
    if isinstance(backend.bus, RecordedBus):
        backend.bus.recorder = writer
    return writer
