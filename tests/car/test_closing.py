"""Closing is complete under any failure: neutral first, then everything else."""

from __future__ import annotations

import logging

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import BusError, LinkLost, NoHello, PcaMissing
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.recording.run import RunReader
from tests.car.pin_witness import no_pulse
from tests.common import MOCK_URL

pytestmark = pytest.mark.usefixtures("armed_esc")
FULL_OFF = 0x1000
"""OFF_H bit 4 of a channel: no pulse."""


def throttle_counts(bus) -> int:
    pair = bytearray(2)
    bus.writeto_then_readfrom(0x40, b"\x0c", pair)
    return pair[0] | (pair[1] & 0x1F) << 8


def driving(tmp_path, record=None):
    backend = open_backend(MOCK_URL)
    closed = []
    bus = backend.bus
    backend.closers = (lambda: closed.append("bus"),)
    car = Car.over(backend, cars=tmp_path, record=record)
    backend.bus = bus  # a recording notes the bus, and ends with the car
    car.arm()
    for _ in car.states(duration=0.2):
        car.drive(throttle=0.3, valid_for=0.5)
    assert throttle_counts(backend.bus) > 320
    return backend, car, closed


def test_close_ends_at_no_pulse_and_lets_go(tmp_path):
    backend, car, closed = driving(tmp_path)
    car.close()
    car.close()
    assert no_pulse(backend.bus)
    assert closed == ["bus"]
    assert car.mode == "CLOSED"


class FailingLog(logging.Handler):
    """Fails at the warning that the car was never armed."""

    def emit(self, record):
        if "car.arm()" in record.getMessage():
            raise OSError("disk full")


def test_a_log_that_fails_at_the_end_leaves_no_pulse_and_no_port():
    handler = FailingLog()
    logger = logging.getLogger("dart_hal")
    logger.addHandler(handler)
    try:
        backend = open_backend(MOCK_URL)
        car = Car.over(backend)
        for _ in car.states(duration=0.1):
            car.drive(throttle=0.2)
        with pytest.raises(OSError, match="disk full"):
            car.close()
    finally:
        logger.removeHandler(handler)
    assert no_pulse(backend.bus)
    assert car.mode == "CLOSED"


def test_the_end_of_the_pulses_is_recorded(tmp_path):
    _, car, _ = driving(tmp_path, tmp_path / "run.mcap")
    closed = car.now
    car.close()
    *_, before, last = RunReader(tmp_path / "run.mcap").applied()
    assert before.applied.throttle == pytest.approx(0.3, abs=0.03)
    assert last.applied.throttle == 0.0
    assert last.t == pytest.approx(closed)
    assert (last.applied.throttle_us, "PULSES_OFF" in last.applied.limited) == (0.0, True)


def test_a_second_ctrl_c_while_closing_skips_nothing(tmp_path):
    backend, car, closed = driving(tmp_path, tmp_path / "run.mcap")

    def interrupt(seconds):
        raise KeyboardInterrupt

    car._engine.driver.actuator._sleep = interrupt        # between the two neutral frames
    with pytest.raises(KeyboardInterrupt):
        car.close()
    assert no_pulse(backend.bus)
    assert closed == ["bus"]
    with Car.open(f"replay://{tmp_path / 'run.mcap'}") as again:
        assert not again.notices, "the recording has its end"


def test_a_bus_that_fails_while_closing_does_not_keep_the_port(tmp_path):
    backend, car, closed = driving(tmp_path)
    backend.bus.nack = 10**9
    car.close()
    assert closed == ["bus"]
    with pytest.raises(LinkLost):
        backend.link.read(0.0)


def test_an_error_in_the_block_passes_through_without_a_pulse(tmp_path):
    backend, car, _ = driving(tmp_path)

    def mistaken():
        with car:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        mistaken()
    assert no_pulse(backend.bus)


def test_no_pca9685_is_reported_and_closes(tmp_path):
    backend = open_backend(MOCK_URL)
    closed = []
    backend.closers = (lambda: closed.append("bus"),)
    backend.bus.nack = 10**9
    with pytest.raises(BusError) as caught:
        Car.over(backend, cars=tmp_path)
    assert isinstance(caught.value, PcaMissing) or caught.value.remedy
    assert closed == ["bus"]


def test_a_silent_nano_leaves_no_pulse(tmp_path):
    backend = open_backend(MOCK_URL)
    closed = []
    backend.closers = (lambda: closed.append("bus"),)
    read = backend.link.read
    backend.link.read = lambda timeout: read(timeout) and None
    with pytest.raises(NoHello):
        Car.over(backend, cars=tmp_path)
    assert closed == ["bus"]
    assert no_pulse(backend.bus)


def test_ctrl_c_while_opening_closes(tmp_path):
    backend = open_backend(MOCK_URL)
    closed = []
    backend.closers = (lambda: closed.append("bus"),)

    def interrupt(timeout):
        raise KeyboardInterrupt

    backend.link.read = interrupt
    with pytest.raises(KeyboardInterrupt):
        Car.over(backend, cars=tmp_path)
    assert closed == ["bus"]


def test_a_backend_closes_all_of_it_also_when_one_part_raises():
    closed = []

    class Link:
        def close(self):
            raise OSError("link")

    backend = Backend(Url.parse(MOCK_URL), Link(), None, None, False,
                      closers=(lambda: closed.append(1), lambda: closed.append(2)))
    with pytest.raises(OSError, match="link"):
        backend.close()
    assert closed == [1, 2]


@pytest.mark.slow
def test_leaving_by_an_exit_leaves_no_pulse(tmp_path):
    """atexit: a program that forgets to close its car."""
    import subprocess
    import sys

    code = ("from dart_hal.car import Car\nfrom dart_hal.devices.links.base import open_backend\n"
            "import atexit\n"
            f"b = open_backend({MOCK_URL!r}); pair = bytearray(2)\n"
            "atexit.register(lambda: (b.bus.writeto_then_readfrom(0x40, b'\\x0c', pair),"
            " print(pair[0] | pair[1] << 8)))\n"
            f"car = Car.over(b, cars={str(tmp_path)!r})\ncar.arm()\n"
            "for _ in car.states(duration=0.2): car.drive(throttle=0.3, valid_for=0.5)\n")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout) & FULL_OFF
