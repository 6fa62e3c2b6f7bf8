"""Boxes, cylinders, tubes, gears and prisms that represent bought parts; no CAD kernel needed.

A shape is a plain dictionary, so that `built.json` holds it and the tests build the same body.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

Shape = dict[str, Any]
Vector = tuple[float, float, float]


def box(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float,
        colour: str = "") -> Shape:
    """Box between two corners, mm in the deck frame."""
    return {"kind": "box", "low": [x0, y0, z0], "high": [x1, y1, z1], "colour": colour}


def cylinder(start: Vector, end: Vector, radius: float, colour: str = "", inner: float = 0.0,
             sides: int = 48) -> Shape:
    """Cylinder from start to end; a tube if `inner` is not 0; six sides make a hexagon."""
    return {"kind": "cylinder", "start": list(start), "end": list(end), "radius": radius,
            "inner": inner, "sides": sides, "colour": colour}


def rim(start: Vector, end: Vector, tip: float, inner: float, teeth: int,
        colour: str = "") -> Shape:
    """Rim of a spur gear: a tube whose outer radius changes between tip and root."""
    return {"kind": "rim", "start": list(start), "end": list(end), "radius": tip, "inner": inner,
            "teeth": teeth, "colour": colour}


def prism(points: list[tuple[float, float]], z0: float, z1: float, colour: str = "") -> Shape:
    """Upright body over a convex polygon."""
    return {"kind": "prism", "points": [list(q) for q in points], "z": [z0, z1],
            "colour": colour}


def hull(circles: list[tuple[float, float, float]]) -> list[tuple[float, float]]:
    """Convex polygon around circles (x, y, radius), counterclockwise."""
    points = sorted({(x + r * math.cos(a), y + r * math.sin(a)) for x, y, r in circles
                     for a in np.linspace(0, 2 * math.pi, 37)[:-1]})

    def half(ordered: list[tuple[float, float]]) -> list[tuple[float, float]]:
        chain: list[tuple[float, float]] = []
        for q in ordered:
            while len(chain) > 1 and ((chain[-1][0] - chain[-2][0]) * (q[1] - chain[-2][1])
                                      <= (chain[-1][1] - chain[-2][1]) * (q[0] - chain[-2][0])):
                chain.pop()
            chain.append(q)
        return chain[:-1]

    return half(points) + half(points[::-1])


def lathe(profile: list[tuple[float, float]], sides: int) -> trimesh.Trimesh:
    """Body of revolution about z through a closed profile of (radius, z)."""
    angles = np.arange(sides) * 2 * math.pi / sides
    return _connect([[(r * math.cos(a), r * math.sin(a), z) for r, z in profile] for a in angles])


def make_toothed_rim(tip: float, inner: float, length: float, teeth: int) -> trimesh.Trimesh:
    """Rim of a spur gear about z. Straight flanks, a tooth of 2.25 modules (ISO 53)."""
    module = 2.0 * tip / (teeth + 2.0)
    root = tip - 2.25 * module
    pitch = 2.0 * math.pi / teeth
    profiles = []
    for tooth in range(teeth):
        # Half the pitch at the pitch circle: narrower at the tip, wider at the root.
        for share, outer in ((0.11, root), (0.36, tip), (0.64, tip), (0.89, root)):
            angle = (tooth + share) * pitch
            profiles.append([(r * math.cos(angle), r * math.sin(angle), z) for r, z in (
                (inner, 0.0), (outer, 0.0), (outer, length), (inner, length))])
    return _connect(profiles)


def _connect(profiles: list[list[Vector]]) -> trimesh.Trimesh:
    """Body around a closed row of profiles that have equally many points."""
    ring = [list(point) for profile in profiles for point in profile]
    sides = len(profiles)
    n, faces = len(profiles[0]), []
    for i in range(sides):
        j = (i + 1) % sides
        for k in range(n):
            m = (k + 1) % n
            faces += [[i * n + k, j * n + k, j * n + m], [i * n + k, j * n + m, i * n + m]]
    return trimesh.Trimesh(ring, faces, process=True)


def turned(start: Vector, end: Vector) -> NDArray[np.float64]:
    """4 x 4 matrix that lays the z axis from start towards end."""
    matrix = trimesh.geometry.align_vectors([0, 0, 1], np.subtract(end, start))
    matrix[:3, 3] = start
    return matrix


def body(shape: Shape) -> trimesh.Trimesh:
    """Closed mesh of a shape in the deck frame, mm."""
    if shape["kind"] == "box":
        mesh = trimesh.creation.box(bounds=[shape["low"], shape["high"]])
    elif shape["kind"] == "prism":
        mesh = _prism(shape["points"], *shape["z"])
    elif shape["kind"] == "rim":
        length = math.dist(shape["start"], shape["end"])
        mesh = make_toothed_rim(shape["radius"], shape["inner"], length, shape["teeth"])
        mesh.apply_transform(turned(shape["start"], shape["end"]))
    else:
        length = math.dist(shape["start"], shape["end"])
        inner, outer = shape["inner"], shape["radius"]
        if inner:
            mesh = lathe([(inner, 0), (outer, 0), (outer, length), (inner, length)],
                         shape["sides"])
        else:
            mesh = trimesh.creation.cylinder(outer, length, sections=shape["sides"])
            mesh.apply_translation([0, 0, length / 2])
        mesh.apply_transform(turned(shape["start"], shape["end"]))
    if mesh.volume < 0:
        mesh.invert()
    return mesh


def _prism(points: list[list[float]], z0: float, z1: float) -> trimesh.Trimesh:
    n = len(points)
    vertices = [[x, y, z0] for x, y in points] + [[x, y, z1] for x, y in points]
    faces = [[0, i + 1, i] for i in range(1, n - 1)] + [[n, n + i, n + i + 1]
                                                        for i in range(1, n - 1)]
    for i in range(n):
        j = (i + 1) % n
        faces += [[i, j, n + j], [i, n + j, n + i]]
    return trimesh.Trimesh(vertices, faces, process=True)
