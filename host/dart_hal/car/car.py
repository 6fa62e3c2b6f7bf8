"""``Car``: the interface of a controller to a real, emulated or recorded car."""

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

from dart_hal.car.camera import CarCamera, attach_camera
from dart_hal.car.engine import Engine
from dart_hal.car.exit_signals import forget_stop, stop_at_end, stop_on_signals
from dart_hal.car.files import load_files
from dart_hal.car.guarding import own_actuator
from dart_hal.car.hooks import Hook
from dart_hal.car.identity import Hello
from dart_hal.car.lidar import CarLidar, attach_lidar
from dart_hal.car.misuse import (
    check_attribute,
    check_message,
    check_record,
    check_times,
    check_url,
    closed_error,
    raise_absent,
)
from dart_hal.car.poses import attach_poses
from dart_hal.car.pump import InlinePump, Pump, ThreadPump
from dart_hal.car.recorder import Record, Recorder, rename_existing
from dart_hal.car.timing import LoopTimer, Timing, check_every
from dart_hal.car.viewers import open_viewer
from dart_hal.compat import accept_old_keyword, load_moved_member
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import EndOfRecording, NoHello
from dart_hal.core.notebook import card
from dart_hal.core.ports import ImageSource, PoseSource, ScanSource
from dart_hal.core.process.forks import ForkedCarLock, call_in_children
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import Applied, Contact, State
from dart_hal.devices.actuation import ArmState, Caution, Event, disarmed_error
from dart_hal.devices.actuation.chain import WATCH_PULSE_US
from dart_hal.devices.actuation.limits import limit_validity, to_finite
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.recording.bus import RecordedBus
from dart_hal.wire.messages import BY_NAME

if TYPE_CHECKING:
    from dart_hal.car.obstacle_guard import ObstacleGuard

# Opened where neither the program nor $DART_HAL_URL gives a URL.
DEFAULT_URL = "sim://"
# s until the ESC has received the first neutral pulses of a car that has just been opened.
FIRST_PULSES_TIME = 0.1
# s that raw() waits for conditions that are met by waiting, such as 0.5 s of good frames.
MAX_RAW_WAIT = 1.0
# s until arming is given up: 2 s of neutral for the ESC, 0.5 s of good checks, and 2 s for
# conditions that are met by waiting.
MAX_ARM_WAIT = 4.5

log = logging.getLogger("dart_hal")


def open_url(url: str | None) -> Backend:
    """Open the backend of a URL; None: $DART_HAL_URL, then sim://. Raises as ``Car.open``."""
    check_url(url)
    return open_backend(url or os.environ.get("DART_HAL_URL") or DEFAULT_URL)


def _make_guard(distance: float | None, backend: Backend, files: CarFiles
                ) -> ObstacleGuard | None:
    """Make the guard for obstacles if there is a distance. Raises UsageError."""
    if distance is None:
        return None
    # Imported here: a car without a guard needs no code of it.
    from dart_hal.car.obstacle_guard import make_obstacle_guard

    return make_obstacle_guard(distance, backend, files)


class Car:
    """One open car: real, emulated or recorded. Made by ``Car.open``; a context manager.

    Attributes:
        files: configuration, calibration and model of the car.
        notices: messages that the user must see once, such as files that are not used.
        raise_on_trip: as in ``open``.
        url: URL that was opened.

    The examples of the methods use this car, which has been opened but not armed::

        from dart_hal import Car
        car = Car.open("sim://?nano=mock")
    """

    raise_on_trip = True

    def __init__(self, backend: Backend, files: CarFiles, record: Record | None = None) -> None:
        # Imported here, with the vehicle model: a program that imports ``Car`` starts sooner.
        from dart_hal.control.loop import SpeedLoop

        self.files = files
        self.notices = backend.notices
        self.url = backend.url.text
        self._engine = Engine(backend, files)
        self._loop = SpeedLoop(files)
        self._timer = LoopTimer()
        self._state: State | None = None
        self._pump: Pump | None = None
        self._closed = False
        self._reported: set[str] = set()
        self._requested: tuple[float, float] | None = None
        # Whether throttle was commanded while the car was not armed, and whether arm() was called.
        self._was_ignored = False
        self._arm_called = False
        self._recorder = Recorder(self._engine, files, record)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse to set an attribute that nothing reads, such as ``car.steering = 0.3``."""
        check_attribute(name)
        super().__setattr__(name, value)

    if not TYPE_CHECKING:  # a type checker is to know of no other member

        def __getattr__(self, name: str) -> Any:
            """Return what replaces a member of version 0.1."""
            return load_moved_member(self, name)

    # -- life ------------------------------------------------------------------

    @classmethod
    def open(cls, url: str | None = None, *, car: str | None = None,
             cars: str | Path | None = None, record: Record | None = None,
             poses: str | PoseSource | None = None, lidar: str | ScanSource | None = None,
             camera: str | ImageSource | None = None, raise_on_trip: bool = True,
             guard_distance: float | None = None) -> Car:
        """Open a car. It is at neutral and disarmed afterwards.

        Args:
            url: what to open, such as sim://, serial:///dev/ttyUSB0?i2c=1 or replay://run.mcap.
                None: $DART_HAL_URL, then sim://.
            car: name of a real car's files. None: $DART_HAL_CAR, then dart-01. A simulated or
                recorded car brings its own files.
            cars: folder with the files of the cars.
            record: MCAP file for all commands, measurements and bytes. An existing file is
                renamed to run.1.mcap, run.2.mcap, ...
            poses: source of external poses, or its URL. None: $DART_HAL_POSES.
            lidar: source of scans, or its URL. None: $DART_HAL_LIDAR.
            camera: source of images, or its name: usb:0, csi:0, or top for sim://.
                None: $DART_HAL_CAMERA.
            raise_on_trip: True: a command to a car that a trip has disarmed raises Disarmed.
                False: only ``Applied.limited`` reports it.
            guard_distance: distance [m] before an obstacle at which the lidar stops the car,
                for any command of the program; ``Applied.limited`` then has OBSTACLE. None: no
                guard.

        Returns:
            The open car. Close it, or use it in a ``with`` block.

        Raises:
            UsageError: an argument is wrong, such as a record that does not end in .mcap.
            UnknownScheme: no backend has this kind of URL.
            PortMissing, PortBusy, PortDenied: the serial port cannot be opened.
            PcaBusy, PcaClaimed: another program uses the PCA9685.
            NoHello: no DART firmware answers on the port.
            ConfigError: a file of the car cannot be read.

        Example:
            >>> with Car.open("sim://?nano=mock&seed=7") as example:
            ...     example.mode
            'DISARMED'
        """
        return cls.over(open_url(url), car=car, cars=cars, record=record, poses=poses,
                        lidar=lidar, camera=camera, raise_on_trip=raise_on_trip,
                        guard_distance=guard_distance)

    @classmethod
    def over(cls, backend: Backend, *, car: str | None = None, cars: str | Path | None = None,
             record: Record | None = None, poses: str | PoseSource | None = None,
             lidar: str | ScanSource | None = None, camera: str | ImageSource | None = None,
             raise_on_trip: bool = True, guard_distance: float | None = None) -> Car:
        """Open a car over a backend that is open already; closes the backend on failure.

        Args: as ``open``, with ``backend`` in place of the URL. Raises: as ``open``.

        Example:
            >>> from dart_hal.car.car import open_url
            >>> with Car.over(open_url("sim://?nano=mock")) as example:
            ...     example.mode
            'DISARMED'
        """
        try:
            if record:
                check_record(record)
            files = load_files(backend, car, cars)
            attach_poses(backend, poses)
            attach_lidar(backend, lidar)
            attach_camera(backend, camera)
            guard = _make_guard(guard_distance, backend, files)
            own_actuator(backend, files)
            if record and backend.bus is not None:
                backend.bus = RecordedBus(backend.bus, backend.clock.now)
            if record and (kept := rename_existing(record)):
                backend.notices += (f"{record} was there; it is kept as {kept}",)
            opened = cls(backend, files, record)
            opened._engine.guard = guard
        except BaseException:
            backend.close()
            raise
        opened.raise_on_trip = raise_on_trip
        opened._begin()
        return opened

    def _begin(self) -> None:
        engine = self._engine
        if not engine.backend.virtual:
            call_in_children(self._release_in_child)
            stop_at_end(self._end_drive)
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
        """Write neutral for two PWM frames, then release the bus and the port; idempotent.

        A ``with`` block and the end of the program call it. A second Ctrl-C meanwhile ends the
        step that is under way; the steps after it are done all the same.

        Example:
            >>> car.close()
            >>> car.mode
            'CLOSED'
        """
        if self._closed:
            return
        self._closed = True
        # The steps run from the last to the first, each also after an error of another:
        # engine (neutral, then no pulses), thread, pulses again, recording, backend, exit handler.
        with ExitStack() as steps:
            steps.callback(self._warn_if_never_armed)
            steps.callback(self._timer.report_overruns, waits=self._engine.backend.virtual)
            steps.callback(atexit.unregister, self.close)
            steps.callback(forget_stop, self._end_drive)
            steps.callback(self._engine.backend.close)
            steps.callback(self._recorder.close)
            steps.callback(self._engine.end_pulses)
            if self._pump is not None:
                steps.callback(self._pump.stop)
            steps.callback(self._engine.close)

    def _warn_if_never_armed(self) -> None:
        """Warn about a program that commanded throttle and did not call ``arm``."""
        if self._was_ignored and not self._arm_called:
            log.warning("the throttle stayed at neutral: the program did not call car.arm()")

    def _release_in_child(self) -> None:
        """Give up the car in a forked child, where it still belongs to the parent."""
        self._closed = True
        self._recorder.disown()
        self._engine.lock = ForkedCarLock()
        atexit.unregister(self.close)
        forget_stop(self._end_drive)

    def __enter__(self) -> Car:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    # -- the loop ----------------------------------------------------------------

    def states(self, *, duration: float = inf, timeout: float = 0.5,
               every: int = 1) -> Iterator[State]:
        """Yield one State per telemetry frame, at 100 Hz: the clock of a control loop.

        Each step waits for the next frame. A loop that is too slow gets the newest State, and
        ``health.skipped`` counts the others. Of two threads that iterate each gets only some
        States. Between two States a command stays in force for its ``valid_for``.

        Args:
            duration: length [s] of the car's time, 0 or more.
            timeout: longest wait [s] for a frame, 0 or more.
            every: yield each n-th State only, 1 to 25: 10 for a loop at 10 Hz.

        Returns:
            Iterator of State. It ends after ``duration``, or with a recording.

        Raises:
            LinkLost: no frame came for ``timeout``.
            UsageError: a time is not a number or below 0, or ``every`` is out of range.

        Example:
            >>> for state in car.states(duration=0.1):
            ...     print(f"{state.speed:.1f} m/s")
            ...     break
            0.0 m/s
        """
        check_times(duration=duration, timeout=timeout)
        check_every(every)
        if duration == 0.0:
            return
        start: float | None = None
        self._timer.begin()
        while True:
            try:
                state = self._next(timeout, every if start is not None else 1)
            except EndOfRecording:
                return
            # The duration counts from the first State.
            start = state.t if start is None else start
            yield state
            if state.t - start >= duration - (every + 0.5) * SAMPLE:
                return

    def _next(self, timeout: float, every: int) -> State:
        if self._pump is None or self._closed:
            raise closed_error("states() or arm()")
        armed = self._engine.driver.mode in (ArmState.ARMED, ArmState.RAW)
        self._timer.record_request(every, armed=armed)
        frames = 0
        while frames < every:
            state, skipped = self._pump.next(timeout)
            frames += 1 + skipped
        self._timer.tick(self._engine.now, frames, every)
        if self._timer.skipped:
            state = replace(state, health=replace(state.health, skipped=self._timer.skipped))
        self._state = state
        self._timer.record_delivery()
        return state

    # -- commands ------------------------------------------------------------------

    def drive(self, *, steering: float = 0.0, throttle: float = 0.0, valid_for: float = 0.2,
              source: str = "user") -> Applied:
        """Command a steering angle and a throttle.

        Args:
            steering: angle [rad] of the front wheels, left positive. Clipped to the range of the
                car (RANGE); beyond 10 rad it is refused.
            throttle: -1 (full reverse) to 1 (full forward). Clipped to the limits of the car
                (RANGE); beyond 10 it is refused.
            valid_for: time [s], above 0 and at most 0.5 (VALIDITY). The throttle returns to
                neutral when no new command comes within it.
            source: name of the sender. Of several sources the one of highest priority in car.toml
                counts.

        Returns:
            Values and pulses at the pins, now or with the next PWM frame. ``limited`` names the
            reasons why they differ from the command.

        Raises:
            BadCommand: a value is not a finite number or out of all reason. The throttle is
                neutral and the car is tripped.
            Disarmed: a trip has disarmed the car since ``arm()``, and ``raise_on_trip`` is set.
            LinkLost: the car is closed, or the link to the Nano is lost.

        Example:
            >>> cautions = car.arm()
            >>> applied = car.drive(steering=0.1, throttle=0.2)
            >>> round(applied.throttle, 1)
            0.2
        """
        return self._drive(steering, throttle, valid_for, source)

    def _drive(self, steering: float, throttle: float, valid_for: float, source: str,
               reasons: tuple[str, ...] = ()) -> Applied:
        """Command as ``drive``; reasons: names of ``Limit`` of the controller, for the pins."""
        engine = self._engine
        self._refuse_if_disarmed()
        with self._commanding() as now:
            planned = engine.driver.actuator.command(steering, throttle, valid_for, source, now,
                                                     reasons)
            if throttle and engine.driver.mode is ArmState.DISARMED:
                self._was_ignored = True
            self._requested = (steering, throttle)
            self._recorder.command(now, steering, throttle, source)
            return engine.driver.applied if engine.answer() else planned

    def drive_speed(self, *, steering: float, speed: float, valid_for: float = 0.2,
                    source: str = "user") -> Applied:
        """Command a steering angle and a speed, which the built-in speed control holds.

        The controller is a feed-forward of the vehicle model (model.toml, else that of the paper)
        plus a PI part, tuned for the delay of the car. The integral is reset at a stop and when
        commands expired. Where coasting is too slow, the ESC brakes; 0 m/s is neutral.

        Args:
            steering: angle [rad] of the front wheels, left positive.
            speed: target [m/s], backward negative. Clipped to [limits] max_speed (RANGE). When
                the car moves forward and the target is backward, the ESC brakes first (REVERSING).
            valid_for: time [s], above 0 and at most 0.5 (VALIDITY).
            source: name of the sender, as in ``drive``.

        Returns:
            As ``drive``. While the measured speed is doubted (``health.speed_doubted``), the
            feed-forward drives alone, at most with [limits] encoder_lost_throttle
            (ENCODER_DOUBTED).

        Raises:
            As ``drive``.

        Example:
            >>> cautions = car.arm()
            >>> for state in car.states(duration=1.5):
            ...     applied = car.drive_speed(steering=0.0, speed=1.0)
            >>> 0.8 < state.speed < 1.2
            True
        """
        with self._commanding():
            sender = f"source {source}"
            target = to_finite("speed", speed, sender)
            window = limit_validity(valid_for, sender)
            driver = self._engine.driver
            armed = driver.mode is ArmState.ARMED and not driver.overridden
            throttle = self._loop.throttle(target, self._state, armed=armed, window=window)
        return self._drive(steering, throttle, valid_for, source, self._loop.active_limits)

    def pulses(self, *, steering_us: float, throttle_us: float | None,
               valid_for: float = 0.2) -> Applied:
        """Command raw pulses for a calibration, inside ``with car.raw():``.

        Args:
            steering_us: pulse [us] of the servo, 1000 to 2000.
            throttle_us: pulse [us] of the ESC, 1000 to 2000. None: no pulse at all, in
                ``raw(lifted=True)`` only.
            valid_for: time [s], above 0 and at most 0.2.

        Returns:
            As ``drive``. The limits of the car apply unless the wheels are lifted.

        Raises:
            BadCommand: a pulse is out of range, or the call is outside ``raw()``. The throttle is
                neutral then.

        Example:
            >>> with car.raw(lifted=True):
            ...     applied = car.pulses(steering_us=1600.0, throttle_us=1500.0)
            >>> 1595 < applied.steering_us < 1605  # in counts of the PCA9685
            True
        """
        engine = self._engine
        with self._commanding() as now:
            planned = engine.driver.raw_pulses(steering_us, throttle_us, valid_for, now)
            return engine.driver.applied if engine.answer() else planned

    @contextmanager
    def _commanding(self) -> Iterator[float]:
        """Yield the time to a command path; on any exception the throttle is neutral first."""
        engine = self._engine
        with engine.lock:
            if self._closed:
                raise closed_error("a command")
            try:
                yield engine.now
            except BaseException:
                engine.driver.refuse_command(engine.now)
                raise

    def _refuse_if_disarmed(self) -> None:
        """Raise LinkLost or Disarmed where that has ended the arming since ``arm()``."""
        with self._engine.lock:
            causes = self._engine.driver.supervisor.ended_by
            if causes and self.raise_on_trip and not self._closed:
                raise (self._pump and self._pump.error()) or disarmed_error(
                    causes, self._engine.driver.stop_reason)

    def stop(self) -> Applied:
        """Set the throttle to neutral now, keep the steering, and disarm the car.

        Returns:
            Values and pulses at the pins.

        Example:
            >>> car.stop().throttle
            0.0
            >>> car.mode
            'DISARMED'
        """
        self._loop.reset()
        with self._engine.lock:
            return self._engine.driver.stop(self._engine.now)

    def _end_drive(self, reason: str) -> None:
        """Stop because the program ends; later commands raise Disarmed."""
        with self._engine.lock:
            if not self._closed:
                self._engine.driver.end_drive(self._engine.now, reason)

    # -- arming ------------------------------------------------------------------------

    def arm(self, *, waive: Sequence[str] = ()) -> tuple[Caution, ...]:
        """Arm the car: keep the ESC at neutral for its start-up time, and check everything.

        The checks wait up to 2 s for clock and IMU, and up to 4.5 s for the ESC. The user is
        never prompted. A car that is armed already stays as it is.

        Args:
            waive: checks to leave out: PWM_CLOCK_UNCALIBRATED, CALIBRATION_MISSING. They are
                noted in the recording.

        Returns:
            Cautions: what does not prevent arming but should be known. The logger "dart_hal"
            reports each of them once per open car.

        Raises:
            NotArmed: with all reasons that hold, or because the car was stopped meanwhile.

        Example:
            >>> cautions = car.arm()
            >>> car.mode
            'ARMED'
        """
        for _ in self.arming(waive=waive):
            pass
        return () if self._engine.backend.bus is None else self._report_cautions()

    def arming(self, *, waive: Sequence[str] = ()) -> Iterator[State]:
        """Arm in steps, one State each, to arm several cars at the same time.

        Args:
            waive: as in ``arm``.

        Returns:
            Iterator of State. The car is armed when it ends.

        Raises:
            As ``arm``.

        Example:
            >>> for state in car.arming():
            ...     pass
            >>> car.mode
            'ARMED'
        """
        engine = self._engine
        names = (waive,) if isinstance(waive, str) else tuple(waive)
        self._arm_called = True
        if engine.backend.bus is None:
            return
        with engine.lock:
            stops = engine.driver.stops
            if engine.driver.mode is ArmState.ARMED:
                return
        yield from self._until_good(stops)
        with engine.lock:
            engine.driver.refuse_if_stopped(stops)
            engine.driver.arm(engine.now, names)
            if names:
                self.note("waived", {"reasons": ", ".join(names)})
        try:
            yield from self._until_armed(stops)
        except BaseException:  # Ctrl-C while it arms must not leave a car that arms by itself
            self.stop()
            raise

    def _report_cautions(self) -> tuple[Caution, ...]:
        found = self.cautions
        for caution in found:
            if caution.name not in self._reported:
                self._reported.add(caution.name)
                log.warning("%s", caution)
        return found

    def _states_until_stopped(self, duration: float, stops: int) -> Iterator[State]:
        """Yield the States of ``duration`` s. Raises NotArmed as ``Driver.refuse_if_stopped``."""
        for state in self.states(duration=duration):
            with self._engine.lock:
                self._engine.driver.refuse_if_stopped(stops)
            yield state

    def _until_armed(self, stops: int) -> Iterator[State]:
        driver = self._engine.driver
        for state in self._states_until_stopped(MAX_ARM_WAIT, stops):
            if driver.mode is ArmState.ARMED:
                return
            if driver.mode is not ArmState.ARMING:
                break
            yield state
        with self._engine.lock:
            raise driver.refusal_error()

    def _until_good(self, stops: int) -> Iterator[State]:
        """Yield States until clock and IMU are ready after the opening; 2 s at most."""
        for state in self._states_until_stopped(2.0, stops):
            with self._engine.lock:
                if self._engine.driver.is_settled(self._engine.now):
                    return
            yield state

    @contextmanager
    def raw(self, *, lifted: bool = False) -> Iterator[None]:
        """Allow ``pulses()`` in place of ``drive()``, for a calibration.

        It is as safe as an armed car: pulses are valid for 0.2 s, and the limits of the car, the
        cap of a lost encoder and every trip apply. It begins after the ESC's neutral time, and
        ends after 10 s without a call.

        Args:
            lifted: True: the wheels are off the ground. Then the full range of 1000 to 2000 us is
                allowed, the recording notes it, and motion of the IMU ends it.

        Returns:
            Context manager. The car is disarmed at its end.

        Raises:
            NotArmed: the link or the bus is not good, or the car was stopped meanwhile. A
                calibration need not exist yet.
            UsageError: the car is armed.

        Example:
            >>> with car.raw():
            ...     car.mode
            'RAW'
        """
        engine = self._engine
        driver = self._engine.driver
        stops = driver.stops
        for _ in self._states_until_stopped(MAX_RAW_WAIT, stops):
            with engine.lock:
                if driver.resume_pulses(engine.now):
                    break
        # The ESC starts up at neutral.
        neutral = self.files.config.throttle.arm_neutral + FIRST_PULSES_TIME
        for _ in self._states_until_stopped(neutral, stops):
            pass
        for _ in self._states_until_stopped(MAX_RAW_WAIT, stops):
            with engine.lock:
                if not driver.raw_refusals(engine.now, lifted=lifted):
                    break
        # All conditions that are met by waiting hold now, or the wait is over: enter or raise.
        with engine.lock:
            driver.refuse_if_stopped(stops)
            driver.open_raw(engine.now, lifted=lifted)
        if lifted:
            self.note("raw_lifted", {"wheels": "off the ground, as the caller says"})
        try:
            yield
        finally:
            with engine.lock:
                driver.stop(engine.now, Event.RAW_CLOSE)

    def unlock(self, reason: str) -> None:
        """Leave the mode LOCKED, which three trips within a minute cause.

        Args:
            reason: text for the recording.

        Example:
            >>> car.unlock("wheel fixed")
            >>> car.mode
            'DISARMED'
        """
        with self._engine.lock:
            self._engine.driver.event(Event.UNLOCK, self._engine.now)
            self.note("unlock", {"reason": str(reason)})

    @accept_old_keyword("by", "source")
    def run_stop(self, held: bool, source: str = "program", reason: str = "") -> None:
        """Press or release a run-stop.

        While any source presses one, the throttle is neutral and the car cannot be armed. A car
        that was driving is tripped, and has to be armed again after the release.

        Args:
            held: True: press; False: release the run-stop of ``source``, not those of others.
            source: name of what presses it.
            reason: sentence for the operator.

        Example:
            >>> car.run_stop(True, source="judge", reason="a person is on the track")
            >>> car.refusals()
            ('RUN_STOP',)
            >>> car.run_stop(False, source="judge")
            >>> car.refusals()
            ()
        """
        with self._engine.lock:
            self._engine.driver.set_run_stop(held, self._engine.now, source, reason)

    @property
    def stop_reason(self) -> str:
        """Return the reason of the run-stop that is pressed, or of the last that ended a drive.

        Empty if there was none.

        Example:
            >>> car.run_stop(True, source="judge", reason="a person is on the track")
            >>> car.stop_reason
            'a person is on the track'
        """
        with self._engine.lock:
            driver = self._engine.driver
            return next(iter(driver.holders.values()), driver.stop_reason)

    def refusals(self) -> tuple[str, ...]:
        """Return the names of what would keep ``arm()`` from arming now.

        Conditions that are met by waiting, such as the neutral time of the ESC, are not among
        them. The names are explained with NotArmed.

        Example:
            >>> car.refusals()
            ()
        """
        with self._engine.lock:
            return self._engine.driver.arm_refusals(self._engine.now)

    @property
    def cautions(self) -> tuple[Caution, ...]:
        """Return what does not prevent arming but should be known; each prints as a sentence.

        Example:
            >>> [caution.name for caution in car.cautions]
            ['IMU_UNCALIBRATED']
        """
        with self._engine.lock:
            return self._engine.driver.cautions(self._engine.now)

    @property
    def causes(self) -> tuple[str, ...]:
        """Return the names of what tripped the car last; empty if nothing did.

        Example:
            >>> car.causes
            ()
        """
        return self._engine.driver.supervisor.causes

    # -- beside the telemetry --------------------------------------------------------

    @property
    def recorder(self) -> Recorder:
        """Return the recorder, which starts and ends a recording of a car that is open.

        Example:
            >>> car.recorder.path is None
            True
        """
        return self._recorder

    @property
    def has_battery(self) -> bool:
        """Return whether the car has a sensor of its battery, by car.toml or in the recording.

        Example:
            >>> car.has_battery
            False
        """
        return self._engine.battery is not None

    @property
    def rc_pulses(self) -> tuple[float, ...] | None:
        """Return the pulses [us] of the RC receiver: steering, throttle, third channel.

        A channel without a signal has 0. None: no receiver by car.toml, or no message of the Nano.

        Example:
            >>> car.rc_pulses is None
            True
        """
        rc = self._engine.driver.rc
        return None if rc is None else rc.pulses_us

    @property
    def has_lidar(self) -> bool:
        """Return whether the car has a lidar, by ``Car.open`` or by its URL.

        Example:
            >>> car.has_lidar
            False
        """
        return self._engine.lidar is not None

    @property
    def lidar(self) -> CarLidar:
        """Return the lidar: its scans and its condition.

        Raises:
            UsageError: the car has none.

        Example:
            >>> with Car.open("sim://?nano=mock&lidar=1") as example:
            ...     for state in example.states(duration=0.5):
            ...         pass
            ...     len(example.lidar.scans()) > 0
            True
        """
        return self._engine.lidar or raise_absent("lidar", "1", "serial:///dev/dart-lidar",
                                                  self.url)

    @property
    def has_camera(self) -> bool:
        """Return whether the car has a camera, by ``Car.open`` or by its URL.

        Example:
            >>> car.has_camera
            False
        """
        return self._engine.camera is not None

    @property
    def camera(self) -> CarCamera:
        """Return the camera: its images and its condition.

        Raises:
            UsageError: the car has none.

        Example:
            >>> if car.has_camera:
            ...     images = car.camera.images()
        """
        return self._engine.camera or raise_absent("camera", "top", "usb:0", self.url)

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Put texts into the recording under a name; of several with one name the newest counts.

        Args:
            name: name of the note.
            values: texts by key.

        Raises:
            UsageError: a value is not text, whether a recording is made or not.

        Example:
            >>> car.note("track", {"surface": "carpet"})
        """
        self._recorder.note(name, values)

    def log(self, name: str, value: object) -> None:
        """Record numbers of the program under a name, with the time of the car's clock.

        Args:
            name: letters, digits and _; parts are joined by /, as in ``mpc/cost``.
            value: a number, an array of any shape, or a dict of them. An entry of a dict becomes
                the channel ``name/key``. NaN and inf are allowed, True is recorded as 1.

        Raises:
            LogError: the name or the value is not allowed, whether a recording is made or not.

        Example:
            >>> car.log("mpc", {"cost": 1.5, "plan": [[0.0, 0.0], [0.1, 0.0]]})
        """
        self._recorder.log(name, value)

    # -- what is known -----------------------------------------------------------------

    @property
    def hello(self) -> Hello:
        """Return the identity of the Nano: firmware, board number, capabilities.

        Raises:
            NoHello: it has not sent any.

        Example:
            >>> car.hello.mock
            True
        """
        hello = self._engine.receiver.hello
        if hello is None:
            raise NoHello("the Nano has not sent its identity (HELLO)", found=self.url)
        return hello

    @property
    def now(self) -> float:
        """Return the current time [s] of the car's clock, which ``State.t`` uses too.

        Example:
            >>> for state in car.states(duration=1.0):
            ...     pass
            >>> abs(car.now - state.t) < 0.02
            True
        """
        return self._engine.now

    @property
    def simulated(self) -> bool:
        """Return whether the car is simulated or a recording.

        Example:
            >>> car.simulated
            True
        """
        return self._engine.backend.simulated or self._engine.backend.virtual

    @property
    def waits(self) -> bool:
        """Return whether the car's time stops while the program computes: virtual time.

        Example:
            >>> car.waits
            True
        """
        return self._engine.backend.virtual

    @property
    def drives(self) -> bool:
        """Return whether commands reach pins. False: a recording, or a port without its I2C bus.

        Example:
            >>> car.drives
            True
        """
        return self._engine.backend.bus is not None

    @property
    def timing(self) -> Timing:
        """Return the timing of loop and link: periods, losses, ages.

        Example:
            >>> for state in car.states(duration=0.5):
            ...     pass
            >>> round(car.timing.p50, 3)
            0.01
        """
        p50, p99, longest = self._timer.quantiles()
        counters = self._engine.receiver.counters
        return Timing(p50, p99, longest, counters.gaps, counters.damaged, self._timer.skipped,
                      self._engine.link_age, *self._timer.work(), self._timer.late)

    def request(self, name: str, **values: int) -> None:
        """Send a request of the wire protocol to the Nano; ``answers`` returns its answers.

        Args:
            name: name of the message, such as "EDGES_REQ".
            values: fields of the message, raw integers.

        Raises:
            UsageError: the protocol has no such message.

        Example:
            >>> car.request("PARAM_GET", id=1)
            >>> for state in car.states(duration=0.1):
            ...     pass
            >>> len(car.answers("PARAM_VALUE")) > 0
            True
        """
        engine = self._engine
        check_message(name, BY_NAME)
        with engine.lock:
            engine.transmitter.send(BY_NAME[name], values, engine.now)

    def answers(self, name: str) -> list[dict[str, Any]]:
        """Return the messages of a name since the last call, at most the newest 64, oldest first.

        Args:
            name: name of the message, such as "EDGES".

        Returns:
            Raw values by field.

        Example:
            >>> car.answers("EDGES")
            []
        """
        with self._engine.lock:
            return self._engine.receiver.take_messages(name)

    def clock_pulse(self, on: bool, longer_us: float = 0.0) -> float:
        """Switch the pulse on the spare channel of the PCA9685, which measures its clock.

        With a hardware cut-off the pulse is always on, and stays on.

        Args:
            on: True: on; False: off.
            longer_us: by how much [us] the pulse is longer than usual, 0 or more.

        Returns:
            Time [s] of the car's clock at which it was written.

        Raises:
            BusError: the PCA9685 did not answer.

        Example:
            >>> written = car.clock_pulse(True)
            >>> written <= car.now
            True
        """
        with self._engine.lock:
            actuator = self._engine.driver.actuator
            now = self._engine.now
            there = on or actuator.watched
            actuator.clock_pulse(WATCH_PULSE_US + max(longer_us, 0.0) if there else None)
            return now

    def on_bytes(self, hook: Hook) -> None:
        """Add a hook to the traffic with the Nano, to trace or to change it.

        Args:
            hook: called as ``hook(direction, data, t)`` with "rx" or "tx", bytes and time [s].
                It returns the bytes to go on with.

        Example:
            >>> sizes = []
            >>> car.on_bytes(lambda direction, data, t: sizes.append(len(data)) or data)
            >>> state = next(car.states())
            >>> sum(sizes) > 0
            True
        """
        self._engine.hooks.add(hook)

    def on_state(self, listener: Callable[[State], None]) -> Callable[[], None]:
        """Add a listener that gets every State, also those that a slow loop skips.

        Args:
            listener: called as ``listener(state)`` in the thread of the link; it must be quick.

        Returns:
            Function that removes the listener.

        Example:
            >>> speeds = []
            >>> remove = car.on_state(lambda state: speeds.append(state.speed))
            >>> for state in car.states(duration=0.1):
            ...     pass
            >>> remove()
            >>> len(speeds) >= 10
            True
        """
        engine = self._engine
        engine.listeners = [*engine.listeners, listener]  # a new list: one may be read now
        def leave() -> None:
            engine.listeners = [one for one in engine.listeners if one is not listener]
        return leave

    # -- shown -------------------------------------------------------------------------

    @property
    def mode(self) -> str:
        """Return the mode: DISARMED, ARMING, ARMED, TRIPPED, LOCKED, RAW, FAULT or CLOSED.

        Example:
            >>> car.mode
            'DISARMED'
        """
        return self._engine.driver.mode.value

    @property
    def asked(self) -> tuple[float, float] | None:
        """Return steering [rad] and throttle of the last ``drive``, before limits; None: none yet.

        Example:
            >>> cautions = car.arm()
            >>> applied = car.drive(steering=0.1, throttle=0.2)
            >>> car.asked
            (0.1, 0.2)
        """
        return self._requested

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """Return the contacts so far with other emulated cars of its world (``sim://?world=NAME``).

        Example:
            >>> car.contacts
            ()
        """
        return self._engine.backend.contacts()

    def view(self, **options: Any) -> Any:
        """Serve a live page of this car, without interrupting the program.

        Everyone who opens the page can stop the car.

        Args:
            options: those of ``dart_lab.live.view.serve.serve``, such as port and lan.

        Returns:
            Context manager; ``urls`` are the addresses of the page.

        Raises:
            UsageError: the port is in use, or the package websockets is missing.

        Example:
            >>> with car.view(port=0) as page:  # 0: any free port
            ...     len(page.urls) > 0
            True
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
        calibration = self.files.calibration
        model = self.files.model
        yield "calibration", "measured" if calibration is not None else "none; nominal values"
        yield "model", "identified" if model is not None else "none; that of the paper"
        yield from self._state.rows() if self._state is not None else (("State", "none yet"),)
