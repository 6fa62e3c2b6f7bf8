"""Messages to systemd (sd_notify): ready, watchdog, status.

Each is a datagram to the socket of $NOTIFY_SOCKET. The protocol is stable and simple, so no library
is needed. Without that variable nothing is sent.
"""

from __future__ import annotations

import os
import socket


def notify(*words: str) -> bool:
    """Send ``READY=1``, ``WATCHDOG=1``, ``STATUS=...``; return whether it was sent.

    A service manager that does not accept the message must not stop the car: it returns False.
    """
    path = os.environ.get("NOTIFY_SOCKET", "")
    if not path.startswith(("/", "@")):
        return False
    address = "\0" + path[1:] if path[0] == "@" else path
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
        line.setblocking(False)
        try:
            line.sendto("\n".join(words).encode(), address)
        except OSError:
            return False
    return True
