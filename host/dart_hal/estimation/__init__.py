"""Estimation of a State from frames: time, wheel speed, dead reckoning, pose in the room.

``dart_hal.car.telemetry.Telemetry.read`` calls the modules in this order:

    frames                            raw integers to SI units in body axes
    core.clock_fit                    device time to host time
    speed, ring                       speed and travel, from the edges of the encoder
    imu_clock                         time of a sample of the gyro
    imu_checks                        plausibility of a sample, agreement with the wheels
    single_samples                    replacement of single wrong samples
    direction, phase                  sign of the travel, by acceleration or a second ring
    consistency, bounds               agreement of the encoder with accelerometer and model
    odometry, gyro                    dead reckoning with covariance
    room: spin, pose_tracking,        with external poses: ground speed of spinning wheels, which
      pose_filter, pose_model           poses are the car's, and their fusion with wheels and gyro

``localisation`` makes external poses from the scans of the car, ``mapping`` a map of a recording.
``source_clock`` and ``pose_check`` are for recordings: stamps of a source, and wrong conventions.

Times are arguments, nothing reads a port or a clock. ``localisation`` alone reads map files,
compiles C, and has a thread (``localisation.source``).
"""

from dart_hal.core.lazy import read_public_names

# The names are in __init__.pyi: a car without external poses needs no filter of them.
__getattr__, __dir__, __all__ = read_public_names(__name__, __file__)
