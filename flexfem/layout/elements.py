# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface of a family of flexible elements to the system."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.layout.tangent_request import EXACT, Strains, TangentRequest

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mpi4py import MPI

    from flexfem.core.nodes.frame_block import FrameBlock
    from flexfem.core.nodes.step_kernels import StepNodes
    from flexfem.core.state import Numbering
    from flexfem.kernels.sequence import Call, Number

__all__ = [
    "DampedElements",
    "ElementFamily",
    "HistoryElements",
    "LumpedElements",
    "MultigridElements",
    "ResultantElements",
    "SequencedElements",
    "StepForces",
    "StepMatrices",
    "SteppedElements",
    "StrainedElements",
    "StresslessElements",
    "TimedElements",
    "TurningElements",
    "one_width",
]


class ElementFamily(Protocol):
    """Residual, tangent and stress resultants of all elements of one formulation on this rank.

    They may come in groups; "all cells" are those of one group after the other. Residuals are inner
    forces and inertia less gravity, in the axes of the nodes: of a block whose nodes have inertial
    axes, (n, 6) arrays hold inertial components in their first three columns.

    Attributes:
        law_owner: name in messages of the first section with a user-defined law, None without one.
        chained: True if nodes are ordered along lines and elements connect consecutive nodes only.
        thin: True if membranes are so much stiffer than bending that steps of motion iterate with
            continued stresses (mixed Newton), see :meth:`continued_strains`.
        stressed: True if the tangent has a geometric stiffness, which :meth:`unstressed` omits.
    """

    law_owner: str | None
    chained: bool
    thin: bool
    stressed: bool

    @property
    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """Local nodes (m, j) of rows and (m, k) of columns of the matrices in :meth:`values`."""
        ...

    @property
    def body(self) -> IntArray:
        """(m,) number of the body in the model, among its kind, that each cell belongs to."""
        ...

    @property
    def viscous(self) -> bool:
        """True if any material is viscous."""
        ...

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """Add ``scale`` times internal, inertia and gravity forces to the block's residual.

        Only the strains of the request have an effect.
        """
        ...

    def values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> FloatArray:  # fmt: skip
        """Entries of the matrices ``scale (k K + C dv + M dw)`` of all cells, flat, row by row.

        ``shifts`` = (dv/dn, dw/dn, k). Rows and columns of a matrix are ``width`` unknowns of each
        node of :attr:`couplings`, node after node; entries of the same place are added.
        """
        ...

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """Add ``scale`` times the same tangent applied to the block's step to its residual."""
        ...

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> Strains | None:
        """Strains at ``frames`` (n, 12), continued linearly along local twists ``steps`` (n, 6).

        None if the family's stresses are not continued: the present ones are used.
        """
        ...

    def unstressed(self) -> Strains | None:
        """Strains without stresses: no geometric stiffness, laws at rest.

        None if the tangent has no geometric stiffness.
        """
        ...

    def accept(self, block: FrameBlock) -> None:
        """Accept the state that the block has accepted (collective)."""
        ...

    def resultants(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Strains and stress resultants (m, 6) in section axes, of all or the ``chosen`` cells.

        They are those at the centres of the cells.
        """
        ...

    def stretches(self, frames: FloatArray) -> FloatArray:
        """Least relative size (m,) of each cell, for measures that can change sign.

        It is the length along the sections' normal of beams, the area projected along the directors
        of shells with directors, and the distances of interfaces of floating bodies. Elements whose
        value is not positive are inverted: they may solve the equations with linear laws, but are
        not physical. Shells without directors measure lengths, which are always positive: ones.
        """
        ...

    def energies(self, frames: FloatArray) -> FloatArray:
        """Strain energies (m,) of all cells, J."""
        ...

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Viscous stress resultants and strains (j, 6) at the points of :attr:`viscous_at`.

        The strains are those that positions make, without initial ones that change with time: what
        damping takes in a step is the mean of the stresses times their change.
        """
        ...

    @property
    def viscous_at(self) -> tuple[IntArray, FloatArray]:
        """Cell (j,) of each point of :meth:`viscosity`, and the size (j,) it represents.

        It is a length in beams, m, and an area in shells, m^2.
        """
        ...

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """Add energy and momenta of the chosen (m,) cells, see ``flexfem.core.nodes.motion``."""
        ...


class StresslessElements:
    """What element families share whose stresses a tangent does not take and that do not damp."""

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> Strains | None:
        """See :class:`ElementFamily`."""
        return None

    def unstressed(self) -> Strains | None:
        """See :class:`ElementFamily`."""
        return None

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """See :class:`ElementFamily`."""
        return np.empty((0, 6)), np.empty((0, 6))

    @property
    def viscous_at(self) -> tuple[IntArray, FloatArray]:
        """See :class:`ElementFamily`."""
        return np.empty(0, dtype=np.int64), np.empty(0)


@runtime_checkable
class SequencedElements(Protocol):
    """Elements whose residual is that of compiled loops alone, with arguments that stay."""

    def residual_calls(
        self, block: FrameBlock, gravity: FloatArray, scale: Number
    ) -> Sequence[Call]:
        """Calls that do what ``add_residual`` does by the present stresses."""
        ...


@runtime_checkable
class StrainedElements(Protocol):
    """Elements that may have initial strains, which may change with time.

    Attributes:
        strained: True if there are any; timed: True if they change. The same on all ranks.
    """

    strained: bool
    timed: bool

    def set_initial_strains(self, t: float, fraction: float = 1.0) -> None:
        """Set a fraction of the initial strains at a time, s."""
        ...

    def eigenstates(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Stresses (j, 6) and what is conjugate to them of the initial strains.

        They are those at the points of ``ElementFamily.viscous_at``. The product of the one and
        minus the change of the other is the work done on the cells, J.
        """
        ...


class StepForces(Protocol):
    """Mean forces of elements over a step, which do the work of energy changes.

    Their methods take the record of the nodes over the step. What rigid motions about the mean
    positions leave alone has no effect: the forces have neither resultant nor moment.

    Attributes:
        centres: (n, 3) mass centres at the nodes, in their axes, m; the rates of a step are those
            of the centres.
        offset: True if elements have mass centres beside those of their nodes.
    """

    centres: FloatArray
    offset: bool

    def begin(self, state: StepNodes, before: FloatArray, share: float) -> None:
        """Start a step.

        Args:
            state: the nodes; of these the frames at the start and the law count.
            before: (n, 12) frames at the start of the last step.
            share: of the strains' change since then that enters the numerical dissipation.
        """
        ...

    def exchange(self, state: StepNodes) -> None:
        """Take the step from its end to its start, until :meth:`begin` is called.

        Args:
            state: the nodes on this way; changes over the last step become opposite.
        """
        ...

    def by_last(
        self, state: StepNodes, before: FloatArray, share: float, scale: float
    ) -> tuple[FloatArray, FloatArray]:
        """Entries of ``scale`` times the derivatives of mean forces by strains of the last step.

        These are the ones at its end, in the numerical dissipation alone, and those at its start.

        Args:
            state: the nodes.
            before: (n, 12) frames at the start of the last step.
            share: see :meth:`begin`.
            scale: see above.

        Returns:
            Entries of matrices by twists at the start of this step, and at that of the last one.
        """
        ...

    def add_force(self, state: StepNodes, scale: float) -> None:
        """Add ``scale`` times mean forces, inertia and weight to the nodes' residual."""
        ...

    def tangent(self, state: StepNodes, scale: float) -> FloatArray:
        """Entries of ``scale`` times their derivatives, as in :meth:`ElementFamily.values`."""
        ...

    def add_action(self, state: StepNodes, scale: float) -> None:
        """Add ``scale`` times the derivatives applied to the steps to the residual.

        The state is that of the last forces.
        """
        ...


@runtime_checkable
class SteppedElements(ElementFamily, Protocol):
    """Elements that may have mean forces over a step, which do the work of energy changes."""

    def step_forces(self, comm: MPI.Intracomm, count: int, dissipates: bool) -> StepForces:
        """Return the mean forces at ``count`` nodes (collective), with numerical dissipation."""
        ...

    def losses(self, before: FloatArray, after: FloatArray, h: float) -> FloatArray:
        """Energies (m,) that damping takes from the cells in a step of size h, s, J.

        The frames of the nodes (n, 12) were those ``before`` and are those ``after`` the step.
        """
        ...


@runtime_checkable
class DampedElements(Protocol):
    """Elements of linear sections whose modes may be damped; their strains are continued."""

    def strain_products(self, strains: Strains, chosen: BoolArray) -> tuple[Strains, Strains]:
        """Strains of the chosen (m,) cells, zero of the others, and integrals of their stresses.

        The product of the latter with other strains, as of ``ElementFamily.continued_strains``, is
        the work of the stresses on them, J.
        """
        ...


@runtime_checkable
class ResultantElements(Protocol):
    """Elements that have stress resultants."""

    @property
    def body(self) -> IntArray:
        """See :class:`ElementFamily`."""
        ...

    @property
    def support(self) -> IntArray:
        """Local nodes (m, k) on which the strains of each cell depend, -1 where it has fewer."""
        ...

    def resultants(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """See :meth:`ElementFamily.resultants`."""
        ...


@runtime_checkable
class StepMatrices(Protocol):
    """Elements that compute the parts of their matrix over a step together with it."""

    def step_values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        out: FloatArray,
    ) -> None:  # fmt: skip
        """Write ``ElementFamily.values`` by velocities, by accelerations, and all in all.

        Args:
            block: the nodes.
            gravity: (3,) m/s^2.
            shifts: as those of ``ElementFamily.values``, with the whole stiffness.
            scale: factor of all.
            out: (3, k), at present stresses. With velocities change accelerations along the axes of
                nodes as well, where translations are integrated in inertial axes.
        """
        ...


@runtime_checkable
class TurningElements(ElementFamily, Protocol):
    """Elements whose matrix leaves out how strain rates change with rotations."""

    def rate_changes(
        self, block: FrameBlock, shifts: FloatArray, scale: float, *, local: bool = False
    ) -> FloatArray:
        """What entries of ``ElementFamily.values`` leave out, (2, k), see there for arguments.

        These are derivatives by positions at fixed rates of increments, if ``local`` at fixed local
        velocities, and by these rates.
        """
        ...


class HistoryDerivatives(Protocol):
    """Derivatives of internal variables of elements at a trial state that was evaluated last.

    The variables of all cells of the rank are (n,) numbers, in the order of
    :meth:`HistoryElements.history`. Ghosts of the blocks' steps are known, and those of residuals
    are left to be added.
    """

    def ended(self) -> FloatArray:
        """Variables (n,) at the end of the step."""
        ...

    def ahead(self, block: FrameBlock, change: FloatArray) -> FloatArray:
        """Their change (n,) by that of the accepted ones and along the block's steps."""
        ...

    def add_ends(self, block: FrameBlock, factors: FloatArray) -> None:
        """Add derivatives of their sum with factors (n,), along local twists, to the residual."""
        ...

    def before(self, factors: FloatArray) -> FloatArray:
        """Derivatives (n,) of the same sum by the accepted variables."""
        ...

    def add_forces(self, block: FrameBlock, change: FloatArray, scale: float) -> None:
        """Add ``scale`` times the change of forces by accepted variables to the residual."""
        ...

    def powers(self, block: FrameBlock) -> FloatArray:
        """Derivatives (n,) of the work of forces on the block's steps by accepted variables."""
        ...


@runtime_checkable
class HistoryElements(Protocol):
    """Elements with internal variables, which advance from one accepted state to the next.

    They learn the time of a step from ``TimedElements.set_time``.

    Attributes:
        remembering: True if there are any; rate_dependent: True if they change with time alone. The
            same on all ranks.
    """

    remembering: bool
    rate_dependent: bool

    def history(self) -> dict[str, tuple[Numbering, FloatArray]]:
        """Accepted internal variables, with their numbering, by a name for checkpoints."""
        ...

    def advance(self, block: FrameBlock) -> None:
        """Accept the internal variables at the time set last and the block's trial state."""
        ...

    def restore_history(self, history: Mapping[str, FloatArray]) -> None:
        """Accept internal variables, by the names of :meth:`history`, at the time set last."""
        ...

    def history_derivatives(self) -> HistoryDerivatives | None:
        """Derivatives of the internal variables, None where there are none (collective)."""
        ...

    def lost(self) -> FloatArray:
        """Energies (m,) that the internal variables of each cell have dissipated, J."""
        ...


@runtime_checkable
class LumpedElements(Protocol):
    """Elements of nodes that are points, whose masses may be lumped: they then couple no nodes.

    Attributes:
        lumped: True if all masses are, on all ranks.
        masses: (n,) lumped masses of the owned nodes, zero for ghosts, kg.
    """

    lumped: bool
    masses: FloatArray


@runtime_checkable
class MultigridElements(Protocol):
    """Elements of nodes that are points, whose matrices an algebraic multigrid can solve.

    Attributes:
        multigrid: True if they fill a continuum: coarse spaces that contain the rigid motions of
            bodies approximate their softest motions, as they do not where a body can bend.
        bulk_over_shear: largest ratio of the moduli at small strains, the same on all ranks.
    """

    multigrid: bool
    bulk_over_shear: float

    def node_masses(self) -> FloatArray:
        """(n,) diagonal of the mass matrix of one direction, kg, of this rank's cells."""
        ...


@runtime_checkable
class TimedElements(Protocol):
    """Elements whose mass changes with time."""

    def set_time(self, t: float) -> None:
        """Set the mass to that of a time, s."""
        ...

    def powers(self, block: FrameBlock, gravity: FloatArray) -> FloatArray:
        """Rates (m,) of the energies of all cells by the change of their masses, W."""
        ...


def one_width(patches: Sequence[IndexArray]) -> IntArray:
    """Rows of nodes of different widths as one array, filled up by -1."""
    width = max((nodes.shape[1] for nodes in patches), default=0)
    rows = [
        np.pad(nodes.astype(np.int64), ((0, 0), (0, width - nodes.shape[1])), constant_values=-1)
        for nodes in patches
    ]
    return np.concatenate([np.empty((0, width), dtype=np.int64), *rows])
