# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients by the places of nodes: differences, tangent, number of models, ranks, refusals."""

import re
from collections.abc import Callable
from functools import cache
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.gradients.motion.parameters import build_of
from flexfem.gradients.shapes import node_influence
from tests.unit.refusals import assert_on_page

COMM, SELF = MPI.COMM_WORLD, MPI.COMM_SELF
#: The accuracy of linearised equations, enlarged by what cancels between equations whose shape
#: changes in place and the start that moves, is the only difference between ranks.
STEPS = {"dt": 2e-3, "t_end": 8e-3, "split_above": 1, "quiet": True}
LOADS = {"load_steps": 1, "split_above": 1, "quiet": True}
FREE = "mesh.nodes[free]"
RUBBER = ff.Material(5e6, 0.3, 1100.0)


def rod(*more: Any, elements: int = 5, orientation: Any = (0.0, 1.0, 0.0)) -> ff.Model:
    """A crooked rod on a hinge, whose sections have directions between those of its elements."""
    s = np.linspace(0.0, 1.0, elements + 1)
    points = np.column_stack([0.5 * s, 0.02 * np.sin(5.0 * s), 0.08 * s * (1.0 - s)])
    cells = [[i, i + 1] for i in range(elements)]
    groups = {"rod": range(elements), "free": range(1, elements)}
    end = ff.Marker("rod", "end")
    model = ff.Model("rod", mesh=ff.LineMesh(points, cells, groups))
    model.add(
        ff.Beam("rod", ff.Section.rectangle(0.03, 0.02, RUBBER), orientation=orientation),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("rod", "start"), axis=(0.0, 1.0, 0.0)),
        ff.PositionProbe("tip", end),
        ff.AggregateProbe("bending", "rod", lambda e, r, x: np.abs(r[:, 4]), rho=200.0),
        *more,
    )
    return model


def strip(*more: Any) -> ff.Model:
    """A shell that bends."""
    surface = ff.SurfaceMesh.grid("strip", np.linspace(0.0, 1.0, 4), [0.0, 0.15, 0.3])
    section = ff.ShellSection.isotropic(0.02, ff.Material(2e9, 0.3, 1000.0))
    corner = ff.Marker("strip", "strip_top_right")
    model = ff.Model("strip", surface=surface)
    model.add(
        ff.Shell("strip", section, element="rotation_free", edges={"strip_left": "clamped"}),
        ff.PointForce("lift", corner, (0.0, 0.0, 30.0)),
        ff.PositionProbe("tip", corner),
        *more,
    )
    return model


def von_mises(e: Any, s: Any, x: Any) -> Any:
    normal = s[:, :3] - s[:, :3].mean(axis=1, keepdims=True)
    return np.sqrt(1.5 * (normal**2).sum(axis=1) + 3.0 * (s[:, 3:] ** 2).sum(axis=1))


LAW = ff.laws.NeoHookean.from_young(1e6, 0.3)


def bar(*more: Any) -> ff.Model:
    """A solid of second order on straight cells, with a smooth largest stress."""
    mesh = ff.SolidMesh.box((1.0, 0.1, 0.08), (2, 1, 1), "tetrahedron")
    model = ff.Model("bar")
    model.add(
        ff.Solid("bar", LAW, mesh, density=1000.0, fixed={"x1": "xyz"}),
        ff.SurfaceTraction("lift", "bar", "x0", (0.0, 0.0, 300.0)),
        ff.PositionProbe("tip", ff.Marker("bar", (0.0, 0.1, 0.08))),
        ff.AggregateProbe("stress", "bar", von_mises, rho=1e-3),
        *more,
    )
    return model


def plate(*more: Any) -> ff.Model:
    """A plane figure of curved cells, whose nodes move in its plane."""
    mesh = ff.SolidMesh.box((1.0, 0.2), (3, 1), "quadrilateral").raised(2)
    mesh = mesh.moved(mesh.points + np.outer(0.1 * mesh.points[:, 0] ** 2, (0.0, 1.0, 0.0)))
    model = ff.Model("plate")
    model.add(
        ff.Solid("plate", LAW, mesh, density=1000.0, plane="strain", fixed={"x0": "xy"}),
        ff.SurfaceTraction("lift", "plate", "x1", (0.0, 300.0, 0.0)),
        ff.PositionProbe("tip", ff.Marker("plate", (1.0, 0.1, 0.0))),
        ff.AggregateProbe("stress", "plate", von_mises, rho=1e-3),
        *more,
    )
    return model


#: Model, path, numbers, options.
KINDS: dict[str, tuple[Callable[[], ff.Model], str, list[str], Any]] = {
    "rod in motion": (
        rod, FREE, ["final:tip_z", "mean:tip_x", "final:bending"],
        ff.RunOptions(**STEPS),
    ),
    "strip at rest": (
        strip, "surface.nodes[strip_top]", ["final:tip_z"], ff.StaticOptions(**LOADS),
    ),
    "bar in motion": (
        bar, "bar.mesh.nodes[y0]", ["final:tip_z", "final:stress"], ff.RunOptions(**STEPS),
    ),
    "plate at rest": (
        plate, "plate.mesh.nodes[y1]", ["final:tip_y", "final:stress"], ff.StaticOptions(**LOADS),
    ),
}  # fmt: skip


@cache
def found(kind: str, *, shared: bool = False) -> ff.Gradient:
    """The gradient, by each rank alone or by all together."""
    build, path, of, options = KINDS[kind]
    return ff.gradient(build(), of, [path], options, accuracy=1e-12, comm=COMM if shared else SELF)


def numbers(kind: str, model: ff.Model) -> np.ndarray:
    """The same numbers by an ordinary run."""
    _, _, of, options = KINDS[kind]
    motion = isinstance(options, ff.RunOptions)
    settings = {**(STEPS if motion else LOADS), "tolerance": 1e-12}
    if motion:
        history = ff.simulate(model, ff.RunOptions(**settings), comm=SELF).history
    else:
        history = ff.solve_static(model, ff.StaticOptions(**settings), comm=SELF).history
    t, values = history["t"], []
    for name in of:
        kind, column = name.split(":")
        x = history[column]
        values.append(x[-1] if kind == "final" else np.trapezoid(x, t) / t[-1])
    return np.array(values)


@pytest.mark.serial
@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=[pytest.mark.slow] * (k == "bar in motion")) for k in KINDS]
)
def test_gradient_by_nodes_is_that_of_differences(kind: str) -> None:
    """Of fourth order, along displacements of all nodes at random.

    What belongs to the node beside, or is left out as directions of sections and middles of edges,
    changes the first digits.
    """
    build, path, of, _ = KINDS[kind]
    made, values = build_of(build(), [path])
    places = values[path]
    by, step = np.random.default_rng(1).standard_normal(places.shape), 5e-5
    by[:, 2] *= kind != "plate at rest"  # it stays plane
    runs = [numbers(kind, made(**{path: places + k * step * by})) for k in (-2, -1, 1, 2)]
    expected = (runs[0] - 8.0 * runs[1] + 8.0 * runs[2] - runs[3]) / (12.0 * step)
    gradient = found(kind)
    np.testing.assert_array_equal(gradient.at[path], places)
    for name, value in zip(of, expected, strict=True):
        parts = gradient.gradient[name][path] * by
        # runs end with steps of 1e-12 m, over differences of 5e-5 m; stresses with five digits
        assert abs(parts.sum() - value) < 2e-5 * np.abs(parts).sum(), name


@pytest.mark.several_ranks
@pytest.mark.parametrize(
    "kind", [pytest.param("rod in motion", marks=pytest.mark.three_ranks),
             pytest.param("bar in motion", marks=pytest.mark.slow_on_ranks),
             pytest.param("plate at rest", marks=pytest.mark.slow_on_ranks)],
)  # fmt: skip
def test_gradient_by_nodes_is_the_same_on_ranks(kind: str) -> None:
    """Of split bodies; a node that a rank lacks or counts twice changes the first digit."""
    path = KINDS[kind][1]
    alone, shared = found(kind), found(kind, shared=True)
    for name, by in shared.gradient.items():
        expected = alone.gradient[name][path]
        # stresses of solids are small differences of what nodes do; the bar's tip moves by 1e-4 of
        # what its shape and its start do each, which cancel
        digits = {"final:stress": 1e-7, "final:tip_z": 1e-8}.get(name, 1e-9)
        assert np.abs(by[path] - expected).max() < digits * np.abs(expected).max(), name


@pytest.mark.serial
def test_tangent_along_nodes_is_that_of_the_adjoint() -> None:
    """Both are exact for the same motion, up to their own differences of models.

    A start whose velocities or accelerations do not move with the nodes is off by the first digit.
    """
    build, path, _, options = KINDS["rod in motion"]
    by = np.random.default_rng(2).standard_normal(found("rod in motion").at[path].shape)
    moved = ff.tangent_motion(build(), [path], {path: by}, options, accuracy=1e-12, comm=SELF)
    # bending moments are small differences of nodes, whose starts move by their own differences
    for name, digits in (("tip_z", 1e-7), ("bending", 2e-5)):
        parts = found("rod in motion").gradient[f"final:{name}"][path] * by
        assert abs(parts.sum() - moved.derivative[name][-1]) < digits * np.abs(parts).sum()


@pytest.mark.slow
@pytest.mark.serial
def test_models_are_no_more_for_more_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice as many nodes take as many models."""
    counts, beside = [], node_influence.beside

    def counted(*arguments: Any) -> Any:
        counts[-1] += 1
        return beside(*arguments)

    monkeypatch.setattr(node_influence, "beside", counted)
    options = ff.RunOptions(dt=2e-3, t_end=2e-3, quiet=True)
    for elements in (8, 16):
        counts.append(0)
        ff.gradient(rod(elements=elements), "final:tip_z", [FREE], options, comm=SELF)
    # two for each of three coordinates of classes of nodes whose frames reach two elements far;
    # 8 and 16 nodes by themselves take 48 and 96
    assert counts[0] == counts[1] <= 3 * 2 * 5 + 4


MOTION, REST = ff.RunOptions(**STEPS), ff.StaticOptions(**LOADS)
WRONG: list[tuple[str, Callable[[], ff.Model], str, dict[str, Any]]] = [
    ("changes equations or columns far from its nodes", lambda: rod(elements=12, orientation=None),
     FREE, {}),
    ("changes equations or columns far from its nodes", lambda: plate(
        ff.SolidProbe("mean", "plate", measures="stress")
    ), "plate.mesh.nodes[y1]", {"of": "final:mean_sxx", "options": REST}),
    ("is refused: Revolute \"hinge\": the markers violate", rod, "mesh.nodes[rod]", {}),
    ("no line or point 'fre'; there are 'rod, free'", rod, "mesh.nodes[fre]", {}),
    ("has no mesh of shells", rod, "surface.nodes[free]", {}),
    ("Beam \"rod\" has no mesh of its own", rod, "rod.mesh.nodes[free]", {}),
    ("responses and buckling loads have no derivatives by \"surface.nodes[strip_top]\"", strip,
     "surface.nodes[strip_top]", {"of": "frequency:1", "options": ff.ModeOptions(modes=1)}),
    ("of motions with damping of modes yet",
     lambda: rod(ff.ModalDamping("damping", 0.1)), FREE, {}),
]  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize("case", range(len(WRONG)))
def test_nodes_without_derivatives_are_refused(case: int) -> None:
    """In one line of the page that names the path, instead of a gradient that lacks a part."""
    message, build, path, more = WRONG[case]
    of, options = more.get("of", "final:tip_z"), more.get("options", MOTION)
    with pytest.raises(ValueError, match=re.escape(message)) as told:
        ff.gradient(build(), of, [path], options, comm=SELF)
    assert "\n" not in str(told.value)
    assert_on_page(str(told.value))


@pytest.mark.serial
def test_groups_that_share_nodes_are_refused() -> None:
    """Places of the second one undo those of the first, whose derivatives would be zero there."""
    with pytest.raises(ValueError, match="name the same; leave one of them out") as told:
        ff.gradient(rod(), "final:tip_z", [FREE, "mesh.nodes[rod]"], MOTION, comm=SELF)
    assert_on_page(str(told.value))
