"""Find, read and write the files of a car; the precedence of their values.

``car.toml`` is searched in this order: the folders given by the caller (``--cars``),
``$DART_CARS``, ``./cars``, ``~/.local/share/dart-hal/cars``.

Measurements (``calibration.toml``, ``model.toml``) are read and written in one folder:

1. the car's folder in a named folder (``--cars``, else ``$DART_CARS``);
2. without a named folder: the car's existing folder in ``./cars`` or the home folder;
3. else a new one in ``./cars`` if that exists, else in the home folder.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from dart_hal.core.config.calibration import Calibration, check_calibration, parse_calibration
from dart_hal.core.config.car import CarConfig, parse_config
from dart_hal.core.config.model import ModelFile, check_model, parse_model
from dart_hal.core.config.quantity import Quantity
from dart_hal.core.config.write import save
from dart_hal.core.errors import ConfigError
from dart_hal.core.text_file import read_text

EXAMPLE_CAR = "dart-01"
# The example car inside an installed package (absent in a checkout).
PACKAGED_EXAMPLE = Path(__file__).resolve().parents[2] / "cars" / EXAMPLE_CAR / "car.toml"
# The same in a checkout.
SOURCE_EXAMPLE = Path(__file__).resolve().parents[4] / "cars" / EXAMPLE_CAR / "car.toml"

# Number of default folders at the end of the search: ./cars and that of the home folder.
DEFAULT_FOLDERS = 2

Folders = Sequence[str | os.PathLike[str]]


@dataclass(frozen=True, slots=True)
class CarFiles:
    """The files of one car. ``folder``: where they are or will be written.

    ``board``: number of the connected Nano, 8 hexadecimal digits; None = the car is not open.
    The properties return the value of the calibration if it has one, else that of car.toml.
    """

    config: CarConfig
    calibration: Calibration | None
    model: ModelFile | None
    folder: Path
    origin: str
    board: str | None = None

    @property
    def oscillator_hz(self) -> Quantity | None:
        """Clock of the PCA9685 [Hz]; None = not measured (25 MHz +- 4 %)."""
        measured = self.calibration.pwm.oscillator_hz if self.calibration else None
        return measured or self.config.pwm.oscillator_hz

    @property
    def neutral_us(self) -> float:
        """Pulse at which the ESC neither drives nor brakes [us]."""
        measured = self.calibration.throttle.neutral_us if self.calibration else None
        return measured.value if measured else self.config.throttle.neutral_us

    @property
    def metres_per_edge(self) -> Quantity:
        """Travel per encoder edge [m]. Raises ConfigError for a car that states none."""
        measured = self.calibration.encoder.metres_per_edge if self.calibration else None
        found = measured or self.config.encoder.metres_per_edge
        if found is None:
            raise ConfigError(
                f"{self.origin}: encoder.metres_per_edge is missing", read=self.origin,
                found="a car that is known by recordings alone",
                expected="[encoder] metres_per_edge = { value = ..., std = ... }, in m",
                remedy="add it to car.toml: the car cannot drive without the scale of its encoder")
        return found

    @property
    def ring(self) -> tuple[float, ...] | None:
        """Interval lengths (N,) of one revolution, mean 1; None = all intervals are equal."""
        measured = self.calibration.encoder.ring if self.calibration else None
        return tuple(measured.value) if measured else None

    @property
    def imu_mount(self) -> tuple[float, float, float]:
        """Mounting angles (yaw, pitch, roll) of the IMU [rad]."""
        table = self.calibration.imu if self.calibration else None
        keys = ("mount_yaw", "mount_pitch", "mount_roll")
        measured = [getattr(table, key, None) for key in keys]
        described = [getattr(self.config.imu, key) for key in keys]
        yaw, pitch, roll = (m.value if m else d for m, d in zip(measured, described, strict=True))
        return yaw, pitch, roll


def car_folders(cars_dirs: Folders | None = None) -> list[Path]:
    """Return the folders that are searched for ``NAME/car.toml``, in order."""
    given = [Path(folder) for folder in cars_dirs or ()]
    named = [Path(p) for p in os.environ.get("DART_CARS", "").split(os.pathsep) if p]
    return [*given, *named, Path("cars"), _own_folder()]


def named_folders(cars_dirs: Folders | None = None) -> list[Path]:
    """Return the folders that the caller or $DART_CARS names."""
    return car_folders(cars_dirs)[:-DEFAULT_FOLDERS]


def cars_home(cars_dirs: Folders | None = None) -> Path:
    """Return the folder for the files of a new car: the first named one, else an existing one."""
    folders = car_folders(cars_dirs)
    named = named_folders(cars_dirs)
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
            config = read_config(folder / "car.toml")
            return _with_measurements(config, measured_folder(name, cars_dirs),
                                      str(folder / "car.toml"), name)
    # The example car of the package, or of its sources, is used if the user has no copy of it.
    home = measured_folder(name, cars_dirs)
    example = PACKAGED_EXAMPLE if PACKAGED_EXAMPLE.is_file() else SOURCE_EXAMPLE
    if name == EXAMPLE_CAR and example.is_file():
        return _with_measurements(read_config(example), home, str(example), name)
    searched = ", ".join(dict.fromkeys(str(folder.parent) for folder in folders))
    from difflib import get_close_matches

    close = get_close_matches(name, _list_existing_cars(cars_dirs), n=1)
    raise ConfigError(f"there is no car {name}", found=_describe_existing_cars(cars_dirs),
                      expected=f"{name}/car.toml in {searched}",
                      remedy=(f"--car {close[0]}; for a new car: " if close else "")
                      + f"mkdir -p {home} ; cp {example} {home} ; then edit its name and what "
                      "differs, or name another folder with --cars")


def parse_run_car(text: str, origin: str, measured: Mapping[str, str],
                  cars_dirs: Folders | None = None) -> CarFiles:
    """Return the car of a recorded run.

    measured: recorded texts of calibration.toml and model.toml. Files of that car below
    ``cars_dirs`` replace them, to read the run with the present calibration.
    Raises as ``load_car``.
    """
    config = parse_config(text, origin, recorded=True)
    for folder in cars_dirs or ():
        if (Path(folder) / config.name).is_dir():
            return _with_measurements(config, Path(folder) / config.name, origin, config.name)
    cal = measured.get("calibration.toml")
    model = measured.get("model.toml")
    return CarFiles(config,
                    parse_calibration(cal, f"calibration.toml in {origin}", config.name,
                                      recorded=True) if cal else None,
                    parse_model(model, f"model.toml in {origin}") if model else None,
                    measured_folder(config.name, cars_dirs), origin)


def parse_car(text: str, origin: str, cars_dirs: Folders | None = None) -> CarFiles:
    """Return the (simulated) car whose car.toml is ``text``; ``origin``: its name in messages.

    Its calibration and model are read from its folder, if it exists.
    Raises as ``load_car``.
    """
    config = parse_config(text, origin)
    return _with_measurements(config, measured_folder(config.name, cars_dirs), origin, config.name)


def read_config(path: Path) -> CarConfig:
    """Read a car.toml. Raises ConfigError."""
    return parse_config(_read(path), str(path))


def load_model(path: str | os.PathLike[str]) -> ModelFile:
    """Read a model.toml. Raises ConfigError."""
    return parse_model(_read(Path(path)), str(path))


def calibration_in(folder: Path, car: str, config: CarConfig | None = None) -> Calibration:
    """Read the calibration.toml of ``folder``; without one, return an empty calibration.

    config: as in ``save_calibration``. Raises ConfigError, OtherCar, NotMonotone.
    """
    path = folder / "calibration.toml"
    if not path.is_file():
        return Calibration(car=car)
    return parse_calibration(_read(path), str(path), car,
                             deliberate_us=_deliberate_neutral(folder, config))


def save_calibration(calibration: Calibration, folder: Path,
                     config: CarConfig | None = None) -> Path:
    """Check and write ``folder``/calibration.toml; the previous one is moved to history/.

    config: the car.toml that may mark an unusual neutral as deliberate; None = the one in
    ``folder``, if it exists.
    """
    path = folder / "calibration.toml"
    return save(check_calibration(calibration, str(path), folder.name,
                                  deliberate_us=_deliberate_neutral(folder, config)), path)


def bind_board(calibration: Calibration, files: CarFiles) -> Calibration:
    """Return ``calibration`` with the number of the connected Nano, if one is connected.

    Raises ConfigError for values of another Nano: one new value must not make all of them appear
    as measured with this one.
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
    """Bind the car's calibration.toml to the connected Nano; return (previous board, file).

    Raises ConfigError if there is no calibration or no Nano, and for an invalid calibration.
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
    """Return the neutral [us] that car.toml marks as deliberate."""
    described = folder / "car.toml"
    if config is None and described.is_file():
        config = parse_config(_read(described), str(described))
    return config.throttle.deliberate_neutral_us if config else None


def save_model(model: ModelFile, path: Path) -> Path:
    """Check and write a model.toml; the previous one is moved to history/ in its folder."""
    return save(check_model(model, str(path)), path)


def _with_measurements(config: CarConfig, folder: Path, origin: str, name: str) -> CarFiles:
    """Return the car with the calibration and the model of ``folder``."""
    if config.name != name:
        raise ConfigError(f"{origin}: key name is not the folder's name", found=config.name,
                          expected=name, remedy=f'write name = "{name}"', read=origin)
    cal_path = folder / "calibration.toml"
    model_path = folder / "model.toml"
    calibration = calibration_in(folder, name, config) if cal_path.is_file() else None
    if calibration is not None:
        _check_direction(config, calibration, str(cal_path), origin)
    model = load_model(model_path) if model_path.is_file() else None
    return CarFiles(config, calibration, model, folder, origin)


def _check_direction(config: CarConfig, calibration: Calibration, path: str, car: str) -> None:
    """Raise ConfigError if the measured map and car.toml have different steering directions."""
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


def _list_existing_cars(cars_dirs: Folders | None) -> list[str]:
    return sorted({p.parent.name for f in car_folders(cars_dirs) for p in f.glob("*/car.toml")})


def _describe_existing_cars(cars_dirs: Folders | None) -> str:
    names = _list_existing_cars(cars_dirs)
    return "cars " + ", ".join(names) if names else "no car files"


def _own_folder() -> Path:
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "dart-hal" / "cars"
