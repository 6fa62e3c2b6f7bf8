"""From bytes to States: decoder, dispatch by message, storage of the other messages."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from dart_hal.car.identity import Hello
from dart_hal.car.telemetry import Telemetry
from dart_hal.car.transmit import Transmitter
from dart_hal.core.types import Applied, State
from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import Counters, FrameDecoder
from dart_hal.wire.frame import WireFrame
from dart_hal.wire.ledger import T_CK
from dart_hal.wire.messages import (
    CAPTURE,
    DIAG,
    HELLO,
    PARAM_STATUS,
    PARAM_VALUE,
    STATE,
    TIME_PONG,
)
from dart_hal.wire.plausible import Gates

# Messages of the rarer kinds that wait for ``take_messages``.
MAX_QUEUED_MESSAGES = 64


class Receiver:
    """Decodes the bytes of the link; one per open car.

    Attributes:
        hello, diag: newest of each.
        params, captures: what the Nano has answered since its boot.
        inbox: other messages in order of arrival.
        boots: number of HELLOs of another boot.
        hello_stale: the Nano's clock restarted, and no HELLO has followed yet.
        sent_at: gives the time at which a recorded ping was sent.
        state_ck: Nano's clock in the newest STATE, in ticks.
        fed: number of bytes so far.
    """

    def __init__(self, telemetry: Telemetry, transmitter: Transmitter) -> None:
        self._telemetry = telemetry
        self._transmitter = transmitter
        self._decoder = FrameDecoder(UP, Gates())
        self.fed = 0
        self.state_ck = 0
        self._seq = -1
        self.hello: Hello | None = None
        self.hello_values: dict[str, Any] | None = None
        self.diag: dict[str, Any] = {}
        self.boots = 0
        self.params: dict[int, int] = {}
        self.captures: deque[dict[str, Any]] = deque(maxlen=4)
        self.hello_stale = False
        self._hello_new = False
        self.inbox: deque[WireFrame] = deque(maxlen=MAX_QUEUED_MESSAGES)
        # By name of a message: called with its values and the host time [s] of its arrival.
        self.handlers: dict[str, Callable[[dict[str, Any], float], None]] = {}
        self.on_boot: Callable[[], None] = lambda: None
        self.sent_at: Callable[[int], float | None] = lambda ping_id: None

    @property
    def counters(self) -> Counters:
        """Return the decoder's counters: frames good, lost, damaged."""
        return self._decoder.counters

    @property
    def schema_ok(self) -> bool:
        """Return whether the firmware has the message definitions of this host."""
        return self.hello is not None and self.hello.same_schema

    def restart_decoder(self) -> None:
        """Drop what was received so far: noise of another line rate."""
        self._decoder = FrameDecoder(UP, Gates())
        self.fed = 0

    def take_messages(self, name: str) -> list[dict[str, Any]]:
        """Remove the messages of a name from the inbox and return them, in order of arrival."""
        found = [frame for frame in self.inbox if frame.message.name == name]
        rest = [frame for frame in self.inbox if frame.message.name != name]
        self.inbox.clear()
        self.inbox.extend(rest)
        return [frame.as_dict() for frame in found]

    def feed(self, data: bytes, t: float, applied: Applied) -> list[State]:
        """Return the States that end in ``data``; its last byte arrived at host time ``t`` [s]."""
        self.fed += len(data)
        states = []
        for frame in self._decoder.feed(data):
            if frame.message is STATE:
                states.append(self._state(frame, t, applied))
            else:
                self._other(frame, t)
        return states

    def _state(self, frame: WireFrame, t: float, applied: Applied) -> State:
        """Return the State of a STATE frame."""
        # Unwrap the 8-bit sequence number.
        self._seq += ((frame.seq - self._seq - 1) & 0xFF) + 1 if self._seq >= 0 else frame.seq + 1
        (self.state_ck,) = T_CK.unpack_from(frame.payload)
        millivolt = self.diag.get("vcc_mv", 0)
        state = self._telemetry.read(frame, self._seq, t, self.fed - frame.end, applied,
                                     self.counters.gaps, millivolt * 1e-3 if millivolt else None)
        if self._telemetry.restarted and not self._hello_new:
            self.hello_stale = True  # another boot, and its HELLO did not get through
            self._forget_boot()
        self._hello_new = False
        return state

    def _forget_boot(self) -> None:
        """Drop the answers of a boot that has ended."""
        self.params.clear()
        self.captures.clear()
        self.on_boot()

    def _other(self, frame: WireFrame, t: float) -> None:
        """Handle a message other than STATE."""
        if self._seq >= 0:
            self._seq += ((frame.seq - self._seq - 1) & 0xFF) + 1
        if frame.message is HELLO:
            self.hello_values = frame.as_dict()
            self._hello(Hello.from_frame(self.hello_values))
        elif frame.message is DIAG:
            self.diag = frame.as_dict()
            self._telemetry.set_slot(1e-6 * self.diag["loop_max_us"])
        elif (handler := self.handlers.get(frame.message.name)) is not None:
            handler(frame.as_dict(), t)
        elif frame.message is TIME_PONG:
            # The pong arrived before the bytes behind it.
            behind = (self.fed - frame.end) * self._telemetry.clock.byte_time
            pong = frame.as_dict()
            self._transmitter.pong(pong, self._telemetry.clock, t - behind,
                                   self.sent_at(pong["ping_id"]))
        elif frame.message is PARAM_VALUE:
            self._param(frame.as_dict())
            self.inbox.append(frame)
        elif frame.message is CAPTURE:
            self.captures.append(frame.as_dict())
            self.inbox.append(frame)
        else:
            self.inbox.append(frame)

    def _param(self, value: dict[str, Any]) -> None:
        if value["status"] == PARAM_STATUS["OK"]:
            self.params[value["id"]] = value["value"]

    def _hello(self, hello: Hello) -> None:
        """Take over a HELLO; restart the estimators if it is of another boot or board."""
        known, stale = self.hello, self.hello_stale
        self.hello = hello
        self.hello_stale = False
        self._telemetry.set_capabilities(hello.caps)
        if known is not None and (known.boot_count, known.board_id) != (hello.boot_count,
                                                                        hello.board_id):
            self.boots += 1
            self._hello_new = not stale
            self._telemetry.restart()
            self._forget_boot()
