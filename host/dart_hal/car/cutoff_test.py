"""Does the hardware cut-off cut? Asked at every arm(), while the throttle is neutral.

The spare channel of the PCA9685 carries a pulse and is led through the cut-off
to the Nano's input capture (D8). First the Nano is told to cut: no
pulse may come. Then to pass: pulses must come, or nobody watches. The ESC sees
neutral all the while, and with /OE for a moment nothing, which is why its
neutral time is counted from the end of the test.
"""

from __future__ import annotations

from dart_hal.car.facts import OUTPUT_ON_AFTER, Observer
from dart_hal.car.receive import Receiver
from dart_hal.car.transmit import Transmitter
from dart_hal.wire.messages import CAPTURE_REQ

PERIODS = 2
"""PWM periods to be seen; three rises."""
SETTLE = 0.06
"""s that a new mode takes to act: a heartbeat of 20 ms, a PWM frame, and a slot of the Nano."""
ANSWER = 0.4
"""s within which CAPTURE answers: 100 ms + 25 ms per period, and its turn on the line."""


class CutoffTest:
    """One run of the test; ``step`` once per PWM frame. ``outcome``: see ``Facts``.

    ``beat``: the mode of the heartbeat while it runs.
    """

    def __init__(self, observer: Observer, transmitter: Transmitter, receiver: Receiver,
                 now: float) -> None:
        self._observer = observer
        self._transmitter, self._receiver = transmitter, receiver
        self._oe = observer.cutoff == "oe"
        self.outcome, self.done = "pending", False
        self._cutting = True
        self._asked: float | None = None
        self._ask_at = now + SETTLE

    @property
    def beat(self) -> str:
        """STOP and DISARMED cut /OE and multiplexer; DISARMED and RAW let pulses through."""
        if self._oe:
            return "STOP" if self._cutting else "DISARMED"
        return "DISARMED" if self._cutting or self.done else "RAW"

    def step(self, now: float) -> None:
        """Ask for a capture when its time has come, and judge the answer."""
        if self._oe and self._cutting:
            self._observer.outputs_off(now)
        if self._asked is None and now >= self._ask_at:
            self._receiver.captures.clear()
            self._transmitter.send(CAPTURE_REQ, {"frames": PERIODS}, now)
            self._asked = now
        elif self._asked is not None and self._receiver.captures:
            self._judge(self._receiver.captures.popleft()["first_rise"] != 0, now)
        elif self._asked is not None and now - self._asked > ANSWER:
            self._asked, self._ask_at = None, now    # the request or its answer was lost

    def _judge(self, came: bool, now: float) -> None:
        self._asked = None
        if not self._cutting:
            self.outcome, self.done = ("passed" if came else "unwired"), True
        elif came:
            self.outcome, self.done = "failed", True
        else:
            self._cutting = False
            self._ask_at = now + (OUTPUT_ON_AFTER if self._oe else 0.0) + SETTLE
