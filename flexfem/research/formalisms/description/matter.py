# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matter of bodies: the positions of their points and their strain energy, in UFL.

Matter defines the cells of the mesh, the fields of the elastic displacement, the position of a
point in the floating frame and the energy of a displacement. Everything else is derived. Matter of
one's own is one more class with these members; numbers that may change between runs are
``parameters``, so that no form is compiled twice for another value.

A beam is its axis and, for the rotary inertia of its sections, the vectors along their axes that
the section's points lie on: ``r = axis + y d2 + z d3``, integrated over the section in advance.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from flexfem import _checks
from flexfem.materials.material import Material

__all__ = ["BeamMatter", "Matter", "PlaneStress", "Solid"]

Expr = Any


class Matter(Protocol):
    """Elastic material and finite elements of a body.

    Attributes:
        cell: "interval", "triangle" or "tetrahedron".
        degree: of the Lagrange elements of the elastic displacement.
        components: of the elastic displacement: translations in the axes of the frame, then
            rotations if there are any.
        strain_degree: polynomial degree up to which the strain energy is integrated.
        parameters: numbers of the energy by name.
    """

    @property
    def cell(self) -> str:
        """See above."""

    @property
    def degree(self) -> int:
        """See above."""

    @property
    def components(self) -> int:
        """See above."""

    @property
    def strain_degree(self) -> int:
        """See above."""

    @property
    def parameters(self) -> Mapping[str, float]:
        """See above."""

    def place(self, x: Expr, u: Expr) -> Expr:
        """Local position of a material point x (components of the mesh) displaced by u."""

    def direction(self, u: Expr, e: Expr) -> Expr:
        """A local vector e fixed to the material at a node, after the displacement u."""

    def inertia(self, x: Expr, u: Expr, c: Mapping[str, Expr]) -> list[tuple[Expr, Expr, bool]]:
        """Terms (density, local vector, whether it is a position and not only a direction)."""

    def strain_energy(self, u: Expr, c: Mapping[str, Expr]) -> Expr:
        """Energy per length, area or volume of the mesh."""


@dataclass(frozen=True)
class BeamMatter:
    """Straight Timoshenko beam along the first axis of the frame, linear in its displacements.

    Displacements u and small rotations have the same elements; the strain energy is integrated with
    one point fewer than it takes, which keeps thin beams from locking in shear.

    Args:
        material: elastic constants and density.
        width: of the rectangular section along the third axis, m.
        height: along the second axis, m.
        spatial: True if it bends and twists in space, with six displacements a node; in the plane
            it has three.
        degree: of the elements.
        damping: dissipation relative to the strain energy of the velocities, s.

    Raises:
        ValueError: a value is out of range.
    """

    material: Material
    width: float
    height: float
    spatial: bool = False
    degree: int = 2
    damping: float = 0.0

    cell: ClassVar[str] = "interval"

    def __post_init__(self) -> None:
        """Check the values."""
        _check(self, "width", "height")

    @property
    def components(self) -> int:
        """Displacements of a node."""
        return 6 if self.spatial else 3

    @property
    def strain_degree(self) -> int:
        """Reduced integration."""
        return 2 * self.degree - 1

    @property
    def parameters(self) -> Mapping[str, float]:
        """Inertia and stiffness of the section."""
        m, b, h = self.material, self.width, self.height
        area, about2, about3 = b * h, h * b**3 / 12.0, b * h**3 / 12.0
        modulus = m.shear_modulus
        flat = {
            "density": m.density * area,
            "inertia_height": m.density * about3,
            "axial": m.youngs_modulus * area,
            "shear": 5.0 / 6.0 * modulus * area,
            "bending": m.youngs_modulus * about3,
        }
        if not self.spatial:
            return flat
        long, short = max(b, h), min(b, h)
        # within half a per cent of the series of Saint-Venant (Roark)
        ratio = short / long
        torsion = long * short**3 * (1.0 / 3.0 - 0.21 * ratio * (1.0 - ratio**4 / 12.0))
        return flat | {
            "inertia_width": m.density * about2,
            "bending_width": m.youngs_modulus * about2,
            "torsion": modulus * torsion,
        }

    def place(self, x: Expr, u: Expr) -> Expr:
        """See :class:`Matter`."""
        import ufl

        return ufl.as_vector([x[0] + u[0], *(u[i] for i in range(1, 3 if self.spatial else 2))])

    def direction(self, u: Expr, e: Expr) -> Expr:
        """See :class:`Matter`."""
        import ufl

        if self.spatial:
            return e + ufl.cross(ufl.as_vector([u[3], u[4], u[5]]), e)
        return e + u[2] * ufl.as_vector([-e[1], e[0]])

    def inertia(self, x: Expr, u: Expr, c: Mapping[str, Expr]) -> list[tuple[Expr, Expr, bool]]:
        """See :class:`Matter`."""
        import ufl

        axis = (c["density"], self.place(x, u), True)
        if not self.spatial:
            return [axis, (c["inertia_height"], ufl.as_vector([-u[2], 1.0]), False)]
        return [
            axis,
            (c["inertia_height"], ufl.as_vector([-u[5], 1.0, u[3]]), False),
            (c["inertia_width"], ufl.as_vector([u[4], -u[3], 1.0]), False),
        ]

    def strain_energy(self, u: Expr, c: Mapping[str, Expr]) -> Expr:
        """See :class:`Matter`."""
        d = [u[i].dx(0) for i in range(self.components)]
        if not self.spatial:
            return 0.5 * (
                c["axial"] * d[0] ** 2 + c["shear"] * (d[1] - u[2]) ** 2 + c["bending"] * d[2] ** 2
            )
        return 0.5 * (
            c["axial"] * d[0] ** 2
            + c["shear"] * ((d[1] - u[5]) ** 2 + (d[2] + u[4]) ** 2)
            + c["torsion"] * d[3] ** 2
            + c["bending_width"] * d[4] ** 2
            + c["bending"] * d[5] ** 2
        )


class _Continuum:
    """Matter without rotations: as many displacements as its mesh has dimensions."""

    degree: int
    components: ClassVar[int]

    @property
    def strain_degree(self) -> int:
        """Exact."""
        return 2 * self.degree - 2

    def place(self, x: Expr, u: Expr) -> Expr:
        """See :class:`Matter`."""
        import ufl

        return ufl.as_vector([x[i] + u[i] for i in range(self.components)])

    def direction(self, u: Expr, e: Expr) -> Expr:
        """See :class:`Matter`; a node has no rotation."""
        return e

    def inertia(self, x: Expr, u: Expr, c: Mapping[str, Expr]) -> list[tuple[Expr, Expr, bool]]:
        """See :class:`Matter`."""
        return [(c["density"], self.place(x, u), True)]

    def strain_energy(self, u: Expr, c: Mapping[str, Expr]) -> Expr:
        """Of an isotropic material: "first" is the modulus of the dilatation."""
        import ufl

        strain = ufl.sym(ufl.grad(u))
        return 0.5 * c["first"] * ufl.tr(strain) ** 2 + c["shear"] * ufl.inner(strain, strain)


@dataclass(frozen=True)
class PlaneStress(_Continuum):
    """Thin plate in its plane, the first two axes of the frame; in space it moves as a membrane.

    Args:
        material: elastic constants and density.
        thickness: m.
        degree: of the elements.
        damping: dissipation relative to the strain energy of the velocities, s.

    Raises:
        ValueError: a value is out of range.
    """

    material: Material
    thickness: float
    degree: int = 2
    damping: float = 0.0

    cell: ClassVar[str] = "triangle"
    components: ClassVar[int] = 2

    def __post_init__(self) -> None:
        """Check the values."""
        _check(self, "thickness")

    @property
    def parameters(self) -> Mapping[str, float]:
        """Density and stiffness per area."""
        m, nu = self.material, self.material.poisson_ratio
        return {
            "density": m.density * self.thickness,
            "first": m.youngs_modulus * self.thickness * nu / (1.0 - nu**2),
            "shear": m.shear_modulus * self.thickness,
        }


@dataclass(frozen=True)
class Solid(_Continuum):
    """Isotropic solid.

    Args:
        material: elastic constants and density.
        degree: of the elements.
        damping: dissipation relative to the strain energy of the velocities, s.

    Raises:
        ValueError: a value is out of range.
    """

    material: Material
    degree: int = 2
    damping: float = 0.0

    cell: ClassVar[str] = "tetrahedron"
    components: ClassVar[int] = 3

    def __post_init__(self) -> None:
        """Check the values."""
        _check(self)
        if self.material.poisson_ratio == 0.5:
            raise ValueError("Solid: poisson_ratio must be below 0.5, got 0.5")

    @property
    def parameters(self) -> Mapping[str, float]:
        """Density and Lamé's constants."""
        m, nu = self.material, self.material.poisson_ratio
        return {
            "density": m.density,
            "first": m.youngs_modulus * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)),
            "shear": m.shear_modulus,
        }


def _check(matter: Any, *sizes: str) -> None:
    """Check the common data of all kinds, and sizes that must be positive."""
    owner = type(matter).__name__
    _checks.instance(owner, "material", matter.material, Material)
    for name in sizes:
        _checks.number(owner, name, getattr(matter, name), positive=True)
    _checks.number(owner, "damping", matter.damping, nonnegative=True)
    if matter.degree not in (1, 2, 3):
        raise ValueError(f"{owner}: degree must be 1, 2 or 3, got {matter.degree!r}")
