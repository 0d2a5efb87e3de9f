# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients by sizes that a mesh generator makes a mesh of: it places nodes to a tolerance."""

from functools import partial

import pytest

import flexfem as ff
from flexfem.cli import load_case
from tests.contract.test_gradients import agree_on_ranks, errors

#: Noise of differences of motions is less with Newton steps of 1e-12.
OPTIONS = partial(ff.RunOptions, integrator="energy_momentum", rho_inf=1.0, tolerance=1e-12)


def ring(outer_radius, width):
    """A rubber ring that spins."""
    mesh = ff.build_body_mesh(
        "bushing", inner_radius=0.1, outer_radius=outer_radius, length=width, cells_around=8,
        cells_across=1, cells_along=1,
    )  # fmt: skip
    solid = ff.SolidMesh.from_dolfinx(mesh.mesh, mesh.cell_tags, mesh.facet_tags, mesh.groups)
    rubber = ff.laws.NeoHookean.from_young(1e6, 0.45)
    model, rim = ff.Model("ring"), ff.Marker("rim")
    ring = ff.Solid("ring", rubber, solid, density=1100.0, angular_velocity=(0.0, 0.0, 20.0))
    model.add(
        ring,
        ff.RigidBody("rim", 3.0, (0.01, 0.01, 0.02), angular_velocity=(0.0, 0.0, 20.0)),
        ff.RigidPoints("bond", rim, nodes=ring.node_markers("inner")),
        ff.Probe("axle", rim, ("spin",), lambda t, s: (s.angular_velocity[2],)),
        ff.EnergyProbe(),
    )
    return model


def wheel(**numbers):
    """The tyre that lands on the ground, with a coarse mesh."""
    case = load_case("tyre")
    defaults = {option.name: option.default for option in case.options}
    return case.build(**{**defaults, "cells_around": 4, **numbers})


SIZES = {"outer_radius": 0.15, "width": 0.05}
MOTIONS = {ring: (["final:spin", "final:energy_strain"], OPTIONS(dt=2e-3, t_end=4e-3)),
           wheel: (["final:x"], OPTIONS(dt=2e-3, t_end=6e-3))}  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize("name", ["outer_radius", pytest.param("width", marks=pytest.mark.slow)])
@pytest.mark.parametrize("build", [ring, pytest.param(wheel, marks=pytest.mark.slow)])
def test_sizes_of_meshes_of_gmsh(build, name):
    """The motion of nodes is told by differences of one length, for the start and the equations.

    With different ones noise of the mesh gives 3e-3, in a wheel that lands 7e-3; with forces of
    contacts by second order, or bodies by as short differences, a wheel is off by 2e-4 to 4e-4.
    """
    of, options = MOTIONS[build]
    rest = partial(build, **{other: x for other, x in SIZES.items() if other != name})
    number = {name: SIZES[name]}
    found = ff.gradient(rest, of, number, options, accuracy=1e-12, check=True)
    # a force that is not transposed gives 1e-3
    assert max(found.check.values()) < 1e-7
    assert errors(found.gradient, rest, number, of, options, 1e-4).max() < 2e-5


@pytest.mark.slow
@pytest.mark.several_ranks
@pytest.mark.three_ranks
@pytest.mark.parametrize("build", MOTIONS)
def test_ranks_agree(build):
    """Noise of short differences is 1e-8 and more."""
    of, options = MOTIONS[build]
    rest = partial(build, width=SIZES["width"])
    number = {"outer_radius": SIZES["outer_radius"]}
    agree_on_ranks(rest, number, of, options, accuracy=1e-11)
