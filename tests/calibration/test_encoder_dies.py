"""An encoder that dies while a calibration drives: how long the throttle stays on the pin."""

from __future__ import annotations

import pytest

from dart_hal.calibration.steering import calibrate_steering
from dart_hal.car import Car
from dart_hal.core.errors import CalibrationFailed
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of

pytestmark = pytest.mark.usefixtures("armed_esc")
DIES = 9.0
"""s of world time: it circles at 0.35 m/s by then."""
NEUTRAL = 1500.0, 10.0
"""us and the tolerance of a count and of the clock."""


def pulled_after(tmp_path, marks, *, believed: bool = False) -> tuple[float, float, bool]:
    """(s of throttle after the encoder changed, fastest m/s since, ended by itself)."""
    backend = open_backend("sim://?nano=mock&seed=4")
    last, fastest, failed = DIES, 0.0, False
    with Car.over(backend, cars=tmp_path) as car:
        world = world_of(backend)
        world.schedule(DIES, lambda w: w.nano.set_ring(0, marks(w.car.ring_a.edges)))

        def watch(channel, pulse):
            nonlocal last, fastest
            rise, fall = pulse
            if channel == 1 and rise > DIES:
                fastest = max(fastest, abs(world.motion.v_x))
                if abs((fall - rise) * 1e6 - NEUTRAL[0]) > NEUTRAL[1]:
                    last = fall

        world.watchers.append(watch)
        if believed:
            car._engine.telemetry.encoder.judge = lambda *_: None

        def late(share: float, text: str) -> None:
            if world.t > DIES + 3.0:
                raise TimeoutError

        try:
            calibrate_steering(car, dry_run=True, progress=late)
        except CalibrationFailed as error:
            failed = "encoder" in str(error)
        except TimeoutError:
            pass
    return last - DIES, fastest, failed


@pytest.mark.parametrize("marks", [lambda edges: (), lambda edges: edges[:2]],
                         ids=["dead", "two marks left"])
@pytest.mark.slow
def test_the_throttle_is_off_within_300_ms(tmp_path, marks):
    seconds, fastest, failed = pulled_after(tmp_path, marks)
    assert seconds <= 0.3
    assert fastest <= 0.6
    assert failed


@pytest.mark.slow
def test_control_an_encoder_that_is_believed_drives_on(tmp_path):
    seconds, fastest, _ = pulled_after(tmp_path, lambda edges: (), believed=True)
    assert seconds > 1.0
    assert fastest > 1.5
