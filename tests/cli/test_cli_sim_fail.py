"""``dart-hal sim --fail``: failures by option, refused at once when there is no such thing."""

from __future__ import annotations

import pytest

from dart_lab.cli import sim
from dart_lab.sim.truth import world_of
from tests.common import MOCK_URL


@pytest.fixture
def capture_backend(monkeypatch):
    """The backend that `--pty` would serve, instead of serving it."""
    opened = []
    monkeypatch.setattr(sim, "_serve", lambda url, *_: opened.append(sim.open_backend(url.text)))
    yield opened
    for backend in opened:
        backend.close()


def test_failures_reach_the_car(verb, capture_backend):
    done = verb("sim", "--pty", "--url", MOCK_URL, "--fail", "mcu:brownout@0.2s",
                "--fail", "power:droop=4.5@0.1s+0.2s")
    assert done.code == 0
    (backend,) = capture_backend
    nano = world_of(backend).nano
    backend.clock.sleep(0.15)
    assert (nano.boot_count, nano._vcc) == (1, 4.5)
    backend.clock.sleep(0.25)
    assert (nano.boot_count, nano._vcc) == (2, 5.0)


@pytest.mark.parametrize("text", ["imu:sulking@3s", "imu:stuck", "enc:wrong=2@1"])
def test_a_wrong_failure_is_refused_before_anything_starts(verb, capture_backend, text):
    error = verb("sim", "--pty", "--url", MOCK_URL, "--fail", text, "--json").error
    assert "USE" in error["code"]
    assert not capture_backend


def test_the_refusal_lists_what_exists(verb):
    message = verb("sim", "--pty", "--fail", "imu:sulking@3s").err
    assert "imu:stuck" in message
    assert "enc:wrong=SHARE" in message


def test_failures_in_the_url_and_by_option_are_one_too_many(verb, capture_backend):
    error = verb("sim", "--pty", "--url", MOCK_URL + "&fail=imu:off@1", "--fail", "imu:stuck@2",
                 "--json").error
    assert "twice" in error["what"]
