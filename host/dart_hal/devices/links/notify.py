"""Words to systemd (sd_notify): ready, alive, what it is doing.

A datagram to the socket that $NOTIFY_SOCKET names; its protocol is stable and
a line long, so no library is needed. Without that variable nothing happens.
"""

from __future__ import annotations

import os
import socket


def notify(*words: str) -> bool:
    """Send ``READY=1``, ``WATCHDOG=1``, ``STATUS=...``; whether somebody listens.

    A manager that does not take the message is not the car's trouble: False.
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
