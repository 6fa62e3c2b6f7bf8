"""``sim://``: a whole car in this process, in virtual time.

Options:

- ``seed`` N >= 0: 0 or none the nominal car, else a hidden one
- ``nano``: avr (firmware in the emulator) or mock
- ``physics``: dynamic or kinematic
- ``ring``: even or hidden; ``rings``: 1 or 2 that the Nano counts
- ``jitter``: none, usb, busy or ftdi; ``ber``: bit error rate from the Nano to the host
- ``cutoff``: none, oe or mux, the hardware cut-off between board and ESC
- ``boot``: none, old or optiboot, the bootloader of the Nano
- ``fail``: failures separated by commas (``dart_lab.sim.failures``)
- ``tick``: 1, or 10 for long runs of the kinematic model [ms]
- ``vehicle``: a model.toml or the name of a shipped set, the true vehicle
- ``effect``: further effects, such as ``steering_lag:0.06,encoder_scale:-0.02``
  (docs/reference/effects.md)
- ``mocap``: 1 or, for example, ``rate=50,lock=2``, a motion capture (``dart_lab.sim.mocap``)
- ``lidar``: 1, a model or, for example, ``ld19,noise=0.01``, a lidar (``dart_lab.sim.lidar``)
- ``battery``: 1 or, ``charge=0.2``, a battery and its INA219; ``nano``, a divider at the Nano
  (``dart_lab.sim.battery``)
- ``rc`` 1: an RC receiver whose sticks rest (``dart_lab.sim.rc``)
- ``map``: the room of lidar and camera
- ``camera``: top, a camera at the ceiling (``dart_lab.sim.camera``)
- ``pace`` 1: real time, the world does not wait for the program
- ``world``: a name, shared by cars of this process that see each other (``dart_lab.sim.arena``)
- ``at`` X,Y,YAW: start pose in the room
- ``sealed``: the token of a car of a class (``dart_lab.sim.sealed``)
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
from dart_hal.devices.links.paced import PacedBus, PacedDevice, PacedLink, PacedPoses
from dart_lab.sim.arena import contacts_with, enter_arena, parse_start, room_seed
from dart_lab.sim.battery import Ina219Model, SimBattery, SimDivider, parse_battery
from dart_lab.sim.camera import TopView
from dart_lab.sim.car_file import battery_table, car_toml
from dart_lab.sim.cutoff import CUTOFFS, FLAWED_WIRINGS
from dart_lab.sim.drawn import parse_choice, resolve_car
from dart_lab.sim.eeprom import make_eeprom
from dart_lab.sim.failures import parse_failure, schedule_failures, silent_intervals
from dart_lab.sim.faults import Line, LineFaults, latency_model
from dart_lab.sim.hidden import HiddenCar
from dart_lab.sim.lidar.maps import RoomMap, room_of
from dart_lab.sim.lidar.params import LidarParams, parse_lidar
from dart_lab.sim.lidar.unit import LidarUnit, SimLidar
from dart_lab.sim.link import SimClock, SimLink
from dart_lab.sim.mocap import MocapParams, SimMocap, parse_mocap
from dart_lab.sim.mock_nano import MockNano
from dart_lab.sim.nano import Nano
from dart_lab.sim.rc import SimReceiver
from dart_lab.sim.workshop import SimWorkshop
from dart_lab.sim.world import World

URL_OPTIONS = ("seed", "nano", "physics", "ring", "rings", "jitter", "ber", "cutoff", "boot",
               "fail", "tick", "vehicle", "effect", "mocap", "lidar", "camera", "map", "pace",
               "world", "at", "battery", "rc", "sealed")


def open_sim(url: Url) -> Backend:
    """Open a simulated car. Raises UsageError, EmulatorMissing (nano=avr only)."""
    url.known(*URL_OPTIONS, old=("model",))
    if url.target not in ("", "/"):
        raise UsageError("sim:// takes options only", found=url.text,
                         expected="sim://?seed=1&nano=mock")
    resolved = resolve_car(url)
    car = resolved.true
    cutoff = url.options.get("cutoff", "none")
    fitted = (cutoff.partition("-")[0] if cutoff in FLAWED_WIRINGS
              else parse_choice(url, "cutoff", *CUTOFFS))
    params = {"safety_out": CUTOFFS[fitted]} if fitted and fitted != "none" else {}
    rings = int(parse_choice(url, "rings", "1", "2") or 1)
    if rings == 2:
        params["ring_b"] = 1
    nano, notices = _make_nano(url, car, make_eeprom(car.board_id, params))
    world = World(car, nano, resolved.model, _parse_tick(url, resolved.model), cutoff)
    pack = parse_battery(url.options.get("battery", "0"))
    if pack is not None:
        world.battery = battery = SimBattery(world, pack)
        if pack.at_nano:
            world.divider = SimDivider(battery, world)
        else:
            world.bus.devices.append(Ina219Model(battery))
    rc = parse_choice(url, "rc", "0", "1") == "1"
    if rc:
        world.receiver = SimReceiver()
    failures = [parse_failure(text) for text in url.options.get("fail", "").split(",") if text]
    schedule_failures(world, failures)
    latency = latency_model(url.options.get("jitter", "none"))
    silence = silent_intervals(failures)
    # Bit errors are in the direction to the host; silence and latency are in both.
    up = LineFaults(bit_error=_parse_share(url, "ber", 0.0), silence=silence)
    world.lines = (Line(up, latency, (car.seed, 200)),
                   Line(LineFaults(silence=silence), latency, (car.seed, 300)))
    link = SimLink(world, *world.lines)
    mocap = mocap_in_room(url, car.seed)
    lidar = lidar_in_room(url, car.seed)
    pace = parse_choice(url, "pace", "1")
    place = enter_arena(url, car.name)
    backend = Backend(url=url, link=link, clock=SimClock(link), bus=world.bus, virtual=True,
                      simulated=True, car=car.name,
                      car_toml=car_toml(resolved.base, resolved.body, rings)
                      + battery_table(pack)
                      + ("\n[rc]\n" if rc else ""),
                      notices=notices + resolved.notices, workshop=SimWorkshop(world),
                      poses=None if mocap is None else SimMocap(world, mocap),
                      lidar=None if lidar is None else SimLidar(
                          LidarUnit(world.poses, lidar[1], lidar[0], car.seed)))
    if place is not None:
        world.trail = place.trail
        backend.contacts = contacts_with(place)
        backend.closers = (place.leave,)
        if isinstance(backend.lidar, SimLidar):
            backend.lidar.unit.others.append(place.visible_outlines)

    def top() -> TopView:
        return TopView(world.poses, room_in_view(url, car.seed), _start_pose(url, car.seed),
                       place.visible_outlines if place else None)

    backend.cameras = {"top": top}
    if parse_choice(url, "camera", "0", "top") == "top":
        backend.camera = top()
    return _pace_backend(backend, link, world, top) if pace else backend


def mocap_in_room(url: Url, seed: int) -> MocapParams | None:
    """Return the motion capture of a URL, None without one. Raises UsageError.

    Cars of one world share the frame of their room, so that their poses can be compared.
    """
    params = parse_mocap(url.options.get("mocap", "0"), seed)
    start = parse_start(url)
    if params is None or start is None or "world" not in url.options:
        return params
    x, y, yaw = start
    return replace(params, x=x, y=y, yaw=yaw)


def lidar_in_room(url: Url, seed: int) -> tuple[LidarParams, RoomMap] | None:
    """Return the lidar of a URL and its room, None without a lidar. Raises UsageError."""
    params = parse_lidar(url.options.get("lidar", "0"), seed)
    name = url.options.get("map")
    if params is None:
        if name is not None and not _has_top_camera(url):
            raise UsageError("map= needs a lidar or a camera", found=url.text,
                             expected=f"lidar=1&map={name}")
        if parse_start(url) is not None and "world" not in url.options and not _has_top_camera(url):
            raise UsageError("at= needs a lidar, a camera or a world", found=url.text,
                             expected="at=X,Y,YAW with lidar=1, or with world=NAME")
        return None
    room = room_of(name or "room", room_seed(url, seed))
    start = parse_start(url)
    return params, room if start is None else replace(room, start=start)


def _has_top_camera(url: Url) -> bool:
    return url.options.get("camera") == "top"


def room_in_view(url: Url, seed: int) -> RoomMap | None:
    """Return the room of a car with a lidar or a map, None without. Raises UsageError."""
    lidar = lidar_in_room(url, seed)
    if lidar is not None:
        return lidar[1]
    name = url.options.get("map")
    start = parse_start(url)
    if name is None:
        return None
    room = room_of(name, room_seed(url, seed))
    return room if start is None else replace(room, start=start)


def _start_pose(url: Url, seed: int) -> tuple[float, float, float]:
    """Return the start x, y [m], yaw [rad] of a car in its room."""
    room = room_in_view(url, seed)
    return room.start if room is not None else parse_start(url) or (0.0, 0.0, 0.0)


def _pace_backend(backend: Backend, link: SimLink, world: World,
                  top: Callable[[], TopView]) -> Backend:
    faster = ("without pace=1 in the URL it waits for its program"
              if isinstance(world.nano, MockNano)
              else "nano=mock in the URL is faster")
    paced = PacedLink(link, lambda: link.now, link.sleep, faster)
    return replace(backend, link=paced, clock=paced, bus=PacedBus(world.bus, paced),
                   virtual=False, poses=backend.poses and PacedPoses(backend.poses, paced),
                   lidar=backend.lidar and PacedDevice(backend.lidar, paced),
                   camera=backend.camera and PacedDevice(backend.camera, paced),
                   cameras={"top": lambda: PacedDevice(top(), paced)},
                   workshop=SimWorkshop(world, paced.lock))


def _make_nano(url: Url, car: HiddenCar, eeprom: bytes) -> tuple[Nano, tuple[str, ...]]:
    """Open the emulated firmware, or MockNano with the reason as a notice."""
    kind = parse_choice(url, "nano", "avr", "mock")
    boot = parse_choice(url, "boot", *BOOTS) or "none"
    notices: tuple[str, ...] = ()
    if kind != "mock":
        try:
            return _open_emulator(car.clock_error, eeprom, boot), ()
        except EmulatorMissing as error:
            if kind == "avr":
                raise
            notices = (f"MockNano instead of the firmware: {error.what}. Its results do not hold "
                       f"for the firmware; to get it: {error.remedy}",)
    return MockNano(clock_error=car.clock_error, eeprom=eeprom, boot=BOOTS[boot]), notices


def _open_emulator(clock_error: float, eeprom: bytes, boot: str) -> Nano:
    """Open the emulated firmware; a Nano with a bootloader is reset, as by DTR of a real port."""
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


def _parse_tick(url: Url, model: str) -> float:
    tick = parse_choice(url, "tick", "1", "10") or "1"
    if tick == "10" and model != "kinematic":
        raise UsageError("tick=10 is too coarse for tyres at walking pace", found=url.text,
                         expected="physics=kinematic with it")
    return int(tick) * 1e-3


def _parse_share(url: Url, name: str, default: float) -> float:
    """Return an option that is a number from 0 to 1."""
    text = url.options.get(name)
    try:
        value = default if text is None else float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= 1.0:
        raise UsageError(f"{name}={text!r} is not a share", found=url.text,
                         expected="a number from 0 to 1")
    return value
