"""Discovery of rooms by mDNS (zeroconf), or from a list.

A room is a service ``_dart-hal._udp.local.`` with the name of a car in it; its record ``room``
holds the URL for joining. Without the package zeroconf only lists are available.
"""

from __future__ import annotations

import os
import socket
import time
from contextlib import suppress
from typing import Any

from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command
from dart_hal.core.url import Url

SERVICE = "_dart-hal._udp.local."
# Environment variable: URLs of rooms, separated by spaces.
ROOM_VARIABLE = "DART_HAL_ROOM"


def list_rooms(rooms: tuple[str, ...]) -> tuple[str, ...]:
    """Return the given rooms, else those of $DART_HAL_ROOM."""
    return rooms or tuple(os.environ.get(ROOM_VARIABLE, "").split())


class Announcement:
    """Announces a car in a room until ``close``. Raises UsageError without zeroconf."""

    def __init__(self, name: str, room: str) -> None:
        zeroconf = _zeroconf()
        url = Url.parse(room)
        port = int(url.target.rpartition(":")[2]) if url.scheme == "udp" else 0
        self._network = zeroconf.Zeroconf()
        address = [socket.inet_aton(own_address())]
        self._info = zeroconf.ServiceInfo(SERVICE, f"{name}.{SERVICE}", addresses=address,
                                          port=port, properties={"room": room, "car": name})
        self._network.register_service(self._info, allow_name_change=True)

    def close(self) -> None:
        """Withdraw the announcement; idempotent."""
        with suppress(Exception):  # the network may be gone
            self._network.unregister_service(self._info)
        self._network.close()


def discover_rooms(seconds: float) -> dict[str, str]:
    """Return car: room of the announcements received within ``seconds`` s. Raises UsageError."""
    zeroconf = _zeroconf()
    network = zeroconf.Zeroconf()
    rooms: dict[str, str] = {}

    class Listener(zeroconf.ServiceListener):  # type: ignore[misc, name-defined]
        def add_service(self, net: Any, kind: str, name: str) -> None:
            info = net.get_service_info(kind, name, 1000)
            properties = {} if info is None else info.properties
            car = properties.get(b"car")
            room = properties.get(b"room")
            if car and room:
                rooms[car.decode("utf-8", "replace")] = room.decode("utf-8", "replace")

        update_service = add_service

        def remove_service(self, net: Any, kind: str, name: str) -> None:
            """Keep the room: it may still be reachable."""

    browser = zeroconf.ServiceBrowser(network, SERVICE, Listener())
    time.sleep(seconds)
    browser.cancel()
    network.close()
    return dict(sorted(rooms.items()))


def own_address() -> str:
    """Address of the interface with the default route; 127.0.0.1 without. Sends nothing."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return "127.0.0.1"


def _zeroconf() -> Any:
    try:
        import zeroconf
    except ImportError as why:
        raise UsageError("cars are found by mDNS with the package zeroconf", found=str(why),
                         expected="it is installed, or a room is named",
                         remedy=f"{install_command('fleet')} ; or --room "
                                "udp://239.255.42.99:7447") from why
    return zeroconf
