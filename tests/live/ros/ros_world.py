"""A ROS master, nodes and an emulated car in processes of their own, with Debian's rospy."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from xmlrpc.client import ServerProxy

HERE = Path(__file__).parent
PAUSES_S = (0.0, 1.0, 4.0, 16.0, 30.0)  # before each attempt to drive
DEBIAN = "/usr/lib/python3/dist-packages"
MISSING = ("no ROS here: sh firmware/toolchain.sh --apt python3-rosmaster python3-rospy "
           "python3-nav-msgs python3-sensor-msgs python3-tf2-ros")


def is_installed():
    """Whether Debian has ROS for the Python that runs this."""
    return shutil.which("rosmaster") is not None and all(
        (Path(DEBIAN) / name).is_dir() or importlib.util.find_spec(name)
        for name in ("rospy", "nav_msgs", "sensor_msgs", "tf2_msgs"))


def upstream_nodes():
    """The folder of DART's own nodes; None where it is not."""
    folder = Path(os.environ.get("DART_UPSTREAM_ROS")
                  or HERE.parents[3] / "shared" / "upstream_ros")
    return folder if (folder / "v_tracking_controller.py").is_file() else None


class RosWorld(ExitStack):
    """``start(script, ...)``: a process that ends with the block."""

    def __init__(self, folder: Path):
        super().__init__()
        self.folder = folder
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        behind = folder / "path"  # Debian's packages behind those of the environment
        behind.mkdir()
        (behind / "sitecustomize.py").write_text(f"import sys\nsys.path.append({DEBIAN!r})\n")
        self.ros = {**os.environ, "ROS_IP": "127.0.0.1",
                    "ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_HOME": str(folder / "ros"),
                    "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "car_number": "1"}
        paths = [str(behind), os.environ.get("PYTHONPATH", "")]
        self.env = {**self.ros, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
        self.port = port

    def __enter__(self):
        master = [shutil.which("rosmaster"), "--core", "-p", str(self.port)]
        self._run("rosmaster", master, self.ros)
        until(self._listens, 20.0)
        assert self._listens(), (self.folder / "rosmaster.log").read_text()
        return self

    def _listens(self):
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def published_topics(self):
        """Names of the topics that a node has registered at the master."""
        master = ServerProxy(self.ros["ROS_MASTER_URI"])
        _, _, (publishers, _, _) = master.getSystemState("/test")
        return {topic for topic, _ in publishers}

    def start(self, script, *args):
        """A Python script in a process; its output is kept in the folder."""
        words = [sys.executable, str(script), *map(str, args)]
        return self._run(Path(script).name, words, self.env)

    def _run(self, name, words, env):
        log = self.enter_context((self.folder / f"{name}.log").open("wb"))
        process = subprocess.Popen(words, env=env, stdin=subprocess.PIPE, stdout=log,
                                   stderr=subprocess.STDOUT)
        self.callback(self._end, process)
        return process

    def _end(self, process, interrupted=False):
        """interrupted: it ends by itself at the end of its standard input."""
        process.stdin.close()
        if not interrupted:
            process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _driver_is_ready(self):
        return "ready" in (self.folder / "driver_node.py.log").read_text()

    def drive(self, mode, *url):
        """What the node of ``driver_node.py`` saw, and the pulses of the car's ESC.

        A computer that is too busy for the emulated car starves its link, which refuses to arm or
        trips, as it has to. So the car starts after all nodes have loaded their libraries (topics
        alone do not tell: the master keeps those of a node that was killed), and a
        starved drive is repeated after a pause, in which other work of the computer may end.
        """
        commands = {f"/{name}" for name in ("safety_value", "steering_1", "throttle_1")}
        for pause in PAUSES_S:
            time.sleep(pause)
            pins = self.folder / "pins.json"
            report = self.folder / "seen.json"
            driver = self.start(HERE / "driver_node.py", mode, report)
            until(self._driver_is_ready, 30.0)
            until(lambda: commands <= self.published_topics(), 30.0)
            assert commands <= self.published_topics(), self.published_topics()
            car = self.start(HERE / "car_node.py", pins, *url)
            until(partial(one_ended, driver, car), 60.0)
            early = car.poll() is not None
            self._end(car, interrupted=True)
            car_log = (self.folder / "car_node.py.log").read_text()
            if car.returncode and ("LINK_STALE" in car_log or "LINK_NOT_GOOD" in car_log):
                self._end(driver)
                continue
            assert not early, car_log
            assert car.returncode == 0, car_log
            assert driver.poll() == 0, (self.folder / "driver_node.py.log").read_text()
            return json.loads(report.read_text()), json.loads(pins.read_text())
        raise AssertionError(car_log)


def one_ended(*processes):
    return any(process.poll() is not None for process in processes)


def until(done, seconds):
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        time.sleep(0.1)
