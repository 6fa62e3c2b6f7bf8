"""The end of the main thread stops a car that another thread drives, at the ESC's pin."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from tests.common import PROCESS_TIMEOUT_S
from tests.contract.conftest import OFF
from tests.contract.test_contract_realtime import driven, wait_for

pytestmark = pytest.mark.realtime

PROGRAM = """
import asyncio, sys, threading, time
from dart_hal.car import Car, car as module
url, name, cars, how, watched = sys.argv[1:6]
if watched == "no":
    module.stop_at_end = lambda stop: None
car = Car.open(url, car=name, cars=cars)
car.arm(waive=("CALIBRATION_MISSING",))
drives = threading.Event()
def loop():
    for state in car.states(timeout=20.0):
        car.drive(throttle=0.3, valid_for=0.5)
        if state.applied.throttle > 0.2 and not drives.is_set():
            print("driving", flush=True)
            drives.set()
async def main():
    await asyncio.to_thread(loop)
if how == "asyncio":
    asyncio.run(main())
threading.Thread(target=loop).start()
drives.wait()
if how == "error":
    raise ValueError("the plot failed")
while True:
    time.sleep(1.0)
"""


def start_driving(served_car, how, watched="yes"):
    """Start the program; return it once it drives."""
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, served_car.url, served_car.name, str(served_car.cars), how,
         watched], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
    assert process.stdout.readline() == "driving\n", process.stderr.read()
    return process


@pytest.mark.slow
@pytest.mark.parametrize(("how", "number"), [
    ("thread", signal.SIGINT), ("thread", signal.SIGTERM), ("asyncio", signal.SIGINT),
    ("asyncio", signal.SIGTERM), ("error", None)])
def test_the_car_stops_and_the_program_ends(served_car, how, number):
    process = start_driving(served_car, how)
    if number is not None:
        process.send_signal(number)
    _, err = process.communicate(timeout=PROCESS_TIMEOUT_S)
    assert process.returncode not in (None, 0)
    assert served_car.counts()[1] & OFF
    # asyncio drops the exception of a thread that is not awaited any more
    assert how == "asyncio" or "RUN_STOP" in err, "the error names the reason"


@pytest.mark.slow
def test_control_without_the_stop_the_thread_drives_on(served_car):
    process = start_driving(served_car, "thread", watched="no")
    try:
        process.send_signal(signal.SIGTERM)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(1.0)
        assert wait_for(lambda: driven(served_car))
    finally:
        process.kill()
        process.communicate()
