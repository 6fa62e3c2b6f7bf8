"""The shipped layout: its panels are in it, and its paths lead to numbers that a run holds."""

from __future__ import annotations

import json
from functools import reduce

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from dart_hal.recording.run import RunReader, RunWriter
from dart_lab.live.foxglove import LAYOUT

IMAGES = "/camera/image/compressed"
"""Which ``tests/car/test_images.py`` reads with other tools."""
CONTENT = json.loads(LAYOUT.read_text())


def panels(node):
    return [node] if isinstance(node, str) else panels(node["first"]) + panels(node["second"])


@pytest.fixture
def run(tmp_path):
    RunWriter(tmp_path / "run.mcap").close()
    return RunReader(tmp_path / "run.mcap")


def test_every_panel_is_placed_once():
    placed = panels(CONTENT["layout"])
    assert sorted(placed) == sorted(CONTENT["configById"])


def test_every_path_leads_to_a_number_of_a_run(run):
    paths = [path["value"] for panel in CONTENT["configById"].values()
             for path in panel.get("paths", [])]
    assert len(paths) >= 8
    types = run._mcap.types
    for path in paths:
        topic, *fields = path.split(".")
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(run.definitions[types[topic]], types[topic]))

        def field(kind, name, store=store):
            return dict(store.fielddefs[kind][1])[name][1]

        assert reduce(field, fields, types[topic])[0] in ("float64", "float32"), path


def test_every_topic_is_one_of_a_run_and_no_panel_publishes(run):
    configs = CONTENT["configById"].values()
    shown_car = {config["topicPath"] for config in configs if "topicPath" in config}
    shown_car |= {topic for config in configs for topic in config.get("topics", {})}
    assert shown_car - {"/external_pose"} <= set(run._mcap.types)
    assert CONTENT["configById"]["Image!camera"]["imageMode"]["imageTopic"] == IMAGES
    assert [config for config in configs if "publishRate" in config] == []
