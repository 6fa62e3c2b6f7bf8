"""The lidars that have a driver: line rates, commands, decoder and timing of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import radians

from dart_hal.devices.lidar.ld19 import LD19_BAUD, LD19_SAMPLE_PERIOD, Ld19Decoder
from dart_hal.devices.lidar.packets import (
    BAUD,
    SAMPLE_PERIOD,
    START_COMMAND,
    STOP_COMMAND,
    BytesDecoder,
    LidarDecoder,
)
from dart_hal.devices.lidar.rplidar import (
    HEALTH_REQUEST,
    INFO_REQUEST,
    MAX_NODE_STEP_BACK,
    MOTOR_REQUEST,
    MOTOR_STOP_REQUEST,
    RPLIDAR_BAUD,
    RPLIDAR_FAST_BAUD,
    RPLIDAR_SAMPLE_PERIOD,
    SAMPLE_RATE_REQUEST,
    SCAN_REQUEST,
    STOP_REQUEST,
    RplidarDecoder,
)
from dart_hal.devices.lidar.rplidar_express import (
    EXPRESS_REQUEST,
    EXPRESS_SAMPLE_PERIOD,
    ExpressDecoder,
)

# Relative error of the sample period of an X4: its quartz and that of the host, with margin.
QUARTZ_ERROR = 0.006
# Relative error of the periods that LD19 and RPLidar state, rounded or nominal.
STATED_PERIOD_ERROR = 0.05


@dataclass(frozen=True, slots=True)
class LidarModel:
    """One kind of lidar.

    key: its name in a URL; title: in messages; bauds [bit/s]: the usual one first; sample_period
    [s]: until the decoder has another; rate [1/s]: nominal revolutions per second; period_error:
    largest relative error of the period; step_back [rad]: by which an angle may lie before the last
    one, None = one step; dtr: state of DTR with which the motor runs; start, stop: commands.
    """

    key: str
    title: str
    bauds: tuple[int, ...]
    sample_period: float
    rate: float
    make_decoder: Callable[[], BytesDecoder] = field(repr=False)
    period_error: float = STATED_PERIOD_ERROR
    step_back: float | None = None
    dtr: bool = True
    start: tuple[bytes, ...] = ()
    stop: tuple[bytes, ...] = ()


X4 = LidarModel("x4", "YDLidar X4", (BAUD,), SAMPLE_PERIOD, 8.0, LidarDecoder,
                period_error=QUARTZ_ERROR, start=(START_COMMAND,), stop=(STOP_COMMAND,))
LD19 = LidarModel("ld19", "LD19", (LD19_BAUD,), LD19_SAMPLE_PERIOD, 10.0, Ld19Decoder,
                  step_back=radians(1.0))
RPLIDAR = LidarModel("rplidar", "RPLidar", (RPLIDAR_BAUD, RPLIDAR_FAST_BAUD),
                     RPLIDAR_SAMPLE_PERIOD, 5.5, RplidarDecoder, step_back=MAX_NODE_STEP_BACK,
                     dtr=False,
                     start=(STOP_REQUEST, MOTOR_REQUEST, INFO_REQUEST, HEALTH_REQUEST,
                            SAMPLE_RATE_REQUEST, SCAN_REQUEST),
                     stop=(STOP_REQUEST, MOTOR_STOP_REQUEST))
# Twice as many samples, for which the firmware has to be 1.17 or later.
RPLIDAR_EXPRESS = replace(RPLIDAR, key="rplidar-express", title="RPLidar in its express scan",
                          sample_period=EXPRESS_SAMPLE_PERIOD, make_decoder=ExpressDecoder,
                          step_back=None, start=(*RPLIDAR.start[:-1], EXPRESS_REQUEST))
# In the order in which an unknown lidar is tried.
UNKNOWN_MODELS = (X4, LD19, RPLIDAR)
LIDAR_MODELS = (*UNKNOWN_MODELS, RPLIDAR_EXPRESS)


def recognise(data: bytes) -> LidarModel | None:
    """Return the model whose packets are in ``data``, None for bytes of no known lidar."""
    for model in LIDAR_MODELS:
        decoder = model.make_decoder()
        decoder.feed(data)
        if decoder.packets:
            return model
    return None
