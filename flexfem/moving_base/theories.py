# SPDX-License-Identifier: LGPL-3.0-or-later
"""One beam on one base by any theory, as cases that compare them need it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flexfem.options import Option

if TYPE_CHECKING:
    from flexfem.moving_base.base import PrescribedBase
    from flexfem.moving_base.properties import BeamProperties

__all__ = ["THEORY_OPTIONS", "beam_by_theory"]

THEORIES = ("consistent", "conventional", "beam", "floating")

#: Options of a case that are arguments of :func:`beam_by_theory`.
THEORY_OPTIONS = (
    Option("theory", str, "consistent", "what the beam is computed with", choices=THEORIES),
    Option("assumed_modes", int, 10, "modes of the assumed-modes theories", minimum=1),
    Option("elements", int, 24, "elements along the beam, also for modes", minimum=3),
    Option("bodies", int, 2, "of theory floating in each segment", minimum=1),
    Option("body_modes", int, 4, "modes of each of these bodies", minimum=0),
    Option("warping", bool, True, "torsion of the channel with its warping held"),
)


def beam_by_theory(
    properties: BeamProperties, base: PrescribedBase, name: str, *, theory: str,
    assumed_modes: int, elements: int, bodies: int, body_modes: int, warping: bool,
) -> Any:  # fmt: skip
    """The beam on its prescribed base by assumed modes, or a model of beams or floating bodies.

    Args:
        properties: the beam, each property a number or piecewise.
        base: its motion with ``position`` and ``rotation``.
        name: of a model.
        theory: "consistent" or "conventional" assumed modes, geometrically exact "beam" elements,
            or bodies in "floating" frames (collective).
        assumed_modes: of the assumed-modes theories.
        elements: along the beam.
        bodies: floating ones in each segment.
        body_modes: of each of them.
        warping: whether torsion includes held warping.
    """
    # each theory imports its own: help needs none of them, and only one reduces finite elements
    if theory == "floating":
        from flexfem.moving_base.floating import floating_model

        return floating_model(
            properties, base, bodies=bodies, modes=body_modes, elements=elements, warping=warping,
            name=name,
        )  # fmt: skip
    if theory == "beam":
        from flexfem.moving_base.exact import exact_model

        return exact_model(properties, base, elements=elements, warping=warping, name=name)
    from flexfem.moving_base.beam import MovingBaseBeam
    from flexfem.moving_base.effects import effects_of

    effects = effects_of(theory, warping=warping)
    return MovingBaseBeam(
        properties=properties, base=base, effects=effects, modes=assumed_modes, elements=elements
    )
