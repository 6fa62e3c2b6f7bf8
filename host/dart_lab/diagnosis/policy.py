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
from dart_lab.identification.evidence.policy import EvidencePolicy, NoisePolicy, PriorPolicy

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
    min_speed: float = 0.5  # m/s; below 0.2 the encoder counts too little
    max_lateral_accel: float = 2.0  # m/s2 sideways, below which a car rolls without slip
    min_wheel_angle: float = 0.1  # rad at the wheels: five times a large trim
    max_angle_change: float = 0.05  # rad, the most that a steered wheel may move ...
    angle_change_s: float = 0.3  # s ... in this time, twice the steering delay
    max_curvature_factor: float = 2.0  # of the curvature; beyond, the model is of another car

    def at_scale(self, scale: Scale) -> InputPolicy:
        """Return the thresholds for a car of that scale."""
        return replace(self, min_yaw_rate=self.min_yaw_rate * scale.yaw_rate,
                       min_speed=self.min_speed * scale.speed)


@dataclass(frozen=True, slots=True)
class ScanPolicy:
    """Sizes of an effect that are tried."""

    min_predicted_loss: float = 3.0  # reduction by a parabola above which larger sizes are tried


@dataclass(frozen=True, slots=True)
class NamingPolicy:
    """Acceptance of an effect in one round."""

    min_hidden_ratio: float = 2.0  # gain of the best explanation by the noise that it leaves, over
    # that by the noise before. Above, what it explains was part of the noise before; if it was not,
    # both gains are the same
    min_size: float = 0.8  # of the small size; below is what sampling conventions do (null rows)
    min_tried_size: float = 0.4  # of the small size, by the linear answer, which may be off by half


@dataclass(frozen=True, slots=True)
class ConfounderPolicy:
    """When two effects are confounded: they explain the data equally well."""

    min_cosine: float = 0.6  # between what two do to the residuals: 53 degrees, a third in common
    min_difference_stds: float = 2.0  # of the loss difference over blocks: 1 in 44


@dataclass(frozen=True, slots=True)
class GradePolicy:
    """Probability of an accepted effect, and constancy of its size."""

    confident_probability: float = 0.97  # of an effect (110 of 110 right) or a group of parameters
    likely_probability: float = 0.8  # 16 of 21 right, 11 of the 12 that the test recordings confirm
    possible_probability: float = 0.3  # probability below which it is not even possible
    change_level: float = 0.01  # level of a change that is reported; of correct sizes once in 25
    min_change: float = 0.1  # of its size, root mean square; smaller changes are not reported


@dataclass(frozen=True, slots=True)
class TwoCarsPolicy:
    """When recordings have two different cars or floors."""

    min_difference_stds: float = 6.0  # standard errors between the two groups
    min_difference_sizes: float = 1.0  # medium sizes of an effect between them; days differ by less
    min_spread_ratio: float = 4.0  # times the distance of any recording from its own group


@dataclass(frozen=True, slots=True)
class ClaimPolicy:
    """When a parameter of the model is reported as wrong."""

    min_probability: float = 0.5  # of a group that is claimed: rather than not ...
    min_error_ratio: float = 1.03  # ... if test errors are this many times as large without it
    # (of 41 of the campaign 33 are exact, 30 at 1.01; 32 with a P of 0.8); by the lower 90 % limit
    # for a group that is not confident
    stretch_s: float = 15.0  # s of a test recording, for the interval of the change of its error
    max_stated_stds: float = 2.0  # standard errors of the file; within them nothing is wrong


@dataclass(frozen=True, slots=True)
class UnexplainedPolicy:
    """When the remaining residuals have structure."""

    min_share: float = 0.1  # of the variance; less structure is not reported: 5 % of the error
    accel: float = 0.03  # m/s2, root mean square; an accelerometer's sensitivity and the angle
    # between its axes are good to 1 % by its data sheet (BNO055), and a car pulls 3 m/s2 aside
    encoder: float = 0.006  # m/s, the same; one edge of 2.1 mm in 0.1 s over sqrt(12)
    max_null_ratio: float = 2.0  # times the level, that the p-value by flipped residuals may have:
    # that null distribution is exact, but wide where there is much structure
    min_share_ratio: float = 1.25  # by which one more variable must multiply the share
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


@dataclass(frozen=True, slots=True)
class SuggestPolicy:
    """When a drive would separate two causes."""

    separation: float = 4.0  # standard deviations: the wrong one then fits better once in 44
    onboard_separation: float = 6.0  # by on-board sensors, whose noise changes with the drive
    min_explained_share: float = 0.25  # of what the cause explains; less is no confounder
    max_error_ratio: float = 0.5  # of a claimed quantity's standard error: justifies a drive


@dataclass(frozen=True, slots=True)
class Policy:
    """Thresholds of a diagnosis; docs/results evaluates the defaults."""

    inputs: InputPolicy = field(default_factory=InputPolicy)
    evidence: EvidencePolicy = field(default_factory=EvidencePolicy)
    noise: NoisePolicy = field(default_factory=NoisePolicy)
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
