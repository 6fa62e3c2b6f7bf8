"""Where the files of a car are found and written, and which value wins.

``car.toml`` is searched in this order: the folders given by the caller (``--cars``),
``$DART_CARS``, ``./cars``, ``~/.local/share/dart-hal/cars``.

What was measured (``calibration.toml``, ``model.toml``) is read and written in one folder: that
of the car in a named folder (``--cars``, else ``$DART_CARS``); where none is named, where the car
has one in ``./cars`` or the home folder, else in ``./cars`` if it exists, else in the home folder.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import msgspec

from dart_hal.core.config.calibration import Calibration, check_calibration, parse_calibration
from dart_hal.core.config.car import CarConfig, parse_config
from dart_hal.core.config.model import ModelFile, check_model, parse_model
from dart_hal.core.config.quantity import Quantity
from dart_hal.core.config.write import save
from dart_hal.core.errors import ConfigError
from dart_hal.core.text_file import read_text

EXAMPLE = "dart-01"
PACKAGED = Path(__file__).resolve().parents[2] / "cars" / EXAMPLE / "car.toml"
"""The example car inside an installed package (absent in a checkout)."""

UNNAMED = 2
"""Folders at the end of the search that nobody named: ./cars and that of the home folder."""

Folders = Sequence[str | os.PathLike[str]]


@dataclass(frozen=True, slots=True)
class CarFiles:
    """The files of one car. ``folder``: where they are, or would be written.

    ``board``: number of the Nano that answers, 8 hex digits; None = the car is not open.
    The properties say which value counts: the calibration's, else car.toml's.
    """

    config: CarConfig
    calibration: Calibration | None
    model: ModelFile | None
    folder: Path
    origin: str
    board: str | None = None

    @property
    def oscillator_hz(self) -> Quantity | None:
        """Clock of the PCA9685 [Hz]; None = never measured (25 MHz +- 4 %)."""
        measured = self.calibration.pwm.oscillator_hz if self.calibration else None
        return measured or self.config.pwm.oscillator_hz

    @property
    def neutral_us(self) -> float:
        """Pulse at which the ESC neither drives nor brakes [us]."""
        measured = self.calibration.throttle.neutral_us if self.calibration else None
        return measured.value if measured else self.config.throttle.neutral_us

    @property
    def metres_per_edge(self) -> Quantity:
        """Travel per encoder edge [m]."""
        measured = self.calibration.encoder.metres_per_edge if self.calibration else None
        return measured or self.config.encoder.metres_per_edge

    @property
    def ring(self) -> tuple[float, ...] | None:
        """Interval lengths of one revolution, mean 1; None = taken as even."""
        measured = self.calibration.encoder.ring if self.calibration else None
        return tuple(measured.value) if measured else None

    @property
    def imu_mount(self) -> tuple[float, float, float]:
        """Mounting angles (yaw, pitch, roll) of the IMU [rad]."""
        named, table = self.config.imu, self.calibration.imu if self.calibration else None
        found = [getattr(table, key, None) for key in ("mount_yaw", "mount_pitch", "mount_roll")]
        given = (named.mount_yaw, named.mount_pitch, named.mount_roll)
        yaw, pitch, roll = (m.value if m else g for m, g in zip(found, given, strict=True))
        return yaw, pitch, roll


def car_folders(cars_dirs: Folders | None = None) -> list[Path]:
    """The folders that are searched for ``NAME/car.toml``, in order."""
    given = [Path(folder) for folder in cars_dirs or ()]
    named = [Path(p) for p in os.environ.get("DART_CARS", "").split(os.pathsep) if p]
    return [*given, *named, Path("cars"), _own_folder()]


def named_folders(cars_dirs: Folders | None = None) -> list[Path]:
    """Those that the caller or $DART_CARS names."""
    return car_folders(cars_dirs)[:-UNNAMED]


def cars_home(cars_dirs: Folders | None = None) -> Path:
    """Where the files of a new car go: the first folder that was named, or exists."""
    folders, named = car_folders(cars_dirs), named_folders(cars_dirs)
    return named[0] if named else next((f for f in folders if f.is_dir()), folders[-1])


def measured_folder(name: str, cars_dirs: Folders | None = None) -> Path:
    """Return the folder in which the measurements of a car are read and written.

    1. Folders named by the caller count; without any, those of ``$DART_CARS``; without any,
       ``./cars`` and the home folder.
    2. Of these, the first that has a folder of the car; else the one for new cars.
    """
    caller = [Path(folder) for folder in cars_dirs or ()]
    candidates = caller or named_folders() or car_folders()
    existing = next((f / name for f in candidates if (f / name).is_dir()), None)
    return existing or (caller[0] if caller else cars_home()) / name


def load_car(name: str, cars_dirs: Folders | None = None) -> CarFiles:
    """Read the files of the car ``name``. Raises ConfigError, OtherCar, NotMonotone."""
    folders = [folder / name for folder in car_folders(cars_dirs)]
    for folder in folders:
        if (folder / "car.toml").is_file():
            config = parse_config(_read(folder / "car.toml"), str(folder / "car.toml"))
            return _with_measurements(config, measured_folder(name, cars_dirs),
                                      str(folder / "car.toml"), name)
    home = measured_folder(name, cars_dirs)
    if name == EXAMPLE and PACKAGED.is_file():
        return _with_measurements(parse_config(_read(PACKAGED), str(PACKAGED)), home,
                                  str(PACKAGED), name)
    searched = ", ".join(str(folder.parent) for folder in folders)
    close = get_close_matches(name, _existing_cars(cars_dirs), n=1)
    example = PACKAGED if PACKAGED.is_file() else Path("cars") / EXAMPLE / "car.toml"
    raise ConfigError(f"there is no car {name}", found=_existing(cars_dirs),
                      expected=f"{name}/car.toml in {searched}",
                      remedy=(f"--car {close[0]}; for a new car: " if close else "")
                      + f"mkdir -p {home} ; cp {example} {home} ; then edit its name and what "
                      "differs, or name another folder with --cars")


def parse_run_car(text: str, origin: str, measured: Mapping[str, str],
                  cars_dirs: Folders | None = None) -> CarFiles:
    """The car of a recorded run: its texts ``measured`` (calibration.toml, model.toml) count.

    Files of that car below ``cars_dirs`` replace them: the run, read by what is known today.
    Raises as ``load_car``, also for each of the texts alone.
    """
    config = parse_config(text, origin, recorded=True)
    for folder in cars_dirs or ():
        if (Path(folder) / config.name).is_dir():
            return _with_measurements(config, Path(folder) / config.name, origin, config.name)
    name, cal, model = config.name, measured.get("calibration.toml"), measured.get("model.toml")
    return CarFiles(config,
                    parse_calibration(cal, f"calibration.toml in {origin}", name, recorded=True)
                    if cal else None,
                    parse_model(model, f"model.toml in {origin}") if model else None,
                    measured_folder(name, cars_dirs), origin)


def parse_car(text: str, origin: str, cars_dirs: Folders | None = None) -> CarFiles:
    """A car whose car.toml comes as ``text`` (a simulated one); ``origin`` names it.

    Its calibration and model are read from its folder, if there is one.
    Raises as ``load_car``.
    """
    config = parse_config(text, origin)
    return _with_measurements(config, measured_folder(config.name, cars_dirs), origin, config.name)


def load_model(path: str | os.PathLike[str]) -> ModelFile:
    """Read a model.toml. Raises ConfigError."""
    return parse_model(_read(Path(path)), str(path))


def calibration_in(folder: Path, car: str, config: CarConfig | None = None) -> Calibration:
    """Read what ``folder`` holds of a car's measurements, to be written again with one more.

    config: as in ``save_calibration``. Raises ConfigError, OtherCar, NotMonotone.
    """
    path = folder / "calibration.toml"
    if not path.is_file():
        return Calibration(car=car)
    return parse_calibration(_read(path), str(path), car,
                             deliberate_us=_deliberate_neutral(folder, config))


def save_calibration(calibration: Calibration, folder: Path,
                     config: CarConfig | None = None) -> Path:
    """Check and write ``folder``/calibration.toml; the old one goes to history/.

    config: the car.toml that may mark an unusual neutral as deliberate; None = the one in
    ``folder``, where there is one.
    """
    path = folder / "calibration.toml"
    return save(check_calibration(calibration, str(path), folder.name,
                                  deliberate_us=_deliberate_neutral(folder, config)), path)


def bind_board(calibration: Calibration, files: CarFiles) -> Calibration:
    """Record with which Nano ``calibration`` is measured, where one answers.

    Raises ConfigError for values of another Nano: with one new value among them they would all
    count as measured with this one.
    """
    if files.board is None:
        return calibration
    if calibration.board not in (None, files.board):
        path = files.folder / "calibration.toml"
        raise ConfigError(f"{path} was measured with another Nano", read=str(path),
                          found=f"board {calibration.board}",
                          expected=f"board {files.board}, which answers now",
                          likely="the Nano was exchanged, or the files are those of another car",
                          remedy="same car, new Nano: dart-hal calibrate accept-board; else move "
                                 "the file away and measure again")
    return msgspec.structs.replace(calibration, board=files.board)


def accept_board(files: CarFiles) -> tuple[str | None, Path]:
    """Bind the car's calibration.toml to the Nano that answers; (board before, file written).

    Raises ConfigError where there is no calibration, or it is no good.
    """
    path = files.folder / "calibration.toml"
    if not path.is_file() or files.board is None:
        raise ConfigError(f"{files.config.name} has no calibration to accept", read=str(path),
                          found="no calibration.toml" if files.board else "no Nano",
                          expected=str(path), remedy="dart-hal calibrate all")
    known = calibration_in(files.folder, files.config.name, files.config)
    bound = msgspec.structs.replace(known, board=files.board)
    return known.board, save_calibration(bound, files.folder, files.config)


def _deliberate_neutral(folder: Path, config: CarConfig | None) -> float | None:
    """Neutral [us] that the car's description marks as deliberate."""
    described = folder / "car.toml"
    if config is None and described.is_file():
        config = parse_config(_read(described), str(described))
    return config.throttle.deliberate_neutral_us if config else None


def save_model(model: ModelFile, path: Path) -> Path:
    """Check and write a model.toml; an older one goes to history/ beside it."""
    return save(check_model(model, str(path)), path)


def _with_measurements(config: CarConfig, folder: Path, origin: str, name: str) -> CarFiles:
    if config.name != name:
        raise ConfigError(f"{origin}: key name is not the folder's name", found=config.name,
                          expected=name, remedy=f'write name = "{name}"', read=origin)
    cal_path, model_path = folder / "calibration.toml", folder / "model.toml"
    calibration = calibration_in(folder, name, config) if cal_path.is_file() else None
    if calibration is not None:
        _check_direction(config, calibration, str(cal_path), origin)
    model = load_model(model_path) if model_path.is_file() else None
    return CarFiles(config, calibration, model, folder, origin)


def _check_direction(config: CarConfig, calibration: Calibration, path: str, car: str) -> None:
    table = calibration.steering.map
    if table is None:
        return
    rising = 1 if table.angle_rad[-1] > table.angle_rad[0] else -1
    if rising != config.steering.direction:
        raise ConfigError(f"{path}: steering.map steers the other way than {car}",
                          found=f"angle {'rises' if rising > 0 else 'falls'} with the pulse",
                          expected=f"direction = {config.steering.direction}", read=path,
                          remedy="correct [steering] direction, or dart-hal calibrate steering")


def _read(path: Path) -> str:
    try:
        return read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} cannot be read: {error}", read=str(path),
                          remedy="check the path, its permissions and its encoding (UTF-8)"
                          ) from error


def _existing_cars(cars_dirs: Folders | None) -> list[str]:
    return sorted({p.parent.name for f in car_folders(cars_dirs) for p in f.glob("*/car.toml")})


def _existing(cars_dirs: Folders | None) -> str:
    names = _existing_cars(cars_dirs)
    return "cars " + ", ".join(names) if names else "no car files"


def _own_folder() -> Path:
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "dart-hal" / "cars"
