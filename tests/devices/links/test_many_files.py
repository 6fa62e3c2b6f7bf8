"""A program with more than 1024 open files: select would refuse their descriptors."""

from __future__ import annotations

import os
import resource
import select
import tty
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

import dart_hal
from dart_hal.core.errors import LinkLost
from dart_hal.core.process.waiting import wait_readable, wait_writable
from dart_hal.devices.links.serial_port import WRITE_TIMEOUT, SerialLink

FILES = 1100


@contextmanager
def many_files():
    """Open so many that every further descriptor is beyond 1024."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 4096:
        pytest.skip(f"this user may open {hard} files only")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 4096), hard))
    opened = [os.open("/dev/null", os.O_RDONLY) for _ in range(FILES)]
    try:
        yield
    finally:
        for descriptor in opened:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.fixture
def wire():
    """A pseudo terminal: the far end, and a link on the near one, beyond 1024."""
    with many_files():
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        link = SerialLink(os.ttyname(slave))
        yield master, link
        link.close()
        for descriptor in (master, slave):
            with suppress(OSError):
                os.close(descriptor)


def test_a_port_with_a_high_descriptor_is_read_and_written(wire):
    master, link = wire
    with pytest.raises(ValueError, match="out of range"):
        select.select([link._port.fd], [], [], 0)  # control: these descriptors are too high
    assert link.read(0.0) is None
    os.write(master, b"state")
    assert link.read(1.0).data == b"state"
    link.write(b"beat")
    assert os.read(master, 100) == b"beat"


@pytest.mark.slow
def test_a_port_that_takes_nothing_is_given_up_after_a_frame(wire):
    _, link = wire
    for _ in range(20):
        link.write(bytes(4096))
    assert link.dropped > 0


def repeat(call, *arguments):
    for _ in range(10):
        call(*arguments)


def test_a_port_that_is_gone_is_reported(wire):
    master, link = wire
    os.close(master)
    with pytest.raises(LinkLost, match="vanished"):
        repeat(link.read, 0.01)
    with pytest.raises(LinkLost):
        repeat(link.write, b"x")


def test_a_closed_port_is_reported(wire):
    _, link = wire
    link.close()
    with pytest.raises(LinkLost):
        link.read(0.0)
    with pytest.raises(LinkLost):
        link.write(b"x")


def test_waiting():
    read, write = os.pipe()
    try:
        assert not wait_readable(read, 0.0)
        assert not wait_readable(read, -1.0)
        assert not wait_readable(None, 0.001)
        assert wait_writable(write, 0.0)
        os.write(write, b"x")
        assert wait_readable(read, 0.0)
        os.read(read, 1)
        os.close(write)
        assert wait_readable(read, 0.0), "the end of the file is something to read"
    finally:
        os.close(read)
    assert WRITE_TIMEOUT == 0.02, "one PWM frame"


def test_no_select_in_the_package():
    folder = Path(dart_hal.__file__).parent
    assert [file.name for file in folder.rglob("*.py")
            if "select.select(" in file.read_text(encoding="utf-8")] == []
