"""The part of ``Car`` that lets it move: arm, raw pulses, and what keeps it from either."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import inf

from dart_hal.car.recorder import Recorded
from dart_hal.core.config import CarFiles
from dart_hal.core.types import Applied, State
from dart_hal.devices.actuation import ArmState, Caution, Event

FIRST_PULSES = 0.1
"""s until the ESC has seen the first neutral of a car that has just been opened."""
RAW_PATIENCE = 1.0
"""s that raw() waits for what comes by waiting: a clean half second of frames."""
ARM_PATIENCE = 4.5
"""s: the ESC's 2 s of neutral, 0.5 s of good checks, 1.5 s for what comes by waiting."""

log = logging.getLogger("dart_hal")


class Arming(Recorded, ABC):
    """Arms and unlocks the car that inherits it."""

    files: CarFiles
    _told: set[str]

    @abstractmethod
    def states(self, *, duration: float = inf, timeout: float = 0.5,
               every: int = 1) -> Iterator[State]:
        """The Car's."""

    @abstractmethod
    def stop(self) -> Applied:
        """The Car's."""

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
            if waive and self._recorder is not None:
                self._recorder.note("waived", {"reasons": ", ".join(waive)})
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
            if self._recorder is not None:
                self._recorder.note("unlock", {"reason": reason})

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
