"""Whether anything is left in the residuals that depends on what the car was doing.

A flexible function of speed, steering, place, time and the like is fitted to
one part of the drive and predicts the residual of the other. Where it does
better than by chance, the model lacks something, whatever the catalogue of
effects has to say. Chance is what the same procedure finds in the same
residuals with the signs of whole stretches turned.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.drive import READ_OUTS
from ..evidence.noise import Noise, replace_diverged
from ..evidence.onboard import OnboardEvidence
from ..evidence.readings import SENSORS
from ..evidence.residuals import MOTION, Evidence, Residuals
from ..policy import BLOCK_S, CLIP, TAIL, USUAL, UnexplainedPolicy
from ..result import Unexplained
from .bases import basis, sets
from .crossfit import Blocked, fitted, held_out, normal_scores, predicted_share
from .features import UNITS, exogenous, message_features, window_features
from .waves import ALONG, WAVES, phases, wave, waves

READ_OUT = 2  # the one at 0.5 s: as far as from window to window
UNIT = {"v_x": "m/s", "v_y": "m/s", "omega": "rad/s", "encoder": "m/s", "gyro": "rad/s",
        "accel_x": "m/s2", "accel_y": "m/s2"}
LAST = 9  # a set of more variables than any has
WITHIN = ("time", "recording")  # variables whose effect need not carry over to another recording


@dataclass(frozen=True, slots=True)
class Group:
    """Residuals with the same rows. y (n, c) in ``size`` (n, c) of SI units; block (n,):
    labels, the same for the same stretch of time in every group; recording (n,): an index to
    ``names``."""

    channels: tuple[str, ...]
    y: FloatArray
    size: FloatArray
    features: Mapping[str, FloatArray]
    block: IntArray
    recording: IntArray
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Shares:
    """share (k,): of the variance, predicted where it was not fitted, for k functions.

    of: (channel, variables) of each. turned, left (s, k): the same by chance,
    with turned signs of the residuals and of what the best functions leave of them.
    least (k,): share below which it is not worth a word.
    """

    of: list[tuple[str, tuple[str, ...]]]
    share: FloatArray
    turned: FloatArray
    left: FloatArray
    least: FloatArray

    def p_values(self, sharp: float) -> FloatArray:
        """Of each function, over the family of all of them, (k,).

        Turned residuals are an exact null, but a strong structure hides among
        its own mirror images; what is left of them is a sharp null that is a
        little too narrow for noise with a memory. So the sharp one decides, and
        the exact one must nearly agree: at ``sharp`` times the level.
        """
        return np.maximum(self._family_wise(self.left), self._family_wise(self.turned) / sharp)

    def _family_wise(self, null: FloatArray) -> FloatArray:
        """By chance alone, too, only what is worth a word is in the way of the others."""
        share = np.vstack([self.share, null])
        scores = np.where(share >= self.least, normal_scores(share), -np.inf)
        chance = np.sort(scores[1:].max(axis=1))
        beaten_by = len(chance) - np.searchsorted(chance, scores[0])
        return np.asarray((1.0 + beaten_by) / (1.0 + len(chance)))


def unexplained(evidence: Evidence, p: Vehicle, residuals: Residuals, noise: Noise, seed: int = 0,
                level: float = 0.01, policy: UnexplainedPolicy = USUAL.unexplained
                ) -> tuple[Unexplained, ...]:
    """Structure in the residuals of p, at most one entry for each channel, the surest first.

    level: probability of any entry when there is nothing but noise that forgets
    within a block. Empty, too, where there is too little to judge by.
    """
    return structure(groups(evidence, p, residuals, noise, policy), seed, level, policy)


def groups(evidence: Evidence, p: Vehicle, residuals: Residuals, noise: Noise,
           policy: UnexplainedPolicy = USUAL.unexplained) -> list[Group]:
    """Motion after 0.5 s, and the sensors."""
    seconds = max(0.5 * len(residuals.motion), 0.1 * len(residuals.sensors))
    length = max(BLOCK_S, seconds / policy.blocks)
    windows, messages = evidence.blocks(length)
    names: tuple[str, ...] = MOTION
    motion = slice(READ_OUT * len(MOTION), (READ_OUT + 1) * len(MOTION))
    sensors = slice(None)
    if isinstance(evidence, OnboardEvidence):
        names, motion, sensors = evidence.read_out
    whitener = np.linalg.inv(noise.motion)
    size = np.sqrt((whitener**2).sum(axis=1))[motion]
    certain = np.broadcast_to(noise.age_scale, residuals.motion.shape)[:, motion]
    x = certain * replace_diverged(residuals.motion[:, motion])
    x = x / size
    while_driven = exogenous(p, window_features(evidence, p, READ_OUTS[READ_OUT]), policy.straight)
    while_counted = exogenous(p, message_features(evidence, p), policy.straight)
    del while_counted["steering_rate"]  # what mocap and sensors smooth differs where a turn begins
    drives = tuple(d.recording.name for d in evidence.drives)
    read, loud = noise.whiten(residuals)[1], evidence.noise_scale
    return [Group(names, x, size / certain, while_driven, windows,
                  evidence.motion_drive, drives),
            Group(tuple(SENSORS[sensors]), read[:, sensors], (noise.sensors / loud)[:, sensors],
                  while_counted, messages, evidence.sensor_drive, drives)]


def structure(of: list[Group], seed: int = 0, level: float = 0.01,
              policy: UnexplainedPolicy = USUAL.unexplained) -> tuple[Unexplained, ...]:
    """``unexplained`` for residuals that are at hand."""
    found = _surely(of, seed, level, policy)
    if found is None:
        return ()
    p_value = found.p_values(policy.sharp)
    out = []
    for group in of:
        for i, channel in enumerate(group.channels):
            mine = {found.of[k][1]: (float(found.share[k]), float(p_value[k]))
                    for k in range(len(found.of)) if found.of[k][0] == channel
                    and p_value[k] <= level and found.share[k] >= found.least[k]}
            if mine:
                along = _simplest({k: share for k, (share, _) in mine.items()}, policy)
                share, p = mine[along]
                period, words = _words(group, i, along, policy)
                variables = tuple(name for name in along if name != WAVES)
                out.append(Unexplained(channel, words, variables, p, share, period))
    return tuple(sorted(out, key=lambda u: (u.p_value, -u.share)))


def _surely(of: list[Group], seed: int, level: float, policy: UnexplainedPolicy) -> Shares | None:
    """What is worth a word by ten turns at the level; a tenth of them tell most that is not."""
    found = None
    for turns, doubted in ((1.0, policy.doubted * level), (10.0, level)):
        found = _search(of, seed, math.ceil(turns / level) - 1, policy)
        if found is None or not ((found.p_values(policy.sharp) <= doubted)
                                 & (found.share >= found.least)).any():
            return None
    return found


def shares(of: list[Group], seed: int = 0, policy: UnexplainedPolicy = USUAL.unexplained
           ) -> dict[str, float]:
    """Share of the variance of each channel that functions of the features predict, 0 to 1.

    What the best of them predicts where it was not fitted, less what the best of
    them does by chance: a lower bound, lower for the fewer windows.
    """
    out = {channel: 0.0 for group in of for channel in group.channels}
    found = _search(of, seed, policy.copies, policy)
    if found is None:
        return out
    for channel in out:
        mine = [k for k in range(len(found.of)) if found.of[k][0] == channel]
        if mine:
            chance = float(np.median(found.turned[:, mine].max(axis=1)))
            out[channel] = float(np.clip(found.share[mine].max() - max(chance, 0.0), 0.0, 1.0))
    return out


def _search(of: list[Group], seed: int, turns: int, policy: UnexplainedPolicy) -> Shares | None:
    """Every function of every group, and the same by chance, ``turns`` times."""
    labels = np.unique(np.concatenate([group.block for group in of]))
    rng = np.random.default_rng(seed)
    signs = rng.choice([-1.0, 1.0], (turns, len(labels)))
    names: list[tuple[str, tuple[str, ...]]] = []
    tables, least = [], []
    for group in of:
        present, block = np.unique(group.block, return_inverse=True)
        if len(present) >= policy.least_blocks:
            mine = signs[:, np.searchsorted(labels, present)]
            table, tried = _tried(group, block, mine, rng, policy)
            tables.append(table)
            known = np.clip(group.y.var(axis=0), 1e-12, 1.0)
            floor = np.array([_tolerance(c, policy) for c in group.channels])
            variance = np.maximum(((group.y * group.size)**2).mean(axis=0), 1e-12)
            least.append(np.tile(np.maximum(policy.share / known, floor**2 / variance), len(tried)))
            names += [(channel, along) for along in tried for channel in group.channels]
    if not tables:
        return None
    table = np.concatenate(tables, axis=1)
    return Shares(names, table[0], table[1:1 + turns], table[1 + turns:], np.concatenate(least))


def _tolerance(channel: str, policy: UnexplainedPolicy) -> float:
    """What a sound sensor may be off, in SI units."""
    if channel.startswith("accel"):
        return policy.accel
    return policy.encoder if channel == "encoder" else 0.0


def _tried(group: Group, block: IntArray, signs: FloatArray, rng: np.random.Generator,
           policy: UnexplainedPolicy) -> tuple[FloatArray, list[tuple[str, ...]]]:
    """Shares (1 + 2 s, sets x channels): as it is, turned, and turned what is left; the sets."""
    features, y = _features(group), _centred(group, CLIP)
    within, across = _folds(group, block, rng, policy)
    tried = sets(features)
    columns = [basis(features, along, TAIL) for along in tried]
    folds = [within if set(along) & set(WITHIN) else across for along in tried]
    _, recording = np.unique(group.recording, return_inverse=True)

    def table(y: FloatArray, signs: FloatArray) -> FloatArray:
        return np.stack([*(predicted_share(phi, Blocked(y, block, fold), signs, policy.ridge)
                           for phi, fold in zip(columns, folds, strict=True)),
                         *(waves(y, block, features[name], phases(name, recording), signs)
                           for name, _ in ALONG)], axis=1)

    share = table(y, np.vstack([np.ones((1, signs.shape[1])), signs]))
    left = y.copy()
    for i, best in enumerate(share[0, :len(tried)].argmax(axis=0)):
        if share[0, best, i] > 0.0:
            left[:, i] -= held_out(columns[best], y[:, i], folds[best], policy.ridge)
    both = np.concatenate([share, table(left, signs)])
    return both.reshape(len(both), -1), [*tried, *ALONG]


def _features(group: Group) -> dict[str, FloatArray]:
    recording = group.recording.astype(np.float64)
    several = len(np.unique(recording)) > 1
    return {**group.features, **({"recording": recording} if several else {})}


def _centred(group: Group, clip: float) -> FloatArray:
    """An offset is no structure: it depends on nothing."""
    y = np.clip(group.y, -clip, clip)
    return np.asarray(y - y.mean(axis=0))


def _folds(group: Group, block: IntArray, rng: np.random.Generator,
           policy: UnexplainedPolicy) -> tuple[IntArray, IntArray]:
    """Folds of blocks, and of whole recordings where there are enough, (n,) both."""
    within = rng.permutation(np.arange(block.max() + 1) % policy.folds)[block]
    _, recording = np.unique(group.recording, return_inverse=True)
    if recording.max() + 1 < policy.recordings:
        return within, within
    return within, np.asarray(recording % policy.folds)


def _simplest(share: Mapping[tuple[str, ...], float], policy: UnexplainedPolicy
              ) -> tuple[str, ...]:
    """The best variable, or the best set of more where one is not nearly enough.

    Last of all waves: on circles what depends on the place comes again along the way as well.
    """
    best: tuple[str, ...] = ()
    rank = {along: LAST if WAVES in along else len(along) for along in share}
    for size in sorted(set(rank.values())):
        here = max((along for along in share if rank[along] == size), key=lambda a: share[a])
        if not best or share[here] > policy.multiply * share[best]:
            best = here
    return best


def _words(group: Group, channel: int, along: tuple[str, ...], policy: UnexplainedPolicy
           ) -> tuple[float, str]:
    """Its period, 0 if it has none; where the model is furthest off, or how large its waves are."""
    features, y = _features(group), _centred(group, CLIP)[:, channel]
    name, unit = group.channels[channel], UNIT[group.channels[channel]]
    lead = f"model minus measured {name}{' after 0.5 s' if name in MOTION else ''}"
    if WAVES in along:
        length, size = wave(y, features[along[0]], phases(along[0], group.recording))
        size *= float(np.median(group.size[:, channel]))
        of = "of way" if along[0] == "way" else f"along {along[0]} of the room"
        return length, f"{lead}: waves of +-{size:.2g} {unit}, one every {length:.2f} m {of}"
    curve = fitted(basis(features, along, TAIL), y, policy.ridge) * group.size[:, channel]
    ends = []
    for row in (int(np.argmax(curve)), int(np.argmin(curve))):
        where = ", ".join(f"{n} {_value(group, n, features[n][row])}" for n in along)
        ends.append(f"{curve[row]:+.2g} {unit} at {where}")
    return 0.0, f"{lead}: {ends[0]}; {ends[1]}"


def _value(group: Group, name: str, value: float) -> str:
    return group.names[int(value)] if name == "recording" else f"{value:.3g}{_unit(name)}"


def _unit(name: str) -> str:
    unit = UNITS.get(name, "-")
    return "" if unit == "-" else f" {unit}"
