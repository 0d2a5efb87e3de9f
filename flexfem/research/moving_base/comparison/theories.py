# SPDX-License-Identifier: LGPL-3.0-or-later
"""One beam on one base by any theory, as cases that compare them need it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flexfem.options import Option
from flexfem.research.moving_base.effects import THEORIES, effect_names, left_out
from flexfem.research.moving_base.rotations import ROTATIONS

if TYPE_CHECKING:
    from flexfem.research.moving_base.base import PrescribedBase
    from flexfem.research.moving_base.properties import BeamProperties

__all__ = ["THEORY_OPTIONS", "beam_by_theory"]

#: Omitted effects of the complete theory.
_NOTHING = "none"


@dataclass(frozen=True, init=False)
class EffectsOption(Option):
    """Effects that are left out, such as "shear+warping"."""

    def __init__(self, name: str, help: str) -> None:
        """Declare the option; arguments as for :class:`Option`."""
        super().__init__(name, str, _NOTHING, help)

    def check(self, value: Any) -> str:
        """Return the text; see :meth:`Option.check`."""
        text: str = super().check(value)
        try:
            _names(text)
        except ValueError as error:
            raise ValueError(f"must be {self.describe()}, got {value!r}") from error
        return text

    def describe(self) -> str:
        """See :meth:`Option.describe`."""
        return f"none, or names of effects joined by + ({', '.join(effect_names())})"


def _names(text: str) -> list[str]:
    """Names of effects in a text.

    Raises:
        ValueError: there is no such effect.
    """
    return [] if text == _NOTHING else left_out(text.split("+"))


#: Options that only the assumed-modes theories have.
_ASSUMED = (
    Option("rotations", str, "theory", "of sections to second order: the theory's own, or others",
           choices=("theory", *ROTATIONS)),
    EffectsOption("leave_out", "effects left out of assumed modes, such as shear+extension"),
    Option("damping_ratio", float, 0.0, "of every assumed mode", minimum=0.0),
    Option("initial_u2", float, 0.0, "of the tip at the start, bent by loads there", unit="m"),
    Option("initial_u3", float, 0.0, "of the tip at the start", unit="m"),
    Option("initial_theta1", float, 0.0, "twist of the tip at the start", unit="rad"),
    Option("initial_u2_rate", float, 0.0, "of the tip at the start, so shaped", unit="m/s"),
    Option("initial_u3_rate", float, 0.0, "of the tip at the start", unit="m/s"),
    Option("initial_theta1_rate", float, 0.0, "of the tip at the start", unit="rad/s"),
)  # fmt: skip

#: Options of a case that are arguments of :func:`beam_by_theory`.
THEORY_OPTIONS = (
    Option("theory", str, "consistent", "theory of the beam",
           choices=(*THEORIES, "beam", "floating")),
    Option("assumed_modes", int, 10,
           "modes of the assumed-modes theories, besides two static functions of the stretch",
           minimum=1),
    Option("elements", int, 24, "elements along the beam, also for modes", minimum=3),
    Option("bodies", int, 8, "of theory floating in each segment", minimum=1),
    Option("body_modes", int, 0, "modes of each of these bodies", minimum=0),
    Option("warping", bool, True, "torsion of the channel with restrained warping"),
    *_ASSUMED,
)  # fmt: skip


def beam_by_theory(
    properties: BeamProperties, base: PrescribedBase, name: str, *, theory: str,
    assumed_modes: int, elements: int, bodies: int, body_modes: int, warping: bool, **assumed: Any,
) -> Any:  # fmt: skip
    """The beam on its prescribed base by assumed modes, or a model of beams or floating bodies.

    Args:
        properties: the beam, each property a number or piecewise.
        base: its motion with ``position`` and ``rotation``.
        name: of a model.
        theory: "consistent", "premature" or "conventional" assumed modes, geometrically exact
            "beam" elements, or bodies in "floating" frames (collective).
        assumed_modes: of the assumed-modes theories; two static functions of the stretch come on
            top.
        elements: along the beam.
        bodies: floating ones in each segment.
        body_modes: of each of them.
        warping: whether torsion includes restrained warping.
        assumed: of the assumed-modes theories: "rotations" of sections ("theory": its own),
            "leave_out" (effects joined by +), "damping_ratio" of all functions, "initial_u2",
            "initial_u3" (m) and "initial_theta1" (rad) of the tip at the start, and their rates
            "initial_u2_rate", "initial_u3_rate" and "initial_theta1_rate".

    Raises:
        TypeError: an argument has no such name.
        ValueError: options of assumed modes were given for other theories.
    """
    defaults = {option.name: option.default for option in _ASSUMED}
    for key, value in assumed.items():
        if key not in defaults:
            raise TypeError(f"beam_by_theory() got an unexpected keyword argument '{key}'")
        if theory not in THEORIES and value != defaults[key]:
            raise ValueError(f"theory '{theory}': {key} is for assumed modes, got {value}")
    # each theory imports its own: help needs none of them, and only one reduces finite elements
    if theory == "floating":
        from flexfem.research.moving_base.comparison.floating import floating_model

        return floating_model(
            properties, base, bodies=bodies, modes=body_modes, elements=elements, warping=warping,
            name=name,
        )  # fmt: skip
    if theory == "beam":
        from flexfem.research.moving_base.comparison.exact import exact_model

        return exact_model(properties, base, elements=elements, warping=warping, name=name)
    from flexfem.research.moving_base.beam import MovingBaseBeam
    from flexfem.research.moving_base.effects import effects_of

    given = {**defaults, **assumed}
    without = [*_names(given["leave_out"]), *([] if warping else ["warping"])]
    rotations = "" if given["rotations"] == "theory" else given["rotations"]
    starts = [
        {name: given[f"initial_{name}{rate}"] for name in ("u2", "u3", "theta1")}
        for rate in ("", "_rate")
    ]
    displacement, velocity = (start if any(start.values()) else None for start in starts)
    return MovingBaseBeam(
        properties=properties, base=base, modes=assumed_modes, elements=elements,
        effects=effects_of(theory, without=without, rotations=rotations),
        damping_ratio=given["damping_ratio"], displacement=displacement, velocity=velocity,
    )  # fmt: skip
