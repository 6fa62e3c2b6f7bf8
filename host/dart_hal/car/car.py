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
from typing import Any

from dart_hal.actuation import ArmState, Caution, Event
from dart_hal.actuation.chain import WATCH_PULSE_US
from dart_hal.actuation.limits import number, validity
from dart_hal.car.engine import Engine
from dart_hal.car.exit_signals import stop_on_signals
from dart_hal.car.guarding import own_actuator
from dart_hal.car.hooks import Hook
from dart_hal.car.identity import Hello
from dart_hal.car.pump import InlinePump, Pump, ThreadPump
from dart_hal.car.recorder import keep_old, start_recording
from dart_hal.car.timing import LoopTimer, Timing
from dart_hal.config import CarFiles, load_car, parse_car
from dart_hal.control.speed import SpeedLoop
from dart_hal.errors import EndOfRecording, LinkLost, NoHello
from dart_hal.links.base import Backend, open_backend
from dart_hal.process.forks import ParentsLock, in_child
from dart_hal.recording.bus import RecordedBus
from dart_hal.types import SAMPLE, Applied, Limit, State
from dart_hal.wire.messages import BY_NAME

DEFAULT_URL = "sim://"
DEFAULT_CAR = "dart-01"
FIRST_PULSES = 0.1
"""s until the ESC has seen the first neutral of a car that has just been opened."""
RAW_PATIENCE = 1.0
"""s that raw() waits for what comes by waiting: a clean half second of frames."""
ARM_PATIENCE = 4.5
"""s: the ESC's 2 s of neutral, 0.5 s of good checks, 1.5 s for what comes by waiting."""

log = logging.getLogger("dart_hal")


class Car:
    """One open car: real, emulated or recorded. Made by ``Car.open``; a context manager.

    ``files`` the car's files; ``hello`` who answered; ``notices`` sentences
    the user must see once.
    """

    def __init__(self, backend: Backend, files: CarFiles, record: str | Path | None = None) -> None:
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
        self._recorder = start_recording(self._engine, files, record) if record else None

    # -- life ------------------------------------------------------------------

    @classmethod
    def open(cls, url: str | None = None, *, car: str | None = None,
             cars: str | Path | None = None, record: str | Path | None = None) -> Car:
        """Open a car and leave it at neutral and disarmed.

        url None: $DART_HAL_URL, then sim://. ``car`` names the files of a real
        car, None: $DART_HAL_CAR, then dart-01; a simulated or recorded car
        brings its own. ``cars``: folder of
        the cars' files. ``record``: MCAP file for everything that passes.
        Raises the errors of the catalogue: UnknownScheme, PortMissing,
        PortBusy, PortDenied, NoHello, PcaMissing, ConfigError, ...
        """
        text = url or os.environ.get("DART_HAL_URL") or DEFAULT_URL
        return cls.over(open_backend(text), car=car, cars=cars, record=record)

    @classmethod
    def over(cls, backend: Backend, *, car: str | None = None, cars: str | Path | None = None,
             record: str | Path | None = None) -> Car:
        """As ``open``, over a backend that is open already; closes it on failure."""
        folders = [cars] if cars else None
        named = car or os.environ.get("DART_HAL_CAR") or DEFAULT_CAR
        try:
            if backend.car_toml is not None:
                files = parse_car(backend.car_toml, backend.url.text, folders)
                if named not in (DEFAULT_CAR, files.config.name):
                    backend.notices += (f"{backend.url.text} is the car {files.config.name}; "
                                        f"the files of {named} are not used",)
            else:
                files = load_car(backend.car or named, folders)
            own_actuator(backend, files)
            if record and backend.bus is not None:
                backend.bus = RecordedBus(backend.bus, backend.clock.now)
            if record and (kept := keep_old(record)):
                backend.notices += (f"{record} was there; it is kept as {kept}",)
            opened = cls(backend, files, record)
        except BaseException:
            backend.close()
            raise
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
            engine.identify()
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
            if self._recorder is not None:
                steps.callback(self._recorder.close)
            if self._pump is not None:
                steps.callback(self._pump.stop)
            steps.callback(self._engine.close)

    def _disown(self) -> None:
        """In a forked child: the car stays its parent's, whatever is called here."""
        self._closed = True
        self._engine.lock = ParentsLock()
        atexit.unregister(self.close)

    def __enter__(self) -> Car:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    # -- the loop ----------------------------------------------------------------

    def states(self, *, duration: float = inf, timeout: float = 0.5) -> Iterator[State]:
        """One State per telemetry frame, 100 Hz: the loop's clock.

        Blocks on the next frame; a loop that is too slow gets the newest one
        (``health.skipped`` counts the others). Ends after ``duration`` s of the
        car's time, or at the end of a recording. Raises LinkLost after
        ``timeout`` s without a frame.
        """
        start: float | None = None
        while True:
            try:
                state = self._next(timeout)
            except EndOfRecording:
                return
            start = state.t if start is None else start
            yield state
            if state.t - start >= duration - 1.5 * SAMPLE:
                return

    def _next(self, timeout: float) -> State:
        if self._pump is None or self._closed:
            raise LinkLost("the car is closed", likely="states() used outside the with block, "
                           "or in a forked child", remedy="open it again with Car.open()")
        state, skipped = self._pump.next(timeout)
        self._timer.tick(self._engine.now, skipped)
        if self._timer.skipped:
            state = replace(state, health=replace(state.health, skipped=self._timer.skipped))
        self._state = state
        return state

    # -- commands ------------------------------------------------------------------

    def drive(self, *, steering: float = 0.0, throttle: float = 0.0, valid_for: float = 0.2,
              source: str = "user") -> Applied:
        """Command steering [rad, left positive] and throttle [-1..1] for ``valid_for`` s.

        Returns what the pins carry, or will with the next PWM frame, and why
        it differs. Raises BadCommand for what is no finite number and for what
        cannot be meant; whatever this call raises, the car is tripped then.
        """
        engine = self._engine
        with self._commanding() as now:
            planned = engine.driver.actuator.command(steering, throttle, valid_for, source, now)
            if self._recorder is not None:
                self._recorder.command(now, steering, throttle, source)
            return engine.driver.applied if engine.answer() else planned

    def drive_speed(self, *, steering: float, speed: float, valid_for: float = 0.2,
                    source: str = "user") -> Applied:
        """Command steering [rad] and a speed [m/s] held by the built-in loop.

        Feed-forward from model.toml (else the paper's model) and a PI part.
        The integral is forgotten at a stop and when commands expired. While the
        measured speed is doubted (``health.speed_doubted``) the feed-forward
        alone drives, at most [limits] encoder_lost_throttle: ENCODER_DOUBTED.
        Raises as ``drive``.
        """
        with self._commanding():
            of = f"source {source}"
            wanted, window = number("speed", speed, of), validity(valid_for, of)
            armed = self._engine.driver.mode is ArmState.ARMED
            throttle = self._loop.throttle(wanted, self._state, armed=armed, window=window)
        applied = self.drive(steering=steering, throttle=throttle, valid_for=window,
                             source=source)
        if not self._loop.open_loop:
            return applied
        return replace(applied, limited=(*applied.limited, Limit.ENCODER_DOUBTED.value))

    def pulses(self, *, steering_us: float, throttle_us: float, valid_for: float = 0.2) -> Applied:
        """Raw pulses [us] for calibration, inside ``with car.raw():``, for at most 0.2 s.

        The car's limits apply as in ``drive``. Raises BadCommand outside 1000
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
            try:
                yield engine.now
            except BaseException:
                engine.driver.actuator.refuse()
                raise

    def stop(self) -> Applied:
        """Throttle neutral now, steering held; the car is disarmed."""
        self._loop.reset()
        with self._engine.lock:
            return self._engine.driver.stop(self._engine.now)

    # -- arming ----------------------------------------------------------------------

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Put a record of this name into the recording, if one is made; the newest counts."""
        if self._recorder is not None:
            self._recorder.note(name, values)

    def arm(self, *, waive: Sequence[str] = ()) -> tuple[Caution, ...]:
        """Hold neutral for the ESC's start-up time, check everything, arm.

        Raises NotArmed with every reason that holds; never prompts. Waivable:
        PWM_CLOCK_UNCALIBRATED, CALIBRATION_MISSING; waivers are recorded.
        Returns what does not refuse but should be known; the log tells it too
        (``logging``, "dart_hal"), each once per open car.
        """
        engine = self._engine
        if engine.backend.bus is None:
            return ()
        for _ in self._until_good():
            pass
        with engine.lock:
            engine.driver.arm(engine.now, tuple(waive))
            if waive and self._recorder is not None:
                self._recorder.note("waived", {"reasons": ", ".join(waive)})
        try:
            self._await_armed()
        except BaseException:  # Ctrl-C while it arms must not leave a car that arms by itself
            self.stop()
            raise
        return self._caution()

    def _caution(self) -> tuple[Caution, ...]:
        found = self.cautions
        for caution in found:
            if caution.name not in self._told:
                self._told.add(caution.name)
                log.warning("%s", caution)
        return found

    def _await_armed(self) -> None:
        driver = self._engine.driver
        for _ in self.states(duration=ARM_PATIENCE):
            if driver.mode is ArmState.ARMED:
                return
            if driver.mode is not ArmState.ARMING:
                break
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
            if self._recorder is not None:
                self._recorder.note("unlock", {"reason": reason})

    # -- what is known -----------------------------------------------------------------

    @property
    def hello(self) -> Hello:
        """Identity of the Nano that answered."""
        hello = self._engine.receiver.hello
        if hello is None:
            raise NoHello("the Nano has not said who it is", found=self.url)
        return hello

    @property
    def mode(self) -> str:
        """DISARMED, ARMING, ARMED, TRIPPED, LOCKED, RAW, FAULT or CLOSED."""
        return self._engine.driver.mode.value

    @property
    def drives(self) -> bool:
        """False where commands go nowhere: a recording, or a port without its I2C bus."""
        return self._engine.backend.bus is not None

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

    @property
    def timing(self) -> Timing:
        """How loop and link run."""
        p50, p99, longest = self._timer.quantiles()
        counters = self._engine.receiver.counters
        return Timing(p50, p99, longest, counters.gaps, counters.damaged, self._timer.skipped,
                      self._engine.link_age)

    def request(self, name: str, **values: int) -> None:
        """Send the Nano a request of the wire ("EDGES_REQ", frames=4); see ``answers``."""
        engine = self._engine
        with engine.lock:
            engine.transmitter.send(BY_NAME[name], values, engine.now)

    def answers(self, name: str) -> list[dict[str, Any]]:
        """Messages of this name that came since the last call, the newest 64, raw values."""
        with self._engine.lock:
            return self._engine.receiver.taken(name)

    def clock_pulse(self, on: bool) -> None:
        """A pulse on the PCA9685's spare channel, by which its clock is measured. Raises BusError.

        Where a cut-off is watched the pulse is there all the time, and stays.
        """
        with self._engine.lock:
            actuator = self._engine.driver.actuator
            if not actuator.watched:
                actuator.clock_pulse(WATCH_PULSE_US if on else None)

    def on_bytes(self, hook: Hook) -> None:
        """``hook(direction, data, t) -> data``: trace or alter the traffic ("rx", "tx")."""
        self._engine.hooks.add(hook)

    def on_state(self, listener: Callable[[State], None]) -> None:
        """``listener(state)`` sees every State, also those a slow loop skips; keep it short."""
        self._engine.listeners.append(listener)
