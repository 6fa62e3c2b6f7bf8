"""``dart-hal drive SCRIPT --view``: the script drives, its page is there, STOP is at the pin."""

from __future__ import annotations

import threading
import time
from urllib.request import urlopen

import pytest

from dart_hal.car import Car
from dart_hal.cli.main import main
from dart_lab.live.view import serve
from dart_lab.live.view.desk import Desk
from dart_lab.sim.truth import world_of
from tests.live.view.at_the_desk import driving
from tests.live.view.sockets import join, send_message, until

pytestmark = [pytest.mark.realtime, pytest.mark.slow]
CONTROL_SCRIPT = "def control(state):\n    return 0.1, 0.3\n"
STOP_DELAY_S = 0.050


class Watcher(threading.Thread):
    """Somebody who opens the page that the verb serves, and presses STOP while the car drives."""

    def __init__(self):
        super().__init__(daemon=True)
        self.served = threading.Event()
        self.page = b""
        self.begin = {}
        self.pulses = []
        self.pressed, self.heard, self.news = 0.0, 0.0, threading.Event()

    def serve(self, car):
        """In place of ``Car.view``: on a free port, and with an eye on the ESC's pin."""
        world_of(car._engine.backend).watchers.append(
            lambda channel, pulse: self.pulses.append(pulse) if channel == 1 else None)
        self.car, self.live = car, serve.serve(car, port=0)
        self.served.set()
        return self.live

    def hears(self, stop):
        """A ``Desk._stop`` that records when it was called."""
        def heard(desk, now):
            self.heard = self.car.now
            self.news.set()
            stop(desk, now)
        return heard

    def run(self):
        assert self.served.wait(10.0)
        with urlopen(self.live.urls[0].partition("#")[0]) as answer:
            self.page = answer.read()
        with join(self.live) as socket:
            self.begin = until(socket, "begin")
            ends = time.monotonic() + 15.0
            while not driving(self.pulses, self.car.now - 0.1) and time.monotonic() < ends:
                time.sleep(0.02)
            time.sleep(0.5)
            self.pressed = self.car.now
            send_message(socket, type="stop")
            assert self.news.wait(15.0)


@pytest.fixture
def stop_from_page(monkeypatch, tmp_path, capsys):
    """(who pressed STOP, exit code, what was printed), once the verb has ended."""
    def run(stop=Desk._stop):
        script = tmp_path / "bend.py"
        watcher = Watcher()
        script.write_text(CONTROL_SCRIPT)
        monkeypatch.setattr(Car, "view", lambda car: watcher.serve(car))
        monkeypatch.setattr(Desk, "_stop", watcher.hears(stop))
        watcher.start()
        with pytest.raises(SystemExit) as left:
            main(["drive", str(script), "--view", "--url", "sim://?nano=mock", "--duration", "10"])
        watcher.join(20.0)
        captured = capsys.readouterr()
        return watcher, int(left.value.code or 0), captured.out + captured.err
    return run


def test_the_script_drives_and_the_page_stops_it(stop_from_page):
    watcher, code, output = stop_from_page()
    assert watcher.live.urls[-1] in output
    assert b"<title>" in watcher.page
    assert watcher.begin["drives"] is False, "the script has the wheel"
    assert driving(watcher.pulses, watcher.pressed - 0.1), "it drove until then"
    assert max(fall for _, fall in driving(watcher.pulses, 0.0)) - watcher.heard <= STOP_DELAY_S
    assert code != 0
    assert "RUN_STOP" in output


def test_control_a_stop_that_is_not_obeyed_shows_at_the_pin(stop_from_page):
    watcher, _, output = stop_from_page(lambda desk, now: None)
    assert driving(watcher.pulses, watcher.heard + 0.3), output
    # Not the exit code: where the computer stalls in these ten seconds, the car stops by itself.
    assert "RUN_STOP" not in output
