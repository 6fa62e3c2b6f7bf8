"""A calibration belongs to the Nano with which it was measured."""

from __future__ import annotations

import json

import pytest

from dart_hal.calibration.measured import Measured, write
from dart_hal.car import Car
from dart_hal.cli.main import main
from dart_hal.core.config import Calibration, Quantity, calibration_in, save_calibration
from dart_hal.core.errors import ConfigError, NotArmed
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from tests.common import MOCK_3_URL

pytestmark = pytest.mark.usefixtures("armed_esc")
MINE = "da270003"
OTHER_BOARD = "da270004"
WAIVED = ("PWM_CLOCK_UNCALIBRATED", "CALIBRATION_MISSING")


def make_measurement(name="throttle.neutral_us", value=1503.0):
    return Measured("sim-3", "test", "esc", {name: Quantity(value, 1.0)}, "", 0.0)


def write_calibration(tmp_path, board=None):
    """Folder of the cars, with a calibration of sim-3 that was measured with this board."""
    folder = tmp_path / "sim-3"
    folder.mkdir(exist_ok=True)
    known = Calibration(car="sim-3", board=board).with_quantities(
        {"throttle.neutral_us": Quantity(1502.0, 1.0)})
    save_calibration(known, folder)
    return tmp_path


def arm_and_list_cautions(cars, url=MOCK_3_URL):
    """Cautions of a car that arms."""
    with Car.open(url, cars=cars) as car:
        return {caution.name for caution in car.arm(waive=WAIVED)}


def test_every_write_records_the_board(tmp_path):
    cars = write_calibration(tmp_path)
    with Car.open(MOCK_3_URL, cars=cars) as car:
        assert car.files.board == MINE
        write(car.files, make_measurement())
    kept = calibration_in(cars / "sim-3", "sim-3")
    assert (kept.board, kept.throttle.neutral_us.value) == (MINE, 1503.0)
    text = (cars / "sim-3" / "calibration.toml").read_text()
    assert text.index("board") < text.index("[throttle]"), "a key of the top of the file"
    assert "CALIBRATION_UNBOUND" not in arm_and_list_cautions(cars)


def test_the_calibration_of_another_board_is_not_armed_with(tmp_path):
    with pytest.raises(NotArmed) as caught:
        arm_and_list_cautions(write_calibration(tmp_path, OTHER_BOARD))
    assert caught.value.reasons == ("CALIBRATION_OTHER_BOARD",)
    assert "calibrate accept-board" in caught.value.remedy


@pytest.mark.slow
def test_nor_is_it_written_into(tmp_path):
    """One new value would make all of them look measured with this board."""
    cars = write_calibration(tmp_path, OTHER_BOARD)
    with Car.open(MOCK_3_URL, cars=cars) as car, pytest.raises(ConfigError, match="another Nano"):
        write(car.files, make_measurement())
    assert calibration_in(cars / "sim-3", "sim-3").board == OTHER_BOARD
    with Car.open(MOCK_3_URL, cars=cars) as car, pytest.raises(NotArmed,
                                                               match="OTHER_BOARD"), car.raw():
        pass


@pytest.mark.slow
def test_a_swapped_nano_is_noticed(tmp_path):
    """The car's files stay, the Nano is another one."""
    cars = write_calibration(tmp_path, MINE)
    assert "CALIBRATION_UNBOUND" not in arm_and_list_cautions(cars)
    backend = open_backend(MOCK_3_URL)
    world_of(backend).nano.board_id = 0x12345678
    with Car.over(backend, cars=cars) as car:
        with pytest.raises(NotArmed, match="CALIBRATION_OTHER_BOARD"):
            car.arm(waive=WAIVED)
        assert "CALIBRATION_OTHER_BOARD" in car.refusals()


@pytest.mark.slow
def test_one_command_accepts_it(tmp_path, capsys):
    cars = write_calibration(tmp_path, OTHER_BOARD)
    with pytest.raises(SystemExit) as left:
        main(["calibrate", "accept-board", "--url", MOCK_3_URL, "--cars", str(cars), "--json"])
    assert not left.value.code
    result = json.loads(capsys.readouterr().out)
    assert (result["board"], result["before"]) == (MINE, OTHER_BOARD)
    assert arm_and_list_cautions(cars) >= set()
    assert len(list((cars / "sim-3" / "history").iterdir())) == 1


def test_without_a_calibration_there_is_nothing_to_accept(tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        main(["calibrate", "accept-board", "--url", MOCK_3_URL, "--cars", str(tmp_path)])
    assert left.value.code
    assert "no calibration to accept" in capsys.readouterr().err


def test_a_file_of_before_warns_and_arms(tmp_path):
    assert "CALIBRATION_UNBOUND" in arm_and_list_cautions(write_calibration(tmp_path))


def test_a_car_without_a_calibration_is_not_queried(tmp_path):
    assert "CALIBRATION_UNBOUND" not in arm_and_list_cautions(tmp_path)


@pytest.mark.parametrize("board", ["", "DA270003", "da27", "da2700034"])
def test_a_board_that_is_no_number_is_refused(tmp_path, board):
    with pytest.raises(ConfigError, match="board"):
        write_calibration(tmp_path, board)


@pytest.mark.emulator
@pytest.mark.parametrize("url", ["sim://?seed=3&nano=avr"])
def test_the_firmware_reports_its_number_too(tmp_path, url):
    with Car.open(url, cars=write_calibration(tmp_path)) as car:
        assert car.files.board == MINE
