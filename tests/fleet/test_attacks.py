"""Recorded, delayed and forged frames in a room: none keeps a car driving, none hides a silent
car. What an attacker can do without a key is stated by the last tests."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import encode
from dart_hal.fleet.peers import MAX_TRANSIT, Peers
from dart_hal.fleet.sender import REPLAY_WINDOW, Order, Sender, Session
from dart_hal.fleet.stopping import StopCall, StopRule
from tests.fleet.attackers import (
    ATTACK_STEP_S,
    OTHER_KEY,
    ROOM_KEY,
    STOP_WITHIN_S,
    AttackScene,
    FakeCar,
    forged_beats,
    reader,
)

STOPS_WITHIN = STOP_WITHIN_S + 2 * ATTACK_STEP_S
"""s: the limit of the rule and two looks. The last beat that counts is older, not younger."""
ROOMS = pytest.mark.parametrize("key", [None, ROOM_KEY], ids=["no key", "key"])


@ROOMS
def test_a_watched_car_drives_and_a_car_without_watcher_does_not(key):
    """Control of the attacks: the rule lets go and holds."""
    with AttackScene(key) as scene:
        scene.watcher()
        scene.run_for(0.3, scene.station.watch)
        assert scene.run_for(1.0, scene.station.watch) >= 0.99
        assert scene.run_for(1.0) <= STOPS_WITHIN


@ROOMS
@pytest.mark.parametrize("part", ["all", "newest", "beyond the window", "beats", "reversed"])
def test_a_replay_does_not_keep_the_car_driving(key, part):
    with AttackScene(key) as scene:
        scene.watcher()
        scene.watch(3.0)
        base = scene.of_kind(m.BEAT) + scene.of_kind(m.HEARD)
        assert len(base) > 2 * REPLAY_WINDOW / 2
        beats = scene.of_kind(m.BEAT)
        frames = {"all": scene.recorded, "newest": scene.recorded[-4:], "beats": beats,
                  "beyond the window": beats[:5], "reversed": scene.recorded[::-1]}[part]
        assert scene.run_for(2.0, scene.play(frames)) <= STOPS_WITHIN


@ROOMS
def test_a_recording_of_yesterday_does_not_beat_for_a_program_that_was_restarted(key):
    """The car's program starts again; the recording has its name, its room and its key."""
    with AttackScene(key) as scene:
        scene.watcher()
        scene.watch(1.0)
        frames = list(scene.recorded)
        scene.station.close()
        scene.station = None
        scene.car.line.close()
        scene.cars = [FakeCar(scene.room, boot=1234, key=key)]
        assert scene.run_for(3.0, scene.play(frames)) == 0.0
        if key is not None:
            assert scene.car.peers.unproven > 20
            assert "recording" in scene.car.peers.list_ignored(scene.now)["base"]


@ROOMS
@pytest.mark.parametrize("delay", [0.4, 1.0, 5.0])
def test_a_stream_that_is_delayed_by_the_network_makes_beats_older(key, delay):
    """All frames of the watcher come late by as much: each is new, in order and signed."""
    with AttackScene(key, options=f"?delay={delay}") as scene:
        scene.watcher()
        assert scene.run_for(delay + 1.0, scene.station.watch) <= 0.0


@ROOMS
def test_a_beat_that_was_held_back_and_comes_late_does_not_beat(key):
    """The attacker withholds BEATs of a watcher that goes on sending its other frames."""
    with AttackScene(key) as scene:
        scene.watcher()
        scene.watch(1.0)
        # The attacker has removed twenty on their way: the car does not know their numbers.
        held_back = iter(scene.of_kind(m.BEAT)[-20:])
        session = scene.car.peers.sessions[("base", scene.station.peers.boot)]
        session.received_bits = 1

        def go_on():
            scene.station.look()
            if scene.count % 5 == 0:
                scene.station._outbox.send_heard(scene.now)
            if scene.count % 10 == 0:
                scene.attacker.send(next(held_back), scene.now)
        assert scene.run_for(1.5, go_on) <= STOPS_WITHIN
        assert session.late > 5, "control: they were new to the car"


@ROOMS
@pytest.mark.parametrize("session", ["new", "that of the watcher"])
def test_a_forged_beat_without_an_echo_does_not_beat(key, session):
    with AttackScene(key) as scene:
        scene.watcher()
        scene.watch(0.5)
        boot = 99 if session == "new" else scene.station.peers.boot
        assert scene.run_for(1.0, forged_beats(scene, boot=boot)) <= STOPS_WITHIN


@pytest.mark.parametrize("signed_with", [None, OTHER_KEY], ids=["unsigned", "another key"])
def test_a_forger_without_the_key_cannot_beat_even_with_echoes(signed_with):
    with AttackScene(ROOM_KEY) as scene:
        scene.watcher()
        scene.watch(0.5)
        assert scene.run_for(1.0, forged_beats(scene, signed_with, echo=True)) <= STOPS_WITHIN
        counters = scene.car.peers.decoder.counters
        assert (counters.unsigned if signed_with is None else counters.forged) > 100
        assert "base" in scene.car.peers.list_ignored(scene.now)


def test_with_the_key_the_same_forger_beats():
    """Control: the forger of the test before sends what a watcher sends."""
    with AttackScene(ROOM_KEY) as scene:
        assert scene.run_for(1.5, forged_beats(scene, ROOM_KEY, echo=True)) > 1.0


def test_without_a_key_a_forger_that_listens_keeps_the_car_driving():
    """What the documentation states of a room without a key."""
    with AttackScene() as scene:
        assert scene.run_for(1.5, forged_beats(scene, echo=True)) > 1.0


@pytest.mark.parametrize("broken", ["arrival", "copies"])
def test_replays_are_noticed_by_these_tests(monkeypatch, broken):
    """Control: beats that count from their arrival, and a window that forgets."""
    act = Peers._notify
    if broken == "arrival":
        def young(self, sender, heard, order):
            act(self, sender, heard, order)
            if heard.kind is m.BEAT:
                self.on_beat(heard.name, 1e9)
        monkeypatch.setattr(Peers, "_notify", young)
    else:
        monkeypatch.setattr(Peers, "_prove", lambda self, sender, heard, arrived:
                            setattr(sender, "proof", arrived))

        def forgets(self, seq):
            self.newest = seq
            return Order.NEWEST
        monkeypatch.setattr(Sender, "classify", forgets)
    with AttackScene() as scene:
        scene.watcher()
        scene.watch(1.0)
        assert scene.run_for(1.0, scene.play(scene.recorded)) > 0.9


# -- every kind of message of a room with a key -------------------------------------------


def test_a_replay_changes_nothing_in_a_room_with_a_key():
    """Within and beyond the window, of another session, to a new receiver: poses, health, stops
    and answers."""
    with AttackScene(ROOM_KEY) as scene:
        scene.watcher()
        scene.watch(2.0)
        scene.station.stop("lunch")
        scene.run_for(1.0)
        frames = list(scene.recorded)
        stops = scene.car.stops
        assert stops > 10
        scene.run_for(1.5, scene.station.watch)
        frames = list(scene.recorded)
        new = FakeCar(scene.room, "blue", boot=55, key=ROOM_KEY)
        scene.cars.append(new)
        scene.car.mode = "ARMED"
        scene.station.close()
        scene.station = None
        before = {s.session: s.heard for s in scene.car.peers.sessions.values()}
        play = scene.play(frames)
        scene.run_for(4.0, lambda: [play() for _ in range(5)])
        assert scene.car.stops == stops
        assert new.stops == 0
        assert new.peers.senders.keys() <= {"red"}, "red lives, the station does not"
        assert {s.session: s.heard for s in scene.car.peers.sessions.values()
                if s.session in before} == before
        assert scene.car.mode == "ARMED"


def test_a_recorded_session_does_not_displace_the_living_one():
    with AttackScene(ROOM_KEY) as scene:
        scene.watcher()
        scene.watch(1.0)
        frames = list(scene.recorded)
        scene.car.line.close()
        scene.cars = [FakeCar(scene.room, boot=77, key=ROOM_KEY)]
        scene.run_for(1.0, scene.station.watch)
        assert scene.station.peers.senders["red"].boot == 77
        play = scene.play(frames)
        scene.run_for(1.0, lambda: (play(), scene.station.watch()))
        assert scene.station.peers.senders["red"].boot == 77


def test_an_earlier_part_of_a_living_session_is_not_believed_by_a_new_receiver():
    with AttackScene(ROOM_KEY) as scene:
        scene.watcher()
        scene.watch(2.0)
        early = scene.recorded[:40]
        scene.run_for(2.0, scene.station.watch)
        new = FakeCar(scene.room, "blue", boot=55, key=ROOM_KEY)
        taken = []
        new.peers.on_health = lambda session, mode: taken.append(
            new.peers.sessions[session].newest)
        scene.cars.append(new)
        play = scene.play(early)
        scene.run_for(1.0, lambda: (play(), scene.station.watch()))
        living = scene.car.outbox._seq
        assert taken
        assert min(taken) > living - 60, "only frames of the last second"


def test_a_new_station_with_the_key_stops_a_car_that_has_never_received_it():
    """The proof costs the time in which the station receives the car once."""
    with AttackScene(ROOM_KEY) as scene:
        scene.run_for(0.5)
        call = scene.watcher().stop("now")
        assert call.silent == set()
        assert call.confirmed_cars == {"red"}
        assert scene.car.stops > 0


def test_a_stop_is_obeyed_after_the_way_back_is_lost():
    """The station was proven; since then it receives nothing any more, and presses stop."""
    with AttackScene(ROOM_KEY) as scene:
        scene.watcher()
        scene.watch(1.0)
        scene.station.peers.receive = lambda transport, now: transport.poll(now)
        scene.run_for(2 * MAX_TRANSIT)
        scene.station.call_stop("way back lost")
        scene.run_for(0.2, scene.station.press)
        assert scene.car.stops > 0


@pytest.mark.parametrize("loss", [0.0, 0.5])
def test_a_room_with_a_key_works_at_loss(loss):
    with AttackScene(ROOM_KEY, options=f"?loss={loss}&seed=3") as scene:
        scene.watcher()
        scene.run_for(1.0, scene.station.watch)
        assert [heard.name for heard in scene.station.cars()] == ["red"]
        assert scene.station.stop("x").silent == set()


@pytest.mark.parametrize(("car_key", "station_key", "reason"), [
    (ROOM_KEY, None, "not signed"), (ROOM_KEY, OTHER_KEY, "signature"),
    (None, ROOM_KEY, "without")])
def test_members_with_and_without_a_key_ignore_each_other_by_name(car_key, station_key, reason):
    with AttackScene(car_key) as scene:
        scene.watcher(key=station_key)
        assert scene.run_for(0.5, scene.station.watch) == 0.0
        assert reason in scene.car.peers.list_ignored(scene.now)["base"]
        assert "red" in scene.station.peers.list_ignored(scene.now)
        assert scene.station.cars() == []


def test_a_flood_of_names_fills_no_list_of_ignored_members():
    with AttackScene(ROOM_KEY) as scene:
        for n in range(500):
            scene.attacker.send(encode(m.BEAT, n, 1, 0.0, (f"n{n}",)), scene.now)
        scene.run_for(0.1)
        assert len(scene.car.peers.decoder.ignored) == 64
        assert scene.car.peers.sessions == {}


def test_a_session_with_a_proof_is_not_pushed_out_by_recordings_of_others():
    with AttackScene(ROOM_KEY) as scene:
        scene.watcher()
        scene.watch(0.5)
        for n in range(600):
            scene.attacker.send(encode(m.BEAT, 1000 + n, 1, 0.0, (f"n{n}",), ROOM_KEY), scene.now)
        scene.run_for(0.1, scene.station.watch)
        assert "base" in scene.car.peers.senders


# -- a car that does not answer is named -------------------------------------------------------


def forge_answers(scene, boot, seq=10**6, then=lambda: None):
    """Answer each STOP in the name of the car, with the number that was overheard."""
    sequence = iter(range(seq, seq + 10**6))

    def send():
        for data in scene.recorded[-20:]:
            heard = reader(scene.key).decode(data)
            if heard is not None and heard.kind is m.STOP:
                scene.attacker.send(encode(m.STOPPED, boot, next(sequence), scene.now,
                                           ("red", heard.values[1])), scene.now)
        then()
    return send


def stop_deaf_car(scene, each):
    """A stop of a car that receives nothing; what the station reports."""
    call = scene.station.call_stop("test")
    scene.run_for(2.2, lambda: (each(), scene.station.press()))
    assert scene.station.press(), "it ends"
    return call


@pytest.mark.slow_except("key-another*")
@pytest.mark.parametrize("boot", [7, 4711], ids=["its session", "another session"])
@ROOMS
def test_a_forged_answer_does_not_hide_a_car_that_drives_on(key, boot):
    with AttackScene(key) as scene:
        scene.watcher()
        scene.watch(0.5)
        scene.car.hears = False
        call = stop_deaf_car(scene, forge_answers(scene, boot))
        assert scene.car.stops == 0
        assert call.silent == {"red"}
        assert call.confirmed_cars == set()


def test_without_an_attacker_the_car_answers():
    with AttackScene() as scene:
        scene.watcher()
        scene.watch(0.5)
        assert stop_deaf_car(scene, lambda: None).silent == set()


@ROOMS
def test_of_two_cars_of_one_name_both_must_answer(key):
    with AttackScene(key, cars=2) as scene:
        scene.watcher()
        scene.watch(0.5)
        scene.cars[1].hears = False
        call = stop_deaf_car(scene, lambda: None)
        assert (call.silent, call.confirmed_cars) == ({"red"}, set())
        scene.cars[1].hears = True
        scene.cars[1].step(scene.now, 1)
        call = stop_deaf_car(scene, lambda: None)
        assert (call.silent, call.confirmed_cars) == (set(), {"red"})


@pytest.mark.parametrize("frame", ["a new session", "a number far ahead", "an old number"])
def test_one_forged_frame_does_not_hide_a_car_from_a_stop(frame):
    with AttackScene() as scene:
        scene.watcher()
        scene.watch(0.5)
        scene.car.hears = False
        boot, seq = {"a new session": (99, 1), "a number far ahead": (7, 2**32 - 1),
                     "an old number": (7, 0)}[frame]
        scene.attacker.send(encode(m.BEAT, boot, seq, scene.now, ("red",)), scene.now)
        scene.run_for(6.0, scene.station.watch)
        assert stop_deaf_car(scene, lambda: None).silent == {"red"}


@ROOMS
def test_a_replayed_answer_of_an_earlier_stop_does_not_count(key):
    with AttackScene(key) as scene:
        scene.watcher()
        scene.watch(0.5)
        assert scene.station.stop("first").silent == set()
        answers = scene.of_kind(m.STOPPED, "red")
        assert answers
        scene.run_for(0.6)
        scene.car.hears = False
        scene.car.mode = "ARMED"
        assert stop_deaf_car(scene, scene.play(answers)).silent == {"red"}


def test_a_car_that_is_first_received_during_the_stop_has_to_answer():
    with AttackScene() as scene:
        scene.watcher()
        scene.car.hears = False
        assert stop_deaf_car(scene, lambda: None).silent == {"red"}


def test_a_dead_car_is_not_made_alive_by_copies_of_its_last_frames():
    with AttackScene() as scene:
        scene.watcher()
        scene.watch(0.5)
        copies = scene.recorded[-8:]
        scene.cars[0].step = lambda now, count: None
        play = scene.play(copies)
        scene.count = 0
        end = scene.now + 2.0
        while scene.now < end:
            scene.now += ATTACK_STEP_S
            play()
            scene.station.look()
        assert scene.station.cars()[0].state == "LOST"


def test_after_a_forged_session_the_car_is_found_again():
    with AttackScene() as scene:
        scene.watcher()
        scene.watch(0.5)
        scene.attacker.send(encode(m.BEAT, 99, 1, scene.now, ("red",)), scene.now)
        scene.run_for(1.0, scene.station.watch)
        assert scene.station.peers.senders["red"].boot == 7
        assert scene.station.cars()[0].state == "ARMED"


@given(st.lists(st.integers(0, 400), max_size=300))
def test_no_number_is_accepted_twice_in_any_order(numbers):
    """Against a list of all that were accepted, for frames that overtake each other at random."""
    sender = Sender(Session("red", 1), 0.0, 0.0, 0.0)
    accepted = set()
    for seq in numbers:
        order = sender.classify(seq)
        newest = max(accepted, default=-1)
        if seq > newest:
            assert order is Order.NEWEST
        elif seq <= newest - REPLAY_WINDOW:
            assert order is Order.OLD
        else:
            assert order is (Order.COPY if seq in accepted else Order.LATE)
        if order in (Order.NEWEST, Order.LATE):
            accepted.add(seq)
    assert sender.accepted == len(accepted)


def test_a_late_number_is_accepted_once():
    sender = Sender(Session("red", 1), 0.0, 0.0, 0.0)
    assert [sender.classify(seq) for seq in (5, 3, 3, 5, 4, 3)] == [
        Order.NEWEST, Order.LATE, Order.COPY, Order.COPY, Order.LATE, Order.COPY]


def test_a_number_stays_known_while_others_overtake_it():
    """100, then the 63 below, then the 63 above: 100 is still in the window."""
    sender = Sender(Session("red", 1), 0.0, 0.0, 0.0)
    for seq in (100, *range(37, 100), *range(101, 164)):
        assert sender.classify(seq) in (Order.NEWEST, Order.LATE)
    assert sender.classify(100) is Order.COPY


def test_only_the_own_recent_number_is_a_proof():
    peers = Peers("red", 7)
    for seq in range(1, 6):
        peers.note_sent(seq, float(seq))

    def proof_after(seq, *echoes):
        heard = reader(None).decode(encode(m.HEARD, 9, seq, 0.0, ("base", echoes)))
        peers.process(heard, 10.0, 10.0)
        return peers.sessions[("base", 9)].proof

    assert proof_after(1) == float("-inf")
    assert proof_after(2, (8, 4)) == float("-inf"), "a number of another member"
    assert proof_after(3, (7, 6)) == float("-inf"), "a number that was not sent yet"
    assert proof_after(4, (8, 5), (7, 4)) == 4.0
    assert proof_after(5, (7, 2)) == 4.0, "an older one takes nothing away"
    assert proof_after(6, (7, 5), (7, 1)) == 5.0


def test_a_stop_takes_answers_with_its_number_alone():
    car = Session("red", 1)
    call = StopCall(77, "", [car], 0.0)
    call.answer(76, car, 0.1)
    assert call.silent == {"red"}
    call.answer(77, car, 0.1)
    assert call.silent == set()
    call.health(car, "ARMED", 0.15)
    assert call.silent == set(), "it may have left before the answer"
    call.health(car, "ARMED", 0.2)
    assert (call.silent, call.confirmed_cars) == ({"red"}, set())
    call.health(car, "TRIPPED", 0.25)
    assert (call.silent, call.confirmed_cars) == (set(), {"red"})
    assert call.is_over(0.3)
    call.health(car, "ARMED", 0.3)
    assert call.silent == set(), "it may arm again when the stop is over"


def test_a_car_that_is_displaced_during_the_stop_has_to_answer():
    """One forged frame of another session at each step, from the moment of the stop on."""
    with AttackScene() as scene:
        scene.watcher()
        scene.watch(0.5)
        scene.car.hears = False
        numbers = iter(range(1, 1000))
        frame = lambda: encode(m.BEAT, 99, next(numbers), scene.now, ("red",))  # noqa: E731
        scene.attacker.send(frame(), scene.now)
        scene.run_for(0.02)
        scene.station.look()
        assert scene.station.peers.senders["red"].boot == 99
        call = stop_deaf_car(scene, lambda: scene.attacker.send(frame(), scene.now))
        assert call.silent == {"red"}


def test_a_car_whose_frames_were_made_old_is_still_known():
    with AttackScene() as scene:
        scene.watcher()
        scene.watch(0.5)
        scene.attacker.send(encode(m.BEAT, 7, 2**32 - 1, scene.now, ("red",)), scene.now)
        scene.run_for(6.0, scene.station.watch)
        assert scene.station.peers.cars(scene.now) == {Session("red", 7)}


def test_an_older_beat_takes_nothing_from_a_newer_one():
    rule = StopRule(STOP_WITHIN_S)
    rule.beat(5.0)
    rule.beat(3.0)
    assert rule.drive_block(5.0 + STOP_WITHIN_S) == ""
    assert rule.drive_block(5.01 + STOP_WITHIN_S) != ""
