"""One run of the identification, whichever way it was made: what a verb shows and writes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec

from dart_hal.config import ModelFile, Quantity
from dart_hal.config.model import Covariance
from dart_hal.identify.fit import Estimate, Fit
from dart_hal.identify.mass import never_weighed, of_mass, weighed
from dart_hal.identify.report import FileReport, Published
from dart_hal.identify.runs import read_any
from dart_hal.identify.write import SECTIONS, Source, rounded, why_unsound
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle.flat import names as flat_names
from dart_hal.vehicle.flat import value as flat_value
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.sets import PAPER

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True)
class Identification:
    """fits by sub-model (as_paper: also rows of its comparison), report by file.

    published: the paper's values beside them; derived: what the data identify
    where single parameters are not identifiable; source: for the file's provenance;
    joint: covariance across sub-models, where they were fitted together;
    mass [kg]: as weighed with the recordings, None = the base's was taken.
    frames: marker frame by file, of the recordings with motion capture.
    """

    fits: Mapping[str, Fit]
    files: Mapping[str, FileReport]
    published: Mapping[str, Published]
    source: Source
    derived: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    joint: Covariance | None = None
    mass: Estimate | None = None
    frames: Mapping[str, Reference] = field(default_factory=dict)

    @property
    def sound(self) -> bool:
        """Whether any fit can be trusted."""
        return any(fit.sound for fit in self.fits.values())

    def over(self, base: ModelFile) -> ModelFile:
        """The base that the fits belong to: with the mass that they hang on."""
        if self.mass is None:
            return base
        mass = Quantity(self.mass.value, self.mass.std)
        return msgspec.structs.replace(base, body={**base.body, "mass": mass})

    def to_json(self) -> dict[str, Any]:
        """``fits`` and ``files`` as ``dart-hal identify --json`` prints them."""
        return {"fits": {name: self._fit(name) for name in self.fits},
                "files": {file: {"used": r.used, "dropped": r.dropped, "why": list(r.why)}
                          for file, r in self.files.items()},
                "references": {file: r.to_json() for file, r in self.frames.items()}}

    def _fit(self, name: str) -> dict[str, Any]:
        fit = self.fits[name]
        out = {**fit.to_json(), "sound": fit.sound, "why_unsound": why_unsound(fit)}
        if name in self.published:
            paper = self.published[name]
            out["paper"] = {"parameters": dict(paper.values), "rmse": paper.rmse}
        out["derived"] = {key: {"value": e.value, "std": e.std, "unit": e.unit}
                          for key, e in self.derived.get(name, {}).items()}
        return out


def published_values(section: str) -> Published:
    """The section of the paper's set, in contract names."""
    start = f"{section}."
    return Published({name.removeprefix(start): float(flat_value(PAPER, name))
                      for name in flat_names(PAPER) if name.startswith(start)})


def jointly(paths: Iterable[Path], names: Sequence[str], base: ModelFile, command: str,
            reference: Reference | None = None, progress: Progress | None = None
            ) -> tuple[Identification, list[Recording]]:
    """All sub-models in one fit on rollouts, from the recordings that have motion capture.

    Standard errors of the base are its prior, unless some of these recordings
    are already in them.

    Errors: RecordingError when none of them can be predicted.
    """
    from dart_hal.identify.shooting import fit_from_recordings

    recordings, skipped = read_any(paths, reference=reference)
    made, grids, unused = fit_from_recordings(recordings, vehicle_of(base), names, reference,
                                              progress, _known(base, recordings))
    used = {str(r.path): (r, g) for r, g in grids}
    files: dict[str, FileReport] = {}
    for r in recordings:
        file, why = str(r.path), [str(note) for note in r.notes]
        bad = int(used[file][1].bad.sum()) if file in used else 0
        taken = len(used[file][1]) - bad if file in used else 0
        files[file] = FileReport(taken, bad, (*why, *unused.get(file, ())), r.sha256)
    files |= {file: FileReport(0, 0, (f"skipped: {reason}",)) for file, reason in skipped}
    points = {file: (g.reference.lx, g.reference.theta, g.reference.ly)
              for file, (_, g) in used.items()}
    source = Source({f: r.sha256 for f, r in files.items() if r.used}, command, points,
                    "one fit of all sub-models by multiple shooting, errors over blocks")
    published = {name: published_values(name) for name in made.fits}
    joint = Covariance(made.names, rounded(made.covariance))
    frames = {file: g.reference for file, (_, g) in used.items()}
    return (Identification(made.fits, files, published, source, joint=joint, frames=frames),
            recordings)


def _known(base: ModelFile, recordings: Sequence[Recording]) -> dict[str, float]:
    """Standard errors of the base by name; none that these recordings have made."""
    seen = set(base.provenance.get("files", {}).values())
    if seen & {r.sha256 for r in recordings}:
        return {}
    return {f"{section}.{key}": entry.std for section in SECTIONS
            for key, entry in getattr(base, section).items() if isinstance(entry, Quantity)}


def per_recording(paths: Iterable[Path], names: Sequence[str], base: Vehicle, command: str,
                  reference: Reference | None = None, progress: Progress | None = None
                  ) -> tuple[Identification, list[Recording]]:
    """Every recording for itself, robust; also the recordings, for pictures.

    Errors: RecordingError when a file named by itself, or all of them, cannot
    be used.
    """
    from dart_hal.identify.submodels import fit_submodels

    recordings, skipped = read_any(paths, reference=reference)
    mass = weighed(recordings)
    fits, reports = fit_submodels(recordings, names, base=of_mass(base, mass), mass=mass,
                                  reference=reference, progress=progress)
    if vague := never_weighed(recordings, base):
        fits = {name: replace(fit, notes=(*fit.notes, vague)) if name in ("friction", "motor")
                else fit for name, fit in fits.items()}
    files: dict[str, FileReport] = {}
    frames: dict[str, Reference] = {}
    for r in recordings:
        found = reports.get(str(r.path)) or reports.get(r.name)
        why = dict.fromkeys([*map(str, r.notes), *(found.why if found else ())])
        files[str(r.path)] = FileReport(found.used if found else 0, found.dropped if found else 0,
                                        tuple(why), r.sha256)
        if r.mocap is not None and r.marker is not None and files[str(r.path)].used:
            frames[str(r.path)] = r.marker
    files |= {file: FileReport(0, 0, (f"skipped: {reason}",)) for file, reason in skipped}
    points = {file: (r.lx, r.theta, r.ly) for file, r in frames.items()}
    source = Source({f: r.sha256 for f, r in files.items() if r.used}, command, points,
                    "per recording, robust, errors over blocks")
    published = {name: published_values(name) for name in fits}
    return Identification(fits, files, published, source, mass=mass, frames=frames), recordings
