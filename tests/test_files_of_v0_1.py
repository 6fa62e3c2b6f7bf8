"""Files of version 0.1 keep working: car, calibration, model, EEPROM, URL options."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from dart_hal.core.config import load_car
from dart_hal.core.config.calibration import QUANTITIES, parse_calibration
from dart_hal.core.config.model import parse_model
from dart_hal.core.errors import EmulatorMissing, PortMissing, RecordingError, UsageError
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle.file import vehicle_from
from dart_hal.wire.messages import PARAM_BY_NAME
from dart_lab.sim.eeprom import parse_eeprom
from dart_lab.sim.mock_nano import MockNano

FILES = Path(__file__).parent / "fixtures_v0_1"
URLS = (FILES / "urls.txt").read_text().split()
BOARD = 0xDA270003
SAFETY_OUT = 1
"""What the firmware had stored in eeprom.bin, with ``cutoff=oe``."""


@pytest.fixture
def cars(tmp_path):
    """A folder of cars that holds the three files of one car."""
    folder = tmp_path / "dart-01"
    folder.mkdir()
    for name in ("car.toml", "calibration.toml", "model.toml"):
        shutil.copy(FILES / name, folder)
    return tmp_path


def test_the_files_of_a_car_are_used_together(cars):
    files = load_car("dart-01", [cars])
    assert (files.config.geometry.wheelbase, files.config.steering.center_us) == (0.175, 1560)
    assert files.calibration.steering.map.pulse_us[0] == 1125.0
    assert files.metres_per_edge.value == 0.00206, "measured wins over drawn"


def test_every_quantity_of_a_calibration_is_read():
    text = (FILES / "calibration.toml").read_text()
    calibration = parse_calibration(text, "calibration.toml", "dart-01")
    later = {"throttle.reverse_rest", "throttle.signal_loss", "throttle.brake",
             "mocap.marker_x", "mocap.marker_y",
             "mocap.marker_yaw", "mocap.latency", "latency.pulse_to_wheel_lag",
             "latency.pulse_to_yaw", "latency.pulse_to_yaw_lag", "steering.slew_us_s",
             "lidar.mount_x", "lidar.mount_y", "lidar.mount_yaw", "lidar.scale"}
    assert set(calibration.quantities()) == set(QUANTITIES) - later
    assert calibration.quantities()["pwm.oscillator_hz"].value == 25_310_000.0
    assert calibration.steering.map.pulse_us[0] == 1125.0
    assert calibration.steering.paper_form.k_left == 1.528722
    assert calibration.provenance["steering"]["n"] == 1805


def test_a_model_is_the_same_vehicle():
    model = parse_model((FILES / "model.toml").read_text(), "model.toml")
    vehicle = vehicle_from(model)
    assert vehicle.friction.a == 1.6750002759688924
    assert vehicle.tyres.rear_cornering_stiffness == 22.30058642311185
    assert {a.name: a.values for a in vehicle.effects} == {
        "steering_lag": (0.06,), "quadratic_drag": (0.2,), "gyro_scale": (0.03,),
        "encoder_ring": (0.1, 0.0, 0.2)}
    assert sorted(model.covariance) == ["delay", "friction", "motor", "steering"]


def test_a_board_keeps_its_name_and_parameters():
    image = (FILES / "eeprom.bin").read_bytes()
    board, params = parse_eeprom(image)
    assert (board, params[PARAM_BY_NAME["safety_out"].id]) == (BOARD, SAFETY_OUT)
    nano = MockNano(eeprom=image)
    assert (nano.board_id, nano.params) == (board, params)


@pytest.mark.emulator
def test_the_firmware_starts_from_that_eeprom():
    from dart_hal.devices.links import bridge
    from dart_hal.devices.links.emulator import EmulatedNano
    from dart_hal.wire.decoder import FrameDecoder
    from dart_hal.wire.messages import HELLO

    try:
        bridge.load()
    except EmulatorMissing as why:
        pytest.skip(f"no emulator: {why.what}")
    image = (FILES / "eeprom.bin").read_bytes()
    nano = EmulatedNano(eeprom=image)
    while nano.run(2.0):
        pass
    frames = FrameDecoder().feed(b"".join(data for data, _ in nano.read()))
    hello = next(f.as_dict() for f in frames if f.message is HELLO)
    assert hello["board_id"] == BOARD
    assert parse_eeprom(nano.eeprom)[1] == parse_eeprom(image)[1]
    nano.close()


@pytest.mark.slow_except("*cutoff*", "*vehicle*", "*enc*", "sim:///")
@pytest.mark.parametrize("url", [u for u in URLS if u.startswith("sim") and "avr" not in u])
def test_every_simulated_car_opens(url):
    open_backend(url).link.close()


@pytest.mark.emulator
@pytest.mark.parametrize("url", [u for u in URLS if "avr" in u])
def test_every_emulated_nano_opens(url):
    try:
        open_backend(url).link.close()
    except EmulatorMissing as why:
        pytest.skip(f"no emulator: {why.what}")


@pytest.mark.parametrize("url", [u for u in URLS if u.startswith(("serial", "hwgrep", "replay"))])
def test_other_urls_fail_for_what_is_not_there(url, tmp_path, monkeypatch):
    """The options are understood; port and file are not on this machine."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("dart_hal.devices.links.serial_port.check_bus", lambda bus: None)
    with pytest.raises((PortMissing, RecordingError)):
        open_backend(url)


def test_an_option_that_there_never_was_is_refused():
    """Negative control."""
    for url in {u.partition("?")[0] for u in URLS}:
        with pytest.raises(UsageError, match="no option"):
            open_backend(f"{url}?colour=red")
