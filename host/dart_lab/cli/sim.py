"""``dart-hal sim``: the virtual car for other programs, or its hidden truth."""

from __future__ import annotations

import signal
import threading
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlencode

import click

from dart_hal.car.car import DEFAULT_URL
from dart_hal.cli.common.options import cars_option, json_option, url_option
from dart_hal.cli.common.output import console, print_json, print_line, results, show_notices
from dart_hal.core.config import cars_home
from dart_hal.core.errors import UsageError
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend, open_backend
from dart_lab.sim.classroom import read_class
from dart_lab.sim.failures import parse_failure as parse_failure
from dart_lab.sim.marking import format_marks, mark_car
from dart_lab.sim.serve import BusServer, PacedWorld
from dart_lab.sim.truth import reveal_url

if TYPE_CHECKING:
    from dart_hal.devices.links.pty import Pty

# Period of the check that the pacing thread is alive.
POLL_PERIOD_S = 0.5


@click.command("sim")
@url_option
@click.option("--vehicle", default=None, metavar="M",
              help="true model of the car: a model.toml, with its effects, or a shipped set")
@click.option("--model", default=None, hidden=True, help="old name of --vehicle")
@click.option("--fail", "fail", multiple=True, metavar="F",
              help="a failure on a timetable, target:kind[=value]@start[+duration], as in "
                   "imu:stuck@3s+1s or enc:wrong=0.5@2s; again for more; a wrong one lists all")
@click.option("--reveal", "show", is_flag=True, help="print the true parameters of this car")
@click.option("--against", type=click.Path(path_type=Path, exists=True, file_okay=False),
              default=None, metavar="CARS",
              help="with --reveal: mark what was measured, in a folder of cars: true value, "
                   "measured value, 90 % interval, inside or outside")
@click.option("--lecturer", type=click.Path(path_type=Path, exists=True, dir_okay=False),
              default=None, metavar="FILE",
              help="with --reveal: the file of the class of a sealed car (dart-hal class)")
@click.option("--pty", is_flag=True, help="serve the Nano as a serial port, in real time")
@click.option("--bus", type=click.Path(path_type=Path), default=None,
              help="serve the I2C bus with the PCA9685 on this unix socket (with --pty)")
@click.option("--link", type=click.Path(path_type=Path), default=None,
              help="symbolic link to the serial port, as udev makes (with --pty)")
@cars_option
@json_option
def command(url: str | None, vehicle: str | None, model: str | None, fail: tuple[str, ...],
            show: bool, against: Path | None, lecturer: Path | None, pty: bool, bus: Path | None,
            link: Path | None, cars: Path | None, as_json: bool) -> None:
    """The simulated car of a URL: `--reveal` its truth, or serve it with `--pty`.

    Serving writes the car's file into the folder of the cars, so that other
    programs open the port with `--car sim-N`. SIGUSR1 unplugs the Nano's cable,
    SIGUSR2 plugs it in again, as another port.
    """
    for text in fail:
        parse_failure(text)  # raises now and not when the car is opened
    if model:
        show_notices(("--model is now called --vehicle; the next version no longer knows it",))
    text = url or DEFAULT_URL
    for option, value in (("vehicle", vehicle), ("vehicle", model), ("fail", ",".join(fail))):
        text = _add_option(text, option, value)
    parsed = Url.parse(text)
    if parsed.scheme != "sim":
        raise UsageError("sim serves simulated cars", found=parsed.text, expected="sim://?seed=N")
    if show == pty or ((bus or link) and not pty):
        raise UsageError("no task for the simulated car",
                         expected="--reveal, or --pty [--bus PATH] [--link PATH]")
    if against is not None and not show:
        raise UsageError("--against marks by the truth", found="--against without --reveal",
                         expected="--reveal --against CARS")
    # A sealed car of a class is revealed with the file of its lecturer alone.
    secret = read_class(lecturer).secret if lecturer is not None else None
    # One of three tasks: mark measurements, print the truth, serve the car.
    if against is not None:
        _mark(parsed, against, secret, as_json)
    elif show:
        _reveal(parsed, secret, as_json)
    else:
        _serve(parsed, bus, link, cars, as_json)


def _add_option(url: str, option: str, value: str | None) -> str:
    """Return the URL with one more option; Url.parse refuses an option that is given twice."""
    # Options of the command line become options of the URL, which is checked once.
    if not value:
        return url
    return f"{url}{'&' if '?' in url else '?'}{urlencode({option: value})}"


def _reveal(url: Url, secret: bytes | None, as_json: bool) -> None:
    """Print the true parameters of a simulated car."""
    truth = reveal_url(url, secret)
    if as_json:
        print_json(truth)
        return
    for group, entries in truth["vehicle"].items():
        if isinstance(entries, dict):  # the other entry is the name of the model
            for name, entry in entries.items():
                unit = entry["unit"].strip("-")
                results.print(f"{group + '.' + name:32} {entry['value']:.6g} {unit}".rstrip())
    for name, value in truth["sensors"].items():
        values = value if isinstance(value, list) else [value]
        results.print(f"{name:32} " + " ".join(f"{v:.6g}" for v in values))
    for effect in truth["effects"]:
        for name, entry in effect["parameters"].items():
            results.print(f"effect {effect['name'] + '.' + name:25} {entry['value']:.6g} "
                          f"{entry['unit'].strip('-')}".rstrip())
    for name, value in (truth["mocap"] or {}).items():
        text = value if isinstance(value, str) else f"{value:.6g}"
        results.print(f"{'mocap.' + name:32} {text}")
    for name, value in (truth["lidar"] or {}).items():
        text = value if isinstance(value, str) else f"{value:.6g}"
        results.print(f"{'lidar.' + name:32} {text}")
    if truth["room"]:
        x, y, yaw = truth["room"]["start"]
        results.print(f"room {truth['room']['name']}: {len(truth['room']['lines'])} lines, start "
                      f"x {x:.3f} m, y {y:.3f} m, yaw {yaw:.3f} rad; --json has them all")
    steering = truth["steering"]
    # Eight points of the steering map; --json has all of them.
    for i in range(0, len(steering["command"]), len(steering["command"]) // 8):
        results.print(f"command {steering['command'][i]:+.2f}  {steering['angle_rad'][i]:+.4f} rad")


def _mark(url: Url, cars: Path, secret: bytes | None, as_json: bool) -> None:
    """Print the marking sheet of a simulated car."""
    sheet = mark_car(url, [cars], secret)
    if as_json:
        print_json(sheet.to_json())
        return
    for line in format_marks(sheet):
        print_line(line)


def _write_car_file(backend: Backend, cars: Path | None) -> str:
    """Write the car.toml that other programs need; returns the car's name."""
    assert backend.car is not None
    assert backend.car_toml is not None
    path = cars_home([cars] if cars else None) / backend.car / "car.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(backend.car_toml, encoding="utf-8")
    return backend.car


def _install_signals(port: Pty, link: Path | None) -> str:
    """Let SIGUSR1 unplug the Nano's cable and SIGUSR2 plug it in; return the name of the port."""
    def unplug(*_: object) -> None:
        port.unplug()
        if link is not None:
            link.unlink(missing_ok=True)

    def plug(*_: object) -> None:
        port.plug()
        if link is not None:
            link.unlink(missing_ok=True)
            link.symlink_to(port.path)

    signal.signal(signal.SIGUSR1, unplug)
    signal.signal(signal.SIGUSR2, plug)
    plug()
    return str(link) if link is not None else port.path


def _serve(url: Url, bus: Path | None, link: Path | None, cars: Path | None,
           as_json: bool) -> None:
    """Serve the simulated car in real time until Ctrl-C or SIGTERM."""
    from dart_hal.devices.links.pty import Pty  # a pty is absent on Windows

    backend = open_backend(url.text)
    show_notices(backend.notices)
    name = _write_car_file(backend, cars)
    # The world runs in real time in its own thread; this thread waits for a signal.
    paced = PacedWorld(backend)
    done = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: done.set())
    signal.signal(signal.SIGINT, lambda *_: done.set())
    served = BusServer(backend, paced, bus) if bus else None
    try:
        with Pty(paced, always=True) as port:
            device = _install_signals(port, link)
            address = f"serial://{device}" + (f"?i2c=unix:{bus}" if bus else "")
            if as_json:
                print_json({"url": address, "pty": device, "bus": bus, "car": name})
            console.print(f"the car answers on {device}; from another terminal:\n"
                          f"  export DART_HAL_URL='{address}' DART_HAL_CAR={name}\n"
                          "  dart-hal top\nCtrl-C ends it",
                          soft_wrap=True, markup=False)
            while port.alive and not done.wait(POLL_PERIOD_S):
                pass
    finally:
        if served is not None:
            served.close()
        if link is not None:
            link.unlink(missing_ok=True)
        backend.close()
