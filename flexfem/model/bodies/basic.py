# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies: beams, rigid bodies and point masses."""

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, InitVar
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import (
    ZERO,
    Array,
    ArrayOrNone,
    Given,
    checked,
    declared,
    direction,
    instance,
    number,
    rotation,
    settled,
    vector,
)
from flexfem._types import FloatArray
from flexfem.core.marker import Marker
from flexfem.materials.section import Section
from flexfem.materials.section_table import AnySection, SectionTable
from flexfem.materials.thermal_strain import ThermalStrain
from flexfem.mesh.geometry.frames import Orientation
from flexfem.mesh.nurbs.curve import NurbsCurve
from flexfem.model.bodies.shapes import SHAPES, Shape

# Relative to the largest principal moment: plates satisfy the triangle inequality as an equality
_TRIANGLE_TOLERANCE = 1e-9
_SINGULAR = 1e-12
# Angular velocity of bodies that are given none
_AT_REST = _checks.freeze(ZERO)

#: Formulations of beams.
FORMULATIONS = ("se3", "nurbs")
#: Rotations as NURBS elements interpolate them.
INTERPOLATIONS = ("quaternions", "relative_rotation_vectors")
#: Degree of curves through the nodes of a mesh.
_DEGREE = 3

#: Function of arc lengths (k,), metres, along a beam.
_Along = Callable[[FloatArray], npt.ArrayLike]


def _section(owner: str, what: str, value: Any) -> Any:
    """Return a checked section."""
    if not isinstance(value, (Section, SectionTable)) and not callable(value):
        raise TypeError(
            f"{owner}: {what} must be a Section, a SectionTable or a function of the arc length, "
            f"got {_checks.show(value)}"
        )
    return value


def _damping(owner: str, what: str, value: Any) -> Any:
    """Return a checked damping: one number, or one for each strain."""
    if np.ndim(value) == 0:
        return _checks.number(owner, what, value, nonnegative=True)
    values = _checks.array(owner, what, value, (6,))
    if (values < 0.0).any():
        raise ValueError(f"{owner}: {what} must not be negative, got {_checks.show(value)}")
    return values


def _along(*shape: int) -> Any:
    """Declare an array of a shape, or a function along the beam; None where left out."""

    def check(owner: str, what: str, value: Any) -> Any:
        return value if callable(value) else _checks.array(owner, what, value, shape)

    return checked(check, default=None)


@declared
class Beam:
    """Beam along a named group of line cells, or along a NURBS curve.

    A place on the beam is its arc length s from the start, metres, in the initial configuration.
    Unless `rest_curvature` or `prestrain` are given, this configuration is free of stress, however
    curved and twisted it is.

    Attributes:
        name: Unique name in the model.
        section: Stiffness and inertia: a :class:`Section`, a :class:`SectionTable`, or a function
            of s that returns a Section. Two-node elements take means of stiffness and inertia over
            their length, isogeometric ones the stiffness at their quadrature points and integrals
            of the inertia; parts on both sides of a jump of a table deform one after the other.
        group: Line group of the model's mesh; None for that of the beam's name, or with a curve.
        curve: Curve of a beam that needs no mesh; its elements are its knot spans.
        degree: Degree of the curve through the nodes of the group with the formulation "nurbs", 3
            when None; None for others.
        formulation: Element formulation: "se3" for geometrically exact two-node elements on the
            cells of the group, "nurbs" for isogeometric elements. None for "nurbs" where a curve is
            given, else "se3".
        interpolation: Rotations as isogeometric elements interpolate them: by the unit
            "quaternions" of the control points, also when None, or their
            "relative_rotation_vectors" to one control point of each element (Crisfield, Jelenic
            1999); None for others. Both are objective. With the vectors, sections jump a little
            between elements that share more than an end.
        orientation: Approximate direction of e2 in inertial axes: a vector, a function of points
            (n, 3) that returns vectors (n, 3), or None for rotation-minimising frames.
        twist: Angle by which section axes are rotated about e1 from the orientation, radians: a
            number or a function of s (k,) that returns (k,); that of a SectionTable is added.
        rest_curvature: Twist and curvatures (kappa1, kappa2, kappa3) of the stress-free beam in
            section axes, shape (3,), 1/m, or a function of s (k,) that returns (3,) or (k, 3); None
            for those of the initial configuration.
        prestrain: Initial strain, shape (6,): the resultants are the stiffness times the strain
            less this one, so that heat has a positive, pretension a negative extension (O. C.
            Zienkiewicz, R. L. Taylor, The Finite Element Method, 5th ed. (2000), eq. 2.5). Or a
            function of s (k,) and the time (the load factor in statics) that returns (6,) or
            (k, 6), such as a :class:`ThermalStrain`.
        damping: Stiffness-proportional damping, seconds; or one number mu_i for each strain, shape
            (6,): the viscous resultants are `sum over j of sqrt(mu_i mu_j) D_ij` times the rate of
            strain j, which dissipates for all stiffnesses D.
        velocity: Initial velocity of the point of the (extended) body at the inertial origin,
            inertial axes, shape (3,), m/s.
        angular_velocity: Initial angular velocity, inertial axes, shape (3,), rad/s; a point at x
            starts with `velocity + angular_velocity x x`.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: A wrong shape, NaN, a zero orientation, negative damping, or arguments that
            exclude one another.
    """

    name: str
    section: AnySection = checked(_section)
    _: KW_ONLY
    group: str | None = None
    curve: NurbsCurve | None = None
    degree: int | None = None
    formulation: Given[str | None, str] = settled(default=None)
    interpolation: str | None = None
    orientation: Orientation = direction(default=None)
    twist: Given[float | _Along | None, FloatArray | _Along | None] = _along()
    rest_curvature: Given[npt.ArrayLike | _Along | None, FloatArray | _Along | None] = _along(3)
    prestrain: Given[
        npt.ArrayLike | Callable[[FloatArray, float], npt.ArrayLike] | None,
        FloatArray | Callable[[FloatArray, float], npt.ArrayLike] | None,
    ] = _along(6)
    damping: Given[npt.ArrayLike, float | FloatArray] = checked(_damping, default=0.0)
    velocity: Array = vector(default=ZERO)
    angular_velocity: Array = vector(default=ZERO)

    def __post_init__(self) -> None:
        """Set the defaults that depend on the curve."""
        owner = _checks.named(self, self.name)
        formulation, degree = _formulation(
            owner, self.group, self.curve, self.degree, self.formulation
        )
        _checks.assign(
            self,
            group=self.name if self.curve is None and self.group is None else self.group,
            degree=degree,
            formulation=formulation,
            interpolation=_interpolation(owner, formulation, self.interpolation),
        )

    @property
    def varies(self) -> bool:
        """True if its section is not the same everywhere."""
        return not isinstance(self.section, Section)

    @property
    def uniform(self) -> Section:
        """Section of a beam along which it does not vary."""
        assert isinstance(self.section, Section)
        return self.section

    @property
    def strained(self) -> bool:
        """True if it has initial strains: a rest curvature or a prestrain."""
        return self.rest_curvature is not None or self.prestrain is not None

    @property
    def timed(self) -> bool:
        """True if its initial strain may change with time."""
        given = self.prestrain
        return callable(given) and not (isinstance(given, ThermalStrain) and given.constant)

    @property
    def vectors(self) -> bool:
        """True if its elements interpolate relative rotation vectors."""
        return self.interpolation == INTERPOLATIONS[1]


@declared
class RigidBody:
    """Rigid body.

    Attributes:
        name: Unique name in the model.
        mass: Mass, kg.
        inertia: Inertia tensor about the centre of mass in body axes, shape (3, 3), kg m^2; its
            diagonal (3,) is accepted as well.
        position: Initial position of the reference point, inertial axes, shape (3,), metres.
        rotation: Initial orientation of the body axes in inertial axes, shape (3, 3), None for
            none.
        centre: Centre of mass relative to the reference point, body axes, shape (3,), metres.
        velocity: Initial velocity of the reference point, inertial axes, shape (3,), m/s.
        angular_velocity: Initial angular velocity, inertial axes, shape (3,), rad/s. It may be
            given in body axes instead, as ``local_angular_velocity``.
        shape: The body in pictures and contact (:class:`Contact`); None for a small default in
            pictures, and for a body that touches only with surfaces given for it.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: A wrong shape, NaN, both angular velocities, a mass that is not positive, or an
            inertia tensor that no body has (not symmetric, not positive definite, triangle
            inequality violated).
    """

    name: str
    mass: float = number(positive=True)
    inertia: Array = checked(lambda owner, what, value: _inertia_tensor(owner, value))
    _: KW_ONLY
    position: Array = vector(default=ZERO)
    rotation: ArrayOrNone = rotation(default=None)
    centre: Array = vector(default=ZERO)
    velocity: Array = vector(default=ZERO)
    angular_velocity: ArrayOrNone = settled(default=None)
    local_angular_velocity: InitVar[npt.ArrayLike | None] = None
    shape: Shape | None = instance(SHAPES, default=None)

    def __post_init__(self, local: npt.ArrayLike | None) -> None:
        """Take the angular velocity in the axes in which it is given."""
        set_spin(self, local)

    @property
    def twist(self) -> FloatArray:
        """Initial velocity of the reference point and angular velocity, (6,), body axes."""
        back = self.rotation.T
        return np.concatenate([back @ self.velocity, back @ self.angular_velocity])

    @property
    def inertia_matrix(self) -> FloatArray:
        """Inertia matrix (6, 6) about the reference point in body axes, translation first."""
        matrix: FloatArray = inertia_matrices([self])[0]
        return matrix


def inertia_matrices(bodies: Sequence[RigidBody]) -> FloatArray:
    """Inertia matrices (n, 6, 6) of rigid bodies, see :attr:`RigidBody.inertia_matrix`."""
    mass = np.array([body.mass for body in bodies])[:, np.newaxis]
    c = np.array([body.centre for body in bodies]).reshape(-1, 3)
    inertia = np.array([body.inertia for body in bodies]).reshape(-1, 3, 3)
    square = np.sum(c * c, axis=1)[:, np.newaxis, np.newaxis] * np.eye(3)
    steiner = square - c[:, :, np.newaxis] * c[:, np.newaxis]
    return inertia_matrix(mass[:, 0], mass * c, inertia + mass[:, :, np.newaxis] * steiner)


def inertia_matrix(mass: float | FloatArray, moment: FloatArray, inertia: FloatArray) -> FloatArray:
    """Inertia matrices (..., 6, 6), translation first, from mass and moments about one point.

    Args:
        mass: kg, shape (...).
        moment: First moments of mass, (..., 3), kg m.
        inertia: Inertia tensors, (..., 3, 3), kg m^2.
    """
    matrix = np.zeros((*moment.shape[:-1], 6, 6))
    matrix[..., 3:, 3:] = inertia
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., i, i] = mass
        matrix[..., 3 + j, i] = matrix[..., i, 3 + j] = moment[..., k]
        matrix[..., 3 + i, j] = matrix[..., j, 3 + i] = -moment[..., k]
    return matrix


@declared(eq=True)
class PointMass:
    """Mass without rotary inertia, fixed to a marker.

    Attributes:
        name: Unique name in the model.
        mass: Mass, kg.
        marker: Marker that carries it.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: The mass is not positive.
    """

    name: str
    mass: float = number(positive=True, as_given=True)
    marker: Marker = instance(Marker)


def _formulation(
    owner: str, group: str | None, curve: object, degree: int | None, formulation: str | None
) -> tuple[str, int | None]:
    """Return the checked formulation of a beam and the degree of the curve through its group."""
    if group is not None:
        _checks.text(owner, "group", group)
    if formulation is None:
        formulation = "se3" if curve is None else "nurbs"
    _checks.word(owner, "formulation", formulation, FORMULATIONS)
    if degree is not None:
        degree = _checks.count(owner, "degree", degree, 1)
    if formulation == "se3":
        for what, value in (("curve", curve), ("degree", degree)):
            if value is not None:
                raise ValueError(
                    f'{owner}: formulation "se3" has no {what}, got {_checks.show(value)}'
                )
        return formulation, None
    if curve is None:
        return formulation, _DEGREE if degree is None else degree
    _checks.instance(owner, "curve", curve, NurbsCurve)
    if group is not None:
        raise ValueError(f'{owner}: give a curve or a group, got group "{group}" as well')
    if degree is not None:
        raise ValueError(
            f"{owner}: the degree is that of the curve (NurbsCurve.elevate raises it), got {degree}"
        )
    return formulation, None


def _interpolation(owner: str, formulation: str, given: str | None) -> str | None:
    """Return the checked interpolation of a beam's rotations, None unless it is isogeometric."""
    if formulation != "nurbs":
        if given is not None:
            raise ValueError(
                f'{owner}: formulation "{formulation}" has no interpolation, got '
                f"{_checks.show(given)}"
            )
        return None
    if given is None:
        return INTERPOLATIONS[0]
    return _checks.word(owner, "interpolation", given, INTERPOLATIONS)


def _inertia_tensor(owner: str, value: npt.ArrayLike) -> FloatArray:
    """Return the checked inertia tensor of a body, from a matrix or its diagonal."""
    tensor = np.diag(_checks.vector(owner, "inertia", value)) if _is_diagonal(value) else value
    tensor = _checks.array(owner, "inertia", tensor, (3, 3))
    size = float(np.abs(tensor).max())
    if np.abs(tensor - tensor.T).max() > 1e-10 * size:
        raise ValueError(f"{owner}: inertia must be symmetric, got {_checks.show(tensor.tolist())}")
    smallest, middle, largest = np.linalg.eigvalsh(tensor)
    moments = f"principal moments {smallest:.6g}, {middle:.6g}, {largest:.6g}"
    if smallest <= _SINGULAR * size:
        raise ValueError(f"{owner}: inertia must be positive definite, got {moments}")
    if largest > (smallest + middle) * (1.0 + _TRIANGLE_TOLERANCE):
        raise ValueError(
            f"{owner}: inertia must satisfy the triangle inequality (no moment above the sum of "
            f"the other two), got {moments}"
        )
    return tensor


def _is_diagonal(value: npt.ArrayLike) -> bool:
    """Return True if the argument has the shape of a diagonal."""
    try:
        return np.shape(value) == (3,)
    except ValueError:  # ragged: reported as a matrix
        return False


def set_spin(body: Any, local: npt.ArrayLike | None) -> None:
    """Set the angular velocity of a body at the start, inertial axes, shape (3,).

    Args:
        body: The body, with its axes at the start and the velocity in inertial axes, or None.
        local: Angular velocity in body axes, or None.

    Raises:
        TypeError: One does not hold numbers.
        ValueError: Both are given, or one has another shape.
    """
    owner, given = _checks.named(body, body.name), body.angular_velocity
    if local is None:
        spin = _AT_REST if given is None else _checks.vector(owner, "angular_velocity", given)
    elif given is None:
        own = _checks.vector(owner, "local_angular_velocity", local)
        spin = _checks.freeze(body.rotation @ own)
    else:
        raise ValueError(
            f"{owner}: give angular_velocity (inertial axes) or local_angular_velocity (body axes)"
        )
    _checks.assign(body, angular_velocity=spin)
