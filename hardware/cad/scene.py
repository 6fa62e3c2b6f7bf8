"""A scene to paint in: bodies with drawn edges, lights, a camera, a small PNG of it.

Off-screen pyvista.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyvista as pv
import trimesh
from labels import add_labels
from legends import Legend
from PIL import Image
from pointing import Shown, middle
from vtkmodules.vtkCommonCore import vtkLogger
from vtkmodules.vtkRenderingCore import vtkCoordinate

vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)  # it warns of the missing X server
INK, MARK = "#20242a", "#b3261e"


@dataclass(frozen=True)
class Thing:
    """One body of the car as it is painted; `shift` [mm] moves it in the exploded view."""

    name: str
    step: str
    mesh: trimesh.Trimesh
    colour: str
    clear: bool = False
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)


def surface(mesh: trimesh.Trimesh) -> pv.PolyData:
    faces = np.hstack([np.full((len(mesh.faces), 1), 3), mesh.faces])
    return pv.PolyData(np.asarray(mesh.vertices), faces)


def add(scene: pv.Plotter, mesh: trimesh.Trimesh, colour: str, opacity: float = 1.0,
        width: float = 1.6) -> None:
    """One body with its sharp edges drawn, so that flat shading reads as a drawing."""
    poly = surface(mesh)
    shaded = poly.compute_normals(split_vertices=True, feature_angle=35)
    scene.add_mesh(shaded, color=colour, opacity=opacity, smooth_shading=True, ambient=0.27,
                   diffuse=0.7, specular=0.15, specular_power=20)
    edges = poly.clean().extract_feature_edges(32, boundary_edges=False, non_manifold_edges=False)
    if edges.n_points:
        scene.add_mesh(edges, color=INK, line_width=width, opacity=min(1.0, opacity + 0.3),
                       lighting=False)


def stage(size: tuple[int, int]) -> pv.Plotter:
    """Empty white scene: key light from the front left, two fills, one at the camera."""
    scene = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
    scene.set_background("white")
    for position, strength in (((300, 500, 700), 0.6), ((700, -400, 300), 0.3),
                               ((-500, 100, 400), 0.25)):
        scene.add_light(pv.Light(position=position, focal_point=(60, 0, 0), color="white",
                                 intensity=strength))
    scene.add_light(pv.Light(light_type="headlight", intensity=0.35))
    scene.enable_anti_aliasing("ssaa")
    scene.enable_depth_peeling(8)
    return scene


def look(scene: pv.Plotter, direction: tuple[float, float, float],
         bounds: tuple[float, ...] | None = None) -> None:
    """Camera far away along a direction, Z up, everything (or the bounds) in view."""
    scene.enable_parallel_projection()
    scene.view_vector(direction, viewup=(0, 0, 1))
    scene.reset_camera(bounds=bounds)
    scene.camera.zoom(1.0 if bounds is None else 1.35)


def seen_at(scene: pv.Plotter, point: Sequence[float]) -> tuple[float, float]:
    """Pixel of a point, from the upper left corner."""
    place = vtkCoordinate()
    place.SetCoordinateSystemToWorld()
    place.SetValue(*point)
    x, y = place.GetComputedDisplayValue(scene.renderer)
    return x, scene.window_size[1] - 1 - y


def save(scene: pv.Plotter, path: Path, legend: Legend = (), drawn: Sequence[Shown] = ()) -> None:
    """Small PNG: white margins cut, the words of the legend next to it, 256 colours."""
    image = Image.fromarray(scene.screenshot(return_img=True))
    points = [seen_at(scene, middle(target, drawn)) for _, target in legend]
    scene.close()
    ink = np.asarray(image.convert("L")) < 250
    rows, columns = np.flatnonzero(ink.any(1)), np.flatnonzero(ink.any(0))
    margin = 24
    left, top = max(columns[0] - margin, 0), max(rows[0] - margin, 0)
    image = image.crop((left, top, min(columns[-1] + margin, image.width),
                        min(rows[-1] + margin, image.height)))
    if points:
        image = add_labels(image, [text for text, _ in legend],
                           [(x - left, y - top) for x, y in points])
    buffer = io.BytesIO()
    image.quantize(256, dither=Image.Dither.NONE).save(buffer, "PNG", optimize=True)
    path.write_bytes(buffer.getvalue())
