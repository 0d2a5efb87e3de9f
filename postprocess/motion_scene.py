# SPDX-License-Identifier: LGPL-3.0-or-later
"""How instants of a motion are drawn: surfaces in colours of a field, arrows, camera, title."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib.colors import LinearSegmentedColormap
from result_series import ARROWS, FLEXIBLE, OBSTACLES, Instant, RenderError

#: Quantities shown by default: resultants of beams and shells, else stresses of solids, else
#: densities of energies.
FIELDS = ("bending_moment", "von_mises", "energy", "deformation")
UNITS = {"bending_moment": "N m", "displacement": "m", "velocity": "m/s", "force_magnitude": "N"}
UNITS |= dict.fromkeys(("N", "Q2", "Q3"), "N") | dict.fromkeys(("T", "M2", "M3"), "N m")
UNITS |= dict.fromkeys(("axial_stress", "shear_stress", "von_mises", "stress"), "Pa")
UNITS |= {"deformation": "m"}
UNITS |= dict.fromkeys(("membrane_energy", "bending_energy", "shear_energy"), "J/m^2")
#: Unit of the field "energy" by the series.
DENSITIES = {"energy_lines": "J/m", "energy_triangles": "J/m^2", "energy_solids": "J/m^3"}
UNITS |= {"angular_velocity": "rad/s"} | dict.fromkeys(("kappa1", "kappa2", "kappa3"), "1/m")
INK = "#303841"
# From blue to red without the near-black and near-white ends that hide shading.
POSITIVE = LinearSegmentedColormap.from_list(
    "positive", ["#3565a8", "#2a9d9d", "#7fbf5a", "#f0b93a", "#d1402f"]
)
SIGNED = LinearSegmentedColormap.from_list(
    "signed", ["#2452b0", "#4f86c6", "#a3a8ad", "#d9744f", "#b81f2c"]
)


@dataclass(frozen=True)
class Scene:
    """What all pictures of one motion have in common."""

    title: str
    clock: str  # format of the time of an instant
    field: str
    limits: tuple[float, float]
    cloud: np.ndarray  # points (n, 3) all over the motion
    size: tuple[int, int]
    view: np.ndarray | None = None  # towards the viewer; None for what suits the motion
    deformation: float = 1.0  # times the displacements
    arrows: str | None = None  # vectors at joints
    arrow_scale: float = 0.0  # lengths in the picture per length of these vectors

    @property
    def bounds(self) -> np.ndarray:
        """Least and greatest coordinates (3, 2)."""
        return np.stack([self.cloud.min(axis=0), self.cloud.max(axis=0)], axis=1)


def scalars(mesh: Any, field: str) -> tuple[str, np.ndarray] | None:
    """Values of a field (the length of a vector) or of a component, of a "point" or "cell" each."""
    for where, data in (("point", mesh.point_data), ("cell", mesh.cell_data)):
        if field in data:
            values = np.asarray(data[field], dtype=float)
            return where, values if values.ndim == 1 else np.linalg.norm(values, axis=1)
        for name in data:
            array = data.GetAbstractArray(name)
            for i in range(array.GetNumberOfComponents()):
                if array.GetComponentName(i) == field:
                    return where, np.asarray(data[name], dtype=float)[:, i]
    return None


def default_field(instants: list[Instant]) -> str:
    """The first usual field that the flexible bodies have."""
    names: set[str] = set()
    for name, mesh in instants[0].meshes(1.0).items():
        if name in FLEXIBLE:
            names.update(mesh.array_names)
    return next((field for field in FIELDS if field in names), FIELDS[0])


def survey(
    instants: list[Instant], field: str, deformation: float = 1.0
) -> tuple[np.ndarray, tuple[float, float]]:
    """Points all over the motion (n, 3) and range of the field."""
    clouds: list[np.ndarray] = [np.zeros((0, 3))]
    obstacles: list[np.ndarray] = [np.zeros((0, 3))]
    values: list[float] = []
    names: set[str] = set()
    flexible = False
    for instant in instants:
        for name, mesh in instant.meshes(deformation).items():
            points = np.asarray(mesh.points, dtype=float)
            ends = np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])
            of = obstacles if name == OBSTACLES else clouds
            of += [points[ends], points[:: 1 + len(points) // 1000]]
            if name in FLEXIBLE:
                flexible = True
                names.update(mesh.array_names)
                found = scalars(mesh, field)
                if found is not None and np.isfinite(found[1]).any():
                    values += [float(np.nanmin(found[1])), float(np.nanmax(found[1]))]
    cloud = with_obstacles(np.concatenate(clouds), np.concatenate(obstacles))
    if not len(cloud) or not np.isfinite(cloud).all():
        raise RenderError(f"{instants[0].folder}: empty or infinite geometry")
    if flexible and not values:
        known = ", ".join(sorted(names - {"TimeValue"}))
        raise RenderError(f"no field '{field}' on flexible bodies, which have {known}")
    smallest, largest = min(values, default=0.0), max(values, default=1.0)
    if smallest < -1e-9 * abs(largest):
        largest = max(-smallest, largest)
        return cloud, (-largest, largest)
    return cloud, (0.0, largest if largest > 0.0 else 1.0)


def with_obstacles(cloud: np.ndarray, obstacles: np.ndarray) -> np.ndarray:
    """Points of a motion with those of obstacles (n, 3), as far as these are close to it."""
    if not len(cloud) or not len(obstacles):
        return cloud if len(cloud) else obstacles
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    margin = 0.1 * float(np.linalg.norm(high - low))
    return np.concatenate([cloud, np.clip(obstacles, low - margin, high + margin)])


def arrow_reach(
    instants: list[Instant], vectors: str, cloud: np.ndarray, deformation: float
) -> tuple[np.ndarray, float]:
    """Points of the motion with those of arrows (n, 3), and the scale of these.

    The longest arrow is a sixth as long as the motion is large.
    """
    points, values = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for instant in instants:
        if ARROWS in instant.files:
            mesh = instant.meshes(deformation)[ARROWS]
            points.append(np.asarray(mesh.points, dtype=float))
            values.append(np.asarray(mesh.point_data[vectors], dtype=float))
    vector = np.concatenate(values)
    longest = np.linalg.norm(vector, axis=1).max(initial=0.0)
    if not longest > 0.0:
        raise RenderError(f"{instants[0].folder}: no {vectors} at joints to draw as arrows")
    scale = float(np.linalg.norm(np.ptp(cloud, axis=0)) / 6.0 / longest)
    return np.concatenate([cloud, np.concatenate(points) + scale * vector]), scale


def look(
    bounds: np.ndarray, towards: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors (right, up, towards the viewer).

    By default the view is across a flat motion and from a corner of all others.
    """
    extent = bounds[:, 1] - bounds[:, 0]
    thin = int(np.argmin(extent))
    if towards is not None:
        view = towards
        up = np.eye(3)[1 if abs(view[2]) > 0.999 * np.linalg.norm(view) else 2]
    elif extent[thin] < 0.3 * np.partition(extent, 1)[1]:
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
    right, up, view = look(scene.bounds, scene.view)
    x, y = scene.cloud @ right, scene.cloud @ up
    middle = scene.bounds.mean(axis=1) @ view
    centre = 0.5 * (x.min() + x.max()) * right + 0.5 * (y.min() + y.max()) * up + middle * view
    radius = float(np.linalg.norm(np.ptp(scene.bounds, axis=1))) or 1.0
    spans = [max(float(np.ptp(s)), 0.05 * radius) for s in (x, y)]
    width, height = scene.size
    # Share of the window for the motion: the scalar bar stands right, the title above.
    scale = 0.5 * max(spans[1] / 0.82, spans[0] * height / width / 0.77)
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
    meshes = instant.meshes(scene.deformation)
    solid = "beam_surfaces" in meshes
    for name, mesh in meshes.items():
        own = style | {"name": key + name}
        if name == ARROWS:
            if opacity == 1.0:
                draw_arrows(plotter, mesh, scene, own)
            continue
        if name == OBSTACLES and opacity == 1.0:
            draw_obstacles(plotter, mesh, own)
        if name == OBSTACLES:
            continue
        if name in ("floating_lines", "energy_lines", "cables"):
            own |= {"line_width": 6, "render_lines_as_tubes": True}
        if name == "cable_nets":
            own |= {"line_width": 1}
        if name == "beams":
            # Inside solid beams the lines show only where these are too slender to be seen.
            if solid and (opacity < 1.0 or scalars(mesh, scene.field) is None):
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
    surface = style["name"].endswith("beam_surfaces")
    found = scalars(mesh, scene.field)
    if found is None:
        # grey: a colour of the bar would tell a value
        plotter.add_mesh(mesh, color="#a7b0ba", **style)
        return None
    shown = pv.UnstructuredGrid(mesh, deep=False)
    where, colours = found
    if where == "point":
        shown.point_data["shown"] = colours
    else:
        # Constant along an element in the file, continuous in the picture. Elements have their own
        # points where surfaces are swept along beams.
        shown.cell_data["shown"] = colours
        shown = (shown.clean() if surface else shown).cell_data_to_point_data()
    cmap = SIGNED if scene.limits[0] < 0.0 else POSITIVE
    return plotter.add_mesh(shown, scalars="shown", clim=scene.limits, cmap=cmap, **style)


def draw_obstacles(plotter: Any, mesh: Any, style: dict[str, Any]) -> None:
    """Add the surfaces that contacts touch, seen from the side where they do."""
    surface = mesh.extract_surface(algorithm="dataset_surface")
    style = style | {"color": "#b3bdc7", "culling": "back", "ambient": 0.2}
    plotter.add_mesh(surface, smooth_shading=True, split_sharp_edges=True, **style)


def draw_arrows(plotter: Any, mesh: Any, scene: Scene, style: dict[str, Any]) -> None:
    """Add the vectors at joints."""
    assert scene.arrows is not None
    values = np.asarray(mesh.point_data[scene.arrows], dtype=float)
    length = scene.arrow_scale * np.linalg.norm(values, axis=1)
    shown = length > 1e-3 * float(np.linalg.norm(np.ptp(scene.bounds, axis=1)))
    plotter.remove_actor(style["name"], render=False)
    if not shown.any():
        return
    points = pv.PolyData(np.asarray(mesh.points)[shown])
    points["vectors"], points["length"] = values[shown], length[shown]
    arrow = pv.Arrow(shaft_radius=0.025, tip_radius=0.07, tip_length=0.2)
    glyphs = points.glyph(orient="vectors", scale="length", factor=1.0, geom=arrow)
    plotter.add_mesh(glyphs, color="#7d3fa8", **style)


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
    if scene.field == "bending_moment" and "shells" in instant.files:  # per length there
        unit = None if "beams" in instant.files else "N m/m"
    if scene.field == "energy":
        units = [DENSITIES[name] for name in instant.files if name in DENSITIES]
        unit = units[0] if len(units) == 1 else None
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
