"""Find structure: residuals that are a function of the motion, place or time.

1. Fit flexible functions of speed, steering, place, time and others to one part of the drive,
   and predict the residuals of the other part.
2. Repeat with the signs of whole blocks flipped at random: the null distribution.
3. Report the function that explains more than chance, the simplest one of each channel.

The model is incomplete where such a function exists, also without an effect in the catalogue.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.drive import READ_OUTS
from dart_lab.identification.evidence.noise import Noise, replace_diverged
from dart_lab.identification.evidence.onboard import OnboardEvidence
from dart_lab.identification.evidence.policy import BLOCK_S, CLIP
from dart_lab.identification.evidence.readings import SENSORS
from dart_lab.identification.evidence.residuals import MOTION, Evidence, Residuals

from ..policy import TAIL, USUAL, UnexplainedPolicy
from ..result import Unexplained
from .bases import basis_functions, list_variable_sets
from .crossfit import (
    FOLDS,
    MIN_SIGN_BLOCKS,
    BlockedResiduals,
    fit_function,
    normal_scores,
    predict_held_out,
    predicted_share,
)
from .features import FEATURE_UNITS, exogenous, message_features, window_features
from .waves import WAVE_SETS, WAVES, find_wave, phase_labels, wave_shares

READ_OUT_INDEX = 2  # at 0.5 s, the distance between windows of short recordings
CHANNEL_UNITS = {"v_x": "m/s", "v_y": "m/s", "omega": "rad/s", "encoder": "m/s", "gyro": "rad/s",
        "accel_x": "m/s2", "accel_y": "m/s2"}
MAX_BLOCKS = 200  # longer ones for longer data: the cost is by the block
MIN_FOLD_RECORDINGS = 3  # from which on they are left out whole
MEDIAN_FLIPS = 49  # data sets with turned signs; the median share is what chance explains
# Times the level: if the p-value by a tenth of the flips is above, the others are not made. A
# p-value at the level is then missed once in 300.
FIRST_LEVEL_RATIO = 6.0
WAVES_RANK = 9  # larger than the size of any set of variables
WITHIN_RECORDING = ("time", "recording")  # need not generalise to another recording


@dataclass(frozen=True, slots=True)
class ResidualGroup:
    """Residuals with common rows.

    y (n, c): in units of ``size`` (n, c), which is in SI units. block (n,): labels, the same for
    the same time in every group. recording (n,): index into ``names``.
    """

    channels: tuple[str, ...]
    y: FloatArray
    size: FloatArray
    features: Mapping[str, FloatArray]
    block: IntArray
    recording: IntArray
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class StructureShares:
    """Explained shares of the variance on test folds, for k functions.

    functions: (channel, variables) of each. share (k,): observed. flipped, remaining (s, k): null
    distributions, from flipped signs of the residuals and of their remainder after the best
    functions. min_share (k,): shares below it are not reported.
    """

    functions: list[tuple[str, tuple[str, ...]]]
    share: FloatArray
    flipped: FloatArray
    remaining: FloatArray
    min_share: FloatArray

    def p_values(self, sharp: float) -> FloatArray:
        """Family-wise p-value of each function, (k,).

        Flipped residuals are an exact null distribution, but a strong structure widens it. The
        remainder gives a sharper null that is slightly too narrow for correlated noise. The sharp
        one decides, and the exact one must agree at ``sharp`` times the level.
        """
        return np.maximum(self._family_wise(self.remaining),
                          self._family_wise(self.flipped) / sharp)

    def _family_wise(self, null: FloatArray) -> FloatArray:
        """P-values over the family of all functions; only shares that would be reported compete."""
        # Shares of different functions have different null distributions: normal scores make them
        # comparable before the maximum is taken.
        share = np.vstack([self.share, null])
        scores = np.where(share >= self.min_share, normal_scores(share), -np.inf)
        # p = (1 + number of null maxima at least as large) / (1 + number of null data sets).
        chance = np.sort(scores[1:].max(axis=1))
        beaten_by = len(chance) - np.searchsorted(chance, scores[0])
        return np.asarray((1.0 + beaten_by) / (1.0 + len(chance)))


def find_structure(evidence: Evidence, p: Vehicle, residuals: Residuals, noise: Noise,
                   seed: int = 0, level: float = 0.01,
                   policy: UnexplainedPolicy = USUAL.unexplained) -> tuple[Unexplained, ...]:
    """Find structure in the residuals of vehicle p, most significant channel first.

    level: probability of any entry if the noise is independent between blocks. Returns nothing if
    there are too few data.
    """
    groups = group_residuals(evidence, p, residuals, noise)
    return find_group_structure(groups, seed, level, policy)


def group_residuals(evidence: Evidence, p: Vehicle, residuals: Residuals, noise: Noise
                    ) -> list[ResidualGroup]:
    """Collect the motion residuals at 0.5 s and the sensor residuals, with their features."""
    # Length of the recordings, as if windows were 0.5 s apart and messages 0.1 s; it only limits
    # the number of blocks.
    seconds = max(0.5 * len(residuals.motion), 0.1 * len(residuals.sensors))
    length = max(BLOCK_S, seconds / MAX_BLOCKS)
    windows, messages = evidence.blocks(length)
    names: tuple[str, ...] = MOTION
    motion = slice(READ_OUT_INDEX * len(MOTION), (READ_OUT_INDEX + 1) * len(MOTION))
    sensors = slice(None)
    if isinstance(evidence, OnboardEvidence):
        names, motion, sensors = evidence.read_out
    # L of the covariance L L^T of the motion; its diagonal has the variances.
    factor = np.linalg.inv(noise.motion)
    size = np.sqrt((factor**2).sum(axis=1))[motion]
    certain = np.broadcast_to(noise.age_scale, residuals.motion.shape)[:, motion]
    x = certain * replace_diverged(residuals.motion[:, motion])
    x = x / size
    window_values = exogenous(p, window_features(evidence, p, READ_OUTS[READ_OUT_INDEX]))
    message_values = exogenous(p, message_features(evidence, p))
    del message_values["steering_rate"]  # mocap and sensors smooth the start of a turn differently
    drives = tuple(d.recording.name for d in evidence.drives)
    readings = noise.whiten(residuals)[1][:, sensors]
    reading_size = (noise.sensors / evidence.noise_scale)[:, sensors]
    return [ResidualGroup(names, x, size / certain, window_values, windows, evidence.motion_drive,
                          drives),
            ResidualGroup(tuple(SENSORS[sensors]), readings, reading_size, message_values, messages,
                          evidence.sensor_drive, drives)]


def find_group_structure(groups: list[ResidualGroup], seed: int = 0, level: float = 0.01,
                         policy: UnexplainedPolicy = USUAL.unexplained) -> tuple[Unexplained, ...]:
    """``find_structure`` for given residuals."""
    found = _search_significant(groups, seed, level, policy)
    if found is None:
        return ()
    p_value = found.p_values(policy.max_null_ratio)
    out = []
    for group in groups:
        for i, channel in enumerate(group.channels):
            # Significant functions of this channel that explain enough.
            own = {found.functions[k][1]: (float(found.share[k]), float(p_value[k]))
                    for k in range(len(found.functions)) if found.functions[k][0] == channel
                    and p_value[k] <= level and found.share[k] >= found.min_share[k]}
            if own:
                variables = _simplest({k: share for k, (share, _) in own.items()}, policy)
                share, p = own[variables]
                period, words = _describe(group, i, variables, policy)
                variables = tuple(name for name in variables if name != WAVES)
                out.append(Unexplained(channel, words, variables, p, share, period))
    return tuple(sorted(out, key=lambda u: (u.p_value, -u.share)))


def _search_significant(groups: list[ResidualGroup], seed: int, level: float,
                        policy: UnexplainedPolicy) -> StructureShares | None:
    """Compute shares with many flips; with a tenth of them if nothing can be significant."""
    found = None
    # A tenth of the flips is enough to see that nothing can be significant, which is so for most
    # data.
    for flips, max_p_value in ((1.0, FIRST_LEVEL_RATIO * level), (10.0, level)):
        found = _compute_shares(groups, seed, math.ceil(flips / level) - 1, policy)
        if found is None or not ((found.p_values(policy.max_null_ratio) <= max_p_value)
                                 & (found.share >= found.min_share)).any():
            return None
    return found


def explained_shares(groups: list[ResidualGroup], seed: int = 0,
                     policy: UnexplainedPolicy = USUAL.unexplained) -> dict[str, float]:
    """Share of the variance of each channel that functions of the features predict, 0 to 1.

    Test share of the best function minus the median of the best one by chance: a lower bound, lower
    for fewer windows.
    """
    out = {channel: 0.0 for group in groups for channel in group.channels}
    found = _compute_shares(groups, seed, MEDIAN_FLIPS, policy)
    if found is None:
        return out
    for channel in out:
        own = [k for k in range(len(found.functions)) if found.functions[k][0] == channel]
        if own:
            # The best of many functions explains a share of pure noise, too: subtract its median.
            chance = float(np.median(found.flipped[:, own].max(axis=1)))
            out[channel] = float(np.clip(found.share[own].max() - max(chance, 0.0), 0.0, 1.0))
    return out


def _compute_shares(groups: list[ResidualGroup], seed: int, flips: int,
                    policy: UnexplainedPolicy) -> StructureShares | None:
    """Compute the shares of every function of every group, observed and for sign flips."""
    labels = np.unique(np.concatenate([group.block for group in groups]))
    rng = np.random.default_rng(seed)
    # One sign for a block in all groups: what the groups have in common stays in the null data.
    signs = rng.choice([-1.0, 1.0], (flips, len(labels)))
    names: list[tuple[str, tuple[str, ...]]] = []
    tables = []
    min_shares = []
    for group in groups:
        present, block = np.unique(group.block, return_inverse=True)
        if len(present) >= MIN_SIGN_BLOCKS:
            own_signs = signs[:, np.searchsorted(labels, present)]
            table, variable_sets = _group_shares(group, block, own_signs, rng, policy)
            tables.append(table)
            known = np.clip(group.y.var(axis=0), 1e-12, 1.0)
            # Shares below these limits are of no use: of the whole variance, or of the error of a
            # sound sensor.
            floor = np.array([_tolerance(c, policy) for c in group.channels])
            variance = np.maximum(((group.y * group.size)**2).mean(axis=0), 1e-12)
            min_shares.append(np.tile(np.maximum(policy.min_share / known, floor**2 / variance),
                                      len(variable_sets)))
            names += [(channel, variables) for variables in variable_sets
                      for channel in group.channels]
    if not tables:
        return None
    table = np.concatenate(tables, axis=1)
    return StructureShares(names, table[0], table[1:1 + flips], table[1 + flips:],
                           np.concatenate(min_shares))


def _tolerance(channel: str, policy: UnexplainedPolicy) -> float:
    """Error of a sound sensor, in SI units."""
    if channel.startswith("accel"):
        return policy.accel
    return policy.encoder if channel == "encoder" else 0.0


def _group_shares(group: ResidualGroup, block: IntArray, signs: FloatArray,
                  rng: np.random.Generator, policy: UnexplainedPolicy
                  ) -> tuple[FloatArray, list[tuple[str, ...]]]:
    """Shares (1 + 2 s, sets x channels): observed, flipped, flipped remainder; and the sets."""
    features = _features(group)
    y = _centre(group, CLIP)
    within, across = _folds(group, block, rng)
    variable_sets = list_variable_sets(features)
    columns = [basis_functions(features, variables, TAIL) for variables in variable_sets]
    folds = [within if set(variables) & set(WITHIN_RECORDING) else across
             for variables in variable_sets]
    _, recording = np.unique(group.recording, return_inverse=True)

    def table(y: FloatArray, signs: FloatArray) -> FloatArray:
        return np.stack([*(predicted_share(phi, BlockedResiduals(y, block, fold), signs)
                           for phi, fold in zip(columns, folds, strict=True)),
                         *(wave_shares(y, block, features[name], phase_labels(name, recording),
                                       signs, policy.max_waves) for name, _ in WAVE_SETS)], axis=1)

    # 1. Observed residuals and their flips.
    share = table(y, np.vstack([np.ones((1, signs.shape[1])), signs]))
    # 2. Subtract the best function of each channel, and flip the remainder.
    remaining = y.copy()
    for i, best in enumerate(share[0, :len(variable_sets)].argmax(axis=0)):
        if share[0, best, i] > 0.0:
            remaining[:, i] -= predict_held_out(columns[best], y[:, i], folds[best])
    both = np.concatenate([share, table(remaining, signs)])
    return both.reshape(len(both), -1), [*variable_sets, *WAVE_SETS]


def _features(group: ResidualGroup) -> dict[str, FloatArray]:
    """Features of a group; with the recording if there are several."""
    recording = group.recording.astype(np.float64)
    several = len(np.unique(recording)) > 1
    return {**group.features, **({"recording": recording} if several else {})}


def _centre(group: ResidualGroup, clip: float) -> FloatArray:
    """Clip the residuals and subtract their means: an offset depends on nothing."""
    y = np.clip(group.y, -clip, clip)
    return np.asarray(y - y.mean(axis=0))


def _folds(group: ResidualGroup, block: IntArray, rng: np.random.Generator
           ) -> tuple[IntArray, IntArray]:
    """Test folds of blocks, and of whole recordings if there are enough, (n,) both."""
    # Random folds of blocks, and folds of whole recordings: these test whether a function also
    # holds in another recording.
    within = rng.permutation(np.arange(block.max() + 1) % FOLDS)[block]
    _, recording = np.unique(group.recording, return_inverse=True)
    if recording.max() + 1 < MIN_FOLD_RECORDINGS:
        return within, within
    return within, np.asarray(recording % FOLDS)


def _simplest(share: Mapping[tuple[str, ...], float], policy: UnexplainedPolicy
              ) -> tuple[str, ...]:
    """Select the best variable, or a larger set if it explains much more.

    Waves come last: on circles a function of the place is periodic with the distance as well.
    """
    best: tuple[str, ...] = ()
    rank = {variables: WAVES_RANK if WAVES in variables else len(variables) for variables in share}
    for size in sorted(set(rank.values())):
        here = max((variables for variables in share if rank[variables] == size),
                   key=lambda a: share[a])
        if not best or share[here] > policy.min_share_ratio * share[best]:
            best = here
    return best


def _describe(group: ResidualGroup, channel: int, variables: tuple[str, ...],
              policy: UnexplainedPolicy) -> tuple[float, str]:
    """Return the period (0 if none) and a text: extremes, or amplitude of the waves."""
    features = _features(group)
    y = _centre(group, CLIP)[:, channel]
    name = group.channels[channel]
    unit = CHANNEL_UNITS[group.channels[channel]]
    lead = f"model minus measured {name}{' after 0.5 s' if name in MOTION else ''}"
    if WAVES in variables:
        length, size = find_wave(y, features[variables[0]],
                                 phase_labels(variables[0], group.recording), policy.max_waves)
        size *= float(np.median(group.size[:, channel]))
        direction = "of way" if variables[0] == "way" else f"along {variables[0]} of the room"
        return length, f"{lead}: waves of +-{size:.2g} {unit}, one every {length:.2f} m {direction}"
    curve = fit_function(basis_functions(features, variables, TAIL), y) * group.size[:, channel]
    ends = []
    for row in (int(np.argmax(curve)), int(np.argmin(curve))):
        where = ", ".join(f"{n} {_value(group, n, features[n][row])}" for n in variables)
        ends.append(f"{curve[row]:+.2g} {unit} at {where}")
    return 0.0, f"{lead}: {ends[0]}; {ends[1]}"


def _value(group: ResidualGroup, name: str, value: float) -> str:
    """Format a value of a feature with its unit."""
    return group.names[int(value)] if name == "recording" else f"{value:.3g}{_unit(name)}"


def _unit(name: str) -> str:
    """Unit of a feature with a leading space; empty if it has none."""
    unit = FEATURE_UNITS.get(name, "-")
    return "" if unit == "-" else f" {unit}"
