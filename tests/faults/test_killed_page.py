"""The program that serves the live page is killed while a hand holds the stick."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager, suppress

import pytest
from fault_table import switches  # noqa: F401 - the layers that may be gone
from fault_table.layers import remove_layers
from fault_table.rows_processes import AFTER, TRIES
from fault_table.stand import HERE, RIG_TIMEOUT_S, PtyRig, environment, guard_of, with_signal
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

pytestmark = [pytest.mark.realtime, pytest.mark.slow]
NEUTRAL_MS = 250.0


class Hand:
    """A page that holds the stick as long as its socket lives; ``arms``: and arms the car."""

    def __init__(self, port, token, arms):
        self.mode = ""
        self.sent = 0
        self._open = ExitStack()
        self._socket = self._open.enter_context(
            connect(f"ws://localhost:{port}/socket", compression=None))
        self._send(type="take", token=token)
        self._arms = arms
        self._thread = threading.Thread(target=self._hold, daemon=True)
        self._thread.start()

    def _send(self, **message):
        self._socket.send(json.dumps(message))

    def _hold(self):
        armed = 0.0
        with suppress(ConnectionClosed, OSError):
            for text in self._socket:
                message = json.loads(text)
                if message["type"] == "status":
                    self.mode = message["mode"]
                    if self._arms and self.mode == "DISARMED" and time.monotonic() > armed + 2.0:
                        armed = time.monotonic()
                        self._send(type="release")
                        self._send(type="arm")
                elif message["type"] == "rows" and (self.mode == "ARMED" or not self._arms):
                    self._send(type="drive", steering=0.0, throttle=1.0, heard=message["now"])
                    self.sent += 1

    def close(self):
        self._open.close()
        self._thread.join()


@contextmanager
def serve_page(rig, arms=True):
    """(program with a page, the hand at it)."""
    program = subprocess.Popen(
        [sys.executable, str(HERE / "page_driver.py"), rig.url, rig.name, rig.cars],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment(),
        start_new_session=True)
    guard = None
    try:
        words = program.stdout.readline().split()
        assert words, program.stderr.read()[-400:]
        guard = guard_of(program.pid)
        hand = Hand(*words[1:], arms)
        yield program, hand
        hand.close()
    finally:
        program.kill()
        program.communicate()
        if guard is not None:
            with_signal(guard, 9)


def until(condition):
    ends = time.monotonic() + RIG_TIMEOUT_S
    while not condition():
        assert time.monotonic() < ends
        time.sleep(0.02)


def kill_page(folder):
    """(ms from kill -9 to the last pulse that drives, 0: none began; whether it drove until then
    and the machine did not stall; whether it drove; the rig)."""
    with PtyRig(folder) as rig:
        with serve_page(rig) as (program, _):
            until(lambda: rig.drove(time.monotonic()))
            time.sleep(0.5)
            at = time.monotonic()
            os.kill(program.pid, signal.SIGKILL)
            time.sleep(AFTER)
            last = rig.last_wrong(at)
            spoilt = rig.longest_stall(at - 0.05, at + 0.3)
            drove = rig.drove(at)
        yield last, drove and not spoilt, drove, rig


def measure_kill(folder):
    for left in reversed(range(TRIES)):
        one = kill_page(folder)
        last, good, drove, rig = next(one)
        if good or not left:
            break
        one.close()
    assert drove, "the machine is too busy: the car tripped before"
    return last, rig, one


def test_neutral_is_at_the_pin_and_the_next_program_is_armed_by_hand(tmp_path):
    last, rig, held = measure_kill(tmp_path)
    assert last <= NEUTRAL_MS
    with serve_page(rig, arms=False) as (_, hand):
        began = time.monotonic()
        until(lambda: hand.sent > 30)
        assert rig.last_wrong(began) == 0.0, "a stick that is held moves nothing"
        assert hand.mode == "DISARMED"
    with serve_page(rig) as (_, hand):
        until(lambda: rig.drove(time.monotonic()))
        assert hand.mode == "ARMED"
    held.close()


def test_control_without_the_guard_it_drives_on(tmp_path):
    with remove_layers("guard"):
        last, _, held = measure_kill(tmp_path)
        held.close()
    assert last > NEUTRAL_MS
