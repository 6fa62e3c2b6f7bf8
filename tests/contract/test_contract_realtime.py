"""Real processes, a real pty, real signals: the ESC is left without a pulse.

What is asserted is what the PCA9685's registers carry in the end and what was
reported, never how fast: this machine does other things as well.
"""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from dart_hal.core.errors import Disarmed, LinkLost, PortBusy, PortMissing
from dart_hal.core.timing import PWM_FRAME
from dart_hal.devices.actuation import guarded
from tests.common import PROCESS_TIMEOUT_S
from tests.contract.conftest import NEUTRAL_COUNTS, OFF

pytestmark = pytest.mark.realtime


REALTIME_PROGRAM = """
import sys
from contextlib import suppress
from dart_hal.car import Car
from dart_hal.core.errors import LinkLost, NotArmed
url, name, cars = sys.argv[1:4]
with Car.open(url, car=name, cars=cars) as car:
    while True:
        with suppress(NotArmed, LinkLost):      # a busy machine may stall the server
            car.arm(waive=("CALIBRATION_MISSING",))
        for state in car.states(timeout=20.0):
            car.drive(steering=0.1, throttle=0.3, valid_for=0.5)
            if car.mode != "ARMED":
                break
            if state.applied.throttle > 0.2:
                print("driving", flush=True)
        if car.mode == "LOCKED":
            car.unlock("again")
        for _ in car.states(duration=0.7, timeout=20.0):
            pass
"""


def drive_on(car, timeout):
    """Drive until something is raised."""
    for _ in car.states(timeout=timeout):
        car.drive(throttle=0.3, valid_for=0.5)


def wait_for(condition, seconds=PROCESS_TIMEOUT_S):
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return condition()


def driven(served_car):
    """Whether the ESC gets a throttle: not the power-on pattern, not neutral."""
    return served_car.counts()[1] in range(312, 420)


@pytest.fixture
def driver(served_car):
    """A program that drives, and reports it."""
    process = subprocess.Popen(
        [sys.executable, "-c", REALTIME_PROGRAM, served_car.url, served_car.name,
         str(served_car.cars)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "driving\n", process.stderr.read()
    threading.Thread(target=process.stdout.read, daemon=True).start()
    yield process
    process.kill()
    process.wait()


@pytest.mark.parametrize(("number", "code"), [
    (signal.SIGTERM, 128 + signal.SIGTERM),
    pytest.param(signal.SIGINT, None, marks=pytest.mark.long),
    pytest.param(signal.SIGHUP, 128 + signal.SIGHUP, marks=pytest.mark.long),
])
def test_a_signal_leaves_no_pulse(served_car, driver, number, code):
    assert wait_for(lambda: driven(served_car)), "it drives before the signal"
    driver.send_signal(number)
    driver.wait(PROCESS_TIMEOUT_S)
    assert served_car.counts()[1] & OFF
    assert driver.returncode == (code if code is not None else -number)


@pytest.mark.parametrize("number", [
    signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.long)])
def test_the_guard_brings_neutral_when_the_program_cannot(served_car, driver, number):
    driver.send_signal(number)
    assert wait_for(served_car.is_stopped)
    assert wait_for(lambda: served_car.counts()[1] & OFF)


@pytest.mark.long       # in real time; tests/cli/test_cli_ctrl_c.py has it in virtual time
def test_ctrl_c_during_a_calibration_stops_and_writes_nothing(served_car, tmp_path):
    command = [sys.executable, "-m", "dart_hal.cli.main", "calibrate", "steering", "--yes",
               "--json", "--url", served_car.url, "--car", served_car.name, "--cars",
               str(served_car.cars)]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               text=True, cwd=tmp_path)
    # Not before it drives: Ctrl-C in an import of it is another story.
    wait_for(lambda: driven(served_car) or program.poll() is not None, 8 * PROCESS_TIMEOUT_S)
    program.send_signal(signal.SIGINT)
    out, err = program.communicate(timeout=PROCESS_TIMEOUT_S)
    assert program.returncode == 130, err
    assert out == ""
    assert "Traceback" not in err
    assert served_car.counts()[1] & OFF
    assert not list(tmp_path.rglob("calibration.toml"))


def test_link_lost_is_reported_and_neutral_and_does_not_hang(served_car, arm):
    """The Nano's cable comes out, the I2C bus stays."""
    with served_car.open() as car:
        arm(car)
        for _ in car.states(duration=0.2, timeout=PROCESS_TIMEOUT_S):
            car.drive(throttle=0.3, valid_for=0.5)
        link = car._engine.backend.link
        car._engine.backend.candidates = list           # nothing is plugged in again
        os.dup2(os.open("/dev/null", os.O_RDWR), link._port.fd)
        with pytest.raises(LinkLost, match=r"vanished|no frame|take bytes"):
            drive_on(car, 1.0)
        assert wait_for(served_car.is_stopped)
        with pytest.raises(LinkLost):
            next(car.states(timeout=1.0))
        with pytest.raises(Disarmed):
            car.drive(throttle=0.3)
        assert car.mode != "ARMED"


def test_in_a_lasting_fault_driver_and_guard_both_write_no_pulse(served_car, arm):
    """Reads fail and writes are taken: the guard, without a beat, writes the same chip."""
    with served_car.open(raise_on_trip=False) as car:
        arm(car)
        for _ in car.states(duration=0.2, timeout=PROCESS_TIMEOUT_S):
            car.drive(throttle=0.3, valid_for=0.5)
        bus = car._engine.backend.bus
        transfer = bus.transfer

        def write_only(address, data, n_read):
            if n_read:
                raise OSError(errno.EIO, "interrupted")
            return transfer(address, data, n_read)

        assert driven(served_car), "negative control"
        bus.transfer = write_only
        assert wait_for(lambda: car._engine.driver.applied.throttle_us == 0.0)
        time.sleep(2 * PWM_FRAME)       # both have written since
        off = set()
        for _ in range(50):
            off.add(bool(served_car.counts()[1] & OFF))
            time.sleep(0.5 * PWM_FRAME)
        assert car.mode == "FAULT"
        assert car._engine.driver._guard.tripped
        assert off == {True}, "neutral and no pulse alternate"
        bus.transfer = transfer
        assert wait_for(lambda: car.mode == "DISARMED")
        assert wait_for(lambda: not car._engine.driver._guard.tripped)
        assert wait_for(lambda: served_car.counts()[1] in NEUTRAL_COUNTS)


@pytest.mark.slow
def test_a_server_that_is_killed_ends_everything_in_order(served_car, arm):
    threads = threading.active_count()
    with served_car.open() as car:
        arm(car)
        guard = car._engine.driver._guard._guard
        served_car.process.kill()
        served_car.process.wait()
        with pytest.raises(LinkLost) as lost:
            drive_on(car, 2.0)
        assert served_car.port in str(lost.value)
        assert lost.value.remedy
        assert car.mode != "ARMED"
    assert car.mode == "CLOSED"
    assert guard.pid in [left.pid for left in guarded._left], "it tries on: the bus may come back"
    os.kill(guard.pid, signal.SIGKILL)                  # half a minute is long for a test
    os.waitpid(guard.pid, 0)
    assert wait_for(lambda: threading.active_count() <= threads)
    with pytest.raises((PortMissing, OSError)):
        served_car.open()


@pytest.mark.slow
def test_a_slow_loop_gets_the_newest_and_counts_the_others(served_car):
    with served_car.open() as car:
        states = []
        for state in car.states(duration=1.2, timeout=PROCESS_TIMEOUT_S):
            states.append(state)
            time.sleep(0.1)
        assert 2 <= len(states) <= 14
        skipped = states[-1].health.skipped
        assert skipped >= 5 * (len(states) - 1)
        assert car.timing.skipped == skipped
        frames = states[-1].seq - states[0].seq
        assert skipped <= frames - len(states) + 1


@pytest.mark.parametrize("error", [
    pytest.param(ZeroDivisionError, marks=pytest.mark.slow), SystemExit,
    pytest.param(KeyboardInterrupt, marks=pytest.mark.slow)])
def test_an_error_in_a_listener_is_raised_in_the_loop_at_neutral(served_car, arm, error):
    """The thread that feeds the pins must not end unnoticed."""
    with served_car.open() as car:
        arm(car)
        for _ in car.states(duration=0.2, timeout=PROCESS_TIMEOUT_S):
            car.drive(throttle=0.3, valid_for=0.5)

        def broken(state):
            raise error("listener")

        car.on_state(broken)
        with pytest.raises(error, match="listener"):
            drive_on(car, 5.0)
        assert wait_for(served_car.is_stopped)
        assert car.mode != "ARMED"


@pytest.mark.long
def test_an_error_in_the_block_leaves_no_pulse(served_car, arm):
    def mistaken():
        with served_car.open() as car:
            arm(car)
            for state in car.states(timeout=PROCESS_TIMEOUT_S):
                car.drive(throttle=0.3, valid_for=0.5)
                if state.applied.throttle > 0.2:
                    raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        mistaken()
    assert served_car.counts()[1] & OFF


@pytest.mark.slow
def test_a_second_program_is_refused_by_name_and_the_first_goes_on(served_car):
    with served_car.open() as car:
        for _ in car.states(duration=0.1, timeout=PROCESS_TIMEOUT_S):
            pass
        code = ("import sys; from dart_hal.devices.links.serial_port import SerialLink\n"
                f"SerialLink({served_car.port!r})")
        second = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True,
                                check=False)
        assert "PortBusy" in second.stderr
        assert f"pid {os.getpid()}" in second.stderr
        with pytest.raises(PortBusy):
            served_car.open()
        for _ in car.states(duration=0.2, timeout=PROCESS_TIMEOUT_S):
            pass
        assert car.timing.lost == 0


@pytest.mark.slow
def test_open_and_close_leave_nothing_behind(served_car):
    def census():
        return len(os.listdir("/proc/self/fd")), threading.active_count()

    served_car.open().close()
    before = census()
    for _ in range(2):
        served_car.open().close()
    assert wait_for(lambda: census() <= before)
    assert served_car.counts()[1] & OFF


@pytest.mark.slow
def test_a_hundred_frames_a_second_arrive_under_load(served_car):
    """Two busy threads next to the loop: frames may be skipped, never lost."""
    done = threading.Event()

    def burn():
        while not done.is_set():
            sum(range(2000))

    threads = [threading.Thread(target=burn, daemon=True) for _ in range(2)]
    with served_car.open() as car:
        for thread in threads:
            thread.start()
        states = list(car.states(duration=1.5, timeout=PROCESS_TIMEOUT_S))
        done.set()
        for thread in threads:
            thread.join()
        frames = states[-1].seq - states[0].seq
        assert car.timing.lost == 0
        assert car.timing.damaged == 0
        assert frames >= 140
        assert states[-1].t - states[0].t == pytest.approx(1.5, abs=0.3)
