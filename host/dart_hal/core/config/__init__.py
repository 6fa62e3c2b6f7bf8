"""The files of a car: ``car.toml``, ``calibration.toml``, ``model.toml``.

No number of a particular car is in the code. Each file is read into a frozen struct. An error
names the file, the key and the remedy.
"""

from dart_hal.core.config.calibration import (
    QUANTITIES,
    Calibration,
    DriveTable,
    PaperForm,
    SteeringTable,
    check_calibration,
    parse_calibration,
)
from dart_hal.core.config.car import CarConfig, parse_config
from dart_hal.core.config.folders import (
    CarFiles,
    accept_board,
    bind_board,
    calibration_in,
    car_folders,
    cars_home,
    load_car,
    load_model,
    measured_folder,
    named_folders,
    parse_car,
    save_calibration,
    save_model,
)
from dart_hal.core.config.model import EffectEntry, ModelFile, parse_model, plain
from dart_hal.core.config.quantity import Quantities, Quantity
from dart_hal.core.config.write import check_writable, dump, save

__all__ = [
    "QUANTITIES", "Calibration", "CarConfig", "CarFiles", "DriveTable", "EffectEntry", "ModelFile",
    "PaperForm", "Quantities", "Quantity", "SteeringTable", "accept_board", "bind_board",
    "calibration_in", "car_folders",
    "cars_home", "check_calibration", "check_writable", "dump", "load_car", "load_model",
    "measured_folder", "named_folders", "parse_calibration", "parse_car", "parse_config",
    "parse_model", "plain", "save", "save_calibration", "save_model",
]
