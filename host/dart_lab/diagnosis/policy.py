"""Thresholds of the diagnosis that studies vary, with units and, for most, the derivation.

"Campaign" means: set on the draws from 0 on of ``studies/diagnosis/campaign.py``, evaluated on
those from 100 on (docs/results/campaign.md). The effect of half and double of most thresholds:
docs/results/policy_sensitivity.md. Other thresholds are constants of the modules that use them.
A loss is in squared standard deviations of one independent residual, so 4.0 is two standard
deviations of one number.

Speeds, yaw rates and lengths are those of a car of 1:10; ``Policy.at_scale`` gives those of another
car. Times are those of servos, messages and sensors, which do not shrink with a car, and
accelerations are the same for cars of all sizes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

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
# Quantile beyond which a function of the state is constant, so that few values do not determine it.
TAIL = 0.02


@dataclass(frozen=True, slots=True)
class InputPolicy:
    """Recordings and models that are refused, or about which the user is warned."""

    train_s: float = 8.0  # s of driving: 16 windows, 4 blocks; below, nothing is diagnosed
    small_train_s: float = 40.0  # s of driving, 20 blocks; below, a note: little is detectable
    test_s: float = 4.0  # s of driving: 8 windows
    test_share: float = 0.4  # held out of each recording where no test is given: 80 of 200 s
    max_factor: float = 2.5  # to the measured motion: no effect of a sound car reaches it, km/h do
    max_log_error: float = 0.2  # of the logarithm; from degrees to cm, the nearest two, it is 0.56
    max_quartile_ratio: float = 1.5  # third over first quartile of a ratio that is one factor
    min_correlation: float = 0.8  # and share of one sign, above which a factor is reported
    min_yaw_rate: float = 0.2  # rad/s: 0.1 m/s2 sideways at ``min_speed``
    min_lateral_accel: float = 0.2  # m/s2; below, an accelerometer is not compared with the motion
    min_speed: float = 0.5  # m/s; below 0.2 the encoder counts too little
    max_lateral_accel: float = 2.0  # m/s2 sideways, below which a car rolls without slip
    min_wheel_angle: float = 0.1  # rad at the wheels: five times a large trim
    max_angle_change: float = 0.05  # rad, the most that a steered wheel may move ...
    angle_change_s: float = 0.3  # s ... in this time, twice the steering delay
    max_curvature_factor: float = 2.0  # of the curvature; beyond, the model is of another car
    min_gyro_rate: float = 1e-6  # rad/s, below one count of any gyro: a dead one

    def at_scale(self, scale: Scale) -> InputPolicy:
        """Return the thresholds for a car of that scale."""
        return replace(self, min_yaw_rate=self.min_yaw_rate * scale.yaw_rate,
                       min_speed=self.min_speed * scale.speed)


@dataclass(frozen=True, slots=True)
class EvidencePolicy:
    """Windows and messages of a recording that are evaluated."""

    whole_s: float = 300.0  # s of recordings, from which on windows do not overlap: cost
    max_yaw_rate_bend: float = 0.1  # rad/s in 0.1 s; a derivative is off it, like less yaw inertia
    max_accel_bend: float = 0.4  # rad/s; an accelerometer shakes more than a derivative is off
    max_speed_bend: float = 0.08  # m/s in 0.14 s; the same for an accelerometer along the car
    max_rest_speed: float = 0.03  # m/s, car at rest: three times the noise of a pose in 0.1 s
    max_rest_yaw_rate: float = 0.1  # rad/s; a car that turns faster, wheels at rest, is carried
    min_encoder_speed: float = 0.2  # m/s; below it an encoder counts too little to be judged
    min_level_std: float = 0.05  # m/s2; a floor is level to 5 mrad at best, for any sensor
    min_forward_throttle: float = -0.01  # below it a car may reverse; an encoder has no sign
    rotation_radius: float = 0.1  # m from the centre, where turning counts as motion

    def at_scale(self, scale: Scale) -> EvidencePolicy:
        """Return the thresholds for a car of that scale."""
        return replace(
            self, max_yaw_rate_bend=self.max_yaw_rate_bend * scale.yaw_rate,
            max_accel_bend=self.max_accel_bend * scale.yaw_rate,
            max_rest_yaw_rate=self.max_rest_yaw_rate * scale.yaw_rate,
            max_speed_bend=self.max_speed_bend * scale.speed,
            max_rest_speed=self.max_rest_speed * scale.speed,
            min_encoder_speed=self.min_encoder_speed * scale.speed,
            rotation_radius=self.rotation_radius * scale.length)


@dataclass(frozen=True, slots=True)
class NoisePolicy:
    """Weights of residuals."""

    robust: float = 3.0  # standard deviations where the loss turns linear; 0.3 % of normal ones
    max_residual: float = 30.0  # standard deviations; residuals are clipped there: 10 ``robust``
    encoder_floor: float = 0.002  # m/s: half a millisecond of jitter at 4 m/s2
    gyro_floor: float = 0.00031  # rad/s: a step of 1/16 deg/s (BNO055) over sqrt(12) ...
    accel_floor: float = 0.0029  # m/s2: ... and one of 0.01: rounded values are not more accurate
    ridge: float = 0.02  # of a variance; keeps the covariance of few windows invertible
    age_s: float = 0.002  # s; ages of commands that differ by less do nothing: a fifth of a sample
    min_age_effect: float = 3.0  # standard deviations that the oldest command must move a reading
    max_passes: int = 5  # fits with a new effect, each with the noise that the last one leaves ...
    volume_tolerance: float = 0.1  # ... until the sum of the log standard deviations (15 of the
    # motion, 4 of sensors) falls by less: 0.5 % of each


@dataclass(frozen=True, slots=True)
class BlockPolicy:
    """Blocks of time that are independent and are held out together.

    Where they only limit a length, or remove what depends on the drive, BLOCK_S counts instead.
    """

    seconds: float = BLOCK_S  # s of a block


@dataclass(frozen=True, slots=True)
class PriorPolicy:
    """Prior distribution of the parameters."""

    max_stated_stds: float = 3.5  # stated standard errors (1 in 2000) that a parameter may move
    effect_width: float = 4.0  # medium sizes in one standard deviation: a medium effect costs 0.06


@dataclass(frozen=True, slots=True)
class ScanPolicy:
    """Sizes of an effect that are tried."""

    ladder: tuple[float, ...] = (0.35, 1.0, 2.2)  # of the medium size: small, medium, large
    dense: tuple[float, ...] = (0.35, 0.45, 0.55, 0.65, 0.8, 0.95, 1.1, 1.3, 1.6, 1.9, 2.2)  # same
    # for effects whose gain has several maxima over their size: steps of a fifth
    min_predicted_loss: float = 3.0  # reduction by a parabola above which larger sizes are tried
    peak_tolerance: float = 0.05  # of the reduction that a parabola predicts at its maximum:
    # if the reduction found there differs by less, larger sizes are not tried
    slope_tolerance: float = 0.25  # of the gain that the changes by size of the last round predict:
    # if the gain found differs by more, all sizes are tried again (Shamanskii)
    refinements: int = 6  # parabola steps after the ladder; most end after one, as predicted
    prediction_tolerance: float = 0.02  # of a predicted reduction: if at most so much of it is
    # missing, the search for the size ends
    min_size_step: float = 0.1  # of a size, between the best size and the next one that is tried
    bisections: int = 5  # of an interval of sizes in which an effect may set in: to 1 / 32 of it
    threshold: float = 0.5  # of the change in proportion to that by a larger size: below, an effect
    # may set in between the two sizes


@dataclass(frozen=True, slots=True)
class NamingPolicy:
    """Acceptance of an effect in one round."""

    draws: int = 1999  # data sets without a cause: 20 of them beyond a false alarm of 1 %
    explanations: int = 3  # fits of a round to find the best explanation ...
    min_kept_share: float = 0.5  # ... which reaches this share of the linearly predicted gain
    min_hidden_ratio: float = 2.0  # gain of the best explanation by the noise that it leaves, over
    # that by the noise before. Above, what it explains was part of the noise before; if it was not,
    # both gains are the same
    max_sharpenings: int = 3  # times that the noise is measured so in a round; each halves the rest
    min_size: float = 0.8  # of the small size; below is what sampling conventions do (null rows)
    min_tried_size: float = 0.4  # of the small size, by the linear answer, which may be off by half
    max_change_ratio: float = 2.0  # of the change of each of two alone: limit of the linear model
    certain_ratio: float = 4.0  # thresholds; an effect with that statistic is not tested again


@dataclass(frozen=True, slots=True)
class ConfounderPolicy:
    """When two effects are confounded: they explain the data equally well."""

    min_gain_share: float = 0.5  # of the gain of the winner; one with less is not compared with it
    min_cosine: float = 0.6  # between what two do to the residuals: 53 degrees, a third in common
    min_difference_stds: float = 2.0  # of the loss difference over blocks: 1 in 44
    min_loss_difference: float = 4.0  # a smaller one is not significant, even if it is steady


@dataclass(frozen=True, slots=True)
class GradePolicy:
    """Probability of an accepted effect, and constancy of its size."""

    draws: int = 400  # of units; P = 0.97 is known to 0.01
    units: int = 16  # stretches of time, where recordings are fewer ...
    family: float = 0.5  # of its size, by which a cause may differ along a function of the state
    place: float = 1.0  # of a force, by which it may act at the steered wheels: all of it
    confident_probability: float = 0.97  # probability of an effect: 110 of 110 right
    likely_probability: float = 0.8  # 16 of 21 right, 11 of the 12 that the test recordings confirm
    possible_probability: float = 0.3  # probability below which it is not even possible
    waves: int = 3  # half waves along each variable on which a size may depend
    period_s: float = 5.0  # s; the shortest wave along time
    time_waves: int = 48  # at most: two minutes of them
    change_level: float = 0.01  # level of a change that is reported; of correct sizes once in 25
    min_change: float = 0.1  # of its size, root mean square; smaller changes are not reported
    turns: int = 999  # signs of blocks turned: ten of them beyond that level


@dataclass(frozen=True, slots=True)
class TwoCarsPolicy:
    """When recordings have two different cars or floors."""

    min_difference_stds: float = 6.0  # standard errors between the two groups
    min_difference_sizes: float = 1.0  # medium sizes of an effect between them; days differ by less
    min_spread_ratio: float = 4.0  # times the distance of any recording from its own group


@dataclass(frozen=True, slots=True)
class ClaimPolicy:
    """When a parameter of the model is reported as wrong."""

    prior_probability: float = 0.2  # that a group is wrong: one or two of the usual seven
    max_criterion_gap: float = 12.0  # twice a log probability; a set worse by it is out: e^6 to one
    max_linear_rise: float = 25.0  # loss; below, a set needs no fit: five standard deviations
    max_swap_gap: float = 100.0  # of the criterion to second order, which is inexact for far moves:
    # an exchange of two groups that is worse by more is not fitted
    min_group_probability: float = 0.05  # probability below which a group is not looked at again
    min_guessed_probability: float = 0.01  # the same to second order: below, it is not fitted
    draws: int = 128  # of units
    min_probability: float = 0.5  # of a group that is claimed: rather than not ...
    min_error_ratio: float = 1.03  # ... if test errors are this many times as large without it,
    # (of 41 of the campaign 33 are exact, 30 at 1.01; 32 with a P of 0.8) ...
    certain_probability: float = 0.97  # ... below this probability, by the lower 90 % limit
    stretch_s: float = 15.0  # s of a test recording, for the interval of the change of its error
    max_stated_stds: float = 2.0  # standard errors of the file; within them nothing is wrong
    min_confounder_probability: float = 0.1  # of another group without this one
    min_pair_probability: float = 0.05  # of a pair, minus that of each part: one claim for both


@dataclass(frozen=True, slots=True)
class UnexplainedPolicy:
    """When the remaining residuals have structure."""

    min_share: float = 0.1  # of the variance; less structure is not reported: 5 % of the error
    accel: float = 0.03  # m/s2, root mean square; an accelerometer's sensitivity and the angle
    # between its axes are good to 1 % by its data sheet (BNO055), and a car pulls 3 m/s2 aside
    encoder: float = 0.006  # m/s, the same; one edge of 2.1 mm in 0.1 s over sqrt(12)
    max_null_ratio: float = 2.0  # times the level, that the p-value by flipped residuals may have:
    # that null distribution is exact, but wide where there is much structure
    first_level_ratio: float = 6.0  # times the level: if the p-value by a tenth of the flips is
    # above, the others are not made; a p-value at the level is then missed once in 300
    min_share_ratio: float = 1.25  # by which one more variable must multiply the share
    max_blocks: int = 200  # at most: longer ones for longer data, the cost is by the block
    min_blocks: int = 10  # 2^10 ways to turn signs: enough for a level of 1 %
    folds: int = 8  # of blocks: 7 of 8 to fit
    min_recordings: int = 3  # from which on they are left out whole
    ridge: float = 10.0  # of residuals of size 1: structure of a tenth of the variance
    sign_flips: int = 49  # data sets with turned signs; the median share is what chance explains
    max_straight_angle: float = 0.03  # rad of steering; half of it is neither left nor right
    max_waves: float = 1.5  # per metre; a prediction averages over half a metre

    def at_scale(self, scale: Scale) -> UnexplainedPolicy:
        """Return the thresholds for a car of that scale."""
        return replace(self, encoder=self.encoder * scale.speed,
                       max_waves=self.max_waves / scale.length)


@dataclass(frozen=True, slots=True)
class ConclusionPolicy:
    """Conclusions about the causes that the search has found."""

    max_remaining_share: float = 0.6  # of the structure may remain; a cause with more is withdrawn
    min_channel_share: float = 0.2  # of the reduction by a cause, above which it acts on a channel
    min_error_rise: float = 0.2  # of the error: an increase that is reported without an interval
    gain_block_s: float = 10.0  # s; bootstrap of residuals over laps of some seconds (predictions
    # over 1 s: ``compare.BLOCK_TIME``)


@dataclass(frozen=True, slots=True)
class SuggestPolicy:
    """When a drive would separate two causes."""

    separation: float = 4.0  # standard deviations: the wrong one then fits better once in 44
    onboard_separation: float = 6.0  # by on-board sensors, whose noise changes with the drive
    min_right_share: float = 0.95  # of simulated repeats name the truth: noise has long tails
    repeats: int = 200  # 0.95 is known to 0.015
    confounders: int = 4  # of one cause that are looked at, the nearest ones
    min_explained_share: float = 0.25  # of what the cause explains; less is no confounder
    max_error_ratio: float = 0.5  # of a claimed quantity's standard error: justifies a drive
    run: int = 4  # rows in a row that noise is drawn in: windows of 2 s
    gyro_noise: float = 0.004  # rad/s of a car at rest, if the data have no rest


@dataclass(frozen=True, slots=True)
class Policy:
    """Thresholds of a diagnosis; docs/results evaluates the defaults."""

    inputs: InputPolicy = field(default_factory=InputPolicy)
    evidence: EvidencePolicy = field(default_factory=EvidencePolicy)
    noise: NoisePolicy = field(default_factory=NoisePolicy)
    blocks: BlockPolicy = field(default_factory=BlockPolicy)
    prior: PriorPolicy = field(default_factory=PriorPolicy)
    scan: ScanPolicy = field(default_factory=ScanPolicy)
    naming: NamingPolicy = field(default_factory=NamingPolicy)
    confounders: ConfounderPolicy = field(default_factory=ConfounderPolicy)
    grade: GradePolicy = field(default_factory=GradePolicy)
    two_cars: TwoCarsPolicy = field(default_factory=TwoCarsPolicy)
    claims: ClaimPolicy = field(default_factory=ClaimPolicy)
    unexplained: UnexplainedPolicy = field(default_factory=UnexplainedPolicy)
    conclusion: ConclusionPolicy = field(default_factory=ConclusionPolicy)
    suggest: SuggestPolicy = field(default_factory=SuggestPolicy)

    def at_scale(self, scale: Scale) -> Policy:
        """Return the thresholds for a car of that scale; those of 1:10 are for the scale 1."""
        return replace(self, inputs=self.inputs.at_scale(scale),
                       evidence=self.evidence.at_scale(scale),
                       unexplained=self.unexplained.at_scale(scale))


USUAL = Policy()
