"""What ``doctor`` and ``find`` report of a lidar, and verbs of one that --lidar names."""

from __future__ import annotations

import os
import threading
import tty
from contextlib import suppress
from types import SimpleNamespace

import pytest

from dart_hal.devices.lidar import port
from dart_hal.devices.links import attached
from tests.common import KINEMATIC_1_URL

pytestmark = pytest.mark.usefixtures("armed_esc")


def find_check(ran):
    return next((c for c in ran.json["checks"] if c["id"] == "lidar"), None)


@pytest.mark.slow
def test_the_doctor_looks_at_it(verb):
    good = find_check(verb("doctor", "--url", f"{KINEMATIC_1_URL}&lidar=1", "--seconds", 2,
                           "--json"))
    assert good["verdict"] == "ok"
    assert "revolutions, 7." in good["found"]
    blind = find_check(verb("doctor", "--url", f"{KINEMATIC_1_URL}&lidar=gap=0.8", "--seconds", 2,
                            "--json"))
    assert blind["verdict"] == "warn"
    assert "nothing comes back from" in blind["found"]
    assert "lidar.md" in blind["try"]


def test_a_car_without_a_lidar_is_not_queried(verb):
    assert find_check(verb("doctor", "--url", KINEMATIC_1_URL, "--seconds", 1, "--json")) is None


def test_a_lidar_that_reports_nothing_is_a_warning(verb):
    silent = find_check(verb("doctor", "--url", f"{KINEMATIC_1_URL}&lidar=lost=0.9", "--seconds",
                             1, "--json"))
    assert silent["verdict"] == "warn"


def test_its_adapter_is_known_by_its_bridge(verb, monkeypatch):
    port = SimpleNamespace(device="/dev/ttyUSB1", vid=0x10C4, pid=0xEA60, serial_number=None,
                           description="CP2102 USB to UART")
    monkeypatch.setattr(attached.list_ports, "comports", lambda: [port])
    monkeypatch.setattr(attached, "holders", lambda device: iter(()))
    result = verb("find", "--json").json
    assert "YDLidar" in result["ports"][0]["bridge"]
    assert any("DART_HAL_LIDAR=serial:///dev/ttyUSB1" in hint for hint in result["hints"])


@pytest.mark.parametrize(("lidar", "words"), [
    ("/dev/ttyUSB0", "is no lidar"), ("serial://", "is no lidar"),
    ("serial:///dev/null-and-void", "null-and-void"),
    ("serial:///dev/ttyUSB0?baud=fast", "is not a line rate"),
    ("serial:///dev/ttyUSB0?baud=0", "is not a line rate"),
    ("serial:///dev/ttyUSB0?speed=128000", "options of a lidar")])
def test_a_lidar_that_cannot_be_is_named(verb, lidar, words):
    error = verb("record", "--url", KINEMATIC_1_URL, "--lidar", lidar, "--json").error
    assert words in error["what"]


@pytest.mark.parametrize("words", ["lane", "localize", "follow circle --speed 1 --odometry",
                                   "calibrate lidar", "calibrate all"])
def test_every_verb_that_looks_through_it_names_it(verb, words):
    error = verb(*words.split(), "--url", f"{KINEMATIC_1_URL}&lidar=1", "--lidar", "serial:///dev/null-and-void",
                 "--json").error
    assert "null-and-void" in error["what"]


@pytest.fixture
def babbler():
    """Path of a port on which bytes come that are no packets, as with a wrong line rate."""
    far, near = os.openpty()
    tty.setraw(near)
    os.set_blocking(far, False)
    done = threading.Event()

    def babble():
        while not done.wait(0.005):
            with suppress(BlockingIOError):
                os.write(far, bytes(range(1, 129)))

    talking = threading.Thread(target=babble)
    talking.start()
    yield os.ttyname(near)
    done.set()
    talking.join()
    os.close(far)
    os.close(near)


@pytest.mark.parametrize("words_of_verb", [("record",), ("localize",)])
@pytest.mark.slow
def test_a_wrong_line_rate_is_named(verb, monkeypatch, babbler, words_of_verb):
    """As fast as it can a virtual car is done before more than a chunk has come."""
    monkeypatch.setattr(port, "MAX_LIDAR_SILENCE", 0.0)
    error = verb(*words_of_verb, "--url", f"{KINEMATIC_1_URL}&lidar=1&pace=1", "--lidar",
                 f"serial://{babbler}?baud=115200", "--duration", 0.5, "--json")
    assert "at 115200 baud that are no packets" in error.err
