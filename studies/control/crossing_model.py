"""Every order of events of a few cars that run ``crossing.order``: who is where is all that is
abstract. A message may be lost, come late or be overtaken, a clock be wrong by any amount, a car
restart at any moment.

    place 0: before the line, 1: on the common ground, 2: past it

    python -m studies.control.crossing_model [--cars 2] [--rounds 2] [--restarts 1] [--room 1]
                                             [--met] [--passed]

passed: somebody else heard a message of a car, whether or not the other did, and passes it on at
any time, as often as it likes, until it has heard another one.
"""

from __future__ import annotations

import argparse
from collections import deque
from typing import NamedTuple

from dart_hal.control.crossing import order
from dart_hal.control.crossing.order import CrossingPhase, Precedence

BEFORE, ON, PAST = 0, 1, 2


class World(NamedTuple):
    """All there is. sent: messages under way from i to j, by seq; kept: stamps on disk; held: of i,
    to be passed on to j."""

    cars: tuple[order.CarOrder, ...]
    places: tuple[int, ...]
    rounds: tuple[int, ...]
    sent: tuple[tuple[order.OrderMessage, ...], ...]
    kept: tuple[int, ...]
    restarts: int
    held: tuple[order.OrderMessage | None, ...] = ()


class Rules:
    """The protocol; mutants change one of its answers."""

    def may_go(self, car: order.CarOrder, j: int) -> bool:
        right = order.precedence(car, j)
        if right is Precedence.AFTER:
            return car.others[j].s_minus >= PAST
        return right is Precedence.GRANTED

    def heard(self, car: order.CarOrder, m: order.OrderMessage) -> order.CarOrder:
        return order.receive(car, m)[0]

    def passed(self, car: order.CarOrder, m: order.OrderMessage) -> order.CarOrder:
        return order.receive(car, m, relayed=True)[0]

    def want(self, car: order.CarOrder, clock: int) -> order.CarOrder:
        return order.request(car, clock)

    def again(self, car: order.CarOrder) -> order.CarOrder:
        return order.restart_session(car, car.boot + 1, 0, BEFORE)

    def restarted(self, n: int, car: order.CarOrder, place: int, kept: int) -> order.CarOrder:
        if place == PAST:
            return order.start_session(car.id, n, car.boot + 1, 0, place, CrossingPhase.DONE)
        phase = (
            CrossingPhase.WANT
            if kept
            else CrossingPhase.BACK
            if place == ON
            else CrossingPhase.FREE
        )
        return order.start_session(car.id, n, car.boot + 1, 0, place, phase, kept)


def put(items, i, value):
    return (*items[:i], value, *items[i + 1:])


def first(
    n: int, rounds: int, restarts: int, met: bool = False, passed: bool = False
) -> World:
    """met: each has told that it hears the others' sessions; passed: messages are passed on."""
    cars = tuple(order.start_session(i, n, 1, 0, BEFORE) for i in range(n))
    if met:
        known = order.OtherCar(1, 1, 0, CrossingPhase.FREE, 0, BEFORE, 0, 1)
        cars = tuple(c._replace(seq=1, others=put((known,) * n, c.id, None)) for c in cars)
    return World(cars, (BEFORE,) * n, (rounds - 1,) * n, ((),) * (n * n), (0,) * n, restarts,
                 (None,) * (n * n) if passed else ())


def after(w: World, rules: Rules, room: int):
    """All worlds that may be next. room: messages under way from one car to another; 0: each comes
    at once, or not at all."""
    n = len(w.cars)
    for i, car in enumerate(w.cars):
        for j in range(n):
            if j == i:
                continue
            way = i * n + j
            told, m = order.next_message(car)
            m = only_for(j, m)
            if w.held and not same(w.held[way], m):
                yield w._replace(cars=put(w.cars, i, told), held=put(w.held, way, m))
            if w.held and (held := w.held[way]) is not None:
                yield w._replace(cars=put(w.cars, j, rules.passed(w.cars[j], held)))
            if news(w, way, j, m):
                new = w._replace(cars=put(w.cars, i, told))
                if not room:
                    yield new._replace(cars=put(new.cars, j, rules.heard(w.cars[j], m)))
                    continue
                if len(w.sent[way]) < room:
                    yield new._replace(sent=put(w.sent, way, (*w.sent[way], m)))
                for k in range(len(w.sent[way])):  # one of those before was lost
                    yield new._replace(sent=put(w.sent, way, (*without(w.sent[way], k), m)))
            for k, m in enumerate(w.sent[way]):
                yield w._replace(cars=put(w.cars, j, rules.heard(w.cars[j], m)),
                                 sent=put(w.sent, way, without(w.sent[way], k)))
        place = w.places[i]
        if car.phase is CrossingPhase.FREE and place == BEFORE:
            top = 1 + max(max(c.highest, c.ts) for c in w.cars)
            for clock in (0, top):
                wants = rules.want(car, clock)
                if wants is not car:
                    yield w._replace(cars=put(w.cars, i, wants), kept=put(w.kept, i, wants.ts))
        if place == BEFORE and car.phase is CrossingPhase.WANT and all(
                rules.may_go(car, j) for j in range(n) if j != i):
            yield moved(w, i, ON, car)
        if place == ON and car.phase is CrossingPhase.WANT:
            w2 = moved(w, i, PAST, order.finish(order.advance(car, PAST)))
            yield w2._replace(kept=put(w.kept, i, 0))
        if place == PAST and car.phase is CrossingPhase.DONE and w.rounds[i]:
            free = rules.again(car)
            yield moved(w, i, BEFORE, free)._replace(rounds=put(w.rounds, i, w.rounds[i] - 1))
        if w.restarts:
            yield w._replace(cars=put(w.cars, i, rules.restarted(n, car, place, w.kept[i])),
                             restarts=w.restarts - 1)


def without(items, k):
    return items[:k] + items[k + 1:]


def only_for(j: int, m: order.OrderMessage) -> order.OrderMessage:
    """What j reads of a message."""
    mine = [(x if k == j else 0) for k, x in enumerate(m.grants)]
    heard = [(x if k == j else 0) for k, x in enumerate(m.heard)]
    return m._replace(grants=tuple(mine), heard=tuple(heard))


def same(a: order.OrderMessage | None, b: order.OrderMessage) -> bool:
    """But for the number."""
    return a is not None and a._replace(seq=0) == b._replace(seq=0)


def news(w: World, way: int, j: int, m: order.OrderMessage) -> bool:
    """Whether it says more than j knows by the newest that was sent: else it changes nothing."""
    last, known = w.sent[way][-1:], w.cars[j].others[m.id]
    if last:
        return not same(last[0], m)
    return known is None or known[0:1] + known[2:8] != (
        m.boot, m.path, m.phase, m.ts, m.s_minus, m.grants[j], m.heard[j])


def moved(w: World, i: int, place: int, car: order.CarOrder) -> World:
    return w._replace(places=put(w.places, i, place),
                      cars=put(w.cars, i, order.advance(car, place)))


def canonical(w: World) -> World:
    """Numbers of messages count by their order alone: each sender's session from 1 up."""
    n, cars, sent, held = len(w.cars), list(w.cars), list(w.sent), list(w.held)
    for i in range(n):
        boot = cars[i].boot
        used = {0}
        for j in range(n):
            o = cars[j].others[i]
            used |= {m.seq for m in sent[i * n + j] if m.boot == boot}
            used |= {o.seq} if o is not None and o.boot == boot else set()
            if held and (h := held[i * n + j]) is not None and h.boot == boot:
                used.add(h.seq)
        rank = {s: k for k, s in enumerate(sorted(used))}
        cars[i] = cars[i]._replace(seq=len(rank))
        for j in range(n):
            way, o = i * n + j, cars[j].others[i]
            if any(m.boot == boot for m in sent[way]):
                sent[way] = tuple(m._replace(seq=rank[m.seq]) if m.boot == boot else m
                                  for m in sent[way])
            if held and (h := held[way]) is not None and h.boot == boot:
                held[way] = h._replace(seq=rank[h.seq])
            if o is not None and o.boot == boot and o.seq != rank[o.seq]:
                cars[j] = cars[j]._replace(others=put(cars[j].others, i,
                                                      o._replace(seq=rank[o.seq])))
    return w._replace(cars=tuple(cars), sent=tuple(sent), held=tuple(held))


def over(w: World) -> bool:
    return not any(w.rounds) and all(p == PAST for p in w.places)


class Checked(NamedTuple):
    """states: how many there are; unsafe: one of two on the ground; stuck: one with no way to
    the end."""

    states: int
    unsafe: World | None
    stuck: World | None


def check(n: int, rounds: int, restarts: int = 0, room: int = 1, rules: Rules | None = None,
          met: bool = False, passed: bool = False, most: int = 2_000_000) -> Checked:
    """All states that can be reached; ends at the first unsafe one."""
    rules = rules or Rules()
    start = canonical(first(n, rounds, restarts, met, passed))
    number, states, into = {start: 0}, [start], [[]]
    line = deque([0])
    while line:
        at = line.popleft()
        w = states[at]
        for new in map(canonical, after(w, rules, room)):
            k = number.get(new)
            if k is None:
                k = number[new] = len(states)
                states.append(new)
                into.append([])
                line.append(k)
                if new.places.count(ON) > 1:
                    return Checked(len(states), new, None)
                if len(states) > most:
                    raise MemoryError(f"more than {most} states")
            into[k].append(at)
    ends = [k for k, w in enumerate(states) if over(w)]
    good, line = set(ends), deque(ends)
    while line:
        for k in into[line.popleft()]:
            if k not in good:
                good.add(k)
                line.append(k)
    stuck = next((w for k, w in enumerate(states) if k not in good), None)
    return Checked(len(states), None, stuck)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    for name, value in (("cars", 2), ("rounds", 2), ("restarts", 0), ("room", 1)):
        parser.add_argument(f"--{name}", type=int, default=value)
    for name in ("met", "passed"):
        parser.add_argument(f"--{name}", action="store_true")
    given = parser.parse_args()
    print(check(given.cars, given.rounds, given.restarts, given.room, met=given.met,
                passed=given.passed))


if __name__ == "__main__":
    main()
