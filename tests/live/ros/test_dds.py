"""The core's CDR on DDS as ROS 2 uses it: topics rt/..., its type names, Cyclone DDS, no ROS.

What rclpy does in addition (its executor, discovery of nodes, quality of service) is not tested.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from ros_types import classes_of

from dart_hal.car import Car
from dart_hal.recording.run import RunReader
from dart_lab.live.ros.commands import Commands
from dart_lab.live.ros.messages import build_object
from dart_lab.live.ros.told import TopicWriter

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from dds_peer import RELIABLE
from dds_types import HEARD, TOPICS, Float32

ROS_FOLDER = Path(__file__).parent
LOOP = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/>" \
        "</Interfaces></General><Discovery><Peers><Peer address='localhost'/></Peers>" \
        "<ParticipantIndex>auto</ParticipantIndex></Discovery></Domain></CycloneDDS>"
"""This computer's loopback, and a domain of its own."""
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def payloads(tmp_path_factory):
    """{rt/topic: CDR payloads}: of the recorder, and of the ROS 2 bridge."""
    path, published, (class_of, store) = (tmp_path_factory.mktemp("run") / "run.mcap",
                                          TopicWriter(1, 0.08, simulated=False),
                                          classes_of("ROS2_HUMBLE"))
    found = {topic: [] for topic in TOPICS}
    with Car.open("sim://?nano=mock&seed=1", record=path) as car:
        for state in car.states(duration=1.0):
            car.drive(steering=0.1)
            for topic, message in published.messages(state, (1.0, 0.2, 0.1), 1.7e9):
                if f"rt/{topic}" in found:
                    made = build_object(message, class_of)
                    found[f"rt/{topic}"].append(bytes(store.serialize_cdr(made,
                                                                          made.__msgtype__)))
    for message in RunReader(path).messages():
        if f"rt{message.topic}" in found:
            found[f"rt{message.topic}"].append(message.data)
    return found


def same_cdr(data, sample):
    """Whether Cyclone's bytes are ours; it may pad the end to four, and notes that it did."""
    other = sample.serialize(use_version_2=False)
    return data[:2] == other[:2] and data[4:] == other[4:][:len(data) - 4]


@pytest.mark.parametrize("topic", TOPICS)
def test_another_implementation_reads_the_bytes_and_writes_the_same(payloads, topic):
    assert len(payloads[topic]) > 20
    for data in payloads[topic]:
        assert same_cdr(data, TOPICS[topic].deserialize(data))


def test_control_a_byte_that_is_wrong_is_detected(payloads):
    data = bytearray(payloads["rt/odom"][0])
    data[-3] ^= 1
    sample = TOPICS["rt/odom"].deserialize(bytes(payloads["rt/odom"][0]))
    assert not same_cdr(bytes(data), sample)


def test_topics_of_ros_2_go_to_another_process_and_come_from_it(payloads, monkeypatch):
    monkeypatch.setenv("CYCLONEDDS_URI", LOOP)
    monkeypatch.setenv("ROS_DOMAIN_ID", "77")
    count = sum(map(len, payloads.values()))
    peer = subprocess.Popen([sys.executable, ROS_FOLDER / "dds_peer.py", str(count)], text=True,
                            stdout=subprocess.PIPE, env=dict(os.environ))
    domain = DomainParticipant()
    writers = {topic: DataWriter(domain, Topic(domain, topic, kind), qos=RELIABLE)
               for topic, kind in TOPICS.items()}
    throttle = DataReader(domain, Topic(domain, HEARD, Float32), qos=RELIABLE)
    until(lambda: all(writer.get_matched_subscriptions() for writer in writers.values()))
    for topic, sent in payloads.items():
        for data in sent:
            writers[topic].write(TOPICS[topic].deserialize(data))
    commands = Commands()
    heard = []
    until(lambda: heard.extend(throttle.take(N=10)) or heard)
    commands.throttle(heard[0].data, 1.0)
    assert commands.upstream_inputs(1.0) == (0.0, 0.25, 0.0)
    out, _ = peer.communicate(timeout=30)
    assert json.loads(out) == {
        topic: [TOPICS[topic].deserialize(d).serialize(use_version_2=False).hex() for d in sent]
        for topic, sent in payloads.items()}


def until(done, seconds=10.0):
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end, "no node was found"
        time.sleep(0.02)
