"""The lidar on a real serial port (a pty): bytes, commands, cables, and who is not a lidar."""

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
from dart_hal.devices.links.serial_port import SerialLink
from tests.devices.lidar.x4_bytes import revolution

pytestmark = pytest.mark.realtime


class Unit:
    """The far end of a port: sends ``packets`` at the pace of their samples, over and over."""

    def __init__(self, packets, *, waits=True):
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
            self._runs = self._runs or START_COMMAND in self.heard
            while self._packets and self._runs and due < time.monotonic():
                raw = self._packets[k % len(self._packets)]
                os.write(self.master, raw)
                k, due = k + 1, due + max(raw[3], 1) * 0.2e-3
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
