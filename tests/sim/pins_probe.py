"""Hand tool of these tests: what a host reads of a car that drives a fixed plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

COUNT = 122 / 25e6                  # s, one count of a board with a nominal clock
EDGE = 0.0412918 / 20               # m, one edge of a nominal ring


@dataclass(frozen=True)
class PinRecord:
    """Columns of STATE, (n,) each: s, edges, rad/s about z, m/s2; pulses (t, channel, width s)."""

    t: np.ndarray
    edges: np.ndarray
    gyro: np.ndarray
    accel_x: np.ndarray
    accel_y: np.ndarray
    pulses: list
    car: object

    @property
    def speed(self):
        """Counted speed over the last 0.1 s [m/s]."""
        return (self.edges[10:] - self.edges[:-10]) * EDGE / (self.t[10:] - self.t[:-10])

    def rows_between(self, start, end):
        """Rows from start to end [s]."""
        return (self.t >= start) & (self.t < end)

    def counted_distance(self, start, end):
        """Counted distance [m]."""
        return float(np.ptp(self.edges[self.rows_between(start, end)])) * EDGE


def pulses(car, steering, throttle):
    """Commands as a host sends them that takes the board's clock for nominal."""
    s, t = (round((1500 + span * u) * 1e-6 / COUNT) for span, u in ((375, steering),
                                                                    (450, throttle)))
    car.backend.bus.writeto(0x40, bytes((0x06, 0, 0, s & 255, s >> 8, 0, 0, t & 255, t >> 8)))


def drive(raw_car, url, plan):
    """Arm for 2.2 s, then each (steering, throttle, seconds) of the plan."""
    car, widths = raw_car(url), []
    car.world.watchers.append(lambda channel, p: widths.append((p[1], channel, p[1] - p[0])))
    for steering, throttle, seconds in ((0.0, 0.0, 2.2), *plan):
        pulses(car, steering, throttle)
        car.run(seconds)
    rows = [f.as_si() for f in car.frames_named("STATE")]
    return PinRecord(np.array([r["t_ck"] for r in rows]), np.array([r["enc_count"] for r in rows]),
                     np.array([r["gyro"][2] for r in rows]), *np.array(
                    [r["lin_acc"][:2] for r in rows]).T, widths, car)
