# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reduced bodies against closed forms: vibration, buckling, stiffening by rotation."""

from typing import Any

import numpy as np
import pytest
import scipy.linalg

import flexfem as ff
from tests.unit.reduction_bodies import ENDS, LENGTH, NODES, STEEL, beam, box, frequencies, sheet

pytestmark = pytest.mark.serial

E, RHO = STEEL.youngs_modulus, STEEL.density
# Slender: shear and rotary inertia change the first frequencies by (wave number times radius of
# gyration)^2, below 1e-4
ROD = ff.Section.circle(0.01, STEEL)
AREA, SECOND = np.pi * 0.01**2 / 4.0, np.pi * 0.01**4 / 64.0
UNIT = np.sqrt(E * SECOND / (RHO * AREA)) / LENGTH**2


def test_frequencies_of_slender_beams() -> None:
    rod = beam(8, ROD)
    clamped = ff.reduce_body(rod, {"left": NODES["left"]}, modes=4).frequencies[::2]
    np.testing.assert_allclose(clamped / UNIT, [1.875104**2, 4.694091**2], rtol=1e-3)
    free = ff.reduce_body(rod, modes=4).frequencies[::2]
    np.testing.assert_allclose(free / UNIT, [4.730041**2, 7.853205**2], rtol=1e-3)
    tied = frequencies(ff.reduce_body(rod, NODES, modes=8))
    # the interfaces' frames are free here; clamped-clamped ones have the same frequencies
    np.testing.assert_allclose(tied[[6, 8]] / UNIT, [4.730041**2, 7.853205**2], rtol=2e-3)


@pytest.mark.slow
def test_solid_beam_has_the_frequencies_of_the_beam() -> None:
    section = ff.Section.rectangle(0.1, 0.08, STEEL)
    slender = frequencies(ff.reduce_body(beam(8, section), NODES, modes=8))[6:9]
    solid = frequencies(ff.reduce_body(box((12, 2, 2)), ENDS, modes=8))[6:9]
    # rigid end faces and two cells across: below one per cent; linear cells are off by a quarter
    np.testing.assert_allclose(solid, slender, rtol=1e-2)


@pytest.mark.parametrize(
    ("held", "factor"),
    [((0, 1, 2, 3, 6, 7, 8), 1.0), (range(6), 0.25), (range(12), 4.0)],
    ids=["hinged", "cantilever", "clamped"],
)
def test_buckling_by_a_pushed_interface(held: Any, factor: float) -> None:
    """Euler's loads: stiffness plus that of the force which a displacement of an end causes."""
    body = ff.reduce_body(beam(8, ROD), NODES, modes=8, geometric_stiffness=True)
    assert body.interface_stiffness is not None
    free = np.setdiff1d(np.arange(body.size), held)
    if len(held) == 6:
        free = np.setdiff1d(free, [6])
    at = np.ix_(free, free)
    pulled = scipy.linalg.eigvalsh(body.interface_stiffness[6][at], body.stiffness[at])
    # pulling the right end to the right stiffens: all of one sign
    assert pulled[0] > -1e-6 * pulled[-1]
    push = 1.0 / pulled[-1]
    load = E * AREA * push / LENGTH
    # four modes in each plane: 0.2 per cent in the clamped shape; another law is off by factors
    assert load == pytest.approx(factor * np.pi**2 * E * SECOND / LENGTH**2, rel=3e-3)


def test_lateral_buckling_by_bending() -> None:
    """Strip bent by equal end moments about its strong axis: Prandtl 1899."""
    section = ff.Section.rectangle(0.1, 0.01, STEEL)
    assert section.stiffness is not None
    body = ff.reduce_body(beam(8, section), NODES, modes=12, geometric_stiffness=True)
    stiffness = body.stiffness
    assert body.interface_stiffness is not None
    # uniform moment about z: opposite rotations of the ends, the distance of the ends held
    weak, torsion, strong = (
        section.stiffness[4, 4],
        section.stiffness[3, 3],
        section.stiffness[5, 5],
    )
    stress = body.interface_stiffness[11] - body.interface_stiffness[5]
    moment = 2.0 * strong / LENGTH  # by unit rotations of -1 and 1
    # forks at the ends: no displacement, no twist; e3 = z is the weak direction's displacement
    free = np.setdiff1d(np.arange(body.size), [0, 1, 2, 3, 5, 6, 7, 8, 9, 11])
    at = np.ix_(free, free)
    critical = 1.0 / np.abs(scipy.linalg.eigvalsh(stress[at], stiffness[at])).max()
    expected = np.pi / LENGTH * np.sqrt(weak * torsion)
    # modes of clamped ends: below one per cent; without the moment's part there is no buckling
    assert critical * moment == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize(("rate", "expected"), [(2.0, 4.1373), (4.0, 5.5850)])
def test_a_rotating_cantilever_stiffens(rate: float, expected: float) -> None:
    """Flapping: Wright, Smith, Thresher, Wang (1982), J. Appl. Mech. 49, table 1."""
    body = ff.reduce_body(beam(8, ROD), {"left": NODES["left"]}, modes=10, geometric_stiffness=True)
    assert body.acceleration_stiffness is not None
    spin = rate * UNIT * np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])
    field = spin @ spin  # acceleration of a rotating frame at r
    stiffening = np.einsum(
        "ab,abij->ij", field, body.acceleration_stiffness[3:].reshape(3, 3, *body.stiffness.shape)
    )
    moving = stiffening + np.einsum("ab,abij->ij", field, body.products[:, :, 1:, 1:])
    found = frequencies(body, range(6), moving)[:2] / UNIT
    # shear and rotary inertia: 1e-4. Without stiffening 3.516 out of plane, less in the plane
    assert found[1] == pytest.approx(expected, rel=1e-3)
    # lagging has the same stiffening, less the rotation itself
    assert found[0] == pytest.approx(np.sqrt(expected**2 - rate**2), rel=2e-3)


@pytest.mark.slow
def test_solid_and_beam_stiffen_alike() -> None:
    section = ff.Section.rectangle(0.1, 0.08, STEEL)
    found = []
    for body, places in ((beam(8, section), NODES), (box((10, 2, 2)), ENDS)):
        left = {"left": places["left"]}
        reduced = ff.reduce_body(body, left, modes=2, geometric_stiffness=True)
        assert reduced.acceleration_stiffness is not None
        found.append(np.diag(reduced.acceleration_stiffness[0])[6:])
    # the same force on the same foreshortening: the root's stress concentration remains
    np.testing.assert_allclose(found[0], found[1], rtol=2e-2)
    assert (found[0] < 0.0).all()  # a push along the axis softens


@pytest.mark.parametrize("thickness", [0.01, 1e-4])
def test_square_plates_do_not_lock(thickness: float) -> None:
    """Free plate: Leissa (1973), J. Sound Vib. 31, nu = 0.3; the same however thin."""
    plate = ff.shell_body(sheet((8, 8), (1.0, 1.0)), ff.ShellSection.isotropic(thickness, STEEL))
    bending = E * thickness**3 / 12.0 / (1.0 - STEEL.poisson_ratio**2)
    unit = np.sqrt(bending / (RHO * thickness))
    free = ff.reduce_body(plate, modes=3).frequencies / unit
    # eight cells a side: half a per cent; linear displacements lock by 1/thickness
    np.testing.assert_allclose(free, [13.468, 19.596, 24.270], rtol=1e-2)
    root = {"root": lambda x: np.isclose(x[0], 0.0)}
    cantilever = ff.reduce_body(plate, root, modes=3).frequencies / unit
    np.testing.assert_allclose(cantilever, [3.471, 8.508, 21.29], rtol=2.5e-2)


@pytest.mark.slow
def test_a_plate_in_its_plane_is_a_beam() -> None:
    from mpi4py import MPI

    from dolfinx import mesh

    domain = mesh.create_rectangle(MPI.COMM_WORLD, [[0, -0.025], [LENGTH, 0.025]], (16, 2))
    plate = ff.plane_body(domain, 0.02, STEEL)
    body = ff.reduce_body(plate, ENDS, modes=2, ties=dict.fromkeys(ENDS, "average"))
    section = ff.Section.rectangle(0.05, 0.02, STEEL)
    rod = ff.reduce_body(beam(1, section), NODES, modes=0)
    assert body.inertia == pytest.approx(rod.inertia, rel=1e-10)
    own = [0, 1, 5, 6, 7, 11]
    # mean rotations of a warped section: half a per cent
    np.testing.assert_allclose(
        body.stiffness[np.ix_(own, own)], rod.stiffness[np.ix_(own, own)],
        rtol=1e-2, atol=1e-6 * rod.stiffness[0, 0],
    )  # fmt: skip
