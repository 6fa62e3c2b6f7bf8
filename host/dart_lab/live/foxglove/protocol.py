"""The messages of Foxglove's WebSocket protocol, version 1, as bytes and text.

https://github.com/foxglove/ws-protocol, docs/spec.md.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from struct import Struct
from typing import Any

# Newest first. The messages below are common to both.
SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
_DATA = Struct("<BIQ")  # opcode, subscription, ns since 1970
_IS_DATA = 1

# Level of a status message.
ERROR = 2


class MalformedRequest(ValueError):
    """A client sent a message that the protocol does not have; the text names the fault."""


def server_info(name: str) -> str:
    """Return the first message to a client: the server offers subscriptions only."""
    return json.dumps({"op": "serverInfo", "name": name, "capabilities": [],
                       "supportedEncodings": [], "metadata": {}})


def advertise(channels: Mapping[int, tuple[str, str]], definitions: Mapping[str, str]) -> str:
    """Return the message that offers channels (topic, type) by number, with definitions by type."""
    return json.dumps({"op": "advertise", "channels": [
        {"id": number, "topic": topic, "encoding": "cdr", "schemaName": kind,
         "schemaEncoding": "ros2msg", "schema": definitions[kind]}
        for number, (topic, kind) in channels.items()]})


def status(level: int, message: str) -> str:
    """Return a status message for the user of a client."""
    return json.dumps({"op": "status", "level": level, "message": message})


def data(subscription: int, ns: int, payload: bytes) -> bytes:
    """Return a message of a channel for one subscription; ns: time since 1970."""
    return _DATA.pack(_IS_DATA, subscription, ns) + payload


def request(text: str) -> dict[str, Any]:
    """Parse a text message of a client: an object with an "op". Raises MalformedRequest."""
    found = _json(text)
    if not isinstance(found, dict) or not isinstance(found.get("op"), str):
        raise MalformedRequest("a text message must be an object with the text field op")
    return found


def pairs(request: Mapping[str, Any], key: str, first: str, second: str) -> list[tuple[Any, Any]]:
    """Return two fields of each object in a list. Raises MalformedRequest."""
    items = request.get(key)
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise MalformedRequest(f"{request['op']} without a list of {key}")
    return [(item.get(first), item.get(second)) for item in items]


def _json(text: str | bytes) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MalformedRequest("the message is not JSON") from error
