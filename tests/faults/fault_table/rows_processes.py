"""Rows of real processes and signals, in real time, on a served car or a real one."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable

from fault_table.bench import Bench
from fault_table.row import Measured, Row, case
from fault_table.rows_pins import MS, PULSE, alone
from fault_table.stand import DriverProcess, ProcessRig, with_signal

TRIES = 5
"""A try that the machine spoilt (it gave no processor for 10 ms) is made again."""
AFTER = 1.2
"""s that pulses are watched for."""

Do = Callable[[ProcessRig, DriverProcess], float]


def kill(number: int) -> Do:
    def do(rig: ProcessRig, driver: DriverProcess) -> float:
        at = time.monotonic()
        os.kill(driver.pid, number)
        return at
    return do


def kill_group(rig: ProcessRig, driver: DriverProcess) -> float:
    at = time.monotonic()
    os.killpg(driver.pid, signal.SIGKILL)
    return at


def kill_guard(number: int) -> Do:
    def do(rig: ProcessRig, driver: DriverProcess) -> float:
        at = time.monotonic()
        if driver.guard is not None:
            os.kill(driver.guard, number)
        return at
    return do


def kill_both(rig: ProcessRig, driver: DriverProcess) -> float:
    at = time.monotonic()
    if driver.guard is not None:
        os.kill(driver.guard, signal.SIGKILL)
    os.kill(driver.pid, signal.SIGKILL)
    return at


def stop_and_go(rig: ProcessRig, driver: DriverProcess) -> float:
    """SIGSTOP, then SIGCONT: what it wrote when it woke up counts as well."""
    at = time.monotonic()
    os.kill(driver.pid, signal.SIGSTOP)
    time.sleep(0.8)
    os.kill(driver.pid, signal.SIGCONT)
    return at


def itself(rig: ProcessRig, driver: DriverProcess) -> float:
    return driver.fault()


def fork_and_kill(rig: ProcessRig, driver: DriverProcess) -> float:
    """A forked worker lives on and holds what it inherited."""
    driver.fault()
    worker = int(driver.expect("worker"))
    time.sleep(0.3)
    at = time.monotonic()
    os.kill(driver.pid, signal.SIGKILL)
    time.sleep(AFTER)
    with_signal(worker, signal.SIGKILL)
    return at


def listener_and_term(rig: ProcessRig, driver: DriverProcess) -> float:
    """A listener that blocks, then SIGTERM; how long the program takes to end is reported."""
    driver.fault()
    time.sleep(0.5)
    driver.process.terminate()
    return time.monotonic() - 0.5


def watch_pulses(do: Do, how: str = "wait", options: str = "", nano: str = "mock",
                 ) -> Callable[[Bench], Measured]:
    """The last driving pulse after ``do``."""
    def measure(bench: Bench) -> Measured:
        for attempt in range(1, TRIES + 1):
            with bench.process_rig(options, nano=nano) as rig:
                driver = rig.driver(how)
                time.sleep(0.3)
                at = do(rig, driver)
                time.sleep(AFTER)
                last = rig.last_wrong(at)
                spoilt = rig.longest_stall(at - 0.05, at + 0.3)
                drove = rig.drove(at)
            if drove and not spoilt:
                break
        assert drove, "the machine is too busy: the car tripped before the fault"
        remark = f", the machine stalled {1e3 * spoilt:.0f} ms" if spoilt else ""
        return Measured(last, f"try {attempt}{remark}")
    return measure


def ends(bench: Bench) -> Measured:
    """s until a program whose listener blocks ends on SIGTERM."""
    with bench.process_rig() as rig:
        driver = rig.driver("listener")
        driver.fault()
        time.sleep(0.3)
        begin = time.monotonic()
        driver.process.terminate()
        while driver.process.poll() is None and time.monotonic() - begin < 8.0:
            time.sleep(0.01)
        code = driver.process.poll()
        return Measured(time.monotonic() - begin if code is not None else float("inf"),
                        f"exit {code}")


def hil(what: str, do: Do, limit: float, *control: str, how: str = "wait"):  # type: ignore[no-untyped-def]
    """A case that a real car can take as well."""
    return case("pty", what, watch_pulses(do, how), limit, MS, *control, hil=True)


BOTH = "driver and guard killed, kernel dead, computer without power"

ROWS = (
    Row(25, BOTH, "the Nano cuts", tuple(
        case("pty", cut, watch_pulses(kill_both, options=f"&cutoff={cut}"), 120 + PULSE, MS,
             "cutoff")
        for cut in ("oe", "mux"))),
    Row(34, "the user's loop stalls", "the command runs out", (
        hil("sleeps 3 s", itself, 500 + PULSE, "expiry", how="stall"),)),
    Row(21, "host kill -9 while driving", "the guard writes neutral", (
        hil("kill -9", kill(signal.SIGKILL), 50, "guard"),
        hil("forked worker lives on", fork_and_kill, 50, "guard", how="fork"),
        hil("segfault", itself, 50, "guard", how="segfault"),
        hil("os._exit", itself, 50, "guard", how="exit"),
        hil("execv", itself, 50, "guard", how="exec"),
    )),
    Row(22, "SIGSTOP, a pause of the interpreter, swap", "neutral, nothing stale after SIGCONT", (
        hil("SIGSTOP, SIGCONT", stop_and_go, 150, "guard"),
        hil("interpreter held", itself, 150, "guard", how="hog"),
    )),
    Row(23, "kill -9 of the process group, terminal closed", "the guard survives", (
        hil("kill -9 of the group", kill_group, 50, "guard_session"),
        case("pty", "SIGHUP, no guard", alone("guard", watch_pulses(kill(signal.SIGHUP))),
             50 + PULSE,
             MS, "signals"),
    )),
    Row(24, "guard killed", "the driver disarms", (
        hil("kill -9", kill_guard(signal.SIGKILL), 100, "guard_gate"),
        hil("SIGSTOP", kill_guard(signal.SIGSTOP), 100 + PULSE, "guard_gate"),
    )),
    Row(36, "an exception in the user's loop", "neutral on the way out", (
        case("pty", "ZeroDivisionError, no guard", alone("guard", watch_pulses(itself, "error")),
             50 + PULSE, MS, "close_neutral"),
    )),
    Row(37, "a listener blocks, then SIGTERM", "neutral, and the program ends", (
        hil("neutral", listener_and_term, 150, "guard", how="listener"),
        case("pty", "the program ends", ends, 3.0, "s", "stop_patience"),
    )),
)
