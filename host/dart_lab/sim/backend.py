"""``sim://``: a whole car in this process, in virtual time.

Options: ``seed`` N >= 0 (0 or none: the nominal car; else a hidden one),
``nano`` avr (firmware in the emulator) or mock, ``model`` dynamic or
kinematic, ``ring`` even or hidden, ``rings`` 1 or 2 that the Nano counts,
``jitter`` none, usb, busy or ftdi,
``ber`` bit error rate of the line upwards, ``cutoff`` none, oe or mux (the
hardware cut-off that the car is wired with), ``boot`` none, old or optiboot
(what comes between a reset of the Nano and its program), ``fail`` a list of
failures separated by commas (``dart_lab.sim.failures``), ``tick`` 1 or, for long runs
of the kinematic model, 10 ms, ``vehicle`` a model.toml or the name of a
shipped set that the car really is, ``effect`` what it has beyond it, such as
``steering_lag:0.06,encoder_ring:missing=0.1`` (docs/reference/effects.md), ``mocap``
1 or, for example, ``rate=50,lock=2``: a motion capture sees the car
(``dart_lab.sim.mocap``), ``lidar`` 1 or, for example, ``rate=8,noise=0.01``: a lidar on the car
(``dart_lab.sim.lidar``), in the room ``map``, ``camera`` top: a camera below the ceiling sees
the car (``dart_lab.sim.camera``), ``pace`` 1: real time, the world does not wait
for its program, ``world`` a name: cars of this process that name the same one see each other's
bodies (``dart_lab.sim.arena``), ``at`` X,Y,YAW: where in the room the car begins.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from dart_hal.core.errors import EmulatorMissing, UsageError
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend
from dart_hal.devices.links.boot import BOOTS, STARTUP, BootWait
from dart_hal.devices.links.image import BOOTLOADER
from dart_hal.devices.links.paced import PacedBus, PacedImages, PacedLink, PacedPoses, PacedScans
from dart_lab.sim.arena import contacts_of, enter, room_seed, start_of
from dart_lab.sim.camera import TopView
from dart_lab.sim.car_file import car_toml
from dart_lab.sim.cutoff import CUTOFFS, FLAWED
from dart_lab.sim.drawn import car_of, choice
from dart_lab.sim.eeprom import preset
from dart_lab.sim.failures import parse, schedule, silences
from dart_lab.sim.faults import Line, LineFaults, jitter
from dart_lab.sim.hidden import HiddenCar
from dart_lab.sim.lidar.maps import Room, room_of
from dart_lab.sim.lidar.params import LidarParams, lidar_of
from dart_lab.sim.lidar.unit import SimLidar, Unit
from dart_lab.sim.link import SimClock, SimLink
from dart_lab.sim.mocap import MocapParams, SimMocap, mocap_of
from dart_lab.sim.mock_nano import MockNano
from dart_lab.sim.nano import Nano
from dart_lab.sim.workshop import SimWorkshop
from dart_lab.sim.world import World

OPTIONS = ("seed", "nano", "physics", "ring", "rings", "jitter", "ber", "cutoff", "boot", "fail",
           "tick", "vehicle", "effect", "mocap", "lidar", "camera", "map", "pace", "world", "at")


def open_sim(url: Url) -> Backend:
    """Open a simulated car. Raises UsageError, EmulatorMissing (nano=avr only)."""
    url.known(*OPTIONS, old=("model",))
    if url.target not in ("", "/"):
        raise UsageError("sim:// takes options only", found=url.text,
                         expected="sim://?seed=1&nano=mock")
    drawn = car_of(url)
    car = drawn.true
    cutoff = url.options.get("cutoff", "none")
    fitted = cutoff.partition("-")[0] if cutoff in FLAWED else choice(url, "cutoff", *CUTOFFS)
    params = {"safety_out": CUTOFFS[fitted]} if fitted and fitted != "none" else {}
    rings = int(choice(url, "rings", "1", "2") or 1)
    if rings == 2:
        params["ring_b"] = 1
    nano, notices = _nano(url, car, preset(car.board_id, params))
    world = World(car, nano, drawn.model, _tick(url, drawn.model), cutoff)
    failures = [parse(text) for text in url.options.get("fail", "").split(",") if text]
    schedule(world, failures)
    latency = jitter(url.options.get("jitter", "none"))
    silence = silences(failures)
    up = LineFaults(bit_error=_number(url, "ber", 0.0), silence=silence)
    world.lines = (Line(up, latency, (car.seed, 200)),
                   Line(LineFaults(silence=silence), latency, (car.seed, 300)))
    link = SimLink(world, *world.lines)
    mocap = mocap_in_room(url, car.seed)
    lidar = lidar_in_room(url, car.seed)
    pace = choice(url, "pace", "1")
    place = enter(url, car.name)
    backend = Backend(url=url, link=link, clock=SimClock(link), bus=world.bus, virtual=True,
                      simulated=True, car=car.name,
                      car_toml=car_toml(drawn.base, drawn.body, rings),
                      notices=notices + drawn.notices, workshop=SimWorkshop(world),
                      poses=None if mocap is None else SimMocap(world, mocap),
                      lidar=None if lidar is None else SimLidar(
                          Unit(world.poses, lidar[1], lidar[0], car.seed)))
    if place is not None:
        world.trail = place.trail
        backend.contacts, backend.closers = contacts_of(place), (place.leave,)
        if isinstance(backend.lidar, SimLidar):
            backend.lidar.unit.others.append(place.others)
    def top() -> TopView:
        return TopView(world.poses, room_in_view(url, car.seed), _begins(url, car.seed),
                       place.others if place else None)

    backend.cameras = {"top": top}
    if choice(url, "camera", "0", "top") == "top":
        backend.camera = top()
    return _in_real_time(backend, link, world, top) if pace else backend


def mocap_in_room(url: Url, seed: int) -> MocapParams | None:
    """The motion capture of a URL, None without one; that of a world of several cars is the room's,
    so that their poses compare. Raises UsageError."""
    params = mocap_of(url.options.get("mocap", "0"), seed)
    start = start_of(url)
    if params is None or start is None or "world" not in url.options:
        return params
    x, y, yaw = start
    return replace(params, x=x, y=y, yaw=yaw)


def lidar_in_room(url: Url, seed: int) -> tuple[LidarParams, Room] | None:
    """The lidar of a URL and the room that it is in, None without one. Raises UsageError."""
    params, name = lidar_of(url.options.get("lidar", "0"), seed), url.options.get("map")
    if params is None:
        if name is not None and not _filmed(url):
            raise UsageError("a map without a lidar that sees it", found=url.text,
                             expected=f"lidar=1&map={name}")
        if start_of(url) is not None and "world" not in url.options and not _filmed(url):
            raise UsageError("a place in a room that nobody sees", found=url.text,
                             expected="at=X,Y,YAW with lidar=1, or with world=NAME")
        return None
    room, start = room_of(name or "room", room_seed(url, seed)), start_of(url)
    return params, room if start is None else replace(room, start=start)


def _filmed(url: Url) -> bool:
    return url.options.get("camera") == "top"


def room_in_view(url: Url, seed: int) -> Room | None:
    """The room of a car that has a lidar, or names a map; None without. Raises UsageError."""
    seen = lidar_in_room(url, seed)
    if seen is not None:
        return seen[1]
    name, start = url.options.get("map"), start_of(url)
    if name is None:
        return None
    room = room_of(name, room_seed(url, seed))
    return room if start is None else replace(room, start=start)


def _begins(url: Url, seed: int) -> tuple[float, float, float]:
    """Where in its room a car begins."""
    room = room_in_view(url, seed)
    return room.start if room is not None else start_of(url) or (0.0, 0.0, 0.0)


def _in_real_time(backend: Backend, link: SimLink, world: World,
                  top: Callable[[], TopView]) -> Backend:
    paced = PacedLink(link, lambda: link.now, link.sleep)
    return replace(backend, link=paced, clock=paced, bus=PacedBus(world.bus, paced),
                   virtual=False, poses=backend.poses and PacedPoses(backend.poses, paced),
                   lidar=backend.lidar and PacedScans(backend.lidar, paced),
                   camera=backend.camera and PacedImages(backend.camera, paced),
                   cameras={"top": lambda: PacedImages(top(), paced)},
                   workshop=SimWorkshop(world, paced.lock))


def _nano(url: Url, car: HiddenCar, eeprom: bytes) -> tuple[Nano, tuple[str, ...]]:
    """The emulated firmware, or MockNano with the reason as a notice."""
    wanted = choice(url, "nano", "avr", "mock")
    boot = choice(url, "boot", *BOOTS) or "none"
    notices: tuple[str, ...] = ()
    if wanted != "mock":
        try:
            return _emulated(car.clock_error, eeprom, boot), ()
        except EmulatorMissing as error:
            if wanted == "avr":
                raise
            notices = (f"MockNano instead of the firmware: {error.what}. Results with it say "
                       f"nothing about the firmware; to get it: {error.remedy}",)
    return MockNano(clock_error=car.clock_error, eeprom=eeprom, boot=BOOTS[boot]), notices


def _emulated(clock_error: float, eeprom: bytes, boot: str) -> Nano:
    """Opening its port resets a Nano that has a bootloader, as DTR does."""
    try:
        from dart_hal.devices.links.emulator import EmulatedNano
    except ImportError as error:
        raise EmulatorMissing(f"the emulator's bindings cannot be imported ({error})") from error
    if boot == "none":
        return EmulatedNano(clock_error=clock_error, eeprom=eeprom)
    real = boot == "old" and BOOTLOADER.is_file()
    nano = EmulatedNano(clock_error=clock_error, eeprom=eeprom, bootloader=real)
    nano.set_boot(BootWait(STARTUP) if real else BOOTS[boot])
    nano.reset("external")
    return nano


def _tick(url: Url, model: str) -> float:
    tick = choice(url, "tick", "1", "10") or "1"
    if tick == "10" and model != "kinematic":
        raise UsageError("tick=10 is too coarse for tyres at walking pace", found=url.text,
                         expected="physics=kinematic with it")
    return int(tick) * 1e-3


def _number(url: Url, name: str, default: float) -> float:
    """A share from 0 to 1."""
    text = url.options.get(name)
    try:
        value = default if text is None else float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= 1.0:
        raise UsageError(f"{name}={text!r} is not a share", found=url.text,
                         expected="a number from 0 to 1")
    return value
