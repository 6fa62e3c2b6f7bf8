"""Rows of a car in a room of cars: it is stopped from there, or its watcher is gone."""

from __future__ import annotations

import itertools
from collections.abc import Callable

from dart_hal.car import join
from dart_hal.core.url import Url
from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import encode, parse_frame
from dart_hal.fleet.key import RoomKey
from dart_hal.fleet.station import Station
from dart_hal.fleet.transports.local import open_local
from fault_table.bench import Bench
from fault_table.drive import forward
from fault_table.row import Measured, Row, case
from fault_table.rows_pins import MS, PULSE

BEAT = 0.3
"""s of silence that the car allows."""
LOOK = 10.0
"""ms from one State, at which the car looks into its room, to the next."""


def stop_by_room(nano: str, loss: float) -> Callable[[Bench], Measured]:
    """Last driving pulse after a STOP through a room that loses frames; the program drives on."""
    def measure(bench: Bench) -> Measured:
        worst = 0.0
        confirmed = 0
        for seed in range(12 if bench.full else 2):
            drive = bench.drive(nano=nano)
            room = f"local://fault-{nano}-{loss}-{seed}?loss={loss}&seed={seed}"
            with (join(drive.car, room, name="red"),
                  Station(room, "base", now=lambda car=drive.car: car.now) as station):
                drive.driving()
                drive.run(0.1 + 0.01 * seed, forward(0.4))
                at = drive.now
                call = station.call_stop("fault table")

                def both(car, state, station=station):
                    station.press()
                    car.drive(throttle=0.4)

                drive.run(1.0, both)
                worst = max(worst, drive.last_wrong(at))
                confirmed = confirmed + len(call.confirmed_cars)
        return Measured(worst, f"{confirmed} answered, then {drive.car.mode}")
    return measure


def stop_beats(nano: str) -> Callable[[Bench], Measured]:
    """Last driving pulse after the last beat of who watches the room."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(nano=nano)
        room = f"local://watched-{nano}"
        with (join(drive.car, room, name="red", beat_within=BEAT),
              Station(room, "base", now=lambda: drive.car.now) as station):
            drive.car.on_state(lambda state: station.watch() if alive else None)
            alive = True
            drive.driving()
            alive = False
            at = drive.now
            drive.run(1.5, forward(0.4))
            return Measured(drive.last_wrong(at), drive.car.mode)
    return measure


FAULT_KEY = RoomKey(b"key of the fault table")
FORGER_KEY = RoomKey(b"another key that was guessed")


class Attacker:
    """Listens in a room and sends into it, once at each State of a car."""

    def __init__(self, room: str) -> None:
        self._line = open_local(Url.parse(room))
        self._numbers = itertools.count(1)
        self.recorded: list[bytes] = []
        self.now = 0.0

    def listen(self, now: float) -> None:
        """Record what has come."""
        self.now = now
        self.recorded += [came.data for came in self._line.poll(now)]

    def player(self, frames: list[bytes]) -> Callable[[], None]:
        """Sends the next of these frames at each call, from the first again at the end."""
        endless = itertools.cycle(frames)
        return lambda: self._line.send(next(endless), self.now)

    def forge(self, kind: m.Kind, values: tuple[object, ...], boot: int = 99) -> None:
        """Send a frame in another member's name, signed with a key that is not the room's."""
        self._line.send(encode(kind, boot, next(self._numbers), self.now, values, FORGER_KEY),
                        self.now)

    def overheard(self) -> tuple[tuple[int, int], ...]:
        """Session and newest number of each member: what an echo repeats."""
        found = {}
        for data in self.recorded[-40:]:
            heard = parse_frame(data, m.SIGNED_VERSION)
            if not isinstance(heard, str):
                found[heard.boot] = heard.seq
        return tuple(found.items())


def attack_room(attack: str) -> Callable[[Bench], Measured]:
    """Last driving pulse of a watched car of a room with a key after its watcher is gone, while an
    attacker goes on: plays its recording of this session or of an earlier one, or forges."""
    def measure(bench: Bench) -> Measured:
        room = f"local://attacked-{attack}"
        recording = watch_and_attack(bench, room, "nothing", [])[1] if attack == "yesterday" else []
        return watch_and_attack(bench, room, attack, recording)[0]
    return measure


def watch_and_attack(bench: Bench, room: str, attack: str, recording: list[bytes]
                     ) -> tuple[Measured, list[bytes]]:
    """One watched drive, and what the attacker has recorded of it."""
    drive = bench.drive(brief=bench.brief and attack != "forged")
    with (join(drive.car, room, name="red", beat_within=BEAT, room_key=FAULT_KEY),
          Station(room, "base", now=lambda: drive.car.now, room_key=FAULT_KEY) as station):
        attacker = Attacker(room)
        watching = True
        actions: list[Callable[[], None]] = []

        def forge() -> None:
            attacker.forge(m.HEARD, ("base", attacker.overheard()))
            attacker.forge(m.BEAT, ("base",))

        def each(state: object) -> None:
            attacker.listen(drive.car.now)
            if watching:
                station.watch()
            for act in actions:
                act()

        drive.car.on_state(each)
        drive.driving()
        watching = False
        at = drive.now
        if attack == "forged":
            actions.append(forge)
        elif attack in ("session", "yesterday"):
            actions.append(attacker.player(recording or list(attacker.recorded)))
        drive.run(1.5, forward(0.4))
        measured = Measured(drive.last_wrong(at), drive.car.mode)
    return measured, attacker.recorded


def stopped_again(bench: Bench) -> Measured:
    """1: a car of a room with a key is disarmed by a recorded STOP of its own watcher."""
    drive = bench.drive()
    room = "local://stopped-again"
    with (join(drive.car, room, name="red", room_key=FAULT_KEY),
          Station(room, "base", now=lambda: drive.car.now, room_key=FAULT_KEY) as station):
        attacker = Attacker(room)
        drive.car.on_state(lambda state: (attacker.listen(drive.car.now), station.watch(),
                                          station.press()))
        drive.run(0.5)
        station.call_stop("fault table")
        drive.run(2.0)
        stops = [data for data in attacker.recorded if not isinstance(
            heard := parse_frame(data, m.SIGNED_VERSION), str) and heard.kind is m.STOP]
        drive.driving()
        play = attacker.player(stops)
        drive.car.on_state(lambda state: play())
        drive.run(0.5, forward(0.4))
        return Measured(float(drive.car.mode != "ARMED"), f"{len(stops)} played: {drive.car.mode}")


def answered_for(bench: Bench) -> Measured:
    """1: a car that drives on is not named, since another session of its name has answered."""
    drive = bench.drive()
    room = "local://answered-for"
    with (join(drive.car, room, name="red") as member,
          Station(room, "base", now=lambda: drive.car.now) as station):
        attacker = Attacker(room)
        numbers = itertools.count(1)

        def each(state: object) -> None:
            attacker.listen(drive.car.now)
            station.press()
            for data in attacker.recorded[-10:]:
                heard = parse_frame(data, m.VERSION)
                if not isinstance(heard, str) and heard.kind is m.STOP:
                    attacker.player([encode(m.STOPPED, 99, next(numbers), 0.0,
                                            ("red", heard.values[1]))])()

        drive.car.on_state(each)
        drive.driving()
        station.look()
        member.peers.receive = lambda transport, now: transport.poll(now)  # it hears no STOP
        call = station.call_stop("fault table")
        drive.run(2.2, forward(0.4))
        return Measured(float("red" not in call.silent), f"{drive.car.mode}, {call.silent} named")


ROWS = (
    Row(47, "all cars of a room are stopped, at 50 % loss", "trip, neutral, answered", (
        case("mock", "no loss", stop_by_room("mock", 0.0), LOOK + PULSE + 10.0, MS, "run_stop",
             fast=True),
        case("mock", "50 % loss", stop_by_room("mock", 0.5), 150.0, MS, "run_stop"),
        case("elf", "no loss", stop_by_room("avr", 0.0), LOOK + PULSE + 10.0, MS, "run_stop"),
    )),
    Row(48, "nobody watches the room any more", "trip, neutral after 0.3 s", (
        case("mock", "silence", stop_beats("mock"), 1e3 * BEAT + 50.0 + LOOK + PULSE, MS,
             "beat_within", fast=True),
    )),
    Row(49, "messages of the watcher are recorded and played again", "no beat, no stop", (
        case("mock", "of this session", attack_room("session"), 1e3 * BEAT + LOOK + PULSE, MS,
             "echo", "replay_window"),
        case("mock", "of an earlier session", attack_room("yesterday"), 1e3 * BEAT + LOOK + PULSE,
             MS,
             "echo", fast=True),
        case("mock", "its STOP", stopped_again, 0, "cars", "replay_window"),
    )),
    Row(50, "messages are forged without the key", "no beat, silent car named", (
        case("mock", "BEAT with the numbers that it overhears", attack_room("forged"),
             1e3 * BEAT + LOOK + PULSE, MS, "room_key", fast=True),
        case("mock", "STOPPED in the name of a car", answered_for, 0, "cars", "stop_answers"),
    )),
)
"""Limits: a State, the pulse under way, one State more until the Nano's line has carried it (47);
the silence counts from the car's own message that the last beat has confirmed (48 to 50). At 50 %
loss ten STOPs, one each 10 ms, are lost one time in a thousand."""
