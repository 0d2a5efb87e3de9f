# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams whose mass centres lie far off the axis: coupled modes, a channel as a cantilever."""

import numpy as np
import pytest
import scipy.linalg

import flexfem as ff
from flexfem import research
from tests.verification.benchmarks.straight_beam import angular_frequencies, beam_model

EA, GA, GJ, EI = 1e4, 300.0, 0.05, 1.0
#: per length: mass, offset along e2, moments of inertia about the mass centre
MASS, OFFSET, POLAR, ROTARY = 1.0, 0.1, 1e-3, 5e-4


def _section(mass: float, y: float, z: float, moments: tuple[float, float, float]) -> np.ndarray:
    first = mass * np.array([[0.0, -z, y], [z, 0.0, 0.0], [-y, 0.0, 0.0]])
    rotary = np.diag(moments) + first.T @ first / mass
    return np.block([[mass * np.eye(3), -first], [first, rotary]])


def _coupled(number: int) -> np.ndarray:
    """Frequencies of w = W sin kx, phi = F cos kx, theta = T sin kx on a span of length one."""
    k = number * np.pi
    K = np.diag([GA * k**2, GA + EI * k**2, GJ * k**2])
    K[0, 1] = K[1, 0] = GA * k
    M = np.diag([MASS, ROTARY, POLAR + MASS * OFFSET**2])
    M[0, 2] = M[2, 0] = MASS * OFFSET
    return np.sqrt(scipy.linalg.eigvalsh(K, M))


@pytest.mark.serial
@pytest.mark.parametrize("formulation", ["se3", "nurbs"])
def test_bending_and_torsion_are_coupled_by_the_offset(formulation):
    """Both ends held but for bending about e2; Timoshenko's beam in bending and torsion."""
    section = ff.Section.general(
        (EA, GA, GA, GJ, EI, 100.0), _section(MASS, OFFSET, 0.0, (POLAR, ROTARY, POLAR - ROTARY))
    )
    expected, errors = np.array([_coupled(n)[0] for n in (1, 2)]), []
    for elements in (12, 24):
        model = beam_model(section, elements)
        if formulation == "nurbs":
            mesh = model.mesh
            model = ff.Model("beam", mesh=mesh)
            model.add(ff.Beam("beam", section, orientation=(0, 1, 0), degree=2,
                              formulation=formulation))  # fmt: skip
        model.add(
            ff.Revolute("root", ff.Ground(), ff.Marker("beam", "start"), axis=(0, 1, 0)),
            ff.Generic("tip", ff.Ground((1.0, 0, 0)), ff.Marker("beam", "end"), free=("x", "ry")),
        )
        found = angular_frequencies(model, 4)
        errors.append([np.abs(found / w - 1.0).min() for w in expected])
    # with first moments on the axis the mass matrix is not positive and no modes are found; the
    # mesh leaves 3e-3, an offset that is a tenth larger lowers the first frequency by 6 per cent
    assert np.max(errors[1]) < 4e-3
    order = np.log2(np.array(errors[0]) / errors[1])
    assert order.min() > 1.8


def _channel(section: ff.Section, lumped: float = 0.0) -> ff.Model:
    """Cantilever of eight elements of which gravity acts from the start on."""
    model = beam_model(section, 8, length=16.0 / 3.0)
    model.add(
        ff.Gravity((0.0, -9.81, 0.0)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")),
        ff.Probe("tip", [ff.Marker("beam", "end")], ("y", "z", "twist"),
                 lambda t, tip: [*tip.position[1:], tip.rotation[2, 1]]),
    )  # fmt: skip
    for i in range(9 if lumped else 0):
        mass = lumped * (2.0 / 3.0) * (0.5 if i in (0, 8) else 1.0)
        place = ff.Marker("beam", i / 8.0, offset=(0.0, 0.0, 0.01875))
        model.add(ff.PointMass(f"mass_{i}", mass, place))
    return model


@pytest.mark.serial
def test_channel_moves_as_one_with_masses_beside_its_nodes():
    section = research.segment_sections(research.outboard_link())[1].section
    mass, moments = section.mass_per_length, np.diag(section.inertia)[3:].copy()
    moments -= mass * 0.01875**2 * np.array([1.0, 1.0, 0.0])
    bare = ff.Section.general(section.stiffness, (0.0, 0.0, 0.0, *moments))
    options = ff.RunOptions(dt=2e-3, t_end=0.3, quiet=True)
    outcomes = [ff.simulate(m, options) for m in (_channel(section), _channel(bare, mass))]
    # first moments on the axis: the run ends after 7 ms
    assert [o.status for o in outcomes] == ["ok", "ok"]
    ours, lumped = (o.history for o in outcomes)
    for name in ("y", "z", "twist"):
        size = np.abs(ours[name]).max()
        # consistent and lumped masses err to opposite sides: 4 per cent of z with 8 elements, 1
        # with 16. It is the offset that twists the beam, by 0.9 rad: half of it would show at once
        assert np.abs(ours[name] - lumped[name]).max() < 0.05 * size
