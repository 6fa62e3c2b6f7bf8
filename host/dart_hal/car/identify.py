"""The handshake: who answers, at which baud rate, within which time.

After an open that may have reset the Nano nothing is sent for 1.6 s: a byte
restarts ATmegaBOOT's time-out, and HELLO comes unasked. Then HELLO_REQ each
100 ms; only then the next rate.
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.car.identity import Hello
from dart_hal.errors import NoHello
from dart_hal.links.base import Backend
from dart_hal.links.serial_port import RealClock, SerialLink
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


def ask_hello(seq: int) -> bytes:
    """A HELLO_REQ with this host's versions; asks for DIAG as well."""
    return encode(HELLO_REQ, seq, {"proto": PROTO, "schema": SCHEMA, "flags": 1})


def await_hello(backend: Backend, poll: Callable[[float], Hello | None],
                ask: Callable[[], None]) -> Hello:
    """Drive ``poll(timeout)`` until HELLO is there; tries every rate of the link.

    Raises NoHello, naming the rates that were tried.
    """
    rates: tuple[int, ...] = getattr(backend.link, "rates", ())
    for number, rate in enumerate(rates or (0,)):
        if number:
            backend.link.set_baud(rate)  # type: ignore[attr-defined]
        listen = LISTEN if number == 0 and backend.resets else 0.0
        hello = _at_one_rate(backend, poll, ask, listen, ASK if listen else ASK_UNRESET)
        if hello is not None:
            return hello
    raise NoHello(f"no DART firmware answers on {backend.url.text}",
                  found="no valid HELLO at " + (", ".join(f"{r} baud" for r in rates)
                                                or "this backend"))


def _at_one_rate(backend: Backend, poll: Callable[[float], Hello | None],
                 ask: Callable[[], None], listen: float, asking: float) -> Hello | None:
    clock = backend.clock
    start = clock.now()
    next_ask = start + listen
    while (now := clock.now()) < start + listen + asking:
        if now >= next_ask:
            ask()
            next_ask = now + ASK_EVERY
        hello = poll(min(next_ask, start + listen + asking) - now + 1e-6)
        if hello is not None:
            return hello
    return None


def identify_port(device: str) -> Hello:
    """HELLO of the Nano on a serial port, with nothing else opened.

    Raises PortMissing, PortBusy, PortDenied, LinkLost, NoHello.
    """
    from dart_hal.links.base import Url

    link = SerialLink(device)
    decoder = Decoder(UP)
    seq = 0

    def poll(timeout: float) -> Hello | None:
        chunk = link.read(timeout)
        for frame in decoder.feed(chunk.data) if chunk else ():
            if frame.message is HELLO:
                return Hello.from_frame(frame.as_dict())
        return None

    def ask() -> None:
        nonlocal seq
        link.write(ask_hello(seq))
        seq += 1

    try:
        backend = Backend(Url.parse(f"serial://{device}"), link, RealClock(), None, False)
        return await_hello(backend, poll, ask)
    finally:
        link.close()
