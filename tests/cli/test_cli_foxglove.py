"""``--foxglove``: what the verbs print and refuse."""

from __future__ import annotations

import socket

import pytest

from tests.common import MOCK_7_URL

pytestmark = pytest.mark.realtime


@pytest.fixture
def free_port():
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        return probe.getsockname()[1]


def test_a_port_in_use_is_refused_before_the_car_is_armed(verb, tmp_path):
    script = tmp_path / "mine.py"
    script.write_text("def control(state):\n    return 0.0, 0.1\n")
    with socket.socket() as taken:
        taken.bind(("localhost", 0))
        taken.listen()
        port = taken.getsockname()[1]
        error = verb("drive", script, "--url", MOCK_7_URL, "--foxglove", "--port", port,
                     "--json").error
    assert error["what"] == f"port {port} cannot be served"
    assert "in use" in error["found"]


def test_it_names_where_to_look(verb, tmp_path, free_port):
    output = verb("record", "--url", MOCK_7_URL, "--duration", 0.3, "--out", tmp_path / "run.mcap",
                  "--foxglove", "--port", free_port)
    assert f"ws://localhost:{free_port}" in output.err
    assert "layout.json" in output.err
