# SPDX-License-Identifier: LGPL-3.0-or-later
"""Probes of energies, momenta, joint forces, beam resultants and elongations."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import checked, declared, text, vector
from flexfem._types import IntArray
from flexfem.core.joint import Joint
from flexfem.core.marker import Ground
from flexfem.joints.cable import Cable
from flexfem.model.bodies.basic import Beam
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shell import Shell
from flexfem.model.probes.base import AnyProbe, check_columns, name_columns, strings
from flexfem.model.structure.marker_places import beam_cell
from flexfem.model.structure.structure import Structure

__all__ = [
    "ElongationProbe",
    "EnergyProbe",
    "MomentumProbe",
    "ReactionProbe",
    "ReductionErrorProbe",
    "ShellEnergyProbe",
    "ShellStrainProbe",
    "StrainProbe",
]

_STRAINS = [f"gamma{i}" for i in "123"] + [f"kappa{i}" for i in "123"]
_SHELL_STRAINS = [f"{what}{i}" for what in ("eps", "kappa") for i in ("11", "22", "12")]
_SHELL_RESULTANTS = [f"{what}{i}" for what in "nm" for i in ("11", "22", "12")]
_RESULTANTS = [f"n{i}" for i in "123"] + [f"m{i}" for i in "123"]


def _bodies(owner: str, what: str, values: Sequence[str]) -> tuple[str, ...]:
    """Return checked names, one at least."""
    names = strings(owner, what, values)
    if not names:
        raise ValueError(f"{owner}: {what} must hold at least one name, or be None for all")
    return names


def _axes(owner: str, what: str, value: str) -> str:
    """Return the checked axes of a joint's force."""
    if value not in ("inertial", "a", "b"):
        raise ValueError(
            f'{owner}: {what} must be "inertial", "a" or "b", got {_checks.show(value)}'
        )
    return value


def _fraction(owner: str, what: str, value: float) -> None:
    """Check a place along a beam."""
    if not 0.0 <= _checks.number(owner, what, value) <= 1.0:
        raise ValueError(f"{owner}: {what} must lie in [0, 1], got {value}")


def _ends(owner: str, what: str, values: Sequence[str]) -> tuple[str, ...]:
    """Return two checked names."""
    ends = strings(owner, what, values)
    if len(set(ends)) != 2 or len(ends) != 2:
        raise ValueError(f"{owner}: {what} must be two names, got {_checks.show(values)}")
    return ends


@declared
class _BodiesProbe(AnyProbe):
    """A probe of the whole model or of some of its bodies.

    Attributes:
        name: Unique name in the model.
        bodies: Names of beams, shells and rigid bodies (with the point masses on them), None for
            all. A point mass where shells meet counts as being on the first of them.

    Raises:
        TypeError: They are no list of names.
        ValueError: An empty list.
    """

    name: str
    bodies: Sequence[str] | None = checked(_bodies, default=None)

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        for name in self.bodies or ():
            if model.get(name) not in model.bodies:
                raise ValueError(
                    f'{type(self).__name__} "{self.name}": {model!r} has no body "{name}"'
                )


@declared
class EnergyProbe(_BodiesProbe):
    """Energies, J, in the columns name_kinetic, _strain, _gravity, _work, _dissipation, _balance.

    - kinetic: as in the equations of motion;
    - strain: of beams, shells, springs and contacts;
    - gravity: potential of the weight, zero at the start;
    - work: done since the start by loads and by drives, and, for a part of the bodies, by the
      joints and springs that connect them with others;
    - dissipation: taken since the start by dampers, contacts and the damping of beams and shells;
    - balance: kinetic + strain + gravity - work + dissipation minus the same at the start. It is
      energy that the time integration has dissipated (negative) or generated (positive), and that
      impacts, joints that lock and springs that are released by events have taken. Steps end within
      a tolerance, and the forces that it leaves out of balance do work, too: with thin shells,
      above all damped ones, that may be as much as the dissipation (take ``tolerance=1e-8`` then).

    Work and dissipation are integrated from row to row of the history, a mean force times a
    displacement, or a mean force times a mean rate times the step: of second order, and exact for
    linear motion by the trapezoidal rule (``rho_inf=1``). Drives work with the impulses by which
    the integrator changes velocities, not with the forces of ``ReactionProbe``. In statics, where
    nothing has a rate, the work of moments, of drives and of bodies left out is missing; the
    potential of a weight that grows with the load factor is minus the work it has done.
    """

    name: str = "energy"

    def __post_init__(self) -> None:
        """Name the columns."""
        name_columns(self, ("kinetic", "strain", "gravity", "work", "dissipation", "balance"))

    @property
    def differentiable(self) -> tuple[str, ...]:
        """See :class:`AnyProbe`: those that are functions of the state."""
        return self.columns[:3]


@declared
class MomentumProbe(_BodiesProbe):
    """Momenta and centre of mass, inertial components.

    Columns: linear momentum name_px, _py, _pz (kg m/s), angular momentum about the inertial origin
    name_lx, _ly, _lz (kg m^2/s), centre of mass name_cx, _cy, _cz (m).
    """

    smooth: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Name the columns."""
        name_columns(self, [f"{what}{axis}" for what in "plc" for axis in "xyz"])


@declared
class ReactionProbe(AnyProbe):
    """Force (N) and moment (N m) that a joint, drive or spring exerts on the body of its marker b.

    Columns name_fx, _fy, _fz, _mx, _my, _mz; the moment is about the origin of marker b. A body
    that hangs from the ground (marker a) on a joint is acted on by the opposite of its weight. The
    opposite force acts on marker a's body at the same place. Of a joint of lines of shells it is
    the resultant in inertial axes, the moment about the first node of the second line, or about the
    marker of the body that it holds a line to. A cable with mass acts on the body by its tension
    and by the inertia and weight of its last part; it must end on a body then.

    In motions the force belongs to the time of the row and to accelerations that satisfy the
    constraints there, whatever the integrator; drives are differentiated over eighths of a step.
    Where accelerations of a drive jump at that time, it is the mean of both sides. A jump of a rate
    takes an impulse, which is in no row.

    Attributes:
        name: Unique name in the model.
        joint: Name of the joint.
        axes: Components in "inertial" axes, or in those of marker "a" or "b".

    Raises:
        TypeError: A name is no string.
        ValueError: An empty name or other axes.
    """

    smooth: ClassVar[bool] = True
    name: str
    joint: str = text()
    axes: str = checked(_axes, default="inertial")

    def __post_init__(self) -> None:
        """Name the columns."""
        name_columns(self, [f"{what}{axis}" for what in "fm" for axis in "xyz"])

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        if not isinstance(model.get(self.joint), Joint):
            raise ValueError(f'ReactionProbe "{self.name}": {model!r} has no joint "{self.joint}"')
        if model[self.joint].joins_lines and self.axes != "inertial":
            raise ValueError(
                f'ReactionProbe "{self.name}": {model[self.joint].owner} needs axes "inertial", '
                f'got "{self.axes}"'
            )
        self._check_cable(model[self.joint])

    def _check_cable(self, cable: Joint) -> None:
        """Refuse what is not known of the force of a cable with mass."""
        if not isinstance(cable, Cable) or not cable.mass_per_length:
            return
        if isinstance(cable.b, Ground):
            raise ValueError(
                f'ReactionProbe "{self.name}": {cable.owner} with mass ends on the ground, where '
                "its force is not known; end it on a body that is fixed there"
            )
        if self.axes == "a":
            raise ValueError(
                f'ReactionProbe "{self.name}": {cable.owner} with mass needs axes "inertial" or '
                '"b", got "a"'
            )


@declared
class StrainProbe(AnyProbe):
    """Strains and stress resultants of a beam at one place, in section axes.

    Columns: extension and shears name_gamma1 to _gamma3, twist and bendings (1/m) name_kappa1 to
    _kappa3, both relative to the shape at the start; forces (N) name_n1 to _n3 and moments (N m)
    name_m1 to _m3 without damping forces. On SE(3) beams they are those of the element whose middle
    is nearest, on NURBS beams those at the fraction.

    Attributes:
        name: Unique name in the model.
        beam: Name of the beam.
        fraction: Place along the beam as a fraction of its length, 0 to 1.

    Raises:
        TypeError: A name is no string, or the fraction no number.
        ValueError: An empty name or a fraction outside [0, 1].
    """

    smooth: ClassVar[bool] = True
    name: str
    beam: str = text()
    fraction: float = checked(_fraction, as_given=True)

    def __post_init__(self) -> None:
        """Name the columns."""
        name_columns(self, _STRAINS + _RESULTANTS)

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        beam = model.get(self.beam)
        if isinstance(beam, Shell):
            raise ValueError(
                f'StrainProbe "{self.name}": "{self.beam}" is a shell, which takes ShellStrainProbe'
            )
        if not isinstance(beam, Beam):
            raise ValueError(f'StrainProbe "{self.name}": {model!r} has no beam "{self.beam}"')
        if beam.formulation == "se3":
            self.nodes(model)

    def nodes(self, model: Structure) -> tuple[int, int]:
        """Return the mesh nodes at both ends of the element of an SE(3) beam.

        Raises:
            ValueError: The beam is no simple line.
        """
        owner, beam = f'StrainProbe "{self.name}"', model[self.beam]
        assert model.mesh is not None
        try:
            return beam_cell(model.mesh, beam, self.fraction)
        except ValueError as error:
            raise ValueError(f"{owner}: {error}") from None


@declared
class ShellEnergyProbe(_BodiesProbe):
    """Strain energies of shells by kind, J, in the columns name_membrane, _bending and _shear.

    Each is the energy of the strains of its kind alone: forces in the plane, moments, and in shells
    with directors the shear across the thickness, which is zero in the others. They add up to the
    strain energy of the shells where sections and laws do not couple membrane and bending.

    Attributes:
        name: Unique name in the model.
        bodies: Names of shells, None for all.
    """

    smooth: ClassVar[bool] = True
    name: str = "shell"

    def __post_init__(self) -> None:
        """Name the columns."""
        name_columns(self, ("membrane", "bending", "shear"))

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        owner = f'ShellEnergyProbe "{self.name}"'
        for name in self.bodies or ():
            if not isinstance(model.get(name), Shell):
                raise ValueError(f'{owner}: {model!r} has no shell "{name}"')
        if not model.shells:
            raise ValueError(f"{owner}: {model!r} has no shells")


@declared
class ElongationProbe(AnyProbe):
    """Elongation of the axis of a body since the start, m, in one column.

    It is the stretch by normal forces: the shortening of the chord by bending, about ``0.6 w^2/l``
    in a cantilever, does not count. Of an SE(3) beam it is the extension of all elements times
    their lengths; of a body in a floating frame the displacement of two interfaces against one
    another along the line that joins them at rest, the axial displacement of linear elements, from
    which with ``stiffening`` the shortening by bending is taken away.

    Attributes:
        name: Unique name in the model, and of the column.
        body: Name of the SE(3) beam or of the body in a floating frame.
        ends: Names of two interfaces of the body; None for its only two. None for a beam.

    Raises:
        TypeError: A name is no string.
        ValueError: An empty name, or ends that are not two.
    """

    smooth: ClassVar[bool] = True
    name: str
    body: str = text()
    ends: Sequence[str] | None = checked(_ends, default=None)

    def __post_init__(self) -> None:
        """Name the column."""
        check_columns(_checks.named(self, self.name), (self.name,))
        _checks.assign(self, columns=(self.name,))

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        owner, body = f'ElongationProbe "{self.name}"', model.get(self.body)
        if isinstance(body, FloatingBody):
            self.interfaces(body)
        elif not isinstance(body, Beam) or body.formulation != "se3":
            raise ValueError(
                f'{owner}: {model!r} has no SE(3) beam or body in a floating frame "{self.body}"'
            )
        elif self.ends is not None:
            raise ValueError(
                f"{owner}: ends must be None for a beam, got {_checks.show(self.ends)}"
            )

    def interfaces(self, body: FloatingBody) -> tuple[int, int]:
        """Return the numbers of the two interfaces in the reduced body.

        Raises:
            ValueError: The body has no such interfaces, or not two.
        """
        names = [interface.name for interface in body.reduced.interfaces]
        ends = tuple(self.ends or names)
        if len(ends) != 2 or not set(ends) <= set(names):
            raise ValueError(
                f'ElongationProbe "{self.name}": ends must be two interfaces of "{self.body}", '
                f"which has {', '.join(names) or 'none'}"
            )
        return names.index(ends[0]), names.index(ends[1])


@declared
class ReductionErrorProbe(AnyProbe):
    """Part of its displacement that a nonlinear reduced body misses, from 0 to 1, in one column.

    The body leaves forces out of balance beside its modes and derivatives: its nonlinear elastic
    forces, on ten functions that answer best to them, and inertia forces and weight, on all. The
    displacement with which it would answer at rest, in the energy norm, is over that with it and
    the body's own (squares of norms add up). Small deflections under gravity are off by the square
    of it; results are off by some per cent at 0.1, where runs warn.

    Attributes:
        name: Unique name in the model, and of the column.
        body: Name of a body in a floating frame that was reduced with ``derivatives``.

    Raises:
        TypeError: A name is no string.
        ValueError: An empty name.
    """

    name: str
    body: str = text()

    def __post_init__(self) -> None:
        """Name the column."""
        check_columns(_checks.named(self, self.name), (self.name,))
        _checks.assign(self, columns=(self.name,))

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        body = model.get(self.body)
        if not isinstance(body, FloatingBody) or body.reduced.polynomial is None:
            raise ValueError(
                f'ReductionErrorProbe "{self.name}": {model!r} has no body "{self.body}" that was '
                "reduced with derivatives"
            )


@declared
class ShellStrainProbe(AnyProbe):
    """Strains and stress resultants of a shell in one triangle, in its material axes.

    Columns: membrane strains name_eps11, _eps22 and _eps12, the last one twice the shear strain;
    curvatures (1/m) relative to the shape at the start name_kappa11, _kappa22 and _kappa12, the
    last one twice the twist; forces per length (N/m) name_n11, _n22, _n12 and moments per length
    (N) name_m11, _m22, _m12 without damping forces. In shells with directors they are means over
    the triangle, and those of the shear across the thickness are left out.

    Attributes:
        name: Unique name in the model.
        shell: Name of the shell.
        position: The triangle is that whose centroid is nearest at the start, shape (3,), m.

    Raises:
        TypeError: A name is no string, or the position does not consist of numbers.
        ValueError: An empty name, or a position of another shape or not finite.
    """

    smooth: ClassVar[bool] = True
    name: str
    shell: str = text()
    position: npt.ArrayLike = vector()

    def __post_init__(self) -> None:
        """Name the columns."""
        name_columns(self, _SHELL_STRAINS + _SHELL_RESULTANTS)

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        owner, shell = f'ShellStrainProbe "{self.name}"', model.get(self.shell)
        if not isinstance(shell, Shell):
            raise ValueError(f'{owner}: {model!r} has no shell "{self.shell}"')

    def nodes(self, model: Structure) -> IntArray:
        """Return the mesh nodes (3,) of the triangle."""
        mesh, body = model.surface, model[self.shell].body
        assert mesh is not None  # checked by validate()
        triangles = mesh.triangles[mesh.bodies[body]]
        away = mesh.points[triangles].mean(axis=1) - np.asarray(self.position)
        nearest: IntArray = triangles[np.argmin((away**2).sum(axis=1))]
        return nearest
