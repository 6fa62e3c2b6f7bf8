"""Who may see a page, and who may drive: origins and a token.

A browser says from which page a socket is opened. Any page that the person at the browser has open
could open one to localhost; only our own may. The token is for those who drive: it is in the
address that is printed, behind the #, and so never in a server's log.
"""

from __future__ import annotations

import hmac
import secrets
import socket
from dataclasses import dataclass, field

from dart_hal.car.viewers import PORT as PORT

LOOPBACK = ("localhost", "127.0.0.1", "[::1]")
LONGEST_NAME = 255
"""Characters of a host name (RFC 1035)."""


def own_addresses() -> tuple[str, ...]:
    """IPv4 addresses of this computer that others may reach; no packet is sent for it."""
    found: list[str] = []
    for route in ("192.0.2.1", "10.255.255.255"):  # no one needs to be there
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.connect((route, 9))
            except OSError:
                continue
            found.append(str(probe.getsockname()[0]))
    return tuple(dict.fromkeys(a for a in found if not a.startswith("127.")))


@dataclass(frozen=True)
class Access:
    """port: where it listens; lan: beyond this computer; names: by which it may be called."""

    port: int
    lan: bool = False
    token: str = field(default_factory=lambda: secrets.token_urlsafe(9), repr=False)
    names: tuple[str, ...] = ()

    @classmethod
    def at(cls, port: int, lan: bool, token: str | None = None) -> Access:
        """Of this computer. token None: a new one."""
        names = (*LOOPBACK, *((*own_addresses(), socket.gethostname()) if lan else ()))
        return cls(port, lan, token or secrets.token_urlsafe(9), names)

    def origins(self) -> tuple[str, ...]:
        """Pages that may open a socket."""
        return tuple(f"http://{name}:{self.port}" for name in self.names)

    def own_host(self, host: str) -> bool:
        """Whether a request was meant for this computer: no name of somebody else's domain may
        stand for it (DNS rebinding)."""
        return len(host) <= LONGEST_NAME and host in {f"{name}:{self.port}" for name in self.names}

    def may_drive(self, token: str) -> bool:
        """In a time that does not hang on how much of it was right."""
        return hmac.compare_digest(token.encode(), self.token.encode())

    @property
    def urls(self) -> tuple[str, ...]:
        """Addresses to open, token included; that for other computers first."""
        hosts = self.names[len(LOOPBACK):-1] if self.lan else ()
        return tuple(f"http://{host}:{self.port}/#{self.token}" for host in (*hosts, "localhost"))
