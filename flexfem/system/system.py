# SPDX-License-Identifier: LGPL-3.0-or-later
"""The assembled system on this rank: blocks, their elements and forces, and constraints.

The equations at the trial state, scaled by ``s = beta h^2`` so that nothing grows as the step
shrinks (Bottasso, Dopico, Trainelli 2008): ``s (f_inertia + f_internal - f_external) + G^T L = 0``
and ``Phi = 0`` with ``L = s lambda``.
"""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, field
from functools import cached_property, partial
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.constraints.batch import Constraints
from flexfem.constraints.interface import Interface
from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.contact.contacts import Contacts
from flexfem.core.load import Load
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.prediction import Misses, Prediction
from flexfem.core.state import Numbering, State, counts
from flexfem.kernels.sequence import Call, Number, Step, clear
from flexfem.la.counting_comm import CountingComm, Sent
from flexfem.la.linear_solver import LinearSolver
from flexfem.layout.elements import (
    ElementFamily,
    HistoryElements,
    LumpedElements,
    SequencedElements,
    StrainedElements,
    TimedElements,
)
from flexfem.layout.family import Family
from flexfem.layout.inner_forces import InnerForces
from flexfem.layout.node_loads import NodeForces, NodeMasses
from flexfem.layout.tangent_request import EXACT, Strains, TangentRequest
from flexfem.system.contact_share import ContactShare
from flexfem.system.evaluation import Evaluation
from flexfem.system.modal_dampers import ModalDampers

__all__ = [
    "GYROSCOPIC",
    "MASS",
    "BlockPart",
    "Counters",
    "PartStrains",
    "Shifts",
    "System",
    "Traffic",
]

#: Strains of each part whose stresses are used in tangents; None for the present ones.
PartStrains = Sequence[Strains | None]

#: Ratio of errors below which a prediction is better than another. For a motion that begins at rest
#: all are equal, and the choice must not depend on rounding, and so on the number of ranks.
_BETTER = 0.99


@dataclass
class Counters:
    """Counters of a run."""

    newton_iterations: int = 0
    residual_evaluations: int = 0
    factorizations: int = 0
    mass_factorizations: int = 0
    fallbacks: int = 0


@dataclass
class Traffic:
    """What iterations send since the start of a run or its restart, and the rows that it is for.

    Attributes:
        iterations: number of iterations.
        sent: by this rank in them.
        elimination: of the multipliers that this rank alone has; empty before the first one.
        largest_front: rows of the largest front of those that this rank shares.
    """

    iterations: int = 0
    sent: Sent = field(default_factory=Sent)
    elimination: str = ""
    largest_front: int = 0

    def add(self, sent: Sent, before: Sent) -> None:
        """Add one iteration, from what this rank has sent at its end and at its start."""
        self.iterations += 1
        both = zip(self.sent, sent, before, strict=True)
        self.sent = Sent(*(total + now - then for total, now, then in both))


@dataclass(frozen=True)
class Shifts:
    """Factors of one implicit scheme at one step size.

    Attributes:
        velocity: dv/dn, 1/s.
        acceleration: da/dn, 1/s^2.
        scale: ``beta h^2``, s^2, with which residual and multipliers are scaled.
        stiffness: factor of the stiffness, 1 but for the mass matrix alone.
        local: True for derivatives at fixed local velocities and accelerations, as if translations
            were not integrated in inertial axes.
    """

    velocity: float
    acceleration: float
    scale: float
    stiffness: float = 1.0
    local: bool = False

    @cached_property
    def array(self) -> FloatArray:
        """Array for the compiled loops: (velocity, acceleration, stiffness)."""
        return np.array([self.velocity, self.acceleration, self.stiffness])

    @cached_property
    def dynamics(self) -> FloatArray:
        """Array for the constraint rows: (velocity, scale)."""
        return np.array([self.velocity, self.scale])

    def request(
        self, strains: Strains | None = None, *, drop_compression: bool = False
    ) -> TangentRequest:
        """Request of a part's tangent.

        See :class:`flexfem.layout.tangent_request.TangentRequest`.
        """
        if strains is None and not (drop_compression or self.local):
            return EXACT
        return TangentRequest(strains, drop_compression, self.local)


#: The mass matrix alone, nothing scaled.
MASS = Shifts(velocity=0.0, acceleration=1.0, scale=1.0, stiffness=0.0)
#: The derivatives by local velocities alone, nothing scaled: gyroscopic terms of masses.
GYROSCOPIC = Shifts(velocity=1.0, acceleration=0.0, scale=1.0, stiffness=0.0)


@dataclass
class BlockPart:
    """A block with its elements, masses, forces and contacts.

    Attributes:
        family: the family of the bodies.
        block: the nodes and their state.
        masses, forces: at nodes of this rank; line_forces: inside its elements.
        elements: the element family, None for rigid bodies.
        node_body: (n,) number of the body that each node belongs to.
        node_cluster: (n,) number of its cluster: bodies that share nodes are one matrix.
        interface_nodes: (n_nodes,) local node of each interface node that this rank owns in it,
            else -1.
        contacts: forces of contacts on its nodes, None without contacts.
    """

    family: Family
    block: FrameBlock
    masses: NodeMasses
    forces: NodeForces
    line_forces: list[InnerForces]
    elements: ElementFamily | None
    node_body: IntArray
    node_cluster: IntArray
    interface_nodes: IntArray
    contacts: ContactShare | None = None

    @property
    def kind(self) -> int:
        """Number of the family, the row of the block in the nest."""
        return self.family.kind

    @property
    def owner(self) -> str:
        """Name of the first body in messages, the same on all ranks."""
        return self.family.owner

    def clusters(self) -> tuple[IntArray, IntArray, IntArray]:
        """Clusters with nodes of this rank, their owned nodes in order, and where each starts."""
        owned = self.node_cluster[: self.block.owned]
        nodes = np.argsort(owned, kind="stable")
        clusters, first = np.unique(owned[nodes], return_index=True)
        return clusters, nodes, np.append(first, len(nodes))

    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """Local nodes (m, j) and (m, k) that the elements couple, then forces inside them."""
        elements = [] if self.elements is None else self.elements.couplings
        return [*elements, *((forces.nodes, forces.nodes) for forces in self.line_forces)]

    @cached_property
    def dirichlet_entries(self) -> BoolArray:
        """Flags of entries of elements, masses and forces in a row or column of a fixed unknown."""
        own = np.concatenate([self.masses.nodes, self.forces.nodes]).astype(np.int64)[:, np.newaxis]
        return self.held_entries([*self.couplings(), (own, own)])

    def held_entries(self, couplings: Sequence[tuple[IndexArray, IndexArray]]) -> BoolArray:
        """Flags of entries between local nodes (m, j) and (m, k), as of :attr:`dirichlet_entries`.

        There are fixed unknowns.
        """
        held, masks = self.block.dirichlet, []
        assert held is not None
        for i, j in couplings:
            row, column = (held[k].reshape(len(k), held.shape[1] * k.shape[1]) for k in (i, j))
            masks.append((row[:, :, np.newaxis] | column[:, np.newaxis]).ravel())
        return np.concatenate(masks)

    @property
    def lumped(self) -> bool:
        """True if masses of elements couple no nodes, on all ranks."""
        return isinstance(self.elements, LumpedElements) and self.elements.lumped

    def add_residual(
        self, gravity: FloatArray, factors: FloatArray, scale: float,
        strains: Strains | None = None,
    ) -> None:  # fmt: skip
        """Compute the scaled residual without constraint forces; ghosts are summed to owners.

        ``strains`` are those whose stresses are used, None for the present ones.
        """
        self.block.residual[:] = 0.0
        if self.elements is not None:
            request = EXACT if strains is None else TangentRequest(strains)
            self.elements.add_residual(self.block, gravity, scale, request)
            for forces in self.line_forces:
                forces.add_residual(self.block, factors, scale)
            self.block.add_ghosts()
        if len(self.masses.nodes):
            self.masses.add_residual(self.block, gravity, scale)
        if len(self.forces.nodes):
            self.forces.add_residual(self.block, factors, scale)
        if self.contacts is not None:
            self.contacts.add_residual(scale)

    def residual_steps(self, gravity: FloatArray, factors: FloatArray, scale: Number) -> list[Step]:
        """Steps of a sequence that does what :meth:`add_residual` does by the present stresses."""
        block, elements = self.block, self.elements
        steps: list[Step] = [Call(clear, block.residual)]
        if isinstance(elements, SequencedElements):
            steps += elements.residual_calls(block, gravity, scale)
        elif elements is not None:
            steps.append(partial(_add, elements, block, gravity, scale))
        if elements is not None:
            steps += [partial(_add, one, block, factors, scale) for one in self.line_forces]
            if block.has_ghosts:
                steps.append(block.add_ghosts)
        if len(self.masses.nodes):
            steps.append(self.masses.residual_call(block, gravity, scale))
        if len(self.forces.nodes):
            steps.append(self.forces.residual_call(block, factors, scale))
        if self.contacts is not None:
            contacts = self.contacts
            steps.append(lambda: contacts.add_residual(scale.value))
        return steps


def _add(
    one: ElementFamily | InnerForces, block: FrameBlock, given: FloatArray, scale: Number
) -> None:
    """Add the residual of elements, or of forces inside them, with the present factor."""
    one.add_residual(block, given, scale.value)


class System:
    """All blocks and constraints of a model on this rank.

    Attributes:
        comm: communicator.
        parts: the blocks that exist, in the order of the nest.
        contacts: contacts of all blocks together, none or one.
        repels: True if these repel by barriers.
        thin: True if there are thin elements.
        present: None for each part: tangents take the present stresses.
        interface, constraints: nodes with joints and the rows between them.
        part_of_node, body_of_node, cluster_of_node: part, body and cluster of every interface node.
        gravity: (3,) acceleration in inertial axes, m/s^2.
        counters: counters of the run.
        traffic: messages of its iterations on several ranks.
        linear: choice between factors and iterative solvers of flexible bodies.
        time: time of the trial state, s.
        lead: time by which loads and drives are evaluated later, s: not zero just before or after a
            jump.
        prediction: the best kind of prediction for the last step.
        modal_dampers: dampers of modes, None without any or where nothing moves.
        decayed: True if damping has ended accelerations where the state was made consistent last.
        slowed: True if dampers of joints have ended velocities at the start.
        withheld: (n_owned,) work, J, at the nodes of each part that damping does not take although
            stresses tell so, or takes beside them if negative: of schemes whose accelerations lack
            a part of it, see ``integrators.split`` and ``integrators.ended_accelerations``.
        ended: (n, 6) forces of each part that the accelerations lack since the state was made
            consistent last, whose work in the next step counts there; or none.
        row_forces: computes forces of all rows (r,) for :meth:`reported_forces` (collective); None
            if those of the rows are reported.
    """

    def __init__(
        self,
        comm: CountingComm,
        parts: Sequence[BlockPart],
        interface: Interface,
        constraints: Constraints,
        body_of_node: IntArray,
        cluster_of_node: IntArray,
        loads: Sequence[Load],
        gravity: FloatArray,
        linear: LinearSolver | None = None,
    ) -> None:
        """Store the parts, the interface nodes and the rows."""
        self.comm, self.parts = comm, list(parts)
        self.present: PartStrains = len(self.parts) * (None,)
        found = [part.contacts.contacts for part in self.parts if part.contacts is not None]
        self.contacts: list[Contacts | BarrierContacts] = found[:1]
        self.repels = any(isinstance(contacts, BarrierContacts) for contacts in found)
        self.thin = any(p.elements is not None and p.elements.thin for p in self.parts)
        every: list[Any] = [part.elements for part in self.parts]
        self._strained = [e for e in every if isinstance(e, StrainedElements) and e.strained]
        self._histories = [e for e in every if isinstance(e, HistoryElements)]
        self._timed = [e for e in every if isinstance(e, TimedElements)]
        kinds = [part.kind for part in self.parts]
        self.part_of_node: IntArray = np.array(
            [kinds.index(int(kind)) for kind in interface.kind], dtype=np.int64
        )
        self.body_of_node, self.cluster_of_node = body_of_node, cluster_of_node
        self.interface, self.constraints = interface, constraints
        self._loads, self.gravity = list(loads), gravity
        self._factors = np.ones(len(self._loads))
        self._evaluation: Evaluation | None = None
        self.linear = linear or LinearSolver()
        self.counters, self.traffic = Counters(), Traffic()
        self.time = self.lead = 0.0
        self.withheld = [np.zeros(part.block.owned) for part in self.parts]
        self.ended: list[FloatArray] = []
        self.decayed = self.slowed = False
        self.prediction = Prediction.VELOCITY
        self.modal_dampers: ModalDampers | None = None
        self.row_forces: Callable[[], FloatArray] | None = None

    def part(self, kind: int) -> BlockPart:
        """The part of a family's number."""
        return next(part for part in self.parts if part.kind == kind)

    def reported_forces(self) -> FloatArray:
        """Forces (r,) of all rows at the accepted state, N or N m (collective).

        These are the forces for probes, fields and sampled controllers. Multipliers of a time
        integrator, ``constraints.forces``, belong to its own accelerations and velocities: they may
        oscillate or be means over a step; the next step begins with them, and energies use their
        work. Impulses count as their means over the steps of the last row of the history. The
        forces are computed on request, once a state.
        """
        rows = self.constraints
        if self.row_forces is None or rows.consistent:
            return rows.forces + rows.mean_impulses if rows.split else rows.forces
        if rows.reported is None:
            rows.reported = self.row_forces()
            if rows.split:
                rows.reported = rows.reported + rows.mean_impulses
        return rows.reported

    def begin_row(self) -> None:
        """Begin the steps of one row of the history, over which impulses are means."""
        self.constraints.passed[:], self.constraints.span = 0.0, 0.0
        for contacts in self.contacts:
            if isinstance(contacts, BarrierContacts):
                contacts.begin_row()

    @property
    def unknowns(self) -> int:
        """Number of unknowns of all blocks on all ranks, without multipliers."""
        return sum(p.block.sizes[1] for p in self.parts)

    @property
    def multipliers(self) -> int:
        """Number of multipliers on all ranks."""
        return self.constraints.size_global

    @property
    def factors(self) -> FloatArray:
        """Amplitudes of the loads at the trial time."""
        return self._factors

    @property
    def instant(self) -> float:
        """Time of loads and drives, s."""
        return self.time + self.lead

    def set_time(self, t: float) -> None:
        """Set amplitudes and drives to time ``t`` (s), or by ``lead`` beside it."""
        self.time = t
        instant = self.instant
        for i, load in enumerate(self._loads):
            self._factors[i] = load.factor(instant)
        self.constraints.set_time(instant)
        for elements in self._timed:
            elements.set_time(instant)
        if self._strained and self.timed:
            self.set_initial_strains()
        for contacts in self.contacts:
            contacts.time = t

    @property
    def remembering(self) -> bool:
        """True if elements have internal variables, which depend on the path."""
        return any(elements.remembering for elements in self._histories)

    @property
    def rate_dependent(self) -> bool:
        """True if elements have internal variables that change with time alone."""
        return any(elements.rate_dependent for elements in self._histories)

    @property
    def strained(self) -> bool:
        """True if elements have initial strains."""
        return len(self._strained) > 0

    @property
    def timed(self) -> bool:
        """True if initial strains change with time."""
        return any(elements.timed for elements in self._strained)

    def set_initial_strains(self, fraction: float = 1.0) -> None:
        """Set a fraction of the elements' initial strains at the time of the loads."""
        for elements in self._strained:
            elements.set_initial_strains(self.instant, fraction)

    def damped(self, strains: PartStrains) -> PartStrains:
        """Strains whose stresses include those of dampers of modes (collective)."""
        return strains if self.modal_dampers is None else self.modal_dampers.strains(strains)

    def viscous(self) -> bool:
        """True if elements of a part have damping, on any rank (collective)."""
        own = any(part.elements is not None and part.elements.viscous for part in self.parts)
        return bool(self.comm.allreduce(own, op=MPI.LOR))

    def may_decay(self) -> bool:
        """True if damping may end accelerations at a start (collective)."""
        return bool(self.comm.allreduce(self.constraints.damped, op=MPI.LOR)) or self.viscous()

    def predict(self, law: FloatArray, rates: FloatArray) -> None:
        """Start a step in every block; see ``core.nodes.frame_kernels.predict``."""
        for part in self.parts:
            part.block.predict(law, rates)

    def continued_strains(self, factor: float = -1.0, *, thin: bool = True) -> PartStrains:
        """Strains at the trial state continued along a multiple of the steps (collective).

        Args:
            factor: the multiple.
            thin: True for thin elements only; the others have None.
        """
        if thin and not self.thin:
            return self.present
        strains: list[Strains | None] = []
        for part in self.parts:
            found = None
            if part.elements is not None and (part.elements.thin or not thin):
                part.block.spread_step()
                found = part.elements.continued_strains(part.block.frames, factor * part.block.step)
            strains.append(found)
        return strains

    def accepted_strains(self, *, thin: bool = True) -> PartStrains:
        """Strains of the accepted state; of ``thin`` elements only.

        A prediction that rotates elements stretches them as well: its stresses are not used.
        """
        if thin and not self.thin:
            return self.present
        return [
            p.elements.continued_strains(p.block.frames0, np.zeros_like(p.block.velocity))
            if p.elements is not None and (p.elements.thin or not thin)
            else None
            for p in self.parts
        ]

    def unstressed(self) -> PartStrains:
        """Strains of each part for which the stresses are zero."""
        return [None if p.elements is None else p.elements.unstressed() for p in self.parts]

    def begin_evaluation(self, acceleration: float) -> None:
        """Count an evaluation of the residuals, and find the contacts at the trial state.

        Args:
            acceleration: da/dn of the scheme, 1/s^2.
        """
        self.counters.residual_evaluations += 1
        for contacts in self.contacts:
            contacts.prepare(acceleration)

    def add_constraint_forces(self, multipliers: FloatArray) -> None:
        """Add ``G^T multipliers`` to the residuals of the blocks."""
        for part in self.parts:
            if len(part.interface_nodes):
                self.constraints.add_forces(multipliers, part.interface_nodes, part.block.residual)

    @property
    def evaluation(self) -> Evaluation:
        """Residuals at the ends of steps, as sequences of loops."""
        if self._evaluation is None or self._evaluation.gravity is not self.gravity:
            scale = Number(1.0)
            before: list[Step] = []
            for part in self.parts:
                before += part.residual_steps(self.gravity, self._factors, scale)
            rows = self.constraints
            after = [
                rows.forces_call(rows.multipliers, part.interface_nodes, part.block.residual)
                for part in self.parts
                if len(part.interface_nodes)
            ]
            self._evaluation = Evaluation(
                [part.block for part in self.parts], rows, self.gravity, scale,
                before + self.interface.steps_of_update, after,
            )  # fmt: skip
        return self._evaluation

    def shift(self, sign: float) -> float:
        """Apply the blocks' steps to the positions alone; largest entry on this rank."""
        return float(np.max([part.block.shift(sign) for part in self.parts], initial=0.0))

    def largest_step(self) -> float:
        """Largest entry of the blocks' steps on any rank (collective)."""
        sizes = [np.abs(part.block.owned_step).max(initial=0.0) for part in self.parts]
        largest = float(np.max(sizes, initial=0.0))
        return self.comm.allreduce(largest, op=MPI.MAX) if self.comm.size > 1 else largest

    def accept(self, law: FloatArray, h: float) -> None:
        """End a step: accept the trial state, and choose the best prediction."""
        self.choose_prediction(self.evaluation.accept(law, h), self._remember)

    def take(self) -> None:
        """Accept the trial state with its velocities and accelerations."""
        for part in self.parts:
            part.block.take()
        self._remember()

    def _remember(self) -> None:
        """Update elements, contacts and rows for the accepted state."""
        for part in self.parts:
            if part.elements is not None:
                part.elements.accept(part.block)
        for contacts in self.contacts:
            contacts.accept()
        self.interface.update()
        self.constraints.accept()

    def advance_histories(self) -> None:
        """Accept the internal variables of elements at the trial state, as motions do by accepting.

        For statics, whose steps accept iterates.
        """
        for part in self.parts:
            if isinstance(part.elements, HistoryElements):
                part.elements.advance(part.block)

    def choose_prediction(self, misses: Misses, meanwhile: Callable[[], None]) -> None:
        """Set ``prediction`` by the largest errors of all kinds on any rank (collective).

        If the errors are equal, velocities are used: a motion that begins continues.

        Args:
            misses: errors on this rank.
            meanwhile: called while those of other ranks are under way.
        """
        if self.comm.size > 1:
            largest = np.array(misses)
            request = self.comm.Iallreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
            meanwhile()
            request.Wait()
            misses = tuple(largest.tolist())
        else:
            meanwhile()
        rest, plain, curved = misses
        better = Prediction.ACCELERATION if curved < _BETTER * plain else Prediction.VELOCITY
        self.prediction = Prediction.REST if rest < _BETTER * min(plain, curved) else better

    def reset(self) -> None:
        """Make the trial state equal to the accepted state."""
        for part in self.parts:
            part.block.reset()
        self.constraints.elements.reset()

    def numberings(self) -> dict[str, Numbering]:
        """Numberings of the nodes of every block and of the rows, by the names in :meth:`state`."""
        blocks = {part.block.name: part.block.numbering() for part in self.parts}
        own: dict[str, Numbering] = {}
        for contacts in self.contacts:
            own |= contacts.numberings()
        for elements in self._histories:
            own |= {name: numbering for name, (numbering, _) in elements.history().items()}
        return {**blocks, **self.constraints.numberings(), **own}

    def state(self) -> State:
        """Accepted state of blocks, rows and contacts, time and counters (collective)."""
        values = {
            "time": np.array([self.time]),
            "prediction": np.array([float(self.prediction)]),
            "counters": np.array(astuple(self.counters), dtype=np.float64),
            # those of the step's end: feedback functions differ at the accepted state
            "factors": self._factors.copy(),
        }
        blocks = {part.block.name: part.block.state() for part in self.parts}
        for elements in self._histories:
            blocks |= {name: {"z": z.copy()} for name, (_, z) in elements.history().items()}
        state = State(values, blocks) | self.constraints.state()
        for contacts in self.contacts:
            state |= contacts.state()
        return state

    def doubts(self, state: State) -> str:
        """Return this rank's objection to the rows of a state; empty if there is none.

        Args:
            state: with the names and shapes of :meth:`state`.
        """
        found = [part.block.doubts(state.rows[part.block.name]) for part in self.parts]
        found.append(self.constraints.lines.doubts(state.rows["places"]["places"]))
        found += [contacts.doubts(state) for contacts in self.contacts]
        return next(filter(None, found), "")

    def restore(self, state: State) -> None:
        """Restore a result of :meth:`state` (collective)."""
        self.set_time(float(state.values["time"][0]))
        self._factors[:] = state.values["factors"]
        (prediction,) = counts("prediction", state.values["prediction"])
        self.prediction = Prediction(prediction)
        self.counters = Counters(*counts("counters", state.values["counters"]))
        for part in self.parts:
            part.block.restore(state.rows[part.block.name])
        for elements in self._histories:
            names = elements.history()
            elements.restore_history({name: state.rows[name]["z"] for name in names})
        self.constraints.restore(state)
        for contacts in self.contacts:
            contacts.restore(state)
        self.interface.update()
        self.constraints.follow_wraps()
