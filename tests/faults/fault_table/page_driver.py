"""A program that serves a live page by which a hand drives: ``python page_driver.py URL CAR CARS``.

Prints "page PORT TOKEN"; the hand is somebody else's.
"""

from __future__ import annotations

import sys

from dart_hal.car import Car
from fault_table import switches, switches_nano  # noqa: F401 - the layers that may be gone
from fault_table.drive import WAIVED
from fault_table.layers import inherit


def main(url: str, name: str, cars: str) -> None:
    with Car.open(url, car=name, cars=cars or None, raise_on_trip=False) as car, \
            car.view(port=0, drives=True, waive=WAIVED) as page:
        print("page", page.access.port, page.access.token, flush=True)
        page.run()


if __name__ == "__main__":
    with inherit():
        main(*sys.argv[1:4])
