"""``--foxglove`` and ``--operate``: what the verbs say, refuse, and do when the operator goes."""

from __future__ import annotations

import json
import socket
import struct
import subprocess
import sys
import time

import pytest
from websockets.sync.client import connect

from dart_hal.recording.run import RunReader

MOCK = "sim://?seed=7&nano=mock"
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
        error = verb("drive", script, "--url", MOCK, "--foxglove", "--port", port, "--json").error
    assert error["what"] == f"port {port} cannot be served"
    assert "in use" in error["found"]


def test_it_says_where_to_look(verb, tmp_path, free_port):
    told = verb("record", "--url", MOCK, "--duration", 0.3, "--out", tmp_path / "run.mcap",
                "--foxglove", "--port", free_port)
    assert f"ws://localhost:{free_port}" in told.err
    assert "layout.json" in told.err


@pytest.mark.more
def test_the_verb_ends_when_its_operator_goes(tmp_path, free_port):
    verb = subprocess.Popen(
        [sys.executable, "-m", "dart_hal.cli.main", "drive", "--operate", "--url", MOCK, "--port",
         str(free_port), "--record", str(tmp_path / "run.mcap"), "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    try:
        while "armed; who" not in (line := verb.stderr.readline()):
            assert line, "it has ended"
        with connect(f"ws://localhost:{free_port}", close_timeout=0.5,
                     subprotocols=["foxglove.websocket.v1"]) as client:
            client.send(json.dumps({"op": "advertise", "channels": [
                {"id": 5, "topic": "/cmd_vel", "encoding": "json", "schemaName": "Twist"}]}))
            twist = json.dumps({"linear": {"x": 0.5}, "angular": {"z": 0.0}}).encode()
            for _ in range(30):
                client.send(struct.pack("<BI", 1, 5) + twist)
                time.sleep(0.05)
        out, err = verb.communicate(timeout=30)
    finally:
        verb.kill()
    assert verb.returncode == 0
    assert "the operator has gone" in err
    assert json.loads(out)["summary"]["distance_m"] > 0.1
    assert {c.source for c in RunReader(tmp_path / "run.mcap").commands()} == {"foxglove"}
