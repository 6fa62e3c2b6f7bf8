"""Does each number beside a picture point at what its line says? By rays, without a renderer.

`make hardware` asks it of every picture and writes none that misleads.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import trimesh
from legends import Legend, Point
from probe import exits

AWAY = 2000.0
"""mm: the camera is farther from the point than any body."""


class Shown(NamedTuple):
    """A body of a picture; one can see through a ``clear`` one."""

    name: str
    mesh: trimesh.Trimesh
    clear: bool = False


def middle(target: str | Point, drawn: Sequence[Shown]) -> Point:
    """The point that a line of a legend means: itself, or the middle of the bodies named so.

    Raises ValueError where no body is named so.
    """
    if not isinstance(target, str):
        return target
    boxes = np.array([s.mesh.bounds for s in drawn if s.name.startswith(target)])
    if not len(boxes):
        raise ValueError(f"legends.py: nothing in the picture is named {target!r}; "
                         f"there are {sorted({s.name for s in drawn})}")
    x, y, z = (boxes[:, 0].min(axis=0) + boxes[:, 1].max(axis=0)) / 2
    return float(x), float(y), float(z)


def apart(point: Point, mesh: trimesh.Trimesh) -> float:
    """Distance of a point from a body [mm]; 0 inside it."""
    at = np.array(point, dtype=float)[None]
    way = np.array([[0.13, 0.29, 0.95]])
    _, face = exits(mesh, at, way)
    if face[0] >= 0 and mesh.face_normals[face[0]] @ way[0] > 0:
        return 0.0
    near = trimesh.triangles.closest_point(mesh.triangles, np.repeat(at, len(mesh.faces), axis=0))
    return float(np.linalg.norm(near - at, axis=1).min())


def meant(target: str | Point, drawn: Sequence[Shown]) -> str:
    """Beginning of the name of the body that a line of a legend is about."""
    if isinstance(target, str):
        return target
    return min(drawn, key=lambda s: apart(target, s.mesh)).name


def astray(legend: Legend, drawn: Sequence[Shown], view: Point) -> Iterator[str]:
    """Numbers whose dot lies on another body than the one they are about, in words.

    `view` points to the camera; what one can see through is passed.
    """
    towards = np.array(view, dtype=float) / np.linalg.norm(view)
    for n, (text, target) in enumerate(legend, 1):
        point, name = middle(target, drawn), meant(target, drawn)
        origin = (np.array(point) + AWAY * towards)[None]
        depths = [(float(exits(s.mesh, origin, -towards[None])[0][0]), s) for s in drawn]
        for _, shown in sorted((d for d in depths if np.isfinite(d[0])), key=lambda d: d[0]):
            if shown.name.startswith(name):
                break
            if not shown.clear:
                yield f"number {n} ({text}) points at {shown.name}, {name} is meant"
                break
        else:
            yield f"number {n} ({text}) points past {name}"
