"""Access to a page: origins that may connect, and a token to drive.

A browser states the origin of the page that opens a socket. Any page in the browser could open one
to localhost, so only our own origins are accepted. The token allows driving. It is in the printed
address after the #, and so never in the log of a server.
"""

from __future__ import annotations

import hmac
import os
import secrets
import socket
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from dart_hal.car.viewers import VIEWER_PORT as VIEWER_PORT

LOOPBACK = ("localhost", "127.0.0.1", "[::1]")
# Characters of a host name (RFC 1035).
MAX_HOST_NAME_LENGTH = 255


# Shortest token that is read from the user's file.
MIN_TOKEN_LENGTH = 12


def token_file() -> Path:
    """Return the file with this user's token; without it the next page has a new token."""
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "dart-hal" / "page_token"


def load_token() -> str:
    """Return this user's token, which survives a restart of the program.

    The file is readable by its owner alone. A file that others can read, that is too short or
    cannot be written is not used: the token is then a new one.
    """
    path = token_file()
    new = secrets.token_urlsafe(9)
    with suppress(OSError, UnicodeDecodeError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
                file.write(new)
            return new
        known = path.read_text(encoding="ascii").strip()
        if not path.stat().st_mode & 0o077 and len(known) >= MIN_TOKEN_LENGTH:
            return known
    return new


def own_addresses() -> tuple[str, ...]:
    """Return IPv4 addresses at which others can reach this computer; sends no packet."""
    found: list[str] = []
    # A UDP socket that "connects" only selects a route: the addresses need not exist.
    for route in ("192.0.2.1", "10.255.255.255"):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.connect((route, 9))
            except OSError:
                continue
            found.append(str(probe.getsockname()[0]))
    return tuple(dict.fromkeys(a for a in found if not a.startswith("127.")))


# Port of HTTP, which an address need not name.
HTTP_PORT = 80


@dataclass(frozen=True)
class Access:
    """port: of the page. lan: open to other computers. names: host names that are accepted."""

    port: int
    lan: bool = False
    token: str = field(default_factory=lambda: secrets.token_urlsafe(9), repr=False)
    names: tuple[str, ...] = ()

    @classmethod
    def of_this_computer(cls, port: int, lan: bool, token: str | None = None) -> Access:
        """Return the access to a page of this computer; token None: a new one."""
        names = (*LOOPBACK, *((*own_addresses(), socket.gethostname()) if lan else ()))
        return cls(port, lan, token or secrets.token_urlsafe(9), names)

    def is_own_origin(self, origin: str, arrived_at: str = "") -> bool:
        """Return whether a page of this origin may open a socket; arrived_at: as ``is_own_host``.
        """
        scheme, _, host = origin.partition("://")
        return scheme == "http" and self.is_own_host(host, arrived_at)

    def is_own_host(self, host: str, arrived_at: str = "") -> bool:
        """Return whether a request names this computer.

        arrived_at: the address of this computer at which the connection arrived. It is accepted
        with ``lan``: a computer without a route to the internet does not know its addresses.
        Another domain that resolves to it (DNS rebinding) is refused: an address is no domain.
        """
        names = (*self.names, arrived_at) if self.lan and arrived_at else self.names
        own = {f"{name}:{self.port}".lower() for name in names}
        if self.port == HTTP_PORT:  # clients leave it out
            own |= {name.lower() for name in names}
        return len(host) <= MAX_HOST_NAME_LENGTH and host.lower() in own

    def may_drive(self, token: str) -> bool:
        """Return whether the token is right, in a time that does not depend on the token."""
        return hmac.compare_digest(token.encode(), self.token.encode())

    @property
    def urls(self) -> tuple[str, ...]:
        """Addresses of the page with the token; those for other computers first."""
        hosts = self.names[len(LOOPBACK):-1] if self.lan else ()
        return tuple(f"http://{host}:{self.port}/#{self.token}" for host in (*hosts, "localhost"))
