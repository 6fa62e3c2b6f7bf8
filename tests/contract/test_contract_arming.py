"""``arm()`` names every reason that holds, each with a remedy; virtual time."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import Disarmed, LinkLost, NotArmed
from dart_hal.core.ports import Chunk
from dart_hal.devices.actuation.arming import BY_NAME
from dart_hal.devices.links.base import open_backend
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import HELLO, STATE, STATE_FLAGS
from dart_lab.sim.truth import world_of
from tests.common import MOCK_URL

CARS = Path(__file__).parents[2] / "cars"


class Rewritten:
    """A link on whose way up frames are changed by ``change(message, values) -> values``."""

    def __init__(self, link, change):
        self._link, self._change, self._decoder = link, change, FrameDecoder(UP)

    def __getattr__(self, name):
        return getattr(self._link, name)

    def read(self, timeout):
        chunk = self._link.read(timeout)
        if chunk is None:
            return None
        out = b""
        for frame in self._decoder.feed(chunk.data):
            values = self._change(frame.message, frame.as_dict())
            out += encode(frame.message, frame.seq, values)
        return Chunk(out, chunk.t)


def open_car(tmp_path, change=None, url=MOCK_URL, **replaced):
    backend = open_backend(url)
    world = world_of(backend)
    if change is not None:
        backend.link = Rewritten(backend.link, change)
    backend = dataclasses.replace(backend, **replaced)
    backend.world = world
    return backend, Car.over(backend, cars=replaced.get("cars") or tmp_path)


def drive_on(car):
    for _ in car.states(duration=1.0, timeout=3.0):
        car.drive(throttle=0.2)


def spin(backend):
    """Turn the wheels by hand, against any motor."""
    nano = backend.world.nano
    nano.set_wheel(1.0)
    nano.set_wheel = lambda rate: None


def change_flags(*names, removed=()):
    add = sum(1 << STATE_FLAGS.index(n) for n in names)
    remove = sum(1 << STATE_FLAGS.index(n) for n in removed)

    def change(message, values):
        if message is STATE:
            values["flags"] = (values["flags"] | add) & ~remove
        return values

    return change


def reasons(car, **options):
    with pytest.raises(NotArmed) as refused:
        car.arm(**options)
    error = refused.value
    assert all(name in error.found for name in error.reasons)
    assert all(BY_NAME[name].remedy in error.remedy for name in error.reasons)
    assert car.mode != "ARMED"
    return error.reasons


def test_a_good_car_arms(tmp_path):
    """The control of all others."""
    _, car = open_car(tmp_path)
    with car:
        car.arm()
        assert car.mode == "ARMED"


@pytest.mark.slow_except("flags1-IMU_STALE")
@pytest.mark.parametrize(("flags", "name"), [
    (("IMU_ABSENT",), "IMU_ABSENT"), (("IMU_STALE",), "IMU_STALE"), (("IMU_STUCK",), "IMU_STUCK"),
    (("WATCHDOG_LAST_BOOT",), "MCU_WATCHDOG_FIRED"),
])
def test_what_the_nano_flags_refuses(tmp_path, flags, name):
    _, car = open_car(tmp_path, change_flags(*flags))
    with car:
        assert name in reasons(car)


@pytest.mark.slow
def test_an_optional_imu_does_not_refuse(tmp_path):
    text = open_backend(MOCK_URL).car_toml.replace("required = true", "required = false")
    _, car = open_car(tmp_path, change_flags("IMU_ABSENT"), car_toml=text)
    with car:
        car.arm()
        assert car.mode == "ARMED"


def test_another_schema_reads_but_does_not_arm(tmp_path):
    def change(message, values):
        if message is HELLO:
            values["schema"] ^= 0xBEEF
        return values

    _, car = open_car(tmp_path, change)
    with car:
        states = list(car.states(duration=1.0))
        assert len(states) == 100
        assert states[-1].accel_x is not None
        with pytest.raises(NotArmed) as refused:
            car.arm()
        assert "SCHEMA_MISMATCH" in refused.value.reasons
        assert "dart-hal flash" in refused.value.remedy
        assert not car.hello.same_schema


def test_a_much_newer_protocol_does_not_arm(tmp_path):
    def change(message, values):
        if message is HELLO:
            values["proto"] += 2
        return values

    _, car = open_car(tmp_path, change)
    with car:
        assert "PROTOCOL_TOO_OLD" in reasons(car)


def test_moving_wheels_refuse(tmp_path):
    backend, car = open_car(tmp_path)
    with car:
        spin(backend)
        assert reasons(car) == ("ENCODER_MOVING",)


def test_a_bus_that_fails_refuses(tmp_path):
    backend, car = open_car(tmp_path)
    with car:
        next(car.states())
        backend.bus.nack = 10**9
        for _ in car.states(duration=0.2):
            pass
        assert reasons(car) == ("PCA_ABSENT",)
        assert car.mode == "FAULT"
        backend.bus.nack = 0
        for _ in car.states(duration=0.5):
            pass
        assert car.mode == "DISARMED"
        car.arm()


def test_a_throttle_in_force_refuses(tmp_path):
    _, car = open_car(tmp_path)
    with car:
        for _ in car.states(duration=1.0):
            pass
        car.drive(throttle=0.3, valid_for=0.5)
        assert "THROTTLE_NOT_NEUTRAL" in reasons(car)


def test_files_refuse_unless_waived(tmp_path):
    folder = tmp_path / "cars" / "dart-01"
    folder.mkdir(parents=True)
    text = (CARS / "dart-01" / "car.toml").read_text()
    folder.joinpath("car.toml").write_text(
        "\n".join(line for line in text.splitlines() if not line.startswith("oscillator_hz")))
    backend = dataclasses.replace(open_backend(MOCK_URL), car_toml=None, car="dart-01")
    with Car.over(backend, cars=tmp_path / "cars") as car:
        assert set(reasons(car)) == {"PWM_CLOCK_UNCALIBRATED", "CALIBRATION_MISSING"}
        assert reasons(car, waive=("CALIBRATION_MISSING",)) == ("PWM_CLOCK_UNCALIBRATED",)
        car.arm(waive=("CALIBRATION_MISSING", "PWM_CLOCK_UNCALIBRATED"))
        assert car.mode == "ARMED"


def test_refusing_a_waiver_names_what_may_be_waived(tmp_path):
    _, car = open_car(tmp_path)
    with car, pytest.raises(NotArmed, match="cannot be waived") as refused:
        car.arm(waive=("IMU_ABSENT",))
    assert "PWM_CLOCK_UNCALIBRATED" in refused.value.remedy


def test_a_cutoff_that_is_demanded_and_absent_refuses(tmp_path):
    text = open_backend(MOCK_URL).car_toml + "\n[safety]\ncutoff_required = true\n"
    _, car = open_car(tmp_path, car_toml=text)
    with car:
        assert reasons(car) == ("CUTOFF_REQUIRED",)
    _, car = open_car(tmp_path, url=MOCK_URL + "&cutoff=oe", car_toml=text)
    with car:
        car.arm()


def test_raw_mode_refuses(tmp_path):
    _, car = open_car(tmp_path)
    with car, car.raw():
        assert "RAW_MODE_OPEN" in reasons(car)


def test_three_trips_lock_until_a_reason_is_given(tmp_path):
    _, car = open_car(tmp_path)
    with car:
        for _ in range(3):
            car.arm()
            for state in car.states(duration=1.0):
                if state.t is not None and car.mode != "ARMED":
                    break
                with pytest.raises(ValueError, match="not a number"):
                    car.drive(throttle=float("nan"))
            for _ in car.states(duration=0.7):
                pass
        assert car.mode == "LOCKED"
        assert "LATCHED" in reasons(car)
        car.unlock("wheel freed")
        car.arm()


def test_a_reboot_disarms_and_a_new_arm_is_explicit(tmp_path):
    backend, car = open_car(tmp_path)
    with car:
        car.arm()
        backend.world.nano.reset("external")
        with pytest.raises(Disarmed):
            drive_on(car)
        assert car.mode == "DISARMED"
        for state in car.states(duration=2.0):
            pass
        assert state.speed == 0.0
        car.arm()
        assert car.mode == "ARMED"


def test_a_reboot_while_arming_is_named(tmp_path):
    backend, car = open_car(tmp_path)
    with car:
        def reset_once(state):
            if car.mode == "ARMING" and not done:
                done.append(state)
                backend.world.nano.reset("external")

        done = []
        car.on_state(reset_once)
        assert "MCU_REBOOTED" in reasons(car)


@pytest.mark.slow
def test_all_reasons_at_once(tmp_path):
    text = open_backend(MOCK_URL).car_toml + "\n[safety]\ncutoff_required = true\n"
    backend, car = open_car(tmp_path, change_flags("IMU_STALE", "IMU_ABSENT"), car_toml=text)
    with car:
        next(car.states())
        spin(backend)
        backend.bus.nack = 10**9
        assert set(reasons(car)) >= {"IMU_ABSENT", "IMU_STALE", "ENCODER_MOVING", "PCA_ABSENT",
                                     "CUTOFF_REQUIRED"}


def test_silence_while_arming_is_a_lost_link(tmp_path):
    _, car = open_car(tmp_path)
    with car:
        heard = []

        def deaf(direction, data, t):
            heard.append(data)
            return data if direction == "tx" or len(heard) < 300 else b""

        car.on_bytes(deaf)
        with pytest.raises(LinkLost, match="no frame for"):
            car.arm()
        assert car.mode == "DISARMED"


def test_ctrl_c_while_arming_leaves_a_disarmed_car(tmp_path):
    _, car = open_car(tmp_path)
    with car:
        def interrupt(state):
            if car.mode == "ARMING" and state.t > 1.0:
                raise KeyboardInterrupt

        car.on_state(interrupt)
        with pytest.raises(KeyboardInterrupt):
            car.arm()
        assert car.mode == "DISARMED"


def test_drive_and_pulses_outside_their_modes(tmp_path):
    _, car = open_car(tmp_path)
    with car:
        with pytest.raises(ValueError, match="raw"):
            car.pulses(steering_us=1500, throttle_us=1500)
        with car.raw():
            with pytest.raises(ValueError, match="pulse"):
                car.pulses(steering_us=1500, throttle_us=2100)
            assert car.mode == "RAW" or car.mode == "DISARMED"
        assert car.mode == "DISARMED"


@pytest.mark.slow
@pytest.mark.emulator
@pytest.mark.parametrize("wait", [1.5, 3.5, 4.1, 4.3, 4.5])
def test_the_imu_saving_its_offsets_does_not_keep_the_car_from_arming(tmp_path, wait):
    """A calibrated BNO055 at rest is read out once: no samples for some 70 ms."""
    with Car.open("sim://", cars=tmp_path) as car:
        for _ in car.states(duration=wait):
            pass
        car.arm()
        assert car.mode == "ARMED"
