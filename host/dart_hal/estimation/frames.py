"""Convert a STATE frame to an SI sample: counters unwrapped, axes turned into the body frame.

Pure: bytes are decoded by ``dart_hal.wire``, times come in as arguments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, inf, sin
from typing import NamedTuple

from dart_hal.wire.messages import CAPS, STATE_FLAGS, TICKS_PER_SECOND

WRAP = 1 << 32
HALF_WRAP = 1 << 31
# s by which device time may outrun arrival: the backlog that buffers of the host hold, 20 kB of a
# pty at 4.5 kB/s are 4.6 s. More is a restart, not a gap.
RESTART_SLACK = 5.0

# Frames between two restarts: a bootloader alone takes longer than 1 s.
MIN_RESTART_FRAMES = 100

IMU_VALID = 1 << STATE_FLAGS.index("IMU_VALID")
GYRO_LOOK = 1 << CAPS.index("GYRO_LOOK")
NO_AGE = 65535
NO_BEAT = 255
SATURATED = 65535

Vector = tuple[float, float, float]
_flag_name_cache: dict[int, frozenset[str]] = {}


def flag_names(flags: int) -> frozenset[str]:
    """Return the names of the bits of STATE.flags that are set."""
    names = _flag_name_cache.get(flags)
    if names is None:
        names = frozenset(n for i, n in enumerate(STATE_FLAGS) if flags >> i & 1)
        _flag_name_cache[flags] = names
    return names


@dataclass(frozen=True, slots=True)
class Mounting:
    """Orientation of the IMU in the car and the scale of its gyro.

    roll, pitch, yaw [rad] turn the body axes into the sensor's (intrinsic
    z-y-x), so ``body = Rz(yaw) Ry(pitch) Rx(roll) sensor``. ``gyro_scale`` is
    reading / truth: readings are divided by it.
    """

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    gyro_scale: float = 1.0

    def matrix(self) -> tuple[float, ...]:
        """Return the rotation sensor -> body, row by row, shape (9,)."""
        cr = cos(self.roll)
        sr = sin(self.roll)
        cp = cos(self.pitch)
        sp = sin(self.pitch)
        cy = cos(self.yaw)
        sy = sin(self.yaw)
        return (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
                sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
                -sp, cp * sr, cp * cr)


class Sample(NamedTuple):
    """One STATE frame in SI units.

    t_dev [s]: device time of the encoder latch, unwrapped within one boot;
    ticks, ticks_b: edges, unwrapped, continuous across restarts; edge_t,
    edge_b_t [s]: device time of the last edge; edge_dt [s]: interval before
    it, 0.0 = unknown or longer than 32.8 ms; gyro [rad/s], acc [m/s2]: body
    axes, None while there is no valid sample; imu_t [s]: device time at which
    the IMU read began; imu_age, beat_age [s]: inf = none or out of range;
    calib: sys, gyr, acc, mag 0..3; flags: bits, see ``flag_names``;
    restarted: the Nano restarted since the frame before; look: where the
    gyro changed, see ``imu_clock``, 0 from firmware without GYRO_LOOK.
    """

    t_dev: float
    ticks: int
    edge_t: float
    edge_dt: float
    ticks_b: int
    edge_b_t: float
    gyro: Vector | None
    acc: Vector | None
    imu_t: float
    imu_age: float
    calib: tuple[int, int, int, int]
    flags: int
    beat_age: float
    restarted: bool
    look: int = 0


class FrameReader:
    """Turns decoded STATE payloads into samples; one per stream.

    ``has_gyro_look``: HELLO.caps has GYRO_LOOK; the two bits of CALIB_STAT for the magnetometer,
    which does not run, then carry the look. ``set_capabilities`` sets it.
    """

    def __init__(self, mounting: Mounting | None = None) -> None:
        mounting = mounting or Mounting()
        self.has_gyro_look = False
        self._matrix = mounting.matrix()
        self._gyro_gain = 1.0 / (900.0 * mounting.gyro_scale)
        self._is_aligned = self._matrix == Mounting().matrix()
        self._t_raw = -1
        self._t_arrival = 0.0
        self._device_ck = 0
        self._count_raw = self._count_b_raw = 0
        self._ticks = self._ticks_b = 0
        self._edge_ck = self._edge_b_ck = 0
        self._restart_pending = False
        self._frames = 0

    def set_capabilities(self, caps: int) -> None:
        """Take over what the firmware can do: HELLO.caps."""
        self.has_gyro_look = bool(caps & GYRO_LOOK)

    def restart(self) -> None:
        """Re-base at the next frame: the Nano restarted (HELLO with another boot_count).

        Does nothing when the frames have just shown the restart themselves.
        """
        self._restart_pending = self._frames > MIN_RESTART_FRAMES

    def read(self, values: Sequence[int], t_arrival: float) -> Sample:
        """Decode one STATE tuple (flat, in the order of the wire definition).

        t_arrival [s]: host time, used only to distinguish a restart from a long gap.
        """
        (t_raw, count, edge_raw, dt_raw, count_b, edge_b_raw, ax, ay, az, gx, gy, gz,
         age_raw, calib, flags, beat) = values
        restarted = self._advance(t_raw, t_arrival, count)
        self._count_edges(t_raw, count, edge_raw, count_b, edge_b_raw, restarted)
        t_dev = self._device_ck / TICKS_PER_SECOND
        if age_raw == NO_AGE:
            imu_age = inf
            imu_t = -inf
        else:
            imu_age = age_raw * 4e-6
            imu_t = t_dev - imu_age
        gyro = acc = None
        if flags & IMU_VALID and age_raw != NO_AGE:
            k = self._gyro_gain
            gyro = self._to_body(gx * k, gy * k, gz * k)
            acc = self._to_body(ax * 0.01, ay * 0.01, az * 0.01)
        low = calib & 3
        return Sample(
            t_dev, self._ticks, self._edge_ck / TICKS_PER_SECOND,
            0.0 if dt_raw == SATURATED else dt_raw / TICKS_PER_SECOND,
            self._ticks_b, self._edge_b_ck / TICKS_PER_SECOND, gyro, acc, imu_t, imu_age,
            (calib >> 6, calib >> 4 & 3, calib >> 2 & 3, 0 if self.has_gyro_look else low),
            flags, inf if beat == NO_BEAT else beat * 1e-3, restarted,
            low if self.has_gyro_look else 0)

    def _advance(self, t_raw: int, t_arrival: float, count: int) -> bool:
        """Unwrap the device clock; return whether it restarted.

        After a long silence the clock may have passed its old time; the edges have not.
        """
        first = self._t_raw < 0
        delta = (t_raw - self._t_raw) % WRAP
        elapsed = t_arrival - self._t_arrival
        jumped = (delta >= HALF_WRAP or delta / TICKS_PER_SECOND > elapsed + RESTART_SLACK
                  or (count - self._count_raw) % WRAP >= HALF_WRAP)
        restarted = not first and (self._restart_pending or jumped)
        self._device_ck = t_raw if first or restarted else self._device_ck + delta
        self._t_raw = t_raw
        self._t_arrival = t_arrival
        self._frames = 1 if restarted else self._frames + 1
        self._restart_pending = False
        return restarted

    def _count_edges(self, t_raw: int, count: int, edge_raw: int, count_b: int,
                     edge_b_raw: int, restarted: bool) -> None:
        """Add the new edges; a restart re-bases without a jump.

        A stamp is read only when its count changed: an old one would alias after
        35.8 min at rest.
        """
        if restarted:
            changed_a = changed_b = True
        else:
            new = (count - self._count_raw) % WRAP
            new_b = (count_b - self._count_b_raw) & 0xFFFF
            self._ticks += new
            self._ticks_b += new_b
            changed_a = new > 0
            changed_b = new_b > 0
        if changed_a:
            self._edge_ck = self._device_ck - (t_raw - edge_raw) % WRAP
        if changed_b:
            self._edge_b_ck = self._device_ck - (t_raw - edge_b_raw) % WRAP
        self._count_raw = count
        self._count_b_raw = count_b

    def _to_body(self, x: float, y: float, z: float) -> Vector:
        """Rotate a vector from sensor to body axes."""
        if self._is_aligned:
            return (x, y, z)
        a, b, c, d, e, f, g, h, i = self._matrix
        return (a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z)
