"""``Car``: the facade that a controller talks to, whatever stands behind it."""

from __future__ import annotations

import atexit
import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from math import inf
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from dart_hal.car.camera import CarCamera, give_camera
from dart_hal.car.engine import Engine
from dart_hal.car.exit_signals import stop_on_signals
from dart_hal.car.files import files_of
from dart_hal.car.guarding import own_actuator
from dart_hal.car.hooks import Hook
from dart_hal.car.identity import Hello
from dart_hal.car.lidar import CarLidar, give_lidar
from dart_hal.car.misuse import (
    absent,
    check_attribute,
    check_message,
    check_record,
    check_times,
    check_url,
    shut,
)
from dart_hal.car.poses import give_poses
from dart_hal.car.pump import InlinePump, Pump, ThreadPump
from dart_hal.car.recorder import Record, Recorder, keep_old
from dart_hal.car.timing import LoopTimer, Timing, check_every
from dart_hal.car.viewers import open_viewer
from dart_hal.compat import load_moved_member
from dart_hal.control.loop import SpeedLoop
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import EndOfRecording, NoHello
from dart_hal.core.notebook import card
from dart_hal.core.ports import ImageSource, PoseSource, ScanSource
from dart_hal.core.process.forks import ParentsLock, in_child
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import Applied, Contact, State
from dart_hal.devices.actuation import ArmState, Caution, Event, disarmed
from dart_hal.devices.actuation.chain import WATCH_PULSE_US
from dart_hal.devices.actuation.limits import number, validity
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.recording.bus import RecordedBus
from dart_hal.wire.messages import BY_NAME

DEFAULT_URL = "sim://"
FIRST_PULSES = 0.1
"""s until the ESC has seen the first neutral of a car that has just been opened."""
RAW_PATIENCE = 1.0
"""s that raw() waits for what comes by waiting: a clean half second of frames."""
ARM_PATIENCE = 4.5
"""s: the ESC's 2 s of neutral, 0.5 s of good checks, 1.5 s for what comes by waiting."""

log = logging.getLogger("dart_hal")


def backend_of(url: str | None) -> Backend:
    """The backend of a URL; None: $DART_HAL_URL, then sim://. Raises as ``Car.open``."""
    check_url(url)
    return open_backend(url or os.environ.get("DART_HAL_URL") or DEFAULT_URL)


class Car:
    """One open car: real, emulated or recorded. Made by ``Car.open``; a context manager.

    ``files`` the car's files; ``hello`` who answered; ``notices`` sentences
    the user must see once; ``raise_on_trip`` as ``open`` says.
    """

    raise_on_trip = True

    def __init__(self, backend: Backend, files: CarFiles, record: Record | None = None) -> None:
        self.files = files
        self.notices = backend.notices
        self.url = backend.url.text
        self._engine = Engine(backend, files)
        self._loop = SpeedLoop(files)
        self._timer = LoopTimer()
        self._state: State | None = None
        self._pump: Pump | None = None
        self._closed = False
        self._told: set[str] = set()
        self._asked: tuple[float, float] | None = None
        self._recorder = Recorder(self._engine, files, record)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse what other libraries know: ``car.steering = 0.3`` would move nothing."""
        check_attribute(name)
        super().__setattr__(name, value)

    if not TYPE_CHECKING:  # a type checker is to know of no other member

        def __getattr__(self, name: str) -> Any:
            """Return what a member of version 0.1 is now."""
            return load_moved_member(self, name)

    # -- life ------------------------------------------------------------------

    @classmethod
    def open(cls, url: str | None = None, *, car: str | None = None,
             cars: str | Path | None = None, record: Record | None = None,
             poses: str | PoseSource | None = None, lidar: str | ScanSource | None = None,
             camera: str | ImageSource | None = None, raise_on_trip: bool = True) -> Car:
        """Open a car and leave it at neutral and disarmed.

        url None: $DART_HAL_URL, then sim://. ``car`` names the files of a real
        car, None: $DART_HAL_CAR, then dart-01; a simulated or recorded car
        brings its own. ``cars``: folder of the cars' files. ``record``: MCAP
        file for everything that passes. ``poses``: who sees the car from
        outside, a source or its URL (None: $DART_HAL_POSES). ``lidar``: a source
        of scans or its URL (None: $DART_HAL_LIDAR); ``camera``: of images, such as usb:0, csi:0,
        of sim:// top (None: $DART_HAL_CAMERA). ``raise_on_trip``: a command
        to a car that a trip has disarmed raises Disarmed; False: only
        ``Applied.limited`` says so. Raises the errors of the catalogue:
        UnknownScheme, NoHello, ...
        """
        return cls.over(backend_of(url), car=car, cars=cars, record=record, poses=poses,
                        lidar=lidar, camera=camera, raise_on_trip=raise_on_trip)

    @classmethod
    def over(cls, backend: Backend, *, car: str | None = None, cars: str | Path | None = None,
             record: Record | None = None, poses: str | PoseSource | None = None,
             lidar: str | ScanSource | None = None, camera: str | ImageSource | None = None,
             raise_on_trip: bool = True) -> Car:
        """As ``open``, over a backend that is open already; closes it on failure."""
        try:
            if record:
                check_record(record)
            files = files_of(backend, car, cars)
            give_poses(backend, poses)
            give_lidar(backend, lidar)
            give_camera(backend, camera)
            own_actuator(backend, files)
            if record and backend.bus is not None:
                backend.bus = RecordedBus(backend.bus, backend.clock.now)
            if record and (kept := keep_old(record)):
                backend.notices += (f"{record} was there; it is kept as {kept}",)
            opened = cls(backend, files, record)
        except BaseException:
            backend.close()
            raise
        opened.raise_on_trip = raise_on_trip
        opened._begin()
        return opened

    def _begin(self) -> None:
        engine = self._engine
        if not engine.backend.virtual:
            in_child(self._disown)
        atexit.register(self.close)
        stop_on_signals()
        try:
            engine.driver.open(engine.now)
            self.files = replace(self.files, board=engine.identify().board)
            engine.start()
            self._pump = InlinePump(engine) if engine.backend.virtual else ThreadPump(engine)
            engine.driver.ready()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Neutral, two PWM frames, then let go of bus and port; idempotent.

        A second Ctrl-C on the way cuts a step short, never the ones after it.
        """
        if self._closed:
            return
        self._closed = True
        with ExitStack() as steps:  # from the last to the first
            steps.callback(atexit.unregister, self.close)
            steps.callback(self._engine.backend.close)
            steps.callback(self._recorder.close)
            if self._pump is not None:
                steps.callback(self._pump.stop)
            steps.callback(self._engine.close)

    def _disown(self) -> None:
        """In a forked child: the car stays its parent's, whatever is called here."""
        self._closed = True
        self._recorder.disown()
        self._engine.lock = ParentsLock()
        atexit.unregister(self.close)

    def __enter__(self) -> Car:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    # -- the loop ----------------------------------------------------------------

    def states(self, *, duration: float = inf, timeout: float = 0.5,
               every: int = 1) -> Iterator[State]:
        """One State per telemetry frame, 100 Hz: the loop's clock; or ``every`` n-th: 10 for 10 Hz.

        Blocks on the next frame; a loop that is too slow gets the newest one, one of two
        threads only some (``health.skipped`` counts the others). Ends after ``duration`` s of the
        car's time, or at the end of a recording. Between, a command holds for its
        ``valid_for``. Raises LinkLost after ``timeout`` s without a frame,
        UsageError for times that are none and an ``every`` that is not of 1 to 25.
        """
        check_times(duration=duration, timeout=timeout)
        check_every(every)
        start: float | None = None
        self._timer.begin()
        while True:
            try:
                state = self._next(timeout, every if start is not None else 1)
            except EndOfRecording:
                return
            start = state.t if start is None else start
            yield state
            if state.t - start >= duration - (every + 0.5) * SAMPLE:
                return

    def _next(self, timeout: float, every: int) -> State:
        if self._pump is None or self._closed:
            raise shut("states()")
        mode, virtual = self._engine.driver.mode, self._engine.backend.virtual
        self._timer.asked(every, armed=mode in (ArmState.ARMED, ArmState.RAW), waits=virtual)
        frames = 0
        while frames < every:
            state, skipped = self._pump.next(timeout)
            frames += 1 + skipped
        self._timer.tick(self._engine.now, frames, every)
        if self._timer.skipped:
            state = replace(state, health=replace(state.health, skipped=self._timer.skipped))
        self._state = state
        self._timer.give()
        return state

    # -- commands ------------------------------------------------------------------

    def drive(self, *, steering: float = 0.0, throttle: float = 0.0, valid_for: float = 0.2,
              source: str = "user") -> Applied:
        """Command steering [rad, left positive] and throttle [-1..1] for ``valid_for`` s,
        at most 0.5: VALIDITY.

        Returns what the pins carry, or will with the next PWM frame, and why
        it differs. Raises BadCommand for what is no finite number and for what
        cannot be meant, and the car is tripped then; Disarmed where a trip has
        disarmed it since ``arm()``.
        """
        engine = self._engine
        self._refuse_if_disarmed()
        with self._commanding() as now:
            planned = engine.driver.actuator.command(steering, throttle, valid_for, source, now)
            self._asked = (steering, throttle)
            self._recorder.command(now, steering, throttle, source)
            return engine.driver.applied if engine.answer() else planned

    def drive_speed(self, *, steering: float, speed: float, valid_for: float = 0.2,
                    source: str = "user") -> Applied:
        """Command steering [rad] and a speed [m/s] held by the built-in loop.

        Feed-forward from model.toml (else the paper's model) and a PI part, tuned from how
        late the car answers; its integral is forgotten at a stop and when commands expired.
        Where rolling out is too slow, the ESC's brake is pulled; 0 is neutral. While the speed is
        doubted (``health.speed_doubted``) the feed-forward alone drives, at most
        [limits] encoder_lost_throttle: ENCODER_DOUBTED. Beyond [limits] max_speed:
        RANGE. Backward after forward, the ESC is braked first: REVERSING. Raises as ``drive``.
        """
        with self._commanding():
            of = f"source {source}"
            wanted, window = number("speed", speed, of), validity(valid_for, of)
            armed = self._engine.driver.mode is ArmState.ARMED
            throttle = self._loop.throttle(wanted, self._state, armed=armed, window=window)
        applied = self.drive(steering=steering, throttle=throttle, valid_for=valid_for,
                             source=source)
        return replace(applied, limited=tuple(dict.fromkeys(
            (*applied.limited, *self._loop.limited))))

    def pulses(self, *, steering_us: float, throttle_us: float | None,
               valid_for: float = 0.2) -> Applied:
        """Raw pulses [us] for calibration, inside ``with car.raw():``, for at most 0.2 s.

        throttle_us None: no pulse at all for the ESC, in ``raw(lifted=True)`` alone. The car's
        limits apply as in ``drive``. Raises BadCommand outside 1000
        to 2000 us or outside raw(); the throttle is neutral then.
        """
        engine = self._engine
        with self._commanding() as now:
            planned = engine.driver.raw_pulses(steering_us, throttle_us, valid_for, now)
            return engine.driver.applied if engine.answer() else planned

    @contextmanager
    def _commanding(self) -> Iterator[float]:
        """A command path: the time; whatever it raises, the throttle is neutral first."""
        engine = self._engine
        with engine.lock:
            if self._closed:
                raise shut("a command")
            try:
                yield engine.now
            except BaseException:
                engine.driver.actuator.refuse()
                raise

    def _refuse_if_disarmed(self) -> None:
        """Raises what ended the arming without the program's knowledge: LinkLost, Disarmed."""
        with self._engine.lock:
            causes = self._engine.driver.supervisor.ended_by
            if causes and self.raise_on_trip and not self._closed:
                raise (self._pump and self._pump.error()) or disarmed(
                    causes, self._engine.driver.stop_reason)

    def stop(self) -> Applied:
        """Throttle neutral now, steering held; the car is disarmed."""
        self._loop.reset()
        with self._engine.lock:
            return self._engine.driver.stop(self._engine.now)

    # -- arming ------------------------------------------------------------------------

    def arm(self, *, waive: Sequence[str] = ()) -> tuple[Caution, ...]:
        """Hold neutral for the ESC's start-up time, check everything, arm.

        Raises NotArmed with every reason that holds; never prompts. Waivable:
        PWM_CLOCK_UNCALIBRATED, CALIBRATION_MISSING; waivers are recorded.
        Returns what does not refuse but should be known; the log tells it too
        (``logging``, "dart_hal"), each once per open car.
        """
        for _ in self.arming(waive=waive):
            pass
        return () if self._engine.backend.bus is None else self._caution()

    def arming(self, *, waive: Sequence[str] = ()) -> Iterator[State]:
        """``arm()`` in steps, one State each, for whoever arms several cars at once."""
        engine = self._engine
        if engine.backend.bus is None:
            return
        yield from self._until_good()
        with engine.lock:
            engine.driver.arm(engine.now, tuple(waive))
            if waive:
                self.note("waived", {"reasons": ", ".join(waive)})
        try:
            yield from self._until_armed()
        except BaseException:  # Ctrl-C while it arms must not leave a car that arms by itself
            self.stop()
            raise

    def _caution(self) -> tuple[Caution, ...]:
        found = self.cautions
        for caution in found:
            if caution.name not in self._told:
                self._told.add(caution.name)
                log.warning("%s", caution)
        return found

    def _until_armed(self) -> Iterator[State]:
        driver = self._engine.driver
        for state in self.states(duration=ARM_PATIENCE):
            if driver.mode is ArmState.ARMED:
                return
            if driver.mode is not ArmState.ARMING:
                break
            yield state
        with self._engine.lock:
            raise driver.refused()

    def _until_good(self) -> Iterator[State]:
        """States until clock and IMU have settled after the opening; 2 s at most."""
        for state in self.states(duration=2.0):
            with self._engine.lock:
                if self._engine.driver.settled(self._engine.now):
                    return
            yield state

    @contextmanager
    def raw(self, *, lifted: bool = False) -> Iterator[None]:
        """Calibration: ``pulses()`` instead of ``drive()``, after the ESC's neutral time.

        As safe as ARMED: pulses hold for 0.2 s, the car's limits, the cap of a
        lost encoder and every trip apply. ``lifted=True`` says that the wheels
        are off the ground: it allows the full range of 1000 to 2000 us, is
        written to the recording, and ends when the IMU shows motion. Ends
        after 10 s without a call. Raises NotArmed when the link or the bus is
        not good; clock and calibration need not exist yet.
        """
        engine, driver = self._engine, self._engine.driver
        for _ in self.states(duration=RAW_PATIENCE):
            with engine.lock:
                if driver.resume_pulses(engine.now):
                    break
        for _ in self.states(duration=self.files.config.throttle.arm_neutral + FIRST_PULSES):
            pass
        for _ in self.states(duration=RAW_PATIENCE):
            with engine.lock:
                if not driver.raw_refusals(engine.now, lifted=lifted):
                    break
        with engine.lock:
            driver.open_raw(engine.now, lifted=lifted)
        if lifted:
            self.note("raw_lifted", {"wheels": "off the ground, as the caller says"})
        try:
            yield
        finally:
            with engine.lock:
                driver.stop(engine.now, Event.RAW_CLOSE)

    def unlock(self, reason: str) -> None:
        """Leave LOCKED (three trips in a minute); the reason is recorded."""
        with self._engine.lock:
            self._engine.driver.event(Event.UNLOCK, self._engine.now)
            self.note("unlock", {"reason": str(reason)})

    def run_stop(self, held: bool, by: str = "program", reason: str = "") -> None:
        """Press a run-stop: a trip, the throttle neutral at once, and nothing arms while somebody
        holds one; False lets go of that of ``by`` alone. A car that it has tripped has to be armed
        again. reason: a sentence for the operator."""
        with self._engine.lock:
            self._engine.driver.hold(held, self._engine.now, by, reason)

    @property
    def stop_reason(self) -> str:
        """Reason of the run-stop that is pressed now, else of the last that ended a drive; ""."""
        with self._engine.lock:
            driver = self._engine.driver
            return next(iter(driver.holders.values()), driver.stop_reason)

    def refusals(self) -> tuple[str, ...]:
        """Names of what would keep ``arm()`` from arming now, waiting apart."""
        with self._engine.lock:
            return self._engine.driver.arm_refusals(self._engine.now)

    @property
    def cautions(self) -> tuple[Caution, ...]:
        """What does not keep the car from arming but should be known."""
        with self._engine.lock:
            return self._engine.driver.cautions(self._engine.now)

    @property
    def causes(self) -> tuple[str, ...]:
        """Names of what tripped the car last."""
        return self._engine.driver.supervisor.causes

    # -- beside the telemetry --------------------------------------------------------

    @property
    def recorder(self) -> Recorder:
        """The recording: begun and ended here, and what the program has logged."""
        return self._recorder

    @property
    def has_lidar(self) -> bool:
        """Whether a lidar was named, or comes with the URL."""
        return self._engine.lidar is not None

    @property
    def lidar(self) -> CarLidar:
        """The lidar: its scans and how it is. Raises UsageError for a car without one."""
        return self._engine.lidar or absent("lidar", "1", "serial:///dev/dart-lidar", self.url)

    @property
    def has_camera(self) -> bool:
        """Whether a camera was named, or comes with the URL."""
        return self._engine.camera is not None

    @property
    def camera(self) -> CarCamera:
        """The camera: its images and how it is. Raises UsageError for a car without one."""
        return self._engine.camera or absent("camera", "top", "usb:0", self.url)

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Put a record of this name into the recording; the newest counts.

        Raises UsageError, recording or not, for values that are not text.
        """
        self._recorder.note(name, values)

    def log(self, name: str, value: object) -> None:
        """Record a number, an array of any shape, or a dict of them, under ``name``, now.

        ``name`` is of letters, digits and _, its parts joined by /: ``mpc/cost``; an entry of a
        dict becomes the channel ``name/key``. NaN and inf are values, True is 1. Stamped in
        the car's clock. Raises LogError for another name or value, recording or not.
        """
        self._recorder.log(name, value)

    # -- what is known -----------------------------------------------------------------

    @property
    def hello(self) -> Hello:
        """Identity of the Nano that answered."""
        hello = self._engine.receiver.hello
        if hello is None:
            raise NoHello("the Nano has not said who it is", found=self.url)
        return hello

    @property
    def now(self) -> float:
        """This moment [s] on the car's clock, on which ``State.t`` is told."""
        return self._engine.now

    @property
    def simulated(self) -> bool:
        """Whether it is a car of this program's world, or a recording."""
        return self._engine.backend.simulated or self._engine.backend.virtual

    @property
    def waits(self) -> bool:
        """Whether the car's time stands still while the program computes: virtual time."""
        return self._engine.backend.virtual

    @property
    def drives(self) -> bool:
        """False where commands go nowhere: a recording, or a port without its I2C bus."""
        return self._engine.backend.bus is not None

    @property
    def timing(self) -> Timing:
        """How loop and link run."""
        p50, p99, longest = self._timer.quantiles()
        counters = self._engine.receiver.counters
        return Timing(p50, p99, longest, counters.gaps, counters.damaged, self._timer.skipped,
                      self._engine.link_age, *self._timer.work(), self._timer.late)

    def request(self, name: str, **values: int) -> None:
        """Send the Nano a request of the wire ("EDGES_REQ", frames=4); see ``answers``.

        Raises UsageError for a message that there is not.
        """
        engine = self._engine
        check_message(name, BY_NAME)
        with engine.lock:
            engine.transmitter.send(BY_NAME[name], values, engine.now)

    def answers(self, name: str) -> list[dict[str, Any]]:
        """Messages of this name that came since the last call, the newest 64, raw values."""
        with self._engine.lock:
            return self._engine.receiver.taken(name)

    def clock_pulse(self, on: bool, longer_us: float = 0.0) -> float:
        """A pulse on the PCA9685's spare channel, by which its clock is measured, ``longer_us``
        than usual; returns when it was written [s]. Raises BusError.

        Where a cut-off is watched the pulse is there all the time, and stays.
        """
        with self._engine.lock:
            actuator, now = self._engine.driver.actuator, self._engine.now
            there = on or actuator.watched
            actuator.clock_pulse(WATCH_PULSE_US + max(longer_us, 0.0) if there else None)
            return now

    def on_bytes(self, hook: Hook) -> None:
        """``hook(direction, data, t) -> data``: trace or alter the traffic ("rx", "tx")."""
        self._engine.hooks.add(hook)

    def on_state(self, listener: Callable[[State], None]) -> Callable[[], None]:
        """``listener(state)`` sees every State, also those a slow loop skips; keep it short.

        What is returned takes it away again.
        """
        engine = self._engine
        engine.listeners = [*engine.listeners, listener]  # a new list: one may be read now
        def leave() -> None:
            engine.listeners = [one for one in engine.listeners if one is not listener]
        return leave

    # -- shown -------------------------------------------------------------------------

    @property
    def mode(self) -> str:
        """DISARMED, ARMING, ARMED, TRIPPED, LOCKED, RAW, FAULT or CLOSED."""
        return self._engine.driver.mode.value

    @property
    def asked(self) -> tuple[float, float] | None:
        """Steering [rad] and throttle of the last ``drive``, as they were asked for; None: none."""
        return self._asked

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """With the other emulated cars of its world (``sim://?world=NAME``), so far."""
        return self._engine.backend.contacts()

    def view(self, **options: Any) -> Any:
        """Serve a live page of this car: ``with car.view() as page: print(page.urls)``.

        Whoever opens it may stop the car; the program goes on driving. options: those of
        ``dart_lab.live.view.serve.serve``, such as port and lan. Raises UsageError for a port that
        is in use, and without the package websockets.
        """
        return open_viewer("page", self, **options)

    def __repr__(self) -> str:
        last = f"; {self._state!r}" if self._state is not None else ""
        return f"<Car {self.files.config.name} at {self.url}: {self.mode}{last}>"

    def _repr_html_(self) -> str:
        return card(f"Car {self.files.config.name}", self._rows())

    def _rows(self) -> Iterator[tuple[str, str]]:
        yield "URL", self.url
        yield "mode", self.mode
        calibration, model = self.files.calibration, self.files.model
        yield "calibration", "measured" if calibration is not None else "none; nominal values"
        yield "model", "identified" if model is not None else "none; that of the paper"
        yield from self._state.rows() if self._state is not None else (("State", "none yet"),)
