"""The handshake: who answers, at which baud rate, within which time.

After an open that may have reset the Nano nothing is sent for 1.6 s: a byte
restarts ATmegaBOOT's time-out, and HELLO comes unasked. Then HELLO_REQ each
100 ms; only then the next rate.
"""

from __future__ import annotations

from typing import Protocol

from dart_hal.car.identity import Hello
from dart_hal.core.errors import NoHello
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend
from dart_hal.devices.links.serial_port import RealClock, SerialLink
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.decoder import Decoder
from dart_hal.wire.messages import HELLO, HELLO_REQ, PROTO, SCHEMA

LISTEN = 1.6
"""s of silence after a reset: bootloader 1.33 s, then the first HELLO."""
ASK = 0.9
"""s of asking after that; 2.5 s in all."""
ASK_EVERY = 0.1
ASK_UNRESET = 0.3
"""s per rate when the port was open already."""


class Caller(Protocol):
    """Who asks; the engine of a Car, or a port alone. ``came``: bytes at this rate."""

    @property
    def came(self) -> int: ...

    def poll(self, timeout: float) -> Hello | None:
        """Read for up to ``timeout`` s; HELLO once it is there. Raises LinkLost."""

    def ask(self) -> None: ...
    def at_rate(self, baud: int) -> None: ...


def await_hello(backend: Backend, caller: Caller) -> Hello:
    """Poll until HELLO is there; tries every rate of the link, the open one first.

    Raises NoHello, naming the rates that were tried and what came at each.
    """
    link = backend.link
    others = [rate for rate in link.rates if rate != link.baud]
    came = []
    for number, rate in enumerate((link.baud, *others)):
        if number:
            caller.at_rate(rate)
        listen = LISTEN if number == 0 and backend.resets else 0.0
        hello = _at_one_rate(backend, caller, listen, ASK if listen else ASK_UNRESET)
        if hello is not None:
            return hello
        came.append((f"at {rate} baud " if rate else "") + _bytes(caller.came))
    raise NoHello(f"no DART firmware answers on {backend.url.text}",
                  found="no valid HELLO: " + ", ".join(came),
                  expected="a HELLO within 2.5 s of opening, or 0.3 s of asking")


def _bytes(n: int) -> str:
    return f"{n} bytes that are no frame of ours" if n else "not one byte"


def _at_one_rate(backend: Backend, caller: Caller, listen: float, asking: float) -> Hello | None:
    clock = backend.clock
    start = clock.now()
    next_ask = start + listen
    while (now := clock.now()) < start + listen + asking:
        if now >= next_ask:
            caller.ask()
            next_ask = now + ASK_EVERY
        hello = caller.poll(min(next_ask, start + listen + asking) - now)
        if hello is not None:
            return hello
    return None


class Port:
    """A serial port with nothing else opened; ``heard`` is all that came."""

    def __init__(self, link: SerialLink) -> None:
        self._link = link
        self._decoder = Decoder(UP)
        self._seq = 0
        self.came = 0
        self.heard = bytearray()

    def poll(self, timeout: float) -> Hello | None:
        chunk = self._link.read(timeout)
        if chunk is None:
            return None
        self.came += len(chunk.data)
        self.heard += chunk.data
        for frame in self._decoder.feed(chunk.data):
            if frame.message is HELLO:
                return Hello.from_frame(frame.as_dict())
        return None

    def ask(self) -> None:
        wanted = {"proto": PROTO, "schema": SCHEMA, "flags": 1}
        self._link.write(encode(HELLO_REQ, self._seq, wanted))
        self._seq = (self._seq + 1) & 0xFF

    def at_rate(self, baud: int) -> None:
        self._link.set_baud(baud)
        self._decoder, self.came = Decoder(UP), 0


def identify_port(device: str) -> Hello:
    """HELLO of the Nano on a serial port, with nothing else opened.

    Raises PortMissing, PortBusy, PortDenied, LinkLost, NoHello.
    """
    link = SerialLink(device)
    try:
        backend = Backend(Url.parse(f"serial://{device}"), link, RealClock(), None, False)
        return await_hello(backend, Port(link))
    finally:
        link.close()
