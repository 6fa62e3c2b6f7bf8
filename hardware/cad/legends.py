"""What the numbers in the pictures of the steps mean. Data alone: the tests read it without a
renderer, and the build guide repeats every line under its picture.

A target is the beginning of a body's name (its middle is meant) or a point, mm in the deck frame.
"""

from __future__ import annotations

Point = tuple[float, float, float]
Legend = tuple[tuple[str, str | Point], ...]

LEGENDS: dict[str, Legend] = {
    "S01": (("expansion board", (70, -5, -12)), ("nylon post", (123, 22.25, -6)),
            ("speed controller", (43, 40, -42)), ("shock", (174, 41, -20)),
            ("tray of the LiPo", (67, 58, -53))),
    "S02": (("main gear", (21, 13, -29)), ("rear gearbox", (-4, 4, -26.8)),
            ("shaft", (75, 0, -37.8)), ("motor", (42, -17, -20)),
            ("speed controller", (43, 27, -27))),
    "S03": (("striped ring", (37, 9, -37)),
            ("front of the main gear, painted black", (22, 9, -32))),
    "S03_rear": (("magnet ring, its holes to the rear", (2, 9, -33)),
                 ("five magnets, the same pole to the rear", (-6.2, 10, -37.8)),
                 ("rear of the main gear", (20, 11, -33))),
    "S04": (("infrared module, flat on the floor", (62, 5, -52)), ("its LEDs", (45.4, 3.2, -47)),
            ("infrared gate", (34, 4, -42.6)), ("slit", (25.5, 0, -47)),
            ("striped ring on the main gear", (23.5, 8, -32)),
            ("two cable ties, their locks to the left", (69.5, 5, -51))),
    "S05": (("Hall holder", (7, 10, -47)), ("leads of the Hall switch", (15.7, 22, -36.4)),
            ("magnet", (17.6, 3.1, -28.3)), ("boss of the rear gearbox", (6.5, 5, -34.6)),
            ("main gear", (21, 0, -22.2))),
    "S06": (("blue cap", (174, 35.5, -18)), ("ring", "shock_ring_front_left"),
            ("spring", (174, 46.5, -34))),
    "S06_servo": (("servo on its side, its bottom to the middle", (104, -35, -34)),
                  ("horn", (76, -57, -33)), ("turnbuckle", (106, -56, -25)),
                  ("motor", (50, -17, -20)), ("crank", (136, -42, -25.7))),
    "S06_centre": (("output shaft, at the rear end", (80, -57, -43.6)),
                   ("horn, 20 deg to the rear", (75, -57, -31)), ("turnbuckle", (106, -56, -25)),
                   ("ear with two screws", (66, -40, -40)), ("crank", (136, -42, -25.7))),
    "S07": (("plus end, red here: button", (124.4, -30, -53)),
            ("minus end: flat", (124.4, 10, -53)), ("spring plate of the holder", (125.2, 20, -22)),
            ("expansion board", (20, -5, -13.6))),
    "S08": (("standoff, 25 + 25 mm", (92.6, 43.3, 30)), ("adapter of the lidar", (77, 49, 8)),
            ("IMU", (46, -6, 9)), ("mount of Nano and IMU", (47, -64, 8)),
            ("board holder", "board_holder_left"), ("arrow of the plate", (27, 56, 3)),
            ("M2.5 x 6 from above, into the post of the board", (123, 22.25, 5.5))),
    "S09": (("antenna", (9.5, 36, 60)), ("6-wire cable through its window", (20, 25, 10)),
            ("window for the fan", (99.5, 10, 3))),
    "S10": (("Jetson", (60, 20, 55)), ("40-pin header", (75, 50.5, 48)),
            ("plug of the 6-wire cable on pins 1 to 6", (41, 50.5, 37)), ("ports", (15, 0, 45))),
    "S11": (("lidar, its motor forward", (182, 3, -10)), ("lidar mount", (171.9, 27.6, 9)),
            ("M3 x 25 from above, in its cup", (168.6, 25, 25)),
            ("rotor, free air all round", (128, 20, 50))),
    "S12_camera": (("camera", (139, 0, 69.5)), ("camera bracket", (126, -16, 72)),
                   ("flat cable, below the bracket", (110, -7, 54)),
                   ("fold, to the right", (64, -4, 56)),
                   ("camera connector, below the board's right edge", (64, -52, 51))),
    "S12": (("upper plate", (70, 45, 62)), ("back plate", (-3, 0, 90)),
            ("board holder", "board_holder_left"),
            ("small board holder", "small_board_holder_left"),
            ("window for the ports", (-3, -10, 34.5))),
    "S13": (("Nano, USB forward", (47, -56, 5)), ("IMU", (37, 0, 9)),
            ("M3 screw of the mount, its nut above", (50, -25, 9)),
            ("arrow: forward", (41, -18, 5)), ("cable tie over the Nano", "nano_tie")),
    "S14": (("LiPo", (90, 66, -40)), ("hold-down bar", (70, 58, -35.5)),
            ("body clip", (113, 58, -34)), ("T plugs, above the plate", (83, 54, 20)),
            ("speed controller", (43, 30, -28)), ("fuse, yellow: 20 A", (52, 68.5, 22))),
    "W06": (("USB of the Nano, round the back plate", (20, -75, 34)),
            ("USB of the lidar, through the window", (4, 29, 38)),
            ("jumper wires below the Nano", (50, -65, -12)),
            ("lead of the servo, round the board's edge", (30, -44, -6.7))),
    "W06_front": (("wires of the infrared module, up before the board", (141.6, -12, -25)),
                  ("the same, back to the Nano below the plate", (100, -44.5, -6)),
                  ("6-wire cable", (20.5, 31, 13.7)), ("T plugs, above the plate", (80, 58, 20)),
                  ("lead of the LiPo", (118, 60, -25)),
                  ("three-wire lead of the speed controller", (43, 43, -9)),
                  ("fuse", (52, 68.5, 22))),
    "exploded": (
        ("`upper_plate`", (100, 30, 202)), ("`back_plate`", (-93, 0, 160)),
        ("`camera_bracket` with the camera", "camera_bracket"), ("`jetson`", (60, 30, 140)),
        ("`standoff_25`", (92.6, 43.3, 70)), ("`standoff_5`", (35, 43, 172)),
        ("`nano`", (30, -72, 49.6)), ("`imu`", (28, -6, 54.6)), ("`nano_imu_mount`", (50, -15, 27)),
        ("`lidar`", (223, 0, 70)), ("`lidar_mount`", (171.6, 35, 28)),
        ("`lidar_adapter`", "lidar_adapter"), ("`base_plate`", (10, 50, 3)),
        ("`board_holder`", "board_holder_left"),
        ("`small_board_holder`", "small_board_holder_left"),
        ("`striped_ring`", (45.5, 8, -87)), ("main gear", "gear"), ("`magnet_ring`", (-6, 9, -88)),
        ("`hall_holder`", "hall_holder"), ("`sensor_gate`", "sensor_gate"),
        ("`ir_module`", "ir_module"), ("`cutoff_holder`", "cutoff_holder")),
}


def line(step: str) -> str:
    """The legend as a sentence of the guide."""
    return ", ".join(f"**{n}** {text}" for n, (text, _) in enumerate(LEGENDS[step], 1)) + "."
