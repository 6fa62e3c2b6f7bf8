"""Who else may touch a car that is driven: two Nanos on one bus, forked children, other
programs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import LinkLost, NotPca, PcaBusy
from dart_hal.devices.links import i2c
from dart_lab.sim.bus import VirtualBus
from tests.common import PROCESS_TIMEOUT_S
from tests.power_monitor import PowerMonitor

pytestmark = pytest.mark.realtime


OWNER_PROGRAM = """
import multiprocessing, sys, time
from dart_hal.car import Car
from dart_hal.core.process import forks
url, name, cars, workers = sys.argv[1:5]

def work(up):
    up.release()
    time.sleep(120)

with Car.open(url, car=name, cars=cars) as car:
    if workers == "keep":
        forks._private.clear()
    fork = multiprocessing.get_context("fork")
    up = fork.Semaphore(0)
    made = [fork.Process(target=work, args=(up,)) for _ in range(2)]
    for worker in made:
        worker.start()
        up.acquire()                        # it runs, and has let go by now
    print(car._engine.driver._guard._guard.pid, *(w.pid for w in made), flush=True)
    for _ in car.states(timeout=60.0):
        pass
"""


@pytest.mark.slow
def test_a_second_nano_on_the_same_bus_is_refused_and_the_first_drives_on(served_car, tmp_path):
    folder = tmp_path / "other"
    folder.mkdir()
    other = type(served_car)(folder)                        # a car of its own: its Nano is free
    url = f"serial://{other.port}?i2c={served_car.url.partition('i2c=')[2]}"
    with served_car.open() as car:
        with pytest.raises(PcaBusy, match="is driven already") as caught:
            Car.open(url, car=served_car.name, cars=served_car.cars)
        assert f"pid {os.getpid()}" in caught.value.found
        command = [sys.executable, "-m", "dart_hal.cli.main", "top", "--url", url, "--car",
                   served_car.name, "--cars", str(served_car.cars)]
        program = subprocess.run(command, capture_output=True, text=True, check=False)
        assert program.returncode != 0
        assert "PCA9685" in program.stderr
        assert f"pid {os.getpid()}" in program.stderr
        for _ in car.states(duration=0.2, timeout=PROCESS_TIMEOUT_S):
            pass
        assert car.causes == ()
    Car.open(url, car=served_car.name, cars=served_car.cars).close()
    other.close()


@pytest.mark.parametrize("workers", ["go", "keep"])
@pytest.mark.slow_except("go")
def test_forked_workers_of_a_killed_driver_keep_nothing(served_car, workers):
    """The control: with what the hook takes away, port and chip stay taken."""
    program = subprocess.Popen(
        [sys.executable, "-c", OWNER_PROGRAM, served_car.url, served_car.name, str(served_car.cars),
         workers],
        stdout=subprocess.PIPE, text=True)
    _, *pids = map(int, program.stdout.readline().split())
    program.send_signal(signal.SIGKILL)
    program.wait()
    program.stdout.close()
    try:
        if workers == "keep":
            with pytest.raises(OSError, match=r"in use|driven already"):
                served_car.open()
        else:
            served_car.open().close()
    finally:
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
    assert served_car.is_stopped()


def test_a_child_cannot_drive_and_the_parent_does_not_notice_it(served_car):
    with served_car.open() as car:
        for _ in car.states(duration=0.1, timeout=PROCESS_TIMEOUT_S):
            pass
        answer = os.pipe()
        child = os.fork()
        if child == 0:
            try:
                car.drive(throttle=0.3)
            except LinkLost as error:
                os.write(answer[1], str(error).encode())
            car.close()                                 # as the end of the child's with block
            os._exit(0)
        os.waitpid(child, 0)
        message = os.read(answer[0], 1000).decode()
        assert "belongs to the process that opened it" in message
        assert "drive in the parent" in message
        for _ in car.states(duration=0.3, timeout=PROCESS_TIMEOUT_S):
            pass
        assert car.mode == "DISARMED"
        assert car._engine.driver._guard._guard.age is not None, "the guard was not ended"
        for fd in answer:
            os.close(fd)


def test_a_power_monitor_behind_the_url_gets_no_write(served_car, monkeypatch):
    """The whole way of an opening: port, lock, look."""
    monitor = PowerMonitor()
    bus = VirtualBus(time.monotonic, [monitor])
    monkeypatch.setattr(i2c.SocketBus, "transfer",
                        lambda self, address, data, n: bus.transfer(address, data, n))
    with pytest.raises(NotPca, match="is no PCA9685"):
        served_car.open()
    assert monitor.stored == []
    monkeypatch.undo()
    served_car.open().close()
