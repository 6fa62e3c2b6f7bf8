"""The messages of Foxglove's WebSocket protocol, version 1, as bytes and text.

https://github.com/foxglove/ws-protocol, docs/spec.md.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from struct import Struct
from typing import Any

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
"""Newest first; both begin with the messages below."""
_DATA = Struct("<BIQ")  # opcode, subscription, ns since 1970
_IS_DATA = 1

ERROR = 2
"""Level of a status message."""


class Malformed(ValueError):
    """What a client sent is none of the protocol's messages; says what is wrong with it."""


def server_info(name: str) -> str:
    """First message to a client: the server offers no capability beyond subscriptions."""
    return json.dumps({"op": "serverInfo", "name": name, "capabilities": [],
                       "supportedEncodings": [], "metadata": {}})


def advertise(channels: Mapping[int, tuple[str, str]], definitions: Mapping[str, str]) -> str:
    """Channels (topic, type) by number, in CDR, with their definitions by type."""
    return json.dumps({"op": "advertise", "channels": [
        {"id": number, "topic": topic, "encoding": "cdr", "schemaName": kind,
         "schemaEncoding": "ros2msg", "schema": definitions[kind]}
        for number, (topic, kind) in channels.items()]})


def status(level: int, message: str) -> str:
    return json.dumps({"op": "status", "level": level, "message": message})


def data(subscription: int, ns: int, payload: bytes) -> bytes:
    """A message of ours for one subscription."""
    return _DATA.pack(_IS_DATA, subscription, ns) + payload


def request(text: str) -> dict[str, Any]:
    """A client's text message, an object with an "op". Raises Malformed."""
    found = _json(text)
    if not isinstance(found, dict) or not isinstance(found.get("op"), str):
        raise Malformed("a text message without an op")
    return found


def pairs(request: Mapping[str, Any], key: str, first: str, second: str) -> list[tuple[Any, Any]]:
    """Two fields of each object in a list. Raises Malformed."""
    items = request.get(key)
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise Malformed(f"{request['op']} without a list of {key}")
    return [(item.get(first), item.get(second)) for item in items]


def _json(text: str | bytes) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise Malformed("no JSON") from error
