"""Hand tool of these tests: drives a simulated car by raw pulses, without the HAL."""

from __future__ import annotations

from dart_hal.devices.links.base import open_backend
from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import FrameDecoder
from dart_lab.sim.truth import world_of


class RawCar:
    """``sim://`` with a decoder and pulses in us; every frame is kept."""

    def __init__(self, url: str, slice_s: float = 0.01):
        self.backend = open_backend(url)
        self.world = world_of(self.backend)
        self.decoder = FrameDecoder(UP)
        self.frames = []
        self.raw = bytearray()
        self.stamps = []
        self.slice_s = slice_s
        bus = self.backend.bus
        for data in (b"\x00\x31", b"\xfe\x79", b"\x00\x21"):
            bus.writeto(0x40, data)

    def pulses(self, steering_us, throttle_us):
        count = 122e6 / self.world.car.oscillator_hz
        s, t = round(steering_us / count), round(throttle_us / count)
        self.backend.bus.writeto(0x40, bytes((0x06, 0, 0, s & 255, s >> 8, 0, 0, t & 255, t >> 8)))

    def spare_pulse(self, pulse_us):
        """Write the pulse of the spare channel, which the Nano sees at D8."""
        n = round(pulse_us * self.world.car.oscillator_hz / 122e6)
        self.backend.bus.writeto(0x40, bytes((0x06 + 4 * 15, 0, 0, n & 255, n >> 8)))

    def run(self, seconds, on_frame=None):
        end = self.backend.clock.now() + seconds
        while self.backend.clock.now() < end - 1e-9:
            chunk = self.backend.link.read(min(self.slice_s, end - self.backend.clock.now()))
            if chunk is None:
                continue
            self.raw += chunk.data
            self.stamps.append(chunk.t)
            for frame in self.decoder.feed(chunk.data):
                self.frames.append(frame)
                if on_frame is not None:
                    on_frame(frame)
        return self

    def drive(self, steering, throttle, seconds):
        self.pulses(1500 + 375 * steering, 1500 + 450 * throttle)
        return self.run(seconds)

    def arm(self):
        self.pulses(1500, 1500)
        return self.run(2.2)

    def frames_named(self, name):
        return [f for f in self.frames if f.message.name == name]

    def states(self):
        return [f.as_si() for f in self.frames_named("STATE")]

    @property
    def truth(self):
        return self.world.truth()
