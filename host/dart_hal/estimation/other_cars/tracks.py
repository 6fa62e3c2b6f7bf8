"""Motion of a tracked car: constant speed and yaw rate, with accelerations as noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, cos, hypot, sin

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.other_cars.rectangle import RectangleFit

# m/s2 and rad/s2, standard deviations of the accelerations, constant over a turn of the lidar.
SPEED_ACCEL_STD = 1.0
YAW_ACCEL_STD = 4.0
# m and rad, smallest standard deviation of a measured pose: error of the own pose.
MIN_PLACE_STD = 0.004
MIN_YAW_STD = 0.015
# Standard deviations of the first state: m, m, rad, m/s, rad/s.
START_STDS = (0.05, 0.05, 0.25, 0.25, 0.7)
# Weight of the newest scan in the mean share of a track.
SHARE_WEIGHT = 0.25
# A track is confirmed by these fits, m of travel (unless it began at rest) and mean share, and ends
# below the other ones.
CONFIRMING_FITS = 4
CONFIRMING_DISTANCE = 0.3
CONFIRMING_SHARE = 0.85
MIN_NEW_SHARE = 0.7
MIN_MEAN_SHARE = 0.6


@dataclass(frozen=True, slots=True)
class CarTrack:
    """A tracked car; number: its own since the start.

    t [s]; mean (5,): x, y [m], yaw [rad] of the rear axle in the room, speed [m/s], signed, yaw
    rate [rad/s]; cov (5, 5); hit_t [s]: last time at which beams ended on it; start (2,) [m]:
    first place of the axle; fits: number of updates; share: mean of those of the fits; confirmed:
    whether it has moved as one car, or rested in the size of one, for some time; at_rest: it has
    not moved since its start, and may be a box. Others may be people.
    """

    number: int
    t: float
    mean: FloatArray
    cov: FloatArray
    hit_t: float
    start: FloatArray
    fits: int = 0
    share: float = 1.0
    confirmed: bool = False
    at_rest: bool = False

    @property
    def is_contradicted(self) -> bool:
        """Whether too many beams pass through it."""
        return self.share < (MIN_MEAN_SHARE if self.confirmed else MIN_NEW_SHARE)

    def predict(self, t: float) -> CarTrack:
        """Return the track at t [s], the predicted path of the car; an earlier t: itself."""
        dt = t - self.t
        if dt <= 0.0:
            return self
        x, y, yaw, speed, rate = self.mean.tolist()
        # 1. Along the chord of the arc.
        c = cos(yaw + 0.5 * rate * dt)
        s = sin(yaw + 0.5 * rate * dt)
        mean = np.array((x + speed * dt * c, y + speed * dt * s, yaw + rate * dt, speed, rate))
        # 2. Derivatives by the state.
        step = np.eye(5)
        step[:2, 2] = -speed * dt * s, speed * dt * c
        step[:2, 3] = dt * c, dt * s
        step[:2, 4] = 0.5 * dt * step[:2, 2]
        step[2, 4] = dt
        # 3. Effect of one standard deviation of each acceleration.
        noise = np.zeros((5, 2))
        noise[:2, 0] = 0.5 * dt * dt * SPEED_ACCEL_STD * np.array((c, s))
        noise[3, 0] = dt * SPEED_ACCEL_STD
        noise[2, 1] = 0.5 * dt * dt * YAW_ACCEL_STD
        noise[4, 1] = dt * YAW_ACCEL_STD
        return replace(self, t=t, mean=mean, cov=step @ self.cov @ step.T + noise @ noise.T)

    def update(self, fit: RectangleFit) -> CarTrack:
        """Return the track with the fit of its pose at ``t``, made of poses that it predicts.

        Speed and yaw rate follow by their correlation with the pose.
        """
        floor = np.diag((MIN_PLACE_STD**2, MIN_PLACE_STD**2, MIN_YAW_STD**2))
        pose_cov = fit.cov + floor
        gain = self.cov[3:, :3] @ np.linalg.inv(self.cov[:3, :3])
        mean = self.mean.copy()
        mean[:3] = fit.mean
        mean[3:] += gain @ (fit.mean - self.mean[:3])
        cov = np.empty((5, 5))
        cov[:3, :3] = pose_cov
        cov[3:, :3] = gain @ pose_cov
        cov[:3, 3:] = cov[3:, :3].T
        cov[3:, 3:] = self.cov[3:, 3:] + gain @ (pose_cov - self.cov[:3, :3]) @ gain.T
        fits = self.fits + 1
        share = self.share + SHARE_WEIGHT * (fit.share - self.share)
        has_moved = hypot(*(mean[:2] - self.start)) >= CONFIRMING_DISTANCE
        at_rest = self.at_rest and not has_moved
        confirmed = self.confirmed or (
            fits >= CONFIRMING_FITS and share >= CONFIRMING_SHARE and (has_moved or at_rest))
        return replace(self, mean=mean, cov=cov, hit_t=self.t, fits=fits, share=share,
                       confirmed=confirmed, at_rest=at_rest)

    def contradict(self, fit: RectangleFit) -> CarTrack:
        """Return the track with a fit that does not support it; its motion is unchanged."""
        return replace(self, share=self.share + SHARE_WEIGHT * (fit.share - self.share))


def start_track(number: int, t: float, centre: FloatArray, velocity: FloatArray, centre_x: float
                ) -> CarTrack:
    """Return the track of a car whose centre (2,) [m] moves with a velocity (2,) [m/s]."""
    yaw = atan2(velocity[1], velocity[0])
    axle = centre - centre_x * np.array((cos(yaw), sin(yaw)))
    mean = np.array((*axle, yaw, hypot(*velocity), 0.0))
    return CarTrack(number, t, mean, np.diag(np.square(START_STDS)), t, mean[:2])


def start_resting_track(number: int, t: float, pose: FloatArray) -> CarTrack:
    """Return the track of a car at rest at an axle pose (3,); its front may be its rear."""
    mean = np.append(pose, (0.0, 0.0))
    return CarTrack(number, t, mean, np.diag(np.square(START_STDS)), t, mean[:2], at_rest=True)
