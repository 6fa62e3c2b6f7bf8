"""The lidar on a real serial port (a pty): bytes, commands, cables, models, other devices."""

from __future__ import annotations

import os
import threading
import time
import tty
from contextlib import suppress
from math import isfinite

import numpy as np
import pytest
import serial

from dart_hal.core.errors import LinkLost, NoScan, PortMissing, UsageError
from dart_hal.devices.lidar import open_lidar, port
from dart_hal.devices.lidar.packets import START_COMMAND, STOP_COMMAND
from dart_hal.devices.lidar.rplidar import SCAN_REQUEST, STOP_REQUEST
from dart_hal.devices.lidar.rplidar_express import EXPRESS_REQUEST
from dart_hal.devices.links.serial_port import SerialLink
from tests.devices.lidar import express_bytes, ld19_bytes, rplidar_bytes
from tests.devices.lidar.x4_bytes import revolution

pytestmark = pytest.mark.realtime


class Unit:
    """The far end of a port: sends ``packets`` at the pace of their samples, over and over.

    interval: s between two packets; None: by the number of samples in a packet of an X4.
    """

    def __init__(self, packets, *, waits=True, start=START_COMMAND, interval=None):
        self._start = start
        self._interval = interval
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(self._slave)
        self.heard = b""
        self._packets, self._runs = packets, not waits
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._talk)
        self._thread.start()

    def _talk(self):
        k, due = 0, time.monotonic()
        while not self._done.wait(0.002):
            with suppress(BlockingIOError):
                self.heard += os.read(self.master, 64)
            self._runs = self._runs or self._start in self.heard
            while self._packets and self._runs and due < time.monotonic():
                raw = self._packets[k % len(self._packets)]
                os.write(self.master, raw)
                k += 1
                due += self._interval or max(raw[3], 1) * 0.2e-3
            if not self._runs:
                due = time.monotonic()

    def close(self):
        self._done.set()
        self._thread.join()
        os.close(self.master)
        os.close(self._slave)


@pytest.fixture
def unit():
    made = []

    def make(packets, **how):
        made.append(Unit(packets, **how))
        return made[-1]

    yield make
    for one in made:
        if not one._done.is_set():
            one.close()


def wait_for(true, seconds=5.0):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.01)


def collect(lidar, seconds, scans=None):
    scans, end = [] if scans is None else scans, time.monotonic() + seconds
    while time.monotonic() < end:
        scans += lidar.poll(time.monotonic())
        time.sleep(0.01)
    return scans


@pytest.mark.parametrize("waits", [True, False])  # an X4, an X4 Pro
def test_scans_come_in_the_time_of_the_car(unit, waits):
    far = unit(revolution(), waits=waits)
    lidar = open_lidar(f"serial://{far.path}")
    begun = time.monotonic()
    scans = collect(lidar, 1.0)
    assert 5 <= len(scans) <= 9
    assert all(len(s) == 606 for s in scans)
    for scan in scans:
        assert begun - 0.3 < scan.t[0] < scan.t[-1] < scan.arrival < time.monotonic()
        assert isfinite(scan.std)
    assert np.diff([s.start for s in scans[2:]]) == pytest.approx(606 * 0.2e-3, abs=0.02)
    assert lidar.trouble is None
    lidar.close()
    wait_for(lambda: far.heard.endswith(STOP_COMMAND))
    lidar.close()


def test_an_unplugged_cable_is_reported_and_scans_continue_after_it(unit, tmp_path, monkeypatch):
    monkeypatch.setattr(port, "PORT_RETRY_INTERVAL", 0.05)
    first, name = unit(revolution()), tmp_path / "dart-lidar"
    name.symlink_to(first.path)
    lidar = open_lidar(f"serial://{name}")
    try:
        assert collect(lidar, 0.5)
        first.close()
        name.unlink()
        wait_for(lambda: lidar.trouble is not None)
        assert isinstance(lidar.trouble, LinkLost)
        assert "the lidar's port vanished" in str(lidar.trouble)
        name.symlink_to(unit(revolution()).path)
        wait_for(lambda: lidar.trouble is None)
        assert collect(lidar, 0.6)
    finally:
        lidar.close()


def test_another_line_rate_is_recognised(unit, monkeypatch):
    monkeypatch.setattr(port, "MAX_LIDAR_SILENCE", 0.2)
    noise = np.random.default_rng(1).integers(0, 256, (40, 90), dtype=np.uint8)
    noise[:, 3] = 40  # the pace that Unit reads there
    lidar = open_lidar(f"serial://{unit([n.tobytes() for n in noise]).path}")
    try:
        assert collect(lidar, 0.6) == []
        assert isinstance(lidar.trouble, NoScan)
        assert "bytes come at 128000 baud that are no packets" in str(lidar.trouble)
    finally:
        lidar.close()


def test_a_silent_unit_is_reported_as_silent_and_started_again(unit, monkeypatch):
    monkeypatch.setattr(port, "MAX_LIDAR_SILENCE", 0.2)
    monkeypatch.setattr(port, "PORT_RETRY_INTERVAL", 0.1)
    far = unit([])
    lidar = open_lidar(f"serial://{far.path}")
    try:
        collect(lidar, 0.6)
        assert isinstance(lidar.trouble, NoScan)
        assert "is silent" in str(lidar.trouble)
        assert far.heard.count(START_COMMAND) >= 2
    finally:
        lidar.close()


def test_a_port_that_is_not_there():
    with pytest.raises(PortMissing):
        open_lidar("serial:///dev/no-lidar")


@pytest.mark.parametrize("url", ["udp://:5005", "serial://", "/dev/ttyUSB1", "serial://[",
                                 "serial:///dev/x?colour=1", "serial:///dev/x?baud=fast",
                                 "serial:///dev/x?model=sick",
                                 "serial:///dev/x?baud=0", "serial:///dev/x?baud=1&baud=2"])
def test_what_is_no_lidar_is_refused(url):
    with pytest.raises(UsageError):
        open_lidar(url)


def test_the_motor_stops_with_the_port(unit, monkeypatch):
    """DTR lets it run; a port that closes leaves the line as it is. The Nano's stays low."""
    lines = []
    monkeypatch.setattr(serial.Serial, "_update_dtr_state",
                        lambda of: lines.append((of.port, of._dtr_state)))
    one = unit([])
    open_lidar(f"serial://{one.path}").close()
    assert [up for _, up in lines][-1] is False
    assert True in [up for _, up in lines]
    lines.clear()
    SerialLink(one.path).close()
    assert True not in [up for _, up in lines]


def ld19_unit(unit):
    raw = ld19_bytes.stream(30)
    return unit([raw[k:k + 47] for k in range(0, len(raw), 47)], waits=False, interval=12 / 4500)


def rplidar_unit(unit, answers=rplidar_bytes.RATE_ANSWER + rplidar_bytes.SCAN_DESCRIPTOR):
    raw = rplidar_bytes.stream(30)
    nodes = [raw[k:k + 40] for k in range(0, len(raw), 40)]
    return unit([answers, *nodes], start=SCAN_REQUEST, interval=8 * 508e-6)


def express_unit(unit):
    answers = rplidar_bytes.RATE_ANSWER + express_bytes.EXPRESS_ANSWER
    return unit([answers, *express_bytes.stream(15)], start=EXPRESS_REQUEST,
                interval=32 * express_bytes.EXPRESS_PERIOD)


@pytest.mark.parametrize(("make", "model", "beams", "rate"), [
    (ld19_unit, "ld19", 450, 10.0), (rplidar_unit, "rplidar", 360, 5.47),
    (express_unit, "rplidar-express", 704, 5.59)])
def test_other_models_scan_and_stop(unit, make, model, beams, rate):
    far = make(unit)
    lidar = open_lidar(f"serial://{far.path}?model={model}")
    scans = collect(lidar, 1.2)
    assert len(scans) >= 4
    assert [len(s) for s in scans[1:]] == [beams] * len(scans[1:])
    assert scans[-1].rate == pytest.approx(rate, rel=0.03)
    assert lidar.trouble is None
    lidar.close()
    if model.startswith("rplidar"):
        wait_for(lambda: far.heard.count(STOP_REQUEST) == 2)
        assert far.heard.startswith(STOP_REQUEST)


@pytest.mark.parametrize(("make", "model"), [(ld19_unit, "ld19"), (rplidar_unit, "rplidar")])
def test_a_model_that_is_not_stated_is_recognised(unit, monkeypatch, make, model):
    monkeypatch.setattr(port, "PROBE_TIME", 0.6)
    monkeypatch.setattr(port, "PORT_RETRY_INTERVAL", 0.05)
    lidar = open_lidar(f"serial://{make(unit).path}")
    try:
        assert lidar.model.key == "x4"
        wait_for(lambda: lidar.poll(time.monotonic()), 10.0)
        assert lidar.model.key == model
        assert collect(lidar, 0.5)
        assert lidar.trouble is None
    finally:
        lidar.close()


def test_an_x4_that_is_not_stated_stays_one(unit, monkeypatch):
    monkeypatch.setattr(port, "PROBE_TIME", 0.2)
    lidar = open_lidar(f"serial://{unit(revolution()).path}")
    try:
        assert collect(lidar, 0.8)
        assert lidar.model.key == "x4"
    finally:
        lidar.close()


def test_another_model_than_stated_is_named(unit, monkeypatch):
    monkeypatch.setattr(port, "MAX_LIDAR_SILENCE", 0.2)
    lidar = open_lidar(f"serial://{ld19_unit(unit).path}?model=rplidar&baud=230400")
    try:
        assert collect(lidar, 0.6) == []
        trouble = lidar.trouble
        assert isinstance(trouble, NoScan)
        assert trouble.found == "packets of an LD19"
        assert "RPLidar at 230400 baud" in trouble.expected
        assert "leave out model=" in trouble.remedy
    finally:
        lidar.close()


def test_the_health_of_a_unit_that_does_not_scan_is_reported(unit, monkeypatch):
    """A unit in protection stop answers, and sends no nodes."""
    monkeypatch.setattr(port, "MAX_LIDAR_SILENCE", 0.2)
    monkeypatch.setattr(port, "MAX_BYTES_WITHOUT_PACKET", 10_000)
    answers = rplidar_bytes.INFO_ANSWER + rplidar_bytes.HEALTH_ANSWER
    far = unit([answers], start=SCAN_REQUEST, interval=10.0)
    lidar = open_lidar(f"serial://{far.path}?model=rplidar")
    try:
        collect(lidar, 0.8)
        assert "health 2, error 4660" in lidar.trouble.found
        assert "model 24" in lidar.trouble.found
    finally:
        lidar.close()


def test_an_unplugged_ld19_is_reported_and_continues(unit, tmp_path, monkeypatch):
    monkeypatch.setattr(port, "PORT_RETRY_INTERVAL", 0.05)
    first = ld19_unit(unit)
    name = tmp_path / "dart-lidar"
    name.symlink_to(first.path)
    lidar = open_lidar(f"serial://{name}?model=ld19")
    try:
        assert collect(lidar, 0.5)
        first.close()
        name.unlink()
        wait_for(lambda: lidar.trouble is not None)
        assert isinstance(lidar.trouble, LinkLost)
        name.symlink_to(ld19_unit(unit).path)
        wait_for(lambda: lidar.trouble is None)
        assert collect(lidar, 0.6)
    finally:
        lidar.close()


def test_the_motor_of_an_a1_runs_while_dtr_is_low(unit, monkeypatch):
    lines = []
    monkeypatch.setattr(serial.Serial, "_update_dtr_state",
                        lambda port: lines.append(port._dtr_state))
    open_lidar(f"serial://{unit([]).path}?model=rplidar").close()
    assert lines[0] is False
    assert lines[-1] is True
