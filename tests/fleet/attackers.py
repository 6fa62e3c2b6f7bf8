"""A room in virtual time with a substitute for a car, a watcher, and an attacker on its network."""

from __future__ import annotations

import itertools

from dart_hal.core.url import Url
from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import Decoder, encode
from dart_hal.fleet.key import RoomKey
from dart_hal.fleet.outbox import Outbox
from dart_hal.fleet.peers import Peers
from dart_hal.fleet.station import Station
from dart_hal.fleet.stopping import StopRule
from dart_hal.fleet.transports.local import open_local

ROOM_KEY = RoomKey(b"key of the laboratory")
OTHER_KEY = RoomKey(b"key of the next laboratory")
ATTACK_STEP_S = 0.01
STOP_WITHIN_S = 0.3
_names = itertools.count()


class FakeCar:
    """The room side of a car: it looks each 10 ms, sends at 20 Hz, answers STOP.

    hears: False = it is out of reach of the room's messages, and sends nevertheless.
    """

    def __init__(self, room, name="red", boot=7, key=None, mode="ARMED"):
        self.line = open_local(Url.parse(room))
        self.peers = Peers(name, boot, key)
        self.outbox = Outbox(self.peers, self.line)
        self.rule = StopRule(STOP_WITHIN_S)
        self.peers.on_beat = lambda who, since: self.rule.beat(since)
        self.peers.on_stop = self.stop
        self.key = key
        self.mode = mode
        self.hears = True
        self.now = 0.0
        self.stops = 0

    def stop(self, number, who, why):
        self.rule.stop(number, who, why, self.now)
        self.mode = "TRIPPED"
        self.stops = self.stops + 1
        self.outbox.send_heard(self.now)
        self.outbox.send(m.STOPPED, (number,), self.now)

    def step(self, now, count):
        self.now = now
        if self.hears:
            self.peers.receive(self.line, now)
        else:
            self.line.poll(now)
        if count % 5 == 0:
            self.outbox.send(m.HEALTH, (self.mode, 0, "", ""), now)
            if self.key is not None:
                self.outbox.send_heard(now)


class AttackScene:
    """Time, members, and what the attacker has recorded (each frame once, in order)."""

    def __init__(self, key=None, *, cars=1, options=""):
        self.room = f"local://scene{next(_names)}"
        self.key = key
        self.now = 0.0
        self.count = 0
        self.cars = [FakeCar(self.room + options, boot=7 + n, key=key) for n in range(cars)]
        self.attacker = open_local(Url.parse(self.room))
        self.recorded = []
        self.station = None

    @property
    def car(self):
        return self.cars[0]

    def watcher(self, key="room", name="base"):
        self.station = Station(self.room, name, now=lambda: self.now, pause=self.run_for,
                               room_key=self.key if key == "room" else key)
        return self.station

    def run_for(self, seconds, each=lambda: None):
        """Let time pass; the longest time without a reason to hold the first car is returned."""
        end = self.now + seconds
        drove = 0.0
        since = self.now
        while self.now < end - 1e-9:
            self.now = round(self.now + ATTACK_STEP_S, 6)
            self.count += 1
            each()
            self.recorded += [d.data for d in self.attacker.poll(self.now)]
            for car in self.cars:
                car.step(self.now, self.count)
            if self.car.rule.drive_block(self.now):
                since = self.now
            drove = max(drove, self.now - since)
        return drove

    def watch(self, seconds):
        """The watcher beats for so long; it has to let the car drive."""
        self.run_for(seconds, lambda: self.station.watch())
        assert self.car.rule.drive_block(self.now) == ""

    def play(self, frames):
        """Send recorded frames, one each step, from the first again when they end."""
        frames = itertools.cycle(list(frames))
        return lambda: self.attacker.send(next(frames), self.now)

    def of_kind(self, kind, name="base"):
        """Recorded frames of a kind, whether signed or not."""
        return [d for d in self.recorded
                if (heard := reader(self.key).decode(d)) and heard.kind is kind
                and heard.name == name]

    def close(self):
        for end in (self.attacker, *(car.line for car in self.cars)):
            end.close()
        if self.station is not None:
            self.station.close()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()


def reader(key):
    return Decoder(key)


def forged_beats(scene, key=None, *, echo=False, boot=99, name="base"):
    """What an attacker sends each step: a BEAT, and with ``echo`` the numbers that it overhears."""
    sequence = itertools.count(1)

    def send():
        if echo:
            newest = {}
            for data in scene.recorded[-40:]:
                heard = reader(scene.key).decode(data)
                if heard is not None:
                    newest[heard.boot] = heard.seq
            scene.attacker.send(encode(m.HEARD, boot, next(sequence), scene.now,
                                       (name, tuple(newest.items())), key), scene.now)
        scene.attacker.send(encode(m.BEAT, boot, next(sequence), scene.now, (name,), key),
                            scene.now)
    return send
