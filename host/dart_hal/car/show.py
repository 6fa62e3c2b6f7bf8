"""What a Car shows of itself, on one line and in a notebook; it asks nothing of the hardware."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from dart_hal.car.engine import Engine
from dart_hal.car.viewers import open_viewer
from dart_hal.core.config import CarFiles
from dart_hal.core.notebook import card
from dart_hal.core.types import Contact, State


class Shown:
    """The part of ``Car`` that is read, not driven."""

    files: CarFiles
    url: str
    _engine: Engine
    _state: State | None
    _asked: tuple[float, float] | None = None

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
