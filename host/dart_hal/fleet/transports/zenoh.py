"""``zenoh://ROOM``: over Eclipse zenoh (the extra ``fleet``).

Options: ``connect`` and ``listen``, each a zenoh end point such as tcp/10.0.0.11:7447; without
them zenoh scouts its network for peers. Frames go to the key dart-hal/fleet/ROOM.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Sequence
from typing import Any

from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.url import Url
from dart_hal.fleet.transports import Datagram

# Frames that wait: 10 s of 20 cars with 20 frames a second each.
MAX_QUEUED_FRAMES = 4096


def open_zenoh(url: Url) -> ZenohTransport:
    """Join a session. Raises UsageError, also where zenoh is not installed."""
    url.known("connect", "listen")
    try:
        import zenoh
    except ImportError as why:
        raise UsageError("zenoh:// needs the package eclipse-zenoh", found=str(why),
                         expected="it is installed", remedy=install_command("fleet")
                         ) from why
    config = zenoh.Config()
    for name in ("connect", "listen"):
        if name in url.options:
            config.insert_json5(f"{name}/endpoints", json.dumps([url.options[name]]))
    if "connect" in url.options or "listen" in url.options:
        config.insert_json5("scouting/multicast/enabled", "false")
    try:
        return ZenohTransport(url, zenoh.open(config))
    except zenoh.ZError as why:
        raise UsageError(f"{url.text}: zenoh does not open", found=str(why),
                         expected="connect=tcp/HOST:PORT that answers, or listen=tcp/0.0.0.0:PORT"
                         ) from why


class ZenohTransport:
    """One session of zenoh, whose own thread puts received frames into a queue."""

    def __init__(self, url: Url, session: Any) -> None:
        self.url = url.text
        self.trouble = ""
        self._session = session
        self._received: deque[tuple[bytes, float]] = deque(maxlen=MAX_QUEUED_FRAMES)
        key = f"dart-hal/fleet/{url.target.strip('/') or 'room'}"
        self._subscriber = session.declare_subscriber(key, self._take)
        self._publisher = session.declare_publisher(key)

    def _take(self, sample: Any) -> None:
        self._received.append((sample.payload.to_bytes(), elapsed()))

    def stamp(self, now: float) -> float:
        """Return the monotonic clock of the computer, which no time server changes."""
        return elapsed()

    def send(self, data: bytes, now: float) -> None:
        try:
            self._publisher.put(data)
            self.trouble = ""
        except Exception as why:  # noqa: BLE001 - what zenoh raises must not stop a car's loop
            self.trouble = str(why)

    def poll(self, now: float) -> Sequence[Datagram]:
        # The age is from the moment at which zenoh delivered a frame: it excludes the waiting time
        # in this queue from the transit that is estimated.
        now_by_line = elapsed()
        out = []
        while self._received:
            data, t = self._received.popleft()
            out.append(Datagram(data, max(now_by_line - t, 0.0)))
        return out

    def answer(self, source: object) -> None:
        """Do nothing: zenoh sends to all subscribers."""

    def close(self) -> None:
        if self._session is not None:
            self._session.close()
            self._session = None
