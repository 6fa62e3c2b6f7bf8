"""What the numbers in the pictures of the steps mean. Data alone: the tests read it without a
renderer, and the build guide repeats every line under its picture.

A target is the beginning of a body's name (its middle is meant) or a point, mm in the deck frame.
"""

from __future__ import annotations

Point = tuple[float, float, float]
Legend = tuple[tuple[str, str | Point], ...]

LEGENDS: dict[str, Legend] = {
    "S01": (("expansion board", (70, -5, -12)), ("nylon post", (123, 22.25, -6)),
            ("speed controller", (43, 27, -25)), ("shock", (174, 41, -20)),
            ("tray of the LiPo", (67, 58, -48))),
    "S02": (("main gear", (21, 13, -24)), ("rear gearbox", (-12, 0, -22)),
            ("shaft", (75, 0, -32.7)), ("motor", (42, -17, -15)),
            ("speed controller", (43, 27, -22))),
    "S03": (("striped ring", (37, 9, -32)), ("main gear, painted black", (21, 9, -27)),
            ("magnet ring", (3, 11, -28))),
    "S04": (("infrared module", (60, 4, -47)), ("its LEDs", (44.5, 3.2, -42)),
            ("infrared gate", (34, 9.5, -42)), ("slit", (25.5, 0, -43)),
            ("striped ring on the main gear", (12, 9, -32))),
    "S05": (("Hall holder", (7, 10, -42)), ("leads of the Hall switch", (17, 22, -32)),
            ("magnet", (17.6, 3.1, -23.2)), ("boss of the rear gearbox", (6.5, 5, -29.5)),
            ("main gear", (21, 0, -17.1))),
    "S06": (("blue cap", (174, 33, -11)), ("ring", "shock_ring_front_left"),
            ("spring", (174, 44, -26))),
    "S06_servo": (("servo", (95, -53, -14)), ("horn", (103, -53, -6)), ("motor", (50, -17, -15)),
                  ("infrared module", (66, 4, -47))),
    "S07": (("18650 cells, four", (95, -10, -30)), ("expansion board", (20, -5, -13.6))),
    "S08": (("lidar, its motor forward", (172, 3, -10)), ("lidar mount", (168.6, 25, 8)),
            ("standoff, 25 + 25 mm", (92.6, 43.3, 30)), ("adapter of the lidar", (77, 49, 8)),
            ("IMU on the mount of Nano and IMU", (30, -6, 8)),
            ("arrow of the plate", (27, 56, 3))),
    "S09": (("antenna", (9.5, 36, 60)), ("window for the 6-wire cable", (19, 23.5, 3)),
            ("window for the fan", (62, 15, 3))),
    "S10": (("Jetson", (60, 20, 55)), ("40-pin header", (75, 50.5, 48)),
            ("its pin 1", (40, 50.5, 46)), ("ports", (15, 0, 45))),
    "S11": (("camera", (139, 0, 69.5)), ("camera bracket", (124, 16, 70)),
            ("flat cable", (75, 3, 57))),
    "S12": (("upper plate", (70, 45, 62)), ("back plate", (-3, 0, 90)),
            ("board holder", "board_holder_left"),
            ("small board holder", "small_board_holder_left"),
            ("window for the ports", (-3, -10, 46))),
    "S13": (("Nano, USB forward", (47, -56, 5)), ("IMU", (37, 0, 9)),
            ("M3 screw of the mount", (52.4, -25, 5)), ("arrow: forward", (41, -18, 5))),
    "S14": (("LiPo", (67, 58, -35)), ("slot for its lead", (102, 51.5, 3)),
            ("slot for the lead of the speed controller", (47.5, 58.5, 3)),
            ("speed controller", (43, 38, -25))),
    "exploded": (
        ("`upper_plate`", (100, 30, 202)), ("`back_plate`", (-93, 0, 160)),
        ("`camera_bracket` with the camera", "camera_bracket"), ("`jetson`", (60, 30, 140)),
        ("`standoff_25`", (92.6, 43.3, 70)), ("`standoff_5`", (35, 43, 175)),
        ("`nano`", (47, -76, 52)), ("`imu`", "imu"), ("`nano_imu_mount`", (50, -15, 27)),
        ("`lidar`", (210, 0, 60)), ("`lidar_mount`", (171.6, 35, 28)),
        ("`lidar_adapter`", "lidar_adapter"), ("`base_plate`", (10, 50, 3)),
        ("`board_holder`", "board_holder_left"),
        ("`small_board_holder`", "small_board_holder_left"),
        ("`striped_ring`", "striped_ring"), ("main gear", "gear"), ("`magnet_ring`", "magnet_ring"),
        ("`hall_holder`", "hall_holder"), ("`sensor_gate`", "sensor_gate"),
        ("`ir_module`", "ir_module"), ("`cutoff_holder`", "cutoff_holder")),
}


def line(step: str) -> str:
    """The legend as a sentence of the guide."""
    return ", ".join(f"**{n}** {text}" for n, (text, _) in enumerate(LEGENDS[step], 1)) + "."
