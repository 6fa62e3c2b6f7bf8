"""Foxglove's own packages, as npm has them: they decode a recording, and watch a served car."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.recording.run import RunReader

NPM_FOLDER = Path(__file__).parent
PACKAGES = ("@mcap/core@2", "@foxglove/rosmsg@5", "@foxglove/rosmsg2-serialization@3",
            "@foxglove/ws-protocol@0.8", "ws@8")
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def node(tmp_path_factory):
    """Runs a script of this folder with the packages, and gives what it printed."""
    folder = tmp_path_factory.mktemp("npm")
    if not shutil.which("npm"):
        pytest.skip("npm is absent")
    installed = subprocess.run(["npm", "install", "--silent", *PACKAGES], cwd=folder, text=True,
                               capture_output=True, check=False)
    if installed.returncode:
        pytest.skip(f"npm cannot install: {installed.stderr[-200:]}")

    def run(script, argument):
        shutil.copy(NPM_FOLDER / script, folder)
        done = subprocess.run(["node", script, str(argument)], cwd=folder, text=True,
                              capture_output=True, check=True, timeout=120)
        return json.loads(done.stdout)

    return run


def test_they_decode_every_message_of_a_recording(node, tmp_path):
    path = tmp_path / "run.mcap"
    with Car.open("sim://?seed=1&nano=mock&lidar=1&camera=top", record=path) as car:
        for n, _ in enumerate(car.states(duration=1.0)):
            car.drive(steering=0.1)
            car.log("cost", n)
            car.log("plan", np.eye(3))
    assert node("decode.mjs", path) == Counter(m.topic for m in RunReader(path).messages())


def test_their_client_sees_every_channel(node, serving):
    with serving() as driven:
        driven.car.on_state(lambda state: driven.car.drive(steering=0.0))
        received = node("watch.mjs", f"ws://localhost:{driven.server.port}")
    assert {"/rx", "/tx", "/odom", "/imu", "/drive", "/applied",
            "/command"} == set(received["counts"])
    assert received["counts"]["/odom"] > 200
