"""``car.toml``: the description of one car by its owner, and the limits of its commands."""

from __future__ import annotations

from typing import Literal

from dart_hal.core.config.parse import METRES_PER_EDGE_RANGE, check_std, parse, require
from dart_hal.core.config.plausible import CAR_RANGES, check_name, check_ranges
from dart_hal.core.config.quantity import FileTable, Quantity
from dart_hal.core.config.ranges import check_neutral, check_oscillator

CAR_SCHEMA = "dart-hal/car/1"
# V of a full lithium cell, and at A0: the lowest supply by the USB specification, which the
# converter has as its reference.
FULL_CELL_V = 4.2
MAX_DIVIDER_V = 4.4
# us between the middle and the end of a stick of an RC transmitter: half of the usual 500.
MIN_STICK_SPAN_US = 250.0
# Standard error of a size over the size: a larger one is no measurement, or has another unit.
MAX_RELATIVE_STD = 0.5


class SizeErrors(FileTable, frozen=True, kw_only=True):
    """Standard errors of sizes, in the units of ``Geometry``; None: the size is exact.

    Of ``l_f`` and ``l_r`` only one: the other one follows from the wheelbase.
    """

    wheelbase: float | None = None
    l_f: float | None = None
    l_r: float | None = None
    mass: float | None = None
    yaw_inertia: float | None = None

    def to_dict(self) -> dict[str, float]:
        """Return the errors that are stated, by key."""
        return {key: getattr(self, key) for key in self.__struct_fields__
                if getattr(self, key) is not None}


class Geometry(FileTable, frozen=True, kw_only=True):
    """Lengths [m] from the axles, mass [kg], yaw inertia [kg m2].

    l_f, l_r: centre of mass to front and rear axle; ``length``, ``width`` of
    the outline; ``lidar_x`` of the lidar ahead of the rear axle; ``front_share`` of the wheel force
    at the front axle: 0 rear-wheel drive, 1 front-wheel drive, 0.5 all-wheel drive; ``std``:
    standard errors, within which a joint fit and a diagnosis may move a size.
    """

    wheelbase: float
    l_f: float
    l_r: float
    mass: float
    yaw_inertia: float | None = None
    length: float | None = None
    width: float | None = None
    track: float | None = None
    wheel_radius: float | None = None
    lidar_x: float | None = None
    front_share: float | None = None
    std: SizeErrors = SizeErrors()


class SteeringConfig(FileTable, frozen=True, kw_only=True):
    """The servo: pulse = center_us + direction x span_us x command, command +1 = full left.

    ``follow_disarmed``: the servo follows commands while the car is disarmed.
    ``take_up_backlash``: half of the measured backlash is added to the pulse in the direction in
    which the wheels have to move.
    """

    channel: int = 0
    center_us: float = 1500.0
    span_us: float = 375.0
    direction: Literal[-1, 1] = 1
    follow_disarmed: bool = False
    take_up_backlash: bool = False


class ThrottleConfig(FileTable, frozen=True, kw_only=True):
    """The ESC: pulse = neutral_us + span_us x throttle; its behaviour, None where unknown.

    arm_neutral [s]: time at neutral after power-on; stop_ramp [s]: time from full throttle to
    neutral on stop; deadband_us, saturation_us: offsets from neutral in both directions;
    signal_loss [s]: time without pulses until the ESC cuts the motor.
    deliberate_neutral_us: accept a neutral near this value outside of 1400 to 1600 us, here and
    in calibration.toml; None: accept none.
    """

    channel: int = 1
    neutral_us: float = 1500.0
    deliberate_neutral_us: float | None = None
    span_us: float = 450.0
    arm_neutral: float = 2.0
    stop_ramp: float = 0.0
    reverse: bool = False
    deadband_us: float | None = None
    saturation_us: float | None = None
    signal_loss: float | None = None


class Pwm(FileTable, frozen=True, kw_only=True):
    """The PCA9685: address, I2C bus number, PWM frequency [Hz].

    ``oscillator_hz``: measured by hand with a scope or logic analyser; the value in
    calibration.toml has precedence. ``clock_channel``: the spare channel wired to the Nano's D8,
    which can measure the clock. ``error_feedback``: the rounding error of a pulse to whole counts
    is compensated in the next frames.
    """

    address: int = 0x40
    bus: int = 1
    frequency: float = 50.0
    oscillator_hz: Quantity | None = None
    clock_channel: int = 15
    error_feedback: bool = True


class EncoderConfig(FileTable, frozen=True, kw_only=True):
    """The rings on the main gear: edges per revolution, metres per edge.

    ``metres_per_edge`` is computed from the drawing, with its tolerance as standard error; the
    value in calibration.toml has precedence. None: a car that is known by recordings alone, which
    ``Car.open`` refuses.
    """

    rings: Literal[1, 2] = 1
    edges_per_rev: int = 20
    edges_per_rev_b: int = 10
    metres_per_edge: Quantity | None = None


class ImuConfig(FileTable, frozen=True, kw_only=True):
    """The BNO055: mounting angles [rad] sensor to body (yaw, then pitch, then roll).

    ``required``: arm() refuses while the IMU is absent, stale or stuck.
    x, y [m]: its position in the body frame, origin at the rear axle.
    """

    required: bool = True
    mount_yaw: float = 0.0
    mount_pitch: float = 0.0
    mount_roll: float = 0.0
    x: float = 0.0
    y: float = 0.0


class Lidar(FileTable, frozen=True, kw_only=True):
    """Mounting of the lidar; geometry.lidar_x is its axis, measured from the rear axle.

    y [m] of the axis; mount_yaw [rad]: direction of its zero angle; ``inverted``: its angles
    increase clockwise in a top view, as of an upright YDLidar; ``scale``: true distance /
    reported distance.
    """

    y: float = 0.0
    mount_yaw: float = 0.0
    inverted: bool = True
    scale: float = 1.0


class BatteryConfig(FileTable, frozen=True, kw_only=True):
    """What measures the battery; without the table, nothing.

    source: ``ina219`` on the bus of the PCA9685, or ``nano``: a divider at its A0. ``ratio``:
    voltage of the battery over that of the divider. ``cells`` in series. Voltages of a cell [V]:
    below ``warn_cell`` a warning, below ``limit_cell`` forward throttle is limited to
    ``limited_throttle``; backward it may be the brake.
    """

    source: Literal["ina219", "nano"] = "ina219"
    ratio: float | None = None
    # The board of a JetRacer. A bare module has 0x40, the address of the PCA9685.
    address: int = 0x41
    # Two LiPo or Li-ion cells, as in the cars that have this board.
    cells: int = 2
    # A cell under a small load has a tenth of its charge left.
    warn_cell: float = 3.5
    # A cell is damaged below 3.0 V; 0.3 V are left for the sag of a last acceleration.
    limit_cell: float = 3.3
    # Enough to drive home.
    limited_throttle: float = 0.2


class RcChannel(FileTable, frozen=True, kw_only=True):
    """Pulses [us] of one stick: at its ends and in the middle.

    ``high_us``: full left or full throttle; below ``low_us`` for a stick of the other direction.
    """

    low_us: float = 1000.0
    center_us: float = 1500.0
    high_us: float = 2000.0


class RcConfig(FileTable, frozen=True, kw_only=True):
    """An RC receiver on the Nano, whose driver overrides the program; without the table, none.

    ``dead_band_us``: offset from the middle within which a stick rests. ``mode_us``: the driver
    overrides while the pulse of the third channel is longer; None: while a stick is moved.
    ``enabled`` False: the receiver is not read.
    """

    enabled: bool = True
    steering: RcChannel = RcChannel()
    throttle: RcChannel = RcChannel()
    dead_band_us: float = 50.0
    mode_us: float | None = None


class CommandLimits(FileTable, frozen=True, kw_only=True):
    """Limits of a command: steering [rad], throttle, speed [m/s], slew rates [1/s].

    None: no slew limit. ``encoder_lost_throttle`` limits the throttle while the encoder is lost.
    """

    max_steering: float = 0.4
    max_throttle: float = 1.0
    min_throttle: float = -1.0
    max_speed: float = 5.0
    steering_slew: float | None = None
    throttle_slew: float | None = None
    encoder_lost_throttle: float = 0.0


class Priorities(FileTable, frozen=True, kw_only=True):
    """Priority of the sources of commands: the first listed one is applied.

    A source that is not listed has the lowest priority.
    """

    sources: tuple[str, ...] = ("run_stop", "gamepad", "keyboard", "user")


class Safety(FileTable, frozen=True, kw_only=True):
    """Whether arm() requires a hardware cut-off (Nano parameter safety_out), and tests it.

    ``cutoff_test``: the capture wire is fitted, so each arm() tests that the cut-off works.
    Without it, an untested cut-off is a warning.
    """

    cutoff_required: bool = False
    cutoff_test: bool = False


class CarConfig(FileTable, frozen=True, kw_only=True):
    """The description of one car. Lengths in m, angles in rad."""

    schema: str = CAR_SCHEMA
    name: str
    geometry: Geometry
    encoder: EncoderConfig = EncoderConfig()
    steering: SteeringConfig = SteeringConfig()
    throttle: ThrottleConfig = ThrottleConfig()
    pwm: Pwm = Pwm()
    imu: ImuConfig = ImuConfig()
    lidar: Lidar = Lidar()
    battery: BatteryConfig | None = None
    rc: RcConfig | None = None
    limits: CommandLimits = CommandLimits()
    priorities: Priorities = Priorities()
    safety: Safety = Safety()


def parse_config(text: str, origin: str, *, recorded: bool = False) -> CarConfig:
    """Read the text of a car.toml. Raises ConfigError with ``origin`` and key.

    recorded: the text comes from a recording, which drives no car: its neutral and oscillator may
    be outside of the present ranges.
    """
    car = parse(text, CarConfig, origin)
    check_ranges(car, CAR_RANGES, origin)
    _check_geometry(car, origin)
    _check_actuators(car, origin)
    _check_limits(car, origin)
    _check_battery(car, origin)
    _check_rc(car, origin)
    encoder = car.encoder
    check_std(encoder.metres_per_edge, "encoder.metres_per_edge", origin, positive=True)
    low, high = METRES_PER_EDGE_RANGE
    metres = encoder.metres_per_edge
    require(metres is None or low <= metres.value <= high, origin,
            "encoder.metres_per_edge.value", metres and metres.value,
            "0.0002 to 0.05 m; are these millimetres?")
    for key in ("edges_per_rev", "edges_per_rev_b"):
        require(2 <= getattr(encoder, key) <= 64, origin, f"encoder.{key}", getattr(encoder, key),
                "2 to 64, as the firmware takes it")
    check_std(car.pwm.oscillator_hz, "pwm.oscillator_hz", origin, positive=True)
    if not recorded:
        check_oscillator(car.pwm.oscillator_hz, origin)
        check_neutral(car.throttle.neutral_us, car.throttle.deliberate_neutral_us, origin,
                      "throttle.neutral_us")
        check_name(car.name, origin)
    return car


def _check_geometry(car: CarConfig, origin: str) -> None:
    body = car.geometry
    for key in ("wheelbase", "l_f", "l_r", "mass"):
        require(getattr(body, key) > 0, origin, f"geometry.{key}", getattr(body, key), "> 0")
    require(abs(body.l_f + body.l_r - body.wheelbase) <= 5e-4, origin, "geometry.wheelbase",
            f"{body.wheelbase} m with l_f + l_r = {body.l_f + body.l_r:.4f} m",
            "l_f + l_r within 0.5 mm")
    errors = body.std.to_dict()
    for key, std in errors.items():
        size = getattr(body, key)
        require(size is not None, origin, f"geometry.std.{key}", std, f"geometry.{key} as well",
                f"add {key} to [geometry]")
        require(0 < std <= MAX_RELATIVE_STD * size, origin, f"geometry.std.{key}", std,
                f"above 0 and at most half of {key} = {size}", "check the unit")
    require(not {"l_f", "l_r"} <= set(errors), origin, "geometry.std.l_r", body.std.l_r,
            "an error of l_f or of l_r; the other one follows from the wheelbase",
            "remove one of the two")


def _check_actuators(car: CarConfig, origin: str) -> None:
    steer = car.steering
    esc = car.throttle
    pwm = car.pwm
    for key, channel in (("steering.channel", steer.channel), ("throttle.channel", esc.channel)):
        require(0 <= channel <= 15, origin, key, channel, "0 to 15")
    require(steer.channel != esc.channel, origin, "throttle.channel", esc.channel,
            "another channel than the steering's")
    for name, channel in (("steering", steer.channel), ("throttle", esc.channel)):
        require(pwm.clock_channel != channel, origin, "pwm.clock_channel", pwm.clock_channel,
                f"another channel than [{name}] channel; without the key it is 15",
                "[pwm] clock_channel = a channel that carries nothing")
    deliberate = esc.deliberate_neutral_us
    for key, pulse in (("steering.center_us", steer.center_us),
                       ("throttle.neutral_us", esc.neutral_us),
                       ("throttle.deliberate_neutral_us", 1500.0 if deliberate is None else
                        deliberate)):
        require(1000 <= pulse <= 2000, origin, key, pulse, "1000 to 2000 us")
    for key, span in (("steering.span_us", steer.span_us), ("throttle.span_us", esc.span_us)):
        require(0 < span <= 750, origin, key, span,
                "above 0 and at most 750 us (a negative gain is direction = -1)")
    require(0x40 <= pwm.address <= 0x7f and pwm.address != 0x70, origin, "pwm.address",
            f"{pwm.address} = {pwm.address:#04x}",
            "0x40 to 0x7f without 0x70; the factory setting is hexadecimal 0x40")
    require(0.9 <= car.lidar.scale <= 1.1, origin, "lidar.scale", car.lidar.scale, "0.9 to 1.1")
    require(40 <= pwm.frequency <= 400, origin, "pwm.frequency", pwm.frequency, "40 to 400 Hz")
    require(esc.arm_neutral >= 0 and esc.stop_ramp >= 0, origin, "throttle.arm_neutral",
            esc.arm_neutral, ">= 0 s")


def _check_battery(car: CarConfig, origin: str) -> None:
    battery = car.battery
    if battery is None:
        return
    # The pins A0 and A1 of an INA219 select one of sixteen addresses.
    require(0x40 <= battery.address <= 0x4f and battery.address != car.pwm.address, origin,
            "battery.address", f"{battery.address} = {battery.address:#04x}",
            "0x40 to 0x4f, another one than that of the PCA9685")
    if battery.source == "nano":
        ratio = battery.ratio
        full = FULL_CELL_V * battery.cells
        require(ratio is not None and full / ratio <= MAX_DIVIDER_V, origin, "battery.ratio", ratio,
                f"(R1 + R2) / R2 of the divider, {full / MAX_DIVIDER_V:.2f} or more for "
                f"{battery.cells} cells: at most {MAX_DIVIDER_V:g} V at A0")
    require(battery.limit_cell <= battery.warn_cell, origin, "battery.limit_cell",
            battery.limit_cell, f"at most warn_cell = {battery.warn_cell:g} V")


def _check_rc(car: CarConfig, origin: str) -> None:
    rc = car.rc
    if rc is None:
        return
    for name in ("steering", "throttle"):
        stick = getattr(rc, name)
        for key in ("low_us", "center_us", "high_us"):
            pulse = getattr(stick, key)
            require(800 <= pulse <= 2200, origin, f"rc.{name}.{key}", pulse, "800 to 2200 us")
        for key in ("low_us", "high_us"):
            end = getattr(stick, key)
            require(abs(end - stick.center_us) >= MIN_STICK_SPAN_US, origin, f"rc.{name}.{key}",
                    end, f"{MIN_STICK_SPAN_US:g} us or more from center_us = "
                         f"{stick.center_us:g} us")
        require((stick.low_us < stick.center_us) == (stick.center_us < stick.high_us), origin,
                f"rc.{name}.center_us", stick.center_us, "between low_us and high_us")


def _check_limits(car: CarConfig, origin: str) -> None:
    limits = car.limits
    require(0 < limits.max_steering < 1.2, origin, "limits.max_steering", limits.max_steering,
            "above 0, below 1.2 rad")
    require(0 <= limits.max_throttle <= 1, origin, "limits.max_throttle", limits.max_throttle,
            "0 to 1")
    require(-1 <= limits.min_throttle <= 0, origin, "limits.min_throttle", limits.min_throttle,
            "-1 to 0")
    for key in ("steering_slew", "throttle_slew", "max_speed"):
        rate = getattr(limits, key)
        require(rate is None or rate > 0, origin, f"limits.{key}", rate, "> 0")
