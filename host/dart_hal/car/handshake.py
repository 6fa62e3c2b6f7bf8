"""The handshake: find the board and its baud rate.

1. After an opening that may have reset the Nano, send nothing for 1.6 s: a byte would restart
   the time-out of its bootloader. HELLO arrives without a request.
2. Send HELLO_REQ each 100 ms.
3. Repeat step 2 at the next rate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from dart_hal.car.identity import Hello
from dart_hal.core.errors import NoHello
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import HELLO, HELLO_REQ, PROTO, SCHEMA

if TYPE_CHECKING:
    from dart_hal.devices.links.serial_port import SerialLink

# s without a request after a reset: bootloader 1.33 s, then the first HELLO.
BOOT_SILENCE = 1.6
# s of requests after that, 2.5 s in all.
REQUEST_TIME = 0.9
# s between two requests.
REQUEST_INTERVAL = 0.1
# s of requests per rate when the port was open already.
REQUEST_TIME_WITHOUT_RESET = 0.3


class HelloRequester(Protocol):
    """Sender of requests: the engine of a Car, or a port alone."""

    @property
    def bytes_received(self) -> int:
        """Return the number of bytes received at this rate."""

    def poll(self, timeout: float) -> Hello | None:
        """Read for up to ``timeout`` s; return HELLO if it has arrived. Raises LinkLost."""

    def request_hello(self) -> None: ...
    def set_rate(self, baud: int) -> None: ...


def await_hello(backend: Backend, requester: HelloRequester) -> Hello:
    """Poll until HELLO arrives; try every rate of the link, the open one first.

    Raises NoHello with the rates that were tried and the bytes received at each.
    """
    link = backend.link
    others = [rate for rate in link.rates if rate != link.baud]
    received = []
    for number, rate in enumerate((link.baud, *others)):
        if number:
            requester.set_rate(rate)
        # Only the first rate follows an opening, which may have reset the Nano.
        silence = BOOT_SILENCE if number == 0 and backend.resets else 0.0
        request_time = REQUEST_TIME if silence else REQUEST_TIME_WITHOUT_RESET
        hello = _await_hello_at_rate(backend, requester, silence, request_time)
        if hello is not None:
            return hello
        answer = _describe_bytes(requester.bytes_received)
        received.append((f"at {rate} baud " if rate else "") + answer)
    raise NoHello(f"no DART firmware answers on {backend.url.text}",
                  found="no valid HELLO: " + ", ".join(received),
                  expected="a HELLO within 2.5 s of opening, or 0.3 s of request_time")


def _describe_bytes(n: int) -> str:
    return f"{n} bytes that are no frame of ours" if n else "not one byte"


def _await_hello_at_rate(backend: Backend, requester: HelloRequester, silence: float,
                         request_time: float) -> Hello | None:
    clock = backend.clock
    start = clock.now()
    next_request = start + silence
    while (now := clock.now()) < start + silence + request_time:
        if now >= next_request:
            requester.request_hello()
            next_request = now + REQUEST_INTERVAL
        hello = requester.poll(min(next_request, start + silence + request_time) - now)
        if hello is not None:
            return hello
    return None


class HelloPort:
    """A serial port without a car; ``received``: all bytes so far."""

    def __init__(self, link: SerialLink) -> None:
        self._link = link
        self._decoder = FrameDecoder(UP)
        self._seq = 0
        self.bytes_received = 0
        self.received = bytearray()

    def poll(self, timeout: float) -> Hello | None:
        """Read for up to ``timeout`` s; return HELLO if it has arrived. Raises LinkLost."""
        chunk = self._link.read(timeout)
        if chunk is None:
            return None
        self.bytes_received += len(chunk.data)
        self.received += chunk.data
        for frame in self._decoder.feed(chunk.data):
            if frame.message is HELLO:
                return Hello.from_frame(frame.as_dict())
        return None

    def request_hello(self) -> None:
        """Send a HELLO_REQ."""
        request = {"proto": PROTO, "schema": SCHEMA, "flags": 1}
        self._link.write(encode(HELLO_REQ, self._seq, request))
        self._seq = (self._seq + 1) & 0xFF

    def set_rate(self, baud: int) -> None:
        """Change the line rate; bytes received before it were noise."""
        self._link.set_baud(baud)
        self._decoder = FrameDecoder(UP)
        self.bytes_received = 0


def identify_port(device: str) -> Hello:
    """Return HELLO of the Nano on a serial port, without opening a car.

    Raises PortMissing, PortBusy, PortDenied, LinkLost, NoHello.
    """
    from dart_hal.devices.links.serial_port import RealClock, SerialLink

    link = SerialLink(device)
    try:
        backend = Backend(Url.parse(f"serial://{device}"), link, RealClock(), None, False)
        return await_hello(backend, HelloPort(link))
    finally:
        link.close()
