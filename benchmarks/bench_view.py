"""What a live page costs and how old its news is; how soon the page of a fleet knows.

    python benchmarks/bench_view.py            everything
    python benchmarks/bench_view.py page       CPU of an emulated car in real time, 0 to 5 pages
    python benchmarks/bench_view.py camera     the same, and each page shows the emulated camera
    python benchmarks/bench_view.py fleet      20 emulated cars: found, lost, stopped

Pages are clients of the socket in a process of their own; the clock of this computer is one for
both, so the age of a sample is from its State to its arrival.
"""

from __future__ import annotations

import json
import multiprocessing
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from math import inf
from typing import Any
from urllib.error import HTTPError
from urllib.request import urlopen

from websockets.sync.client import connect

from dart_hal.car import Car, Fleet
from dart_hal.fleet.station import Station
from dart_lab.live.view.fleet_desk import FleetDesk

URL = "sim://?nano=mock&pace=1&lidar=1&map=room"
SECONDS = 8.0
PAGES = (0, 1, 5)
ASK_EVERY = 0.06
"""s from an image to the question for the next: AGAIN of page/camera.js."""
CARS, PROGRAMS = 20, 2
ROOM = "udp://239.255.42.97:7449?via=127.0.0.1"


def listen(port: int, pages: int, seconds: float, camera: bool, results_queue: Any) -> None:
    """Read for so long; of all pages (samples, steps that are not 10 ms, ages [s], images)."""
    sockets = [connect(f"ws://localhost:{port}/socket", max_size=None, compression=None)
               for _ in range(pages)]
    for socket in sockets:
        socket.__enter__()
    results: list[tuple[int, int, list[float]]] = []
    images: list[int] = []
    threads = [threading.Thread(target=lambda s=s: results.append(read(s, seconds)))
               for s in sockets]
    threads += [threading.Thread(target=lambda: images.append(look(port, seconds)))
                for _ in sockets if camera]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    results_queue.put((sum(r[0] for r in results), sum(r[1] for r in results),
              [age for r in results for age in r[2]], sum(images)))


def look(port: int, seconds: float) -> int:
    """How many images one page was given: it asks for the next as the page's own script does."""
    ends, count = time.monotonic() + seconds, 0
    while time.monotonic() < ends:
        with suppress(HTTPError), urlopen(f"http://localhost:{port}/camera.jpg") as answer:
            count += bool(answer.read())
        time.sleep(ASK_EVERY)
    return count


def read(socket: Any, seconds: float) -> tuple[int, int, list[float]]:
    """Of one page. A sample's age: its batch's, and what it is older than the newest of it."""
    ends, last, gaps, ages = time.monotonic() + seconds, None, 0, []
    while time.monotonic() < ends:
        message = json.loads(socket.recv())
        if message["type"] != "rows" or not message["rows"]:
            continue
        late = time.monotonic() - message["now"]
        newest = message["rows"][-1][0]
        for row in message["rows"]:
            gaps += last is not None and round(100 * (row[0] - last)) != 1
            last = row[0]
            ages.append(late + newest - row[0])
    return len(ages), gaps, ages


def page(camera: bool = False) -> None:
    """CPU share of the program that drives and serves, by the number of its pages."""
    url = URL + "&camera=top" if camera else URL
    base, spawn = 0.0, multiprocessing.get_context("spawn")
    for pages in PAGES:
        with Car.open(url) as car, car.view(port=0) as live:
            results_queue = spawn.Queue()
            reader = spawn.Process(target=listen, args=(
                live.access.port, pages, SECONDS, camera, results_queue))
            reader.start()
            time.sleep(3.0)  # it imports, and connects
            cpu, wall = time.process_time(), time.monotonic()
            for _ in car.states(duration=SECONDS - 3.0):
                pass
            share = (time.process_time() - cpu) / (time.monotonic() - wall)
            base = share if pages == 0 else base
            line = f"{pages} pages: {100 * share:.1f} % of a core, {100 * (share - base):+.1f}"
            for _ in car.states(duration=5.0):
                pass
            samples, gaps, ages, images = results_queue.get()
            reader.join()
            if pages:
                ages.sort()
                line += (f"; {samples} samples, {gaps} not 10 ms behind the last; age p50 "
                         f"{1e3 * ages[len(ages) // 2]:.0f}, p95 "
                         f"{1e3 * ages[int(0.95 * len(ages))]:.0f} ms")
                line += f"; {images / pages / SECONDS:.1f} images a second each" if camera else ""
            print(line, flush=True)


def share_of_fleet(first: int, cars: int, begin: Any, end: Any) -> None:
    """A program with its part of the cars, at rest, in real time."""
    urls = [f"sim://?nano=mock&pace=1&seed={first + n}" for n in range(cars)]
    with Fleet.open(urls, room=ROOM, raise_on_trip=False) as fleet:
        begin.wait()
        for _ in fleet.states():
            if end.is_set():
                return


def fleet() -> tuple[float, float, float]:
    """s until all cars are on the page, one that is killed is lost, all have obeyed its STOP; inf
    where one did not."""
    spawn = multiprocessing.get_context("spawn")
    begin, end, gone = spawn.Event(), spawn.Event(), spawn.Event()
    part = (CARS - 1) // PROGRAMS
    programs = [spawn.Process(target=share_of_fleet, args=(1, part, begin, end)),
                spawn.Process(target=share_of_fleet, args=(1 + part, CARS - 1 - part, begin, end)),
                spawn.Process(target=share_of_fleet, args=(CARS, 1, begin, gone))]
    for program in programs:
        program.start()
    begin.set()
    time.sleep(15.0)  # they are open, and tell
    with Station(ROOM) as station:
        desk = FleetDesk([station])
        news = iterate_news(desk)
        came = time.monotonic()
        while len(next(news)) < CARS:
            pass
        found = time.monotonic() - came
        print(f"{CARS} cars are on the page after {found:.2f} s", flush=True)
        programs[2].kill()
        killed = time.monotonic()
        while sum(car["state"] == "lost" for car in next(news)) < 1:
            pass
        red = time.monotonic() - killed
        print(f"one that is killed is red after {red:.2f} s", flush=True)
        pressed = time.monotonic()
        call = station.call_stop("bench")
        while len(call.confirmed_cars) < CARS - 1 and time.monotonic() - pressed < 3.0:
            next(news)
        stopped = time.monotonic() - pressed
        print(f"{len(call.confirmed_cars)} of {CARS - 1} cars have obeyed STOP ALL after "
              f"{stopped:.2f} s", flush=True)
    end.set()
    for program in programs:
        program.join(5.0)
        program.kill()
    return found, red, stopped if len(call.confirmed_cars) == CARS - 1 else inf


def iterate_news(desk: FleetDesk) -> Iterator[list[dict[str, object]]]:
    """The cars as the page knows them, thirty times a second."""
    cars: list[dict[str, object]] = []
    while True:
        for message in map(json.loads, desk.batch()):
            cars = message["cars"] if message["type"] == "cars" else cars
        yield cars
        time.sleep(1 / 30)


if __name__ == "__main__":
    for name, what in {"page": page, "camera": lambda: page(camera=True), "fleet": fleet}.items():
        if not sys.argv[1:] or name in sys.argv[1:]:
            what()
