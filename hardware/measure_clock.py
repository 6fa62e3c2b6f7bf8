"""Clock of the PCA9685 without an instrument: the capture wire lets the Nano time it.

    python hardware/measure_clock.py             the car of $DART_HAL_URL
    python hardware/measure_clock.py 'sim://?seed=7'

Needs the wire from the spare channel (clock_channel of car.toml) to D8, the board on, the
wheels in the air. Throttle stays at neutral and nothing is armed; the Nano is sent heartbeats, so
that a cut-off lets the board's pulses pass (with a multiplexer the ESC is on: it feeds the chip).
The Nano's own resonator may be 0.5 % off, so its
ticks are compared with this computer's clock meanwhile.
"""

from __future__ import annotations

import os
import sys

import numpy as np

from dart_hal.car.guarding import own_actuator
from dart_hal.core.config import CarFiles, load_car, parse_car
from dart_hal.core.errors import DartHalError, LinkLost, UsageError
from dart_hal.devices.actuation.pca9685 import Pca9685
from dart_hal.devices.actuation.quantiser import COUNTS_PER_FRAME
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.wire.codec import encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import BEAT_MODES, CAPTURE_REQ, HEARTBEAT

PERIODS = 1000
"""Of 20 ms: 20 s, in which a jitter of 1 ms of single frames leaves some 10 ppm."""
COUNTS = 307
"""About 1.5 ms, as good as any."""
TICKS = 1 << 32
BOOTED = 200
"""STATE frames, 2 s: a cut-off opens after 0.5 s of beats, and not within the measurement."""
BEAT = 0.02
"""s between two heartbeats."""
PATIENCE = 10.0
"""s beyond the measurement."""


def board(backend: Backend, files: CarFiles) -> Pca9685:
    """The board at neutral with a pulse on the spare channel, while nobody else drives it.

    Raises BusError (PcaBusy), UsageError.
    """
    if backend.bus is None:
        raise UsageError(f"{backend.url.text} names no I2C bus", expected="...?i2c=1")
    own_actuator(backend, files)
    car = files.config
    pca = Pca9685(backend.bus, address=car.pwm.address, frequency=car.pwm.frequency,
                  channels=(car.steering.channel, car.throttle.channel),
                  sleep=backend.clock.sleep)
    neutral = [int(us / pca.count_us) for us in (car.steering.center_us, car.throttle.neutral_us)]
    pca.open((neutral[0], neutral[1]))
    pca.write_channel(car.pwm.clock_channel, COUNTS)
    return pca


class Heart:
    """Beats for the Nano; those before its HELLO carry a wrong token and open nothing."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._last = -BEAT
        self._seq = 0
        self.token = 0

    def beat(self, mode: str) -> None:
        """At most one each `BEAT`; the last one, DISARMED, at once."""
        now = self._backend.clock.now()
        if mode == "RAW" and now - self._last < BEAT:
            return
        self._last, self._seq = now, (self._seq + 1) % 256
        self._backend.link.write(encode(HEARTBEAT, self._seq, {
            "host_id": 0, "throttle": 0, "steering": 0, "arm_token": self.token,
            "mode": BEAT_MODES[mode], "flags": 0}))


def periods(backend: Backend) -> tuple[float, float, float]:
    """Ticks of the Nano in one PWM period, seconds of ours in one tick, and the relative
    standard error of that. Raises LinkLost."""
    decoder = FrameDecoder()
    pairs = []
    requested = False
    heart = Heart(backend)
    period, wraps = None, 0
    end = backend.clock.now() + PERIODS * 0.02 + PATIENCE
    while period is None and backend.clock.now() < end:
        chunk = backend.link.read(0.1)
        heart.beat("RAW")
        for frame in decoder.feed(chunk.data if chunk else b""):
            if frame.message.name == "STATE" and chunk is not None:
                ticks = frame.as_dict()["t_ck"]
                wraps += bool(pairs) and ticks + wraps * TICKS < pairs[-1][0] - TICKS / 2
                pairs.append((ticks + wraps * TICKS, chunk.t))
            elif frame.message.name == "HELLO":
                heart.token = frame.as_dict()["boot_nonce"]
            elif frame.message.name == "CAPTURE":
                seen = frame.as_dict()
                span = (seen["last_rise"] - seen["first_rise"]) % TICKS
                period = span / seen["frames"] if seen["frames"] else None  # no pulse came
        if not requested and len(pairs) > BOOTED:
            backend.link.write(encode(CAPTURE_REQ, 0, {"frames": PERIODS}))
            requested = True
    heart.beat("DISARMED")
    if period is None:
        raise LinkLost("the Nano timed no pulse", found=f"{len(pairs)} STATE frames",
                       expected=f"{PERIODS} pulses at D8", likely="no wire from the spare "
                       "channel to D8, another channel, or a multiplexer without supply",
                       remedy="check the capture wire")
    return period, *rate(np.array(pairs))


def rate(pairs: np.ndarray) -> tuple[float, float]:
    """Slope of seconds over ticks and its relative standard error; pairs: shape (n, 2)."""
    x, y = (pairs - pairs.mean(axis=0)).T
    slope = float(x @ y / (x @ x))
    return slope, float(np.std(y - slope * x) / np.sqrt(x @ x) / slope)


def measure(url: str) -> tuple[float, float]:
    """Oscillator of the board behind ``url`` and its standard error, Hz."""
    backend = open_backend(url)
    try:
        files = (parse_car(backend.car_toml, url) if backend.car_toml is not None
                 else load_car(backend.car or os.environ.get("DART_HAL_CAR", "dart-01")))
        pca = board(backend, files)
        period, slope, error = periods(backend)
        pca.all_off()
    finally:
        backend.close()
    hertz = COUNTS_PER_FRAME * (pca.prescale + 1) / (period * slope)
    return hertz, hertz * max(error, 20e-6)


def main() -> int:
    """Measure, and print the line for car.toml."""
    if sys.argv[1:] in (["-h"], ["--help"]):
        sys.stdout.write(__doc__ or "")
        return 0
    url = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("DART_HAL_URL", "sim://")
    try:
        hertz, std = measure(url)
    except DartHalError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write("# into car.toml, under [pwm]\n"
                     f"oscillator_hz = {{ value = {hertz:.0f}, std = {std:.0f}, "
                     f'method = "{PERIODS} periods at D8" }}\n')
    return 0


if __name__ == "__main__":
    sys.exit(main())
