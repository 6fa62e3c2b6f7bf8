"""Thresholds of the evidence and of every fit to it, for a car of 1:10, see ``Policy``."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dart_hal.vehicle.scale import Scale

# Time that is held out together [s]: the disturbance is correlated over 0.15 s, and a
# prediction takes 1 s.
BLOCK_S = 2.0
# From this number on recordings are the units: all of them improve by chance in 1 of 64 cases.
MANY_RECORDINGS = 6
# Readings for a standard deviation with an error of 16 %, 1 / sqrt(2 n); 2 s at 10 Hz.
MIN_READINGS = 20
# Clipping of residuals for the noise estimate [standard deviations]: 1 in 16,000 normal ones.
CLIP = 4.0


@dataclass(frozen=True, slots=True)
class EvidencePolicy:
    """Windows and messages of a recording that are evaluated."""

    max_yaw_rate_bend: float = 0.1  # rad/s in 0.1 s; a derivative is off it, like less yaw inertia
    max_accel_bend: float = 0.4  # rad/s; an accelerometer shakes more than a derivative is off
    max_speed_bend: float = 0.08  # m/s in 0.14 s; the same for an accelerometer along the car
    max_rest_speed: float = 0.03  # m/s, car at rest: three times the noise of a pose in 0.1 s
    max_rest_yaw_rate: float = 0.1  # rad/s; a car that turns faster, wheels at rest, is carried
    min_encoder_speed: float = 0.2  # m/s; below it an encoder counts too little to be judged
    min_level_std: float = 0.05  # m/s2; a floor is level to 5 mrad at best, for any sensor

    def at_scale(self, scale: Scale) -> EvidencePolicy:
        """Return the thresholds for a car of that scale."""
        return replace(
            self, max_yaw_rate_bend=self.max_yaw_rate_bend * scale.yaw_rate,
            max_accel_bend=self.max_accel_bend * scale.yaw_rate,
            max_rest_yaw_rate=self.max_rest_yaw_rate * scale.yaw_rate,
            max_speed_bend=self.max_speed_bend * scale.speed,
            max_rest_speed=self.max_rest_speed * scale.speed,
            min_encoder_speed=self.min_encoder_speed * scale.speed)


@dataclass(frozen=True, slots=True)
class NoisePolicy:
    """Weights of residuals."""

    robust: float = 3.0  # standard deviations where the loss turns linear; 0.3 % of normal ones
    max_residual: float = 30.0  # standard deviations; residuals are clipped there: 10 ``robust``
    ridge: float = 0.02  # of a variance; keeps the covariance of few windows invertible
    age_s: float = 0.002  # s; ages of commands that differ by less do nothing: a fifth of a sample
    min_age_effect: float = 3.0  # standard deviations that the oldest command must move a reading


@dataclass(frozen=True, slots=True)
class PriorPolicy:
    """Prior distribution of the parameters."""

    max_stated_stds: float = 3.5  # stated standard errors (1 in 2000) that a parameter may move
    effect_width: float = 4.0  # medium sizes in one standard deviation: a medium effect costs 0.06


USUAL_EVIDENCE = EvidencePolicy()
USUAL_NOISE = NoisePolicy()
USUAL_PRIOR = PriorPolicy()
