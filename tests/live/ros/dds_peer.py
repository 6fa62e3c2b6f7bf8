"""A DDS participant in a process of its own, without ROS: hears ``TOPICS``, publishes a throttle.

    python dds_peer.py N: ends behind N samples and prints {topic: [hex of each sample's CDR]}
"""

from __future__ import annotations

import json
import sys
import time

from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from dds_types import HEARD, TOPICS, Float32

RELIABLE = Qos(Policy.Reliability.Reliable(2_000_000_000), Policy.History.KeepAll)


def main(count):
    domain = DomainParticipant()
    readers = {topic: DataReader(domain, Topic(domain, topic, kind), qos=RELIABLE)
               for topic, kind in TOPICS.items()}
    throttle = DataWriter(domain, Topic(domain, HEARD, Float32), qos=RELIABLE)
    heard = {topic: [] for topic in TOPICS}
    end = time.monotonic() + 20.0
    while sum(map(len, heard.values())) < count and time.monotonic() < end:
        throttle.write(Float32(0.25))
        for topic, reader in readers.items():
            heard[topic] += [sample.serialize(use_version_2=False).hex()
                             for sample in reader.take(N=100)]
        time.sleep(0.02)
    print(json.dumps(heard))


if __name__ == "__main__":
    main(int(sys.argv[1]))
