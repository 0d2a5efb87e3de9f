# SPDX-License-Identifier: LGPL-3.0-or-later
"""What can be differentiated: everything else is refused by name."""

from flexfem._checks import InputError
from flexfem.analyses.dynamics import RunOptions
from flexfem.model.model import Model

__all__ = ["check_supported"]


def check_supported(model: Model, options: RunOptions) -> None:
    """Refuse models and options of which the adjoint would miss a part.

    Raises:
        InputError: naming it.
    """
    for kind, things in (
        ("Event", model.events), ("Controller", model.controllers), ("Contact", model.contacts),
        ("ModalDamping", model.modal_dampings),
    ):  # fmt: skip
        if things:
            raise InputError(
                f'gradient: {kind} "{things[0].name}" has no derivatives yet; leave it out'
            )
    chosen = {
        "integrator": "generalized_alpha", "adaptive": False, "linear_solver": "direct",
        "redundant_constraints": "refuse",
    }  # fmt: skip
    for name, value in chosen.items():
        given = getattr(options, name)
        if given != value and not (name == "linear_solver" and given == "auto"):
            raise InputError(f"gradient: {name} must be {value!r}, got {given!r}")
    if options.restart is not None:
        raise InputError("gradient: a motion is differentiated from its start, without restart")
