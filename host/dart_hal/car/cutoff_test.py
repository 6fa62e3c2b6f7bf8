"""Self-test of the hardware cut-off, run at every arm() while the throttle is neutral.

The spare channel of the PCA9685 carries a pulse, which passes through the cut-off to the input
capture of the Nano (D8).

1. With a cut-off by /OE, servo and ESC get no pulse until the end of the test: without the wire to
   D8 the Nano would cut a pulse of the ESC, which would take the rest for a command.
2. The Nano switches the outputs off: no pulse may arrive.
3. The Nano switches them on: pulses must arrive, else the input capture is not wired.

With a multiplexer the ESC gets neutral meanwhile. With /OE its neutral time counts from the end of
the test.
"""

from __future__ import annotations

from dart_hal.car.facts import OE_SWITCH_ON_TIME, Observer
from dart_hal.car.receive import Receiver
from dart_hal.car.transmit import Transmitter
from dart_hal.wire.messages import CAPTURE_REQ

# PWM periods of one capture, which has three rising edges.
CAPTURED_PWM_PERIODS = 2
# s until a new mode acts: a heartbeat of 20 ms, a PWM frame of 20 ms, a time slot of the Nano.
MODE_CHANGE_TIME = 0.06
# s until the PCA9685 has no pulse: the frame of the program, and the rest of its own.
SILENCE_TIME = 0.05
# s within which CAPTURE arrives: 100 ms, 25 ms per period, and its turn on the line.
MAX_CAPTURE_TIME = 0.4


class CutoffTest:
    """One run of the test; ``step`` once per PWM frame.

    ``outcome``: pending, passed, failed or unwired, as in ``Facts``. ``done``: it has ended.
    """

    def __init__(self, observer: Observer, transmitter: Transmitter, receiver: Receiver,
                 now: float) -> None:
        self._observer = observer
        self._transmitter = transmitter
        self._receiver = receiver
        self._oe = observer.cutoff == "oe"
        self.outcome = "pending"
        self.done = False
        self._cutting = True
        self._requested_at: float | None = None
        self._cut_at = now + SILENCE_TIME if self._oe else now
        self._request_at = self._cut_at + MODE_CHANGE_TIME
        self._now = now

    @property
    def silent(self) -> bool:
        """Whether servo and ESC get no pulse."""
        return self._oe and not self.done

    @property
    def beat(self) -> str:
        """Return the mode of the heartbeat, by which the Nano switches the outputs.

        STOP switches off /OE, DISARMED the multiplexer; DISARMED (/OE) and RAW switch them on.
        """
        if self._oe:
            return "STOP" if self._cutting and self._now >= self._cut_at else "DISARMED"
        return "DISARMED" if self._cutting or self.done else "RAW"

    def step(self, now: float) -> None:
        """Request a capture when it is due, and evaluate the answer."""
        self._now = now
        if self._oe and self._cutting:
            self._observer.outputs_off(now)
        if self._requested_at is None and now >= self._request_at:
            self._receiver.captures.clear()
            self._transmitter.send(CAPTURE_REQ, {"frames": CAPTURED_PWM_PERIODS}, now)
            self._requested_at = now
        elif self._requested_at is not None and self._receiver.captures:
            self._judge(self._receiver.captures.popleft()["first_rise"] != 0, now)
        elif self._requested_at is not None and now - self._requested_at > MAX_CAPTURE_TIME:
            # The request or its answer was lost.
            self._requested_at = None
            self._request_at = now

    def _judge(self, came: bool, now: float) -> None:
        """Evaluate one capture: first with the outputs off, then with them on."""
        self._requested_at = None
        if not self._cutting:
            self.outcome = "passed" if came else "unwired"
            self.done = True
        elif came:
            self.outcome = "failed"
            self.done = True
        else:
            self._cutting = False
            self._request_at = now + (OE_SWITCH_ON_TIME if self._oe else 0.0) + MODE_CHANGE_TIME
