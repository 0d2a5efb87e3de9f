# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometrically exact beam lines in Exudyn, shared by the speed benchmark and the reference data.

Exudyn is a dependency of these scripts only (``pip install exudyn``); flexfem never imports it.
"""

import contextlib
import itertools
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np

# Exudyn's build with vector instructions and without range checks must be selected before the
# import, which then writes a line that would spoil the JSON on the standard output.
sys.exudynFast = True  # type: ignore[attr-defined]
with contextlib.redirect_stdout(sys.stderr):
    import exudyn as exu
    import exudyn.itemInterface as eii

# Saint-Venant torsion constant of a square of side 1.
SQUARE_TORSION = 0.140577


@dataclass(frozen=True)
class SquareSection:
    """Homogeneous square section.

    Args:
        side: Edge length in m.
        youngs_modulus: Young's modulus in Pa.
        poisson_ratio: Poisson's ratio.
        density: Mass density in kg/m^3.
        shear_factor: Shear correction factor of both transverse directions.
    """

    side: float
    youngs_modulus: float
    poisson_ratio: float
    density: float
    shear_factor: float = 5.0 / 6.0

    @property
    def stiffness(self) -> list[float]:
        """Diagonal (EA, kGA, kGA, GJ, EI, EI)."""
        e, b = self.youngs_modulus, self.side
        g = e / (2.0 * (1.0 + self.poisson_ratio))
        shear, bending = self.shear_factor * g * b**2, e * b**4 / 12.0
        return [e * b**2, shear, shear, g * SQUARE_TORSION * b**4, bending, bending]

    @property
    def mass_per_length(self) -> float:
        """Mass per length in kg/m."""
        return self.density * self.side**2

    @property
    def rotary_inertia(self) -> list[float]:
        """Diagonal of the rotary inertia per length in kg m (tangent first)."""
        transverse = self.density * self.side**4 / 12.0
        return [2.0 * transverse, transverse, transverse]

    @property
    def data(self) -> Any:
        """Exudyn's section."""
        found = exu.BeamSection()
        found.massPerLength = self.mass_per_length
        found.inertia = np.diag(self.rotary_inertia)
        found.stiffnessMatrix = np.diag(self.stiffness)
        return found


@dataclass(frozen=True)
class BeamLine:
    """Numbers of the Exudyn items of one straight beam, from start to end."""

    nodes: list[int]
    elements: list[int]


def add_beam(
    mbs: Any,
    section: Any,
    start: np.ndarray,
    end: np.ndarray,
    n_elements: int,
    gravity: np.ndarray,
    rotation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0),
) -> BeamLine:
    """Add a straight line of three-dimensional two-node elements, with its weight.

    Args:
        mbs: Exudyn main system.
        section: Cross-section, as an ``exudyn.BeamSection``.
        start: First end in m, shape (3,).
        end: Second end in m, shape (3,).
        n_elements: Number of elements of equal length.
        gravity: Acceleration in m/s^2, shape (3,).
        rotation: Euler parameters of the sections' axes, of which the first is along the line.

    Returns:
        The node and element numbers.
    """
    points = np.linspace(start, end, n_elements + 1)
    nodes = [mbs.AddNode(eii.NodeRigidBodyEP(referenceCoordinates=[*p, *rotation])) for p in points]
    length = float(np.linalg.norm(end - start)) / n_elements
    elements = []
    for pair in itertools.pairwise(nodes):
        item = eii.ObjectBeamGeometricallyExact(
            nodeNumbers=list(pair), length=length, sectionData=section
        )
        beam = mbs.AddObject(item)
        marker = mbs.AddMarker(eii.MarkerBodyMass(bodyNumber=beam))
        mbs.AddLoad(eii.LoadMassProportional(markerNumber=marker, loadVector=gravity))
        elements.append(beam)
    return BeamLine(nodes, elements)


def integration_settings(steps: int, dt: float, options: dict[str, Any]) -> Any:
    """Exudyn settings for a silent generalized-alpha run (spectral radius 0.9, one thread).

    Args:
        steps: Number of steps.
        dt: Step size in s.
        options: Dotted attribute names of ``SimulationSettings`` with their values, e.g.
            ``{"timeIntegration.newton.relativeTolerance": 1e-6}``; applied last.
            ``linearSolver.solverType`` takes the name of the enumeration member.

    Returns:
        The ``exudyn.SimulationSettings``.

    Raises:
        ValueError: If a name does not exist.
    """
    settings = exu.SimulationSettings()
    settings.parallel.numberOfThreads = 1
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    settings.solution.sensors.active = False
    settings.solution.solverInformationFileName = ""
    integration = settings.timeIntegration
    integration.endTime = steps * dt
    integration.numberOfSteps = steps
    integration.adaptiveStep = False
    integration.verboseMode = 0
    integration.generalizedAlpha.spectralRadius = 0.9
    for name, value in options.items():
        _set(settings, name, value)
    return settings


def _set(settings: Any, name: str, value: Any) -> None:
    *path, last = name.split(".")
    target = settings
    for part in path:
        target = getattr(target, part, None)
    if target is None or not hasattr(target, last):
        raise ValueError(f"SimulationSettings has no attribute {name!r}")
    if last == "solverType":
        kind = exu.LinearSolverType if path == ["linearSolver"] else exu.DynamicSolverType
        value = kind.__members__[value]
    setattr(target, last, value)
