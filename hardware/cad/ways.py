"""Where each lead runs: its middle line from contact to contact, mm in the deck frame.

The solids of `cables` and the plan, the lengths and the openings of `../wiring/routing.py` are made
from these points. Ways are those of the photographs where they show them, else the shortest that
keeps clear of wheels, lidar and shaft [assumed]. No CAD kernel.
"""

from __future__ import annotations

from parameters import Parameters
from shapes import Vector

JUMPER = 14.0
"""Length of the socket of a jumper wire, mm [data sheet]."""
USB_A, USB_MINI, USB_MICRO = 36.9, 20.0, 20.0
"""Length of a USB plug with its sleeve, mm [assumed]."""
T_PLUG = 16.0
"""Half of a pair of T plugs, mm [data sheet]."""
DEEP = 4.0
"""mm of a lead within a plug or a device that it comes out of."""
Way = tuple[Vector, ...]
"""First and last point are the contacts, so that the length is that of the cable that is bought."""


def port_z(p: Parameters) -> float:
    """Height of the middle of the Jetson's USB sockets, mm."""
    return p.sheet.thickness + p.stack.standoff_lower - 5.0


def nano_middle(p: Parameters) -> tuple[float, float]:
    w = p.base_windows
    return sum(w.nano_x) / 2, sum(w.nano_y) / 2


def socket_low(p: Parameters) -> float:
    """Lower end of the sockets below the Nano, mm."""
    return p.sheet.thickness - 2.7 - JUMPER


def module_pins(p: Parameters) -> float:
    """X of the ends of the infrared module's pins, mm."""
    c = p.car
    return c.gear_x + c.gear_width / 2 + p.gate.to_gear + p.gate.depth + 32.0


def usb(p: Parameters) -> dict[str, Way]:
    """Nano round the back plate, lidar adapter through it, to the rear of the Jetson."""
    z, port, middle = p.sheet.thickness, port_z(p), sum(p.jetson.y) / 2
    x, y = nano_middle(p)
    x += p.imu_nano.nano_length / 2 + 2.6
    side, back = -p.base.half_width - 5, -14.0
    right, left = middle - 9, middle + 7
    a, b = p.base_holes.adapter_x, p.base_holes.adapter_y
    ax, ay = sum(a) / 2, b[0] - 3.1
    end = 14.9 - USB_A
    return {
        "W_USB": ((x, y, z + 4.5), (x + USB_MINI, y, z + 4.5), (x + 34, y - 2, z + 6),
                  (x + 34, y - 9, z + 18), (x - 10, side, 34), (back, side, 34),
                  (-42, -50, port), (-42, right, port), (end, right, port), (14.9, right, port)),
        "W_LIDAR": ((ax, ay, z + 7), (ax, ay - USB_MICRO, z + 7), (ax - 18, 14, z + 12),
                    (20, 18, 30), (6, 29, 36), (-8, 29, 38.5), (-36, 22, port),
                    (-36, left, port), (end, left, port), (14.9, left, port)),
    }


def six_wire(p: Parameters) -> Way:
    """Expansion board through the plate's window to pins 1 to 6 of the Jetson's header."""
    x, y = sum(p.base_windows.six_wire[:2]) / 2, sum(p.base_windows.six_wire[2:]) / 2
    high = p.sheet.thickness + p.stack.standoff_lower - 8.6
    head = sum(p.jetson.y) / 2 + 47.5
    return ((x, y, p.car.board_z), (x, y, p.car.board_z + 6.2), (x, y, 12), (25, 54, 19),
            (42.4, 54, 23), (42.4, head, high - JUMPER), (42.4, head, high))


def jumpers(p: Parameters) -> dict[str, Way]:
    """The infrared module's wires come up before the expansion board, the IMU's go down through the
    round hole; both end in sockets below the Nano."""
    (x, y), low, z = nano_middle(p), socket_low(p), p.sheet.thickness
    pin, floor, board = module_pins(p), p.car.floor_z, 141.6
    h = p.base_holes
    cx, cy, imu = h.cable_x[0], h.cable_y[0], h.imu_x + 9
    top = low + JUMPER
    return {
        "W_IR": ((pin, 0.0, floor + 3.4), (pin + JUMPER, 0.0, floor + 3.4),
                 (118, -7.5, floor + 3), (board, -12, floor + 6), (board, -12, -6.0),
                 (board, -44.5, -6.0), (x + 24, -44.5, -7.0), (x + 8, y + 7.62, low),
                 (x + 8, y + 7.62, top)),
        "W_IMU": ((imu, -11.0 + DEEP, z + 6.2), (imu, -11.0, z + 6.2), (imu, -20, z + 10),
                  (cx, cy, z + 5), (cx, cy, -5.0), (x, y + 10.62, low - 1), (x - 2, y + 7.62, low),
                  (x - 2, y + 7.62, top)),
    }


def channels(p: Parameters) -> dict[str, Way]:
    """Three-wire leads of servo and speed controller, round the edges of the expansion board to its
    channels 0 and 1."""
    f, s, plug = p.car.floor_z, p.steering, p.car.board_z + 3.0
    rear = s.servo_x - s.servo_width / 2
    bottom = s.servo_top_y + s.servo_depth
    return {
        "W_SERVO": ((rear, bottom - 4, f + 14), (rear - DEEP, bottom - 4, f + 14),
                    (66.5, -35, f + 20), (61, -43, -24), (61, -43, -6), (52, -44.4, -5),
                    (42, -44.4, -5), (28, -44, -7), (28, -40.6, plug), (28, -38, plug)),
        "W_ESC": ((52, 40, f + 18), (52, 40 + DEEP, f + 18), (50, 44.5, -20), (43, 43, -8),
                  (29, 16, -6.6), (29, -20, -6.6), (26, -24, plug), (26, -25, plug)),
    }


def battery(p: Parameters) -> dict[str, Way]:
    """Pack and speed controller up through their slots, T plugs and fuse above the plate."""
    w, z, floor = p.base_windows, p.sheet.thickness, p.car.floor_z
    (ex, lx), (ey, ly) = w.lead_x, w.lead_y
    end, top, low, esc = 69.5 + p.battery.length / 2, z + 16.5, floor + 7, floor + 16
    plug, fuse = fuse_front(p) + 0.4 + 2 * (T_PLUG + 1), fuse_front(p)
    return {
        "W_PACK": ((end - DEEP, ly + 13, low), (end + 0.2, ly + 13, low), (end + 9, ly + 13, low),
                   (end + 13, ly + 11, -17), (lx, ly, -8), (lx, ly, z + 6), (lx - 3, 54, top),
                   (plug, 54, top), (fuse, 54, top)),
        "W_LIPO": ((ex, ey, z + 9), (ex, ey, z + 8), (ex, ey, -10),
                   (43, 44, esc), (43, 40.3, esc), (43, 40.3 - DEEP, esc)),
    }


def fuse_front(p: Parameters) -> float:
    """X of the front of the fuse's holder, which stands over the slot of the speed controller."""
    return p.base_windows.lead_x[0] + 9.7


def ways(p: Parameters) -> dict[str, Way]:
    """Every lead that a builder lays in the car without options, by its name in the harness."""
    return {**usb(p), "W_BOARD": six_wire(p), **jumpers(p), **channels(p), **battery(p)}
