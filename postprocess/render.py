#!/usr/bin/env python3
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Draw the motion in a result folder: motion.png (superposed instants) and motion.gif.

Reads only the ParaView series of the folder (beams, beam_surfaces, shells, floating_bodies,
floating_lines, rigid_bodies, joints):

    python postprocess/render.py results/slider_crank --colour M3 --size 1600x900
Superposed are a few instants, or with ``--interval 0.1`` one every 0.1 s.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import imageio.v3 as iio
import numpy as np
import pyvista as pv
from matplotlib.colors import LinearSegmentedColormap
from vtkmodules.vtkCommonCore import vtkLogger

# what is coloured by a field
FLEXIBLE = ("beam_surfaces", "beams", "shells", "floating_bodies", "floating_lines")
SERIES = (*FLEXIBLE, "rigid_bodies", "joints")
UNITS = {"bending_moment": "N m", "displacement": "m", "velocity": "m/s", "force_magnitude": "N"}
UNITS |= dict.fromkeys(("N", "Q2", "Q3"), "N") | dict.fromkeys(("T", "M2", "M3"), "N m")
UNITS |= {"von_mises": "Pa", "stress": "Pa", "deformation": "m"}
UNITS |= {"angular_velocity": "rad/s"} | dict.fromkeys(("kappa1", "kappa2", "kappa3"), "1/m")
GHOSTS = 5  # earlier instants in motion.png
MAX_FRAMES = 120
INK = "#303841"
# From blue to red without the near-black and near-white ends that hide shading.
POSITIVE = LinearSegmentedColormap.from_list(
    "positive", ["#3565a8", "#2a9d9d", "#7fbf5a", "#f0b93a", "#d1402f"]
)
SIGNED = LinearSegmentedColormap.from_list(
    "signed", ["#2452b0", "#4f86c6", "#a3a8ad", "#d9744f", "#b81f2c"]
)


class RenderError(Exception):
    """A user's mistake, told in one line."""


def read_grid(file: Path) -> Any:
    """Read one grid; a series never names a file without points."""
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            mesh = pv.read(file)
    except Exception as exc:  # whatever the reader makes of a damaged file
        reason = str(exc).strip().splitlines()[-1].strip('\t "')
        raise RenderError(f"{file}: cannot be read ({reason})") from exc
    finally:
        vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    if not mesh.n_points:
        raise RenderError(f"{file}: cannot be read")
    return mesh


@dataclass(frozen=True)
class Instant:
    """Files of all series at one time."""

    folder: Path
    time: float
    files: dict[str, Path]

    def meshes(self) -> dict[str, Any]:
        """Read the grids."""
        return {name: read_grid(file) for name, file in self.files.items()}


@dataclass(frozen=True)
class Scene:
    """What all pictures of one motion have in common."""

    title: str
    clock: str  # how the time of an instant is told
    field: str
    limits: tuple[float, float]
    cloud: np.ndarray  # points (n, 3) all over the motion
    size: tuple[int, int]

    @property
    def bounds(self) -> np.ndarray:
        """Least and greatest coordinates (3, 2)."""
        return np.stack([self.cloud.min(axis=0), self.cloud.max(axis=0)], axis=1)


def read_series(folder: Path) -> list[Instant]:
    """Instants of a result folder, by time."""
    times: dict[float, dict[str, Path]] = {}
    for name in SERIES:
        pvd = folder / f"{name}.pvd"
        if not pvd.is_file():
            continue
        try:
            for entry in ET.parse(pvd).getroot().iter("DataSet"):
                files = times.setdefault(float(entry.attrib["timestep"]), {})
                files[name] = folder / entry.attrib["file"]
        except (ET.ParseError, KeyError, ValueError) as exc:
            raise RenderError(f"{pvd}: not a readable series ({exc})") from exc
    if not times:
        raise RenderError(f"{folder}: no series to draw ({', '.join(n + '.pvd' for n in SERIES)})")
    for files in times.values():
        for file in files.values():
            if not file.is_file():
                raise RenderError(f"{file}: named by the series but missing")
    return [Instant(folder, t, times[t]) for t in sorted(times)]


def scalars(mesh: Any, field: str) -> np.ndarray | None:
    """Values of a field (the length of a vector) or of a named component, at points or cells."""
    for data in (mesh.point_data, mesh.cell_data):
        if field in data:
            values = np.asarray(data[field], dtype=float)
            return values if values.ndim == 1 else np.linalg.norm(values, axis=1)
        for name in data:
            array = data.GetAbstractArray(name)
            for i in range(array.GetNumberOfComponents()):
                if array.GetComponentName(i) == field:
                    return np.asarray(data[name], dtype=float)[:, i]
    return None


def survey(instants: list[Instant], field: str) -> tuple[np.ndarray, tuple[float, float]]:
    """Points all over the motion (n, 3) and range of the field."""
    clouds: list[np.ndarray] = [np.zeros((0, 3))]
    values: list[float] = []
    names: set[str] = set()
    flexible = False
    for instant in instants:
        for name, mesh in instant.meshes().items():
            points = np.asarray(mesh.points, dtype=float)
            ends = np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])
            clouds += [points[ends], points[:: 1 + len(points) // 1000]]
            if name in FLEXIBLE:
                flexible = True
                names.update(mesh.array_names)
                found = scalars(mesh, field)
                if found is not None:
                    values += [float(np.nanmin(found)), float(np.nanmax(found))]
    cloud = np.concatenate(clouds)
    if not len(cloud) or not np.isfinite(cloud).all():
        raise RenderError(f"{instants[0].folder}: empty or infinite geometry")
    if flexible and not values:
        known = ", ".join(sorted(names - {"TimeValue"}))
        raise RenderError(f"no field '{field}' on beams or shells, which have {known}")
    smallest, largest = min(values, default=0.0), max(values, default=1.0)
    if smallest < -1e-9 * abs(largest):
        largest = max(-smallest, largest)
        return cloud, (-largest, largest)
    return cloud, (0.0, largest if largest > 0.0 else 1.0)


def look(bounds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors (right, up, towards the viewer): across a flat motion, else from a corner."""
    extent = bounds[:, 1] - bounds[:, 0]
    thin = int(np.argmin(extent))
    if extent[thin] < 0.3 * np.partition(extent, 1)[1]:
        normal = np.eye(3)[thin] * (-1.0 if thin == 1 else 1.0)
        up = np.eye(3)[1 if thin == 2 else 2]
        view = normal + 0.22 * np.cross(up, normal) + 0.3 * up
    else:
        view, up = np.array([0.8, -1.5, 0.8]), np.eye(3)[2]
    view = view / np.linalg.norm(view)
    right = np.cross(up, view)
    right /= np.linalg.norm(right)
    return right, np.cross(view, right), view


def fit_camera(plotter: Any, scene: Scene) -> None:
    """Parallel projection that shows the bounds as large as title and scalar bar allow."""
    right, up, view = look(scene.bounds)
    x, y = scene.cloud @ right, scene.cloud @ up
    middle = scene.bounds.mean(axis=1) @ view
    centre = 0.5 * (x.min() + x.max()) * right + 0.5 * (y.min() + y.max()) * up + middle * view
    radius = float(np.linalg.norm(np.ptp(scene.bounds, axis=1))) or 1.0
    spans = [max(float(np.ptp(s)), 0.05 * radius) for s in (x, y)]
    width, height = scene.size
    # Share of the window for the motion: the scalar bar stands right, the title above.
    scale = 0.5 * max(spans[1] / 0.82, spans[0] * height / width / 0.8)
    focus = centre + scale * (0.16 * width / height * right + 0.06 * up)
    camera = plotter.camera
    camera.parallel_projection = True
    camera.focal_point, camera.position, camera.up = focus, focus + 3.0 * radius * view, up
    camera.parallel_scale = scale
    camera.clipping_range = (0.5 * radius, 6.0 * radius)


def new_plotter(scene: Scene) -> Any:
    """Off-screen window with background, lights and the axes of the inertial frame."""
    plotter: Any = pv.Plotter(off_screen=True, window_size=list(scene.size), lighting="light kit")
    plotter.set_background("#f6f8fb")
    plotter.enable_anti_aliasing("msaa", multi_samples=8)
    length = 0.06 * float(np.linalg.norm(np.ptp(scene.bounds, axis=1))) or 0.1
    for axis, colour in zip(np.eye(3), ("#c0392b", "#27ae60", "#2c6fbb"), strict=True):
        arrow = pv.Arrow(
            start=(0, 0, 0), direction=axis, scale=length, shaft_radius=0.035, tip_radius=0.09
        )
        plotter.add_mesh(arrow, color=colour, name=f"ground{colour}", render=False)
    plotter.add_axes(line_width=3, color=INK, viewport=(0.0, 0.0, 0.14, 0.2))
    return plotter


def draw(plotter: Any, instant: Instant, scene: Scene, key: str, opacity: float) -> Any:
    """Add or replace one instant; opacity below one makes it a ghost. Returns a coloured actor."""
    coloured = None
    style = {"opacity": opacity, "ambient": 0.25, "render": False, "show_scalar_bar": False}
    meshes = instant.meshes()
    solid = "beam_surfaces" in meshes
    for name, mesh in meshes.items():
        own = style | {"name": key + name}
        if name == "floating_lines":
            own |= {"line_width": 6, "render_lines_as_tubes": True}
        if name == "beams":
            # Inside solid beams the lines show only where these are too slender to be seen.
            if solid and opacity < 1.0:
                continue
            own |= {"line_width": 3 if solid else 6, "render_lines_as_tubes": True}
        if name in FLEXIBLE:
            coloured = draw_flexible(plotter, mesh, scene, own) or coloured
        else:
            colour = "#8fa3b8" if name == "rigid_bodies" else "#e07b39"
            surface = mesh.extract_surface(algorithm="dataset_surface")
            own |= {"color": colour, "specular": 0.3}
            plotter.add_mesh(surface, smooth_shading=True, split_sharp_edges=True, **own)
    return coloured


def draw_flexible(plotter: Any, mesh: Any, scene: Scene, style: dict[str, Any]) -> Any:
    """Add beams or shells coloured by the field; returns the actor, None without the field."""
    colours = scalars(mesh, scene.field)
    if colours is None:
        # grey: a colour of the bar would tell a value
        plotter.add_mesh(mesh, color="#a7b0ba", **style)
        return None
    shown = pv.UnstructuredGrid(mesh, deep=False)
    if scene.field in mesh.point_data:
        shown.point_data["shown"] = colours
    else:
        # Constant along an element in the file, continuous in the picture.
        shown.cell_data["shown"] = colours
        shown = shown.cell_data_to_point_data()
    cmap = SIGNED if scene.limits[0] < 0.0 else POSITIVE
    return plotter.add_mesh(shown, scalars="shown", clim=scene.limits, cmap=cmap, **style)


def decorate(plotter: Any, instant: Instant, scene: Scene, coloured: Any) -> None:
    """Title with the time, and the scalar bar."""
    text = f"{scene.title}    {scene.clock.format(instant.time)}"
    size = max(9, scene.size[1] // 56)
    plotter.add_text(
        text,
        position=(0.02, 0.935),
        viewport=True,
        font_size=size,
        color=INK,
        name="title",
        render=False,
    )
    if coloured is None or plotter.scalar_bars:
        return
    unit = UNITS.get(scene.field)
    plotter.add_scalar_bar(
        title=scene.field.replace("_", " ") + (f" ({unit})" if unit else "") + "\n",
        mapper=coloured.mapper,
        vertical=True,
        position_x=0.88,
        position_y=0.2,
        height=0.6,
        width=0.06,
        n_labels=5,
        fmt="%.0f" if 100.0 <= scene.limits[1] < 1e6 else "%.3g",
        color=INK,
        title_font_size=scene.size[1] // 48,
        label_font_size=scene.size[1] // 54,
        render=False,
    )


def spread(instants: list[Instant], interval: float | None) -> list[Instant]:
    """A few instants over the whole motion or those at intervals (s), the last one included."""
    if interval is None:
        chosen = np.linspace(0, len(instants) - 1, GHOSTS + 1).round().astype(int)
    elif not interval > 0.0:
        raise RenderError(f"--interval must be positive, got {interval:g}")
    else:
        times = np.array([instant.time for instant in instants])
        wanted = np.append(np.arange(times[0], times[-1], interval), times[-1])
        chosen = np.abs(times - wanted[:, None]).argmin(axis=1)
    return [instants[i] for i in sorted(set(chosen.tolist()))]


def picture(instants: list[Instant], scene: Scene, path: Path) -> None:
    """Last instant over fainter earlier ones."""
    plotter = new_plotter(scene)
    for i, instant in enumerate(instants[:-1]):
        draw(plotter, instant, scene, f"ghost{i}", 0.15 + 0.25 * i / (len(instants) - 1))
    coloured = draw(plotter, instants[-1], scene, "", 1.0)
    decorate(plotter, instants[-1], scene, coloured)
    fit_camera(plotter, scene)
    plotter.screenshot(str(path))
    plotter.close()


def animation(instants: list[Instant], scene: Scene, path: Path) -> None:
    """All instants, one after the other."""
    plotter = new_plotter(scene)
    frames = []
    for instant in instants:
        coloured = draw(plotter, instant, scene, "", 1.0)
        decorate(plotter, instant, scene, coloured)
        fit_camera(plotter, scene)
        plotter.render()
        frames.append(plotter.screenshot(None, return_img=True))
    plotter.close()
    pause = max(40, min(200, 6000 // len(frames)))
    iio.imwrite(path, np.stack(frames), extension=".gif", duration=pause, loop=0)


def window_size(text: str) -> tuple[int, int]:
    """Parse WIDTHxHEIGHT."""
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) >= 200 and int(height) >= 150):
        raise argparse.ArgumentTypeError(f"'{text}' is not WIDTHxHEIGHT with at least 200x150")
    return int(width), int(height)


def positive(text: str) -> int:
    """Parse a positive integer."""
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a positive integer")
    return int(text)


def title_of(folder: Path) -> tuple[str, str]:
    """Name of the case from the summary, or of the folder, and how its times are told."""
    name, clock = folder.resolve().name, "t = {:.4g} s"
    try:
        summary = json.loads((folder / "summary.json").read_text())
        if "renewals" in summary:  # a relaxation counts iterations
            clock = "iteration {:.0f}"
        return str(summary["case"]), clock
    except (OSError, ValueError, KeyError, TypeError):
        return name, clock


def arguments(argv: list[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path, metavar="RESULTS_DIR")
    parser.add_argument(
        "--every",
        type=positive,
        metavar="N",
        help=f"animate every Nth instant (default: at most {MAX_FRAMES} frames)",
    )
    parser.add_argument("--size", type=window_size, default=(1200, 800), metavar="WxH")
    parser.add_argument(
        "--colour",
        "--color",
        default="bending_moment",
        metavar="FIELD",
        help="field or component on the beams (N, Q2, Q3, T, M2, M3, kappa1, velocity, ...) or "
        "bodies in floating frames (von_mises, deformation, ...); default: %(default)s",
    )
    parser.add_argument("--interval", type=float, help="seconds between instants of motion.png")
    parser.add_argument("--no-animation", action="store_true", help="write motion.png only")
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Run the program."""
    options = arguments(argv)
    logging.getLogger().setLevel(logging.CRITICAL)  # damaged files end in one line
    # Without an X server VTK warns and then draws off screen by itself.
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    try:
        instants = read_series(options.folder)
        every = options.every or -(-len(instants) // MAX_FRAMES)
        frames = instants[::every]
        if frames[-1] is not instants[-1]:
            frames.append(instants[-1])
        shown = spread(instants, options.interval)
        cloud, limits = survey([*shown, *frames], options.colour)
        scene = Scene(*title_of(options.folder), options.colour, limits, cloud, options.size)
        made = [options.folder / "motion.png"]
        picture(shown, scene, made[0])
        if not options.no_animation and len(frames) > 1:
            made.append(options.folder / "motion.gif")
            animation(frames, scene, made[-1])
    except (RenderError, OSError) as exc:
        print(f"render.py: {exc}", file=sys.stderr)
        return 2
    for path in made:
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
