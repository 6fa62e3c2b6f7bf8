"""Mount of Nano and IMU with an arrow that points forward, and the holder of the cut-off."""

from __future__ import annotations

import build123d as bd
from geometry import Part, Z, block, drill, prism, screw_bore
from layout import arrow, cutoff_points, imu_points
from outlines import polygon, rectangle
from parameters import Parameters


def nano_frame(p: Parameters) -> bd.Part:
    """Low wall around the Nano, whose pins go down through the slots; open at the USB plug and
    at the standoff of the Jetson beside it. x, y as in the deck frame."""
    m, w = p.imu_nano, p.base_windows
    x = sum(w.nano_x) / 2
    y = sum(w.nano_y) / 2
    a = m.nano_length / 2 + m.nano_play
    b = m.nano_width / 2 + m.nano_play
    t, h = m.wall, m.wall_height
    ring = prism(rectangle(x, y, 2 * (a + t), 2 * (b + t), radius=1.0), 0, h)
    ring -= block(x - a, x + a, y - b, y + b, -1, h + 1)
    ring -= block(x + a - 1, x + a + t + 1, y - 5, y + 5, 1.4, h + 1)  # USB plug
    ring -= block(p.jetson.x[0] - 5, p.jetson.x[0] + 5, y + b - 0.5, y + b + t + 1, -1, h + 1)
    for side in (-1, 1):  # a cable tie runs over the Nano here
        ring -= block(x + 10 - 1.8, x + 10 + 1.8, y + side * (b + t / 2) - t, y + side
                      * (b + t / 2) + t, h - 2, h + 1)
    return ring


def nano_imu_mount(p: Parameters) -> Part:
    """One piece on the base plate: frame of the Nano, bridge with the arrow, seat of the IMU."""
    m, h = p.imu_nano, p.base_holes
    top = m.floor + m.post
    half_x, half_y = h.imu_pitch_x / 2 + 3.2, h.imu_pitch_y / 2 + 3.2
    seat = prism(rectangle(h.imu_x, 0, 2 * half_x, 2 * half_y, radius=2.0), 0, m.floor)
    frame_y = sum(p.base_windows.nano_y) / 2 + m.nano_width / 2 + m.nano_play
    # The neck passes between a screw of the expansion board (X 37) and the cable hole (X 50).
    bridge = prism(polygon([(27, -half_y + 1), (27, -31), (45, -31), (54, -30),
                            (54, -half_y + 1)]), 0, m.floor)
    bridge += block(40.8, 44.8, frame_y + 0.5, -30, 0, m.wall_height)
    body = seat + bridge + nano_frame(p)
    # The second hole of the pair stays free: a screw head there would touch the IMU board.
    bores = [screw_bore(p, "M3", (h.mount_x, min(h.mount_y), m.floor / 2), Z, m.floor,
                        "base_plate")]
    for x, y in imu_points(p):
        body += bd.Pos(x, y, top / 2) * bd.Cylinder(3.0, top)
        bores.append(screw_bore(p, "M2.5", (x, y, top / 2), Z, top, "imu"))
    body = drill(body, bores)
    mark = [(h.imu_x + 1.2 * x, -22 + 1.2 * y, b) for x, y, b in arrow(0.0, 0.0)]
    body -= prism(tuple(mark), m.floor - 0.6, m.floor + 1)
    return Part("nano_imu_mount", body, tuple(bores), "printed", p.printer.wall_min, "#d9822b")


def cutoff_holder(p: Parameters) -> Part:
    """Tray for the small board of the optional cut-off, two ears for its screws."""
    c = p.cutoff
    a, b = c.board_length / 2 + 0.3, c.board_width / 2 + 0.3
    floor, ledge, height = 2.0, 2.0 + c.ledge, 2.0 + c.ledge + 3.0
    centre = (p.upper.cutoff_x, p.upper.cutoff_y)
    body = prism(rectangle(0, 0, 2 * (a + c.wall), 2 * (b + c.wall), radius=1.5), 0, height)
    body -= block(-a, a, -b, b, ledge, height + 1)
    body -= block(-a + 2, a - 2, -b + 2, b - 2, floor, height + 1)
    body -= block(-a - 5, -a + 3, -6, 6, ledge, height + 1)  # leads out at both ends
    body -= block(a - 3, a + 5, -6, 6, ledge, height + 1)
    bores = []
    for x, y in cutoff_points(p):
        x, y = x - centre[0], y - centre[1]
        inner = (a + c.wall - 0.5) * (1 if x > 0 else -1)
        ear = prism(rectangle((x + inner) / 2, y, abs(x - inner), 9), 0, 2.6)
        body += ear + bd.Pos(x, y, 1.3) * bd.Cylinder(4.5, 2.6)
        bores.append(screw_bore(p, "M3", (x, y, 1.3), Z, 2.6, "upper_plate"))
    return Part("cutoff_holder", drill(body, bores), tuple(bores), "printed", p.printer.wall_min,
                "#d9822b")


def parts(p: Parameters) -> list[Part]:
    return [nano_imu_mount(p), cutoff_holder(p)]
