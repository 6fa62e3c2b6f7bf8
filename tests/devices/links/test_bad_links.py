"""What a port, a URL or a line can be instead of a Nano: each a clear error."""

from __future__ import annotations

import errno
import os
import random
import threading
import tty
from types import SimpleNamespace

import pytest
import serial

from dart_hal.car import Car, handshake
from dart_hal.core.errors import (
    BusError,
    DartHalError,
    EmulatorMissing,
    LinkLost,
    NoHello,
    PortBusy,
    PortDenied,
    PortMissing,
    UnknownScheme,
    UsageError,
)
from dart_hal.core.url import Url
from dart_hal.devices.links import serial_port
from dart_hal.devices.links.base import open_backend
from dart_hal.devices.links.serial_port import SerialLink, find_port, open_serial
from dart_hal.wire.codec import encode
from dart_hal.wire.messages import HELLO, TIME_PONG
from tests.wire.wire_samples import random_values


class FakeNano:
    """The other end of a pty: sends ``greet(self)`` again and again."""

    def __init__(self, greet=lambda nano: b"") -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.path, self._slave = os.ttyname(slave), slave
        self.heard = b""
        self._done = threading.Event()
        self._greet = greet
        os.set_blocking(self.master, False)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._done.wait(0.005):
            try:
                self.heard += os.read(self.master, 4096)
            except BlockingIOError:
                pass
            except OSError:
                return
            words = self._greet(self)
            if words:
                try:
                    os.write(self.master, words)
                except BlockingIOError:
                    continue

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        for fd in (self.master, self._slave):
            if fd >= 0:
                os.close(fd)
        self.master = self._slave = -1


@pytest.fixture
def fake():
    made = []

    def make(*args):
        made.append(FakeNano(*args))
        return made[-1]

    yield make
    for nano in made:
        nano.close()


@pytest.fixture
def hurried(monkeypatch):
    monkeypatch.setattr(handshake, "BOOT_SILENCE", 0.1)
    monkeypatch.setattr(handshake, "REQUEST_TIME", 0.3)


def clear(error: DartHalError) -> DartHalError:
    """Every refusal has a code, a sentence, and something to type."""
    assert error.code.startswith("D-")
    assert error.code != "D-000"
    assert error.what
    assert error.remedy
    assert error.found or error.expected
    return error


@pytest.mark.slow
def test_a_silent_port_names_the_rates_that_were_tried(fake, hurried):
    with pytest.raises(NoHello) as caught:
        Car.open(f"serial://{fake().path}")
    error = clear(caught.value)
    assert "500000 baud" in error.found
    assert "115200 baud" in error.found
    assert error.found.count("not one byte") == 2


@pytest.mark.slow
def test_a_port_with_foreign_bytes_is_reported_with_their_number(fake, hurried):
    noisy = fake(lambda nano: b"\xa5\x00garbage\x13")
    with pytest.raises(NoHello) as caught:
        Car.open(f"serial://{noisy.path}")
    assert clear(caught.value).found.count("bytes that are no frame of ours") == 2


@pytest.mark.slow
def test_frames_without_a_hello_are_no_answer(fake, hurried):
    pong = encode(TIME_PONG, 0, random_values(TIME_PONG, random.Random(1)))
    with pytest.raises(NoHello):
        Car.open(f"serial://{fake(lambda nano: pong).path}")


@pytest.mark.slow
def test_it_falls_back_to_the_rate_at_which_hello_comes(fake, hurried):
    """The far end answers requests only once the port runs at 115200."""
    hello = encode(HELLO, 7, random_values(HELLO, random.Random(1)))

    def answer(nano):
        import termios
        speed = termios.tcgetattr(nano._slave)[5]
        received, nano.heard = nano.heard, b""
        if speed != termios.B115200:
            return b"\xff\xfe\xfd"
        return hello if received.endswith(b"\0") else b""

    nano = fake(answer)
    with Car.open(f"serial://{nano.path}") as car:
        assert car._engine.backend.link.baud == 115_200
        assert car.timing.damaged == 0, "noise of the first rate does not count"
        assert car._engine.telemetry.clock.byte_time == pytest.approx(10 / 115_200)
        assert "commands are not sent" in car.notices[0]


@pytest.mark.slow
@pytest.mark.emulator
def test_a_nano_whose_parameter_is_115200_is_found(hurried):
    from dart_hal.devices.links.emulator import EmulatedNano
    from dart_hal.devices.links.image import find_image
    from dart_hal.devices.links.pty import Pty
    from dart_lab.sim.eeprom import make_eeprom

    try:
        nano = EmulatedNano(find_image(), eeprom=make_eeprom(0x1234, {"baud": 115_200}))
    except EmulatorMissing as error:
        pytest.skip(f"emulator: {error.what}")
    with nano, Pty(nano) as pty, Car.open(f"serial://{pty.path}") as car:
        assert car._engine.backend.link.baud == 115_200
        assert car.hello.board_id == 0x1234
        states = list(car.states(duration=0.5, timeout=20.0))
        assert car.timing.lost == 0
        assert states[-1].seq > states[0].seq + 20


def test_no_port(tmp_path):
    with pytest.raises(PortMissing) as caught:
        Car.open(f"serial://{tmp_path}/ttyUSB9")
    assert "No such file" in clear(caught.value).found
    with pytest.raises(PortMissing, match="no serial port matches") as caught:
        find_port("FFFF:EEEE")
    assert "1A86:7523" in clear(caught.value).expected
    with pytest.raises(PortMissing, match="names no port"):
        Car.open("serial://")


def test_what_is_no_terminal_is_no_port():
    with pytest.raises(PortMissing):
        Car.open("serial:///dev/null")


def test_a_port_without_permission_gives_the_command_to_type(monkeypatch, fake):
    def deny_access(*args, **options):
        raise PermissionError(errno.EACCES, "Permission denied")

    path = fake().path
    monkeypatch.setattr(serial.serialposix, "os", SimpleNamespace(
        open=deny_access, O_RDWR=0, O_NOCTTY=0, O_NONBLOCK=0))
    with pytest.raises(PortDenied) as caught:
        SerialLink(path)
    assert "dialout" in clear(caught.value).remedy


def test_a_busy_port_names_who_has_it(fake):
    path = fake().path
    first = SerialLink(path)
    with pytest.raises(PortBusy) as caught:
        SerialLink(path)
    clear(caught.value)
    first.close()
    SerialLink(path).close()


def test_a_port_that_vanishes_is_a_lost_link(fake):
    nano = fake()
    link = SerialLink(nano.path)
    nano.close()
    with pytest.raises(LinkLost, match=r"vanished") as caught:
        link.read(5.0)
    assert nano.path in clear(caught.value).what
    with pytest.raises(LinkLost):
        link.write(b"x")
    link.close()
    link.close()
    for use_closed_port in (lambda: link.read(0.0), lambda: link.write(b"x")):
        with pytest.raises(LinkLost) as caught:
            use_closed_port()
        assert "port that is not open" in str(caught.value.found)


def test_a_port_that_takes_nothing_does_not_hold_up_the_pulses(fake):
    nano = fake()
    nano._done.set()                                        # without a reader from here on
    nano._thread.join()
    link = SerialLink(nano.path)
    for _ in range(300):
        link.write(bytes(1024))
        if link.dropped:
            break
    assert link.dropped > 0
    assert serial_port.WRITE_TIMEOUT <= 0.02
    link.close()


@pytest.mark.parametrize(("text", "error"), [
    ("", UnknownScheme), ("ttyUSB0", UnknownScheme), ("can://can0", UnknownScheme),
    ("http://[half", UnknownScheme), ("sim:", UnknownScheme), ("://x", UnknownScheme),
    ("sim://?sead=1", UsageError), ("sim://?seed=x", UsageError), ("sim://?seed=-1", UsageError),
    ("sim://?nano=8051", UsageError), ("sim://?jitter=lots", UsageError),
    ("sim://?ber=many", UsageError), ("sim://?cutoff=axe", UsageError),
    ("sim://?model=quantum", UsageError), ("sim://road", UsageError),
    ("serial:///dev/null?bauds=1", UsageError), ("serial:///dev/null?baud=fast", UsageError),
    ("serial:///dev/null?baud=0", UsageError), ("avr://default?wheel=x", UsageError),
    ("avr://default?edges=7", UsageError), ("avr:///no/such.elf", DartHalError),
    ("replay://", DartHalError), ("replay:///no/such.mcap", DartHalError),
    ("replay://x?speed=2", UsageError),
])
def test_a_url_that_means_nothing(text, error):
    with pytest.raises(error) as caught:
        open_backend(text)
    clear(caught.value)


def test_an_unknown_scheme_lists_those_that_exist():
    with pytest.raises(UnknownScheme) as caught:
        open_backend("can://can0")
    assert {"sim://", "serial://", "replay://"} <= set(caught.value.expected.split(", "))


@pytest.mark.parametrize(("spec", "error"), [
    ("i2c=77", BusError), ("i2c=unix:/no/such.sock", BusError), ("i2c=one", UsageError),
    ("i2c=", UsageError),
])
def test_a_bus_that_is_not_there_lets_go_of_the_port(fake, spec, error):
    nano = fake()
    with pytest.raises(error) as caught:
        open_serial(Url.parse(f"serial://{nano.path}?{spec}"))
    clear(caught.value)
    SerialLink(nano.path).close()


@pytest.mark.slow
def test_a_failed_open_closes_what_was_open(fake, hurried):
    nano = fake()
    before = len(os.listdir("/proc/self/fd"))
    with pytest.raises(NoHello):
        Car.open(f"serial://{nano.path}")
    assert len(os.listdir("/proc/self/fd")) == before
    SerialLink(nano.path).close()
