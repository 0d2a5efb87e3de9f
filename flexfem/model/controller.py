# SPDX-License-Identifier: LGPL-3.0-or-later
"""Controllers, which close loops from probes to actuators and loads."""

from collections.abc import Sequence
from dataclasses import field
from typing import Any

from flexfem import _checks
from flexfem._fields import Given, checked, declared, number, owner_of
from flexfem.control.law import Law, SampledLaw
from flexfem.core.load import Load
from flexfem.joints.actuator import Actuator
from flexfem.model.probes.base import AnyProbe, name_columns, strings
from flexfem.model.probes.cable import CableProbe
from flexfem.model.probes.measured import ReactionProbe
from flexfem.model.structure.structure import Structure

__all__ = ["Controller"]


def _law(owner: str, what: str, value: Any) -> Any:
    """Check a function of t and y, or a sampled law."""
    if not callable(value) and not isinstance(value, SampledLaw):
        raise TypeError(
            f"{owner}: {what} must be a function of t and y, or have update(t, y) and state, got "
            f"{_checks.show(value)}"
        )
    if not isinstance(value, SampledLaw):
        _checks.arguments(owner, what, value, "t", "y")
    return value


@declared
class Controller:
    """Feedback from probes to actuators and loads.

    A function ``law(t, y)`` without a sample time acts continuously. It must depend on nothing but
    its arguments, and is called on every rank, several times a step. If it measures functions of
    markers (`Probe`) at nodes of beams, of bodies in floating frames and of rigid bodies, and
    drives actuators, it acts implicitly: on the motion that each step solves for, so that stiff
    gains on light bodies are stable. Other measurements (strains, energies, accelerations, sliders)
    and loads take values extrapolated linearly from the last two accepted steps, which is of second
    order in the step, and stable only if the step resolves the motion that they feed back to.

    Every other law is sampled: it is called once per sample time, on the first rank, with the
    accepted state of that instant, and its outputs are held until the next sample. A sample time is
    a whole multiple of the time step. The integrators take forces at the end of each step, so that
    held outputs act half a time step later than an ideal hold, to second order in the step.

    Sampled laws may read every probe. A joint's force follows an output at once, so that a
    continuous law cannot read it; a sampled law reads the force at the end of the step.

    The outputs are added to the force of an ``Actuator``, and are the amplitude of a load, which
    must have none of its own. Analyses other than motion in time take all outputs as zero.

    Attributes:
        name: unique name in the model.
        inputs: names of probes, or of single columns of theirs.
        outputs: names of actuators and loads.
        law: a function ``law(t, y)`` of time (s) and measurements, shape (inputs,), that returns
            one number per output, or an object with memory, see ``flexfem.control.law``; each run
            works with a copy of its own.
        sample_time: s; None for a continuous law, and for every time step with memory.
        columns: of the history: ``<name>_<output>`` for each output, N or N m for an actuator, the
            factor of a load; a sampled one is that which acts from the row's time on.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: No outputs, one twice, or a sample time that is not positive.
    """

    name: str
    inputs: Given[Sequence[str], tuple[str, ...]] = checked(strings)
    outputs: Given[Sequence[str], tuple[str, ...]] = checked(strings)
    law: Law = checked(_law)
    sample_time: float | None = number(default=None, positive=True)
    columns: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        """Name the columns."""
        if not self.outputs:
            owner = _checks.named(self, self.name)
            raise ValueError(f"{owner}: outputs must hold at least one name, got none")
        name_columns(self, self.outputs)

    @property
    def sampled(self) -> bool:
        """True if its outputs are held between samples."""
        return self.sample_time is not None or isinstance(self.law, SampledLaw)

    def measured(self, model: Structure) -> tuple[tuple[AnyProbe, int], ...]:
        """Probe and column number of every measurement.

        Raises:
            ValueError: The model has no such probe or column, or it is a joint's force, which
                no continuous law can read.
        """
        found: list[tuple[AnyProbe, int]] = []
        for wanted in self.inputs:
            fits = [
                (probe, k)
                for probe in model.of(AnyProbe)
                for k, column in enumerate(probe.columns)
                if probe.name == wanted
            ] or [
                (probe, probe.columns.index(wanted))
                for probe in model.of(AnyProbe)
                if wanted in probe.columns
            ]
            owner = f'{type(self).__name__} "{self.name}"'
            if not fits:
                known = [column for probe in model.of(AnyProbe) for column in probe.columns]
                raise ValueError(
                    f'{owner}: {model!r} has no probe or column "{wanted}", its columns are '
                    f"{_checks.show(', '.join(known), 200)}"
                )
            for probe, _ in fits:
                if isinstance(probe, (ReactionProbe, CableProbe)) and not self.sampled:
                    raise ValueError(
                        f'{owner}: input "{wanted}" of {owner_of(probe)} is known at '
                        "the ends of steps only; give the controller a sample_time"
                    )
            found += fits
        return tuple(found)

    def check(self, model: Structure) -> None:
        """Check inputs and outputs.

        Raises:
            ValueError: The model has no such probe, actuator or load, the load has an amplitude of
                its own, or another controller drives it.
        """
        self.measured(model)
        owner = f'{type(self).__name__} "{self.name}"'
        for output in self.outputs:
            thing = model.get(output)
            if not isinstance(thing, Actuator | Load):
                got = f"it is a {type(thing).__name__}"
                if thing is None:
                    known = [x.name for x in model.joints if isinstance(x, Actuator)]
                    known += [load.name for load in model.loads]
                    got = f"which has {_checks.show(', '.join(known), 200) if known else 'none'}"
                raise ValueError(
                    f'{owner}: output "{output}" must be an Actuator or a load of {model!r}, {got}'
                )
            if isinstance(thing, Load) and thing.amplitude is not None:
                raise ValueError(
                    f'{owner}: {type(thing).__name__} "{output}" has an amplitude of its own'
                )
            users = [c for c in model.of(Controller) if output in c.outputs]
            if users[0] is not self:
                first = f'{type(users[0]).__name__} "{users[0].name}"'
                raise ValueError(f'{owner}: output "{output}" is driven by {first} already')
