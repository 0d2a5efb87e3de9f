# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beam cells of one material: their data and the calls of the compiled loops."""

from dataclasses import dataclass, fields

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.frame_kernels import Nodes, step_changes, step_rates
from flexfem.families.beam_se3.motion import add_cell_motion, cell_rates, cell_twists
from flexfem.families.beam_se3.tangents import LinearSections, linear_matrices, linear_sections
from flexfem.families.common.section_groups import (
    Material,
    about_centres,
    symmetric,
    viscous_factors,
)
from flexfem.forms.beam import beam_forms
from flexfem.kernels.driver import (
    LINE,
    CellKernel,
    Cells,
    Nodal,
    add_forces,
    cell_kernel,
    evaluate_tangents,
)
from flexfem.kernels.form_kernels import compile_forms
from flexfem.lie import se3

__all__ = ["BeamCells", "BeamGroup"]

#: Nodal data of the forms of ``forms.beam`` in the record of the nodes.
_NODAL = {
    "position": (Nodal.POSITION, Nodes.word("frames")),
    "rotation": (Nodal.ROTATION, Nodes.word("frames")),
    "velocity": (Nodal.TWIST, Nodes.word("velocity")),
    "acceleration": (Nodal.TWIST, Nodes.word("acceleration")),
    "turn": (Nodal.TWIST, Nodes.word("turn")),
    "velocity_change": (Nodal.TWIST, Nodes.word("velocity_change")),
    "acceleration_change": (Nodal.TWIST, Nodes.word("acceleration_change")),
}
#: Columns in the data of cells: the length, and behind it the roots of the dampings.
_LENGTH, _DAMPING = 6, 7
#: Forms, and whether their kernels evaluate several cells at once.
_BATCHED = {"residual": True, "stiffness": False, "inertia": False, "action": True}


@dataclass(frozen=True)
class BeamCells:
    """Constant data of cells.

    Attributes:
        cells: (m, 2) nodes.
        body: (m,) number of the beam.
        section: (m,) number of the section.
        frames: (m, 2, 12) section frames at both ends at the start.
        rest: (m, 6) relative twists of the ends without stress, less the prestrain that changes
            with time; strained: (m,) True where they are not those at the start.
        arcs: (m, 2) arc lengths of the ends, m, where something varies along the beam.
        damping: (m, 1) stiffness-proportional damping, s, or (m, 6) of each strain.
    """

    cells: IndexArray
    body: IntArray
    section: IntArray
    frames: FloatArray
    rest: FloatArray
    strained: BoolArray
    arcs: FloatArray
    damping: FloatArray

    def take(self, rows: IntArray | BoolArray) -> "BeamCells":
        """Some of the cells."""
        return BeamCells(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


class BeamGroup:
    """Kernels, tangent and stress resultants of the cells of one material on this rank.

    Attributes:
        residual: kernel of internal, inertia and gravity forces.
        data: constant data of the cells; sections count those of the material.
        cells: the same in the format of the kernel driver; own data are the twists without stress,
            lengths and damping, those of sections ``Material.data``.
        start: (m, 6) relative twists of the ends at the start; lengths: (m,) arc lengths, m.
        centres: (s, 3) mass centres of the sections, m; rotary: (s, 3, 3) inertia about them, kg m.
        turned: (m,) True where section axes differ from the axes of the nodes.
    """

    def __init__(
        self, comm: MPI.Intracomm, data: BeamCells, material: Material, start: FloatArray
    ) -> None:
        """Compile the kernels (collective) and prepare the cells.

        Args:
            comm: communicator.
            data: constant data of this rank's cells.
            material: their material.
            start: (n, 12) frames of this rank's nodes at the start.
        """
        self.data, self._material = data, material
        self._every = np.arange(len(data.cells))
        ends = data.frames
        self.start = np.ascontiguousarray(se3.log(se3.compose(se3.inverse(ends[:, 0]), ends[:, 1])))
        self.lengths = np.linalg.norm(self.start[:, :3], axis=1)
        turns = np.swapaxes(se3.rotation(start[data.cells]), -1, -2) @ se3.rotation(ends)
        self.turned = np.abs(turns - np.eye(3)).max(axis=(1, 2, 3), initial=0.0) > 1e-12
        # one row for all cells whose section axes are the nodes' own
        turns = turns if self.turned.any() else np.tile(np.eye(3), (1, 2, 1, 1))
        self._turns = np.ascontiguousarray(turns.reshape(-1, 2, 9))
        self.cells = Cells(
            nodes=data.cells, turned=self.turned, turns=self._turns,
            own=np.column_stack([data.rest, self.lengths, viscous_factors(data.damping)]),
            section=data.section, sections=material.data, corners=LINE,
        )  # fmt: skip
        self._inertias = symmetric(material.data[:, :21])
        self.centres, self.rotary = about_centres(self._inertias)
        self._linear: LinearSections | None = None
        if material.law is None and not material.damped:
            self._linear = linear_sections(
                symmetric(material.data[:, 21:]), self._inertias[:, 0, 0], self.centres, self.rotary
            )
        kernels = compile_forms(comm, beam_forms, (material.damped, material.law), _BATCHED)
        section = {"inertia": (0, 21), kernels.names[7]: (21, material.data.shape[1] - 21)}
        width = data.damping.shape[1]
        own = {"relative_twist": (0, 6), "length": (_LENGTH, 1), "damping": (_DAMPING, width)}

        def placed(form: str, size: int) -> CellKernel:
            return cell_kernel(kernels[form], size, kernels.names, _NODAL, own, section)

        self.residual, self._action = placed("residual", 12), placed("action", 12)
        self._stiffness, self._inertia = placed("stiffness", 144), placed("inertia", 144)

    def cells_at(self, block: FrameBlock, strains: FloatArray | None) -> Cells:
        """Cells with initial twists from which changes (m, 6) lead to the present twists.

        The changes are those of :meth:`continued_strains`, None for the present ones.
        """
        cells = self.cells
        if strains is None:
            return cells
        own = cells.own.copy()
        own[:, :6] = self.twists(block.frames) - strains
        return Cells(
            nodes=cells.nodes, turned=cells.turned, turns=cells.turns, own=own,
            section=cells.section, sections=cells.sections, corners=cells.corners,
        )  # fmt: skip

    def tangent(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        strains: FloatArray | None = None, *, local: bool = False,
    ) -> FloatArray:  # fmt: skip
        """Matrices (m, 12, 12) ``scale (k K + C dv + M dw)``, ``shifts`` = (dv/dn, dw/dn, k).

        Args:
            block: the nodes.
            gravity: (3,) m/s^2.
            shifts: see above.
            scale: see above.
            strains: (m, 6) as in :meth:`cells_at`.
            local: the derivative K is that at fixed local velocities and accelerations.
        """
        inertial = block.inertial_rates(shifts) and not local
        rates = _rates(block, shifts, inertial=inertial)[np.newaxis]
        values = np.empty((1, len(self.data.cells), 144))
        factors = np.array([[shifts[2], scale]])
        self._evaluate(self.cells_at(block, strains), block, gravity, (rates, factors), values)
        return values.reshape(-1, 12, 12)

    def step_matrices(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        out: FloatArray,
    ) -> None:  # fmt: skip
        """Write the matrices (3, m, 144) of ``StepMatrices`` at the present strains."""
        if self._linear is not None:
            linear_matrices(
                self.cells.memory, self._linear.memory, block.nodes.memory,
                self.twists(block.frames), gravity, np.array([*shifts[:2], scale]), out,
            )  # fmt: skip
            return
        rates = np.stack([_rates(block, own, inertial=True) for own in (
            np.array([0.0, 0.0, 1.0]), shifts * [1.0, 0.0, 1.0], shifts * [0.0, 1.0, 1.0], shifts
        )])  # fmt: skip
        rates[1:3] -= rates[0]
        factors = np.array([[0.0, scale], [0.0, scale], [shifts[2], scale]])
        self._evaluate(self.cells, block, gravity, (rates[1:], factors), out)

    def _evaluate(
        self, cells: Cells, block: FrameBlock, gravity: FloatArray,
        changes: tuple[FloatArray, FloatArray], values: FloatArray,
    ) -> None:  # fmt: skip
        """Evaluate the generated matrices of cells, for some rates and factors."""
        evaluate_tangents(
            self._stiffness.memory, self._inertia.memory, cells.memory, block.nodes.memory, gravity,
            *changes, values,
        )  # fmt: skip

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        strains: FloatArray | None = None, *, local: bool = False,
    ) -> None:  # fmt: skip
        """Add ``scale`` times :meth:`tangent` applied to the block's step to its residual."""
        step_changes(block.nodes.memory, shifts, block.inertial_rates(shifts) and not local)
        add_forces(
            self._action.memory, self.cells_at(block, strains).memory, block.nodes.memory,
            gravity, scale, block.residual,
        )  # fmt: skip

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> FloatArray:
        """Change (m, 6) of the relative twists, continued along local twists ``steps`` of nodes.

        Newton's method for the mixed form, in which stresses are unknowns: large rotations then
        leave no membrane stress of second order in the tangent (Magisano, Leonetti, Garcea, Int.
        J. Numer. Methods Eng. 109 (2017) 1237-1262).
        """
        twists = self.twists(frames)
        back = np.swapaxes(self._turns.reshape(-1, 2, 3, 3), -1, -2)
        halves = steps[self.data.cells].reshape(-1, 2, 2, 3)
        turned = (back[:, :, np.newaxis] @ halves[..., np.newaxis]).reshape(-1, 2, 6)
        change = np.einsum("mij,mj->mi", se3.inverse_tangent(twists), turned[:, 1])
        change -= np.einsum("mij,mj->mi", se3.inverse_tangent(-twists), turned[:, 0])
        continued: FloatArray = twists - self.rest + change
        return continued

    def stresses_of_changes(self, changes: FloatArray) -> FloatArray:
        """Stress resultants (m, 6) of changes (m, 6) of the relative twists."""
        strain = changes / self.lengths[:, np.newaxis]
        return self._material.response(strain, self.data.section)[0]

    @property
    def rest(self) -> FloatArray:
        """Relative twists (m, 6) of the ends without stress, as a view to be written to."""
        return self.cells.own[:, :6]

    @property
    def viscous(self) -> bool:
        """True if the material of the cells is viscous."""
        return self._material.viscous

    def twists(self, frames: FloatArray, at: IntArray | None = None) -> FloatArray:
        """Relative twists (m, 6) of both ends of the given cells, all by default."""
        at = self._every if at is None else at
        twists = np.empty((len(at), 6))
        cell_twists(self.cells.memory, at, frames, twists)
        return twists

    def twist_derivatives(self, frames: FloatArray) -> FloatArray:
        """Derivatives (m, 6, 12) of the relative twists by local twists of the nodes."""
        twists = self.twists(frames)
        back = np.swapaxes(self._turns.reshape(-1, 2, 1, 3, 3), -1, -2)
        count, found = len(twists), []
        for side, changes in enumerate(
            (-se3.inverse_tangent(-twists), se3.inverse_tangent(twists))
        ):
            halves = changes.reshape(-1, 6, 2, 3).swapaxes(1, 2) @ back[:, side]
            found.append(halves.swapaxes(1, 2).reshape(count, 6, 6))
        return np.concatenate(found, axis=2)

    def _strain(
        self, frames: FloatArray, at: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Relative twists and strains (m, 6) of the given cells, all by default."""
        twists = self.twists(frames, at)
        if at is None:
            strain = twists - self.rest
            strain /= self.lengths[:, np.newaxis]
            return twists, strain
        return twists, (twists - self.rest[at]) / self.lengths[at, np.newaxis]

    def stretches(self, frames: FloatArray) -> FloatArray:
        """Lengths (m,) of the cells along the normal of the section, relative to the start."""
        stretched: FloatArray = 1.0 + self.elongations(frames) / self.lengths
        return stretched

    def elongations(self, frames: FloatArray) -> FloatArray:
        """Changes (m,) of these lengths since the start, m."""
        change: FloatArray = self.twists(frames)[:, 0] - self.start[:, 0]
        return change

    def response(
        self, frames: FloatArray, at: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Strains and resultants (m, 6) in section axes, energies (m,) of the cells in J.

        Args:
            frames: (n, 12) frames of the nodes.
            at: numbers of the cells, all by default.
        """
        _, strain = self._strain(frames, at)
        chosen = slice(None) if at is None else at
        resultant, energy = self._material.response(strain, self.data.section[chosen])
        return strain, resultant, energy * self.lengths[chosen]

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Viscous stress resultants and strains (m, 6) of all cells, see ``ElementFamily``."""
        twists, strain = self._strain(block.frames)
        rate, lengths = np.empty_like(twists), self.lengths[:, np.newaxis]
        cell_rates(self.cells.memory, twists, block.nodes.memory, rate)
        rate /= lengths
        damping = self.data.damping
        stress = self._material.viscous_stress(strain, rate, self.data.section, damping)
        return stress, twists / lengths

    def losses(self, change: FloatArray, h: float) -> FloatArray:
        """Energies (m,) that linear damping takes from the cells, see ``SteppedElements``."""
        sections, damping = self.data.section, self.data.damping
        stress = self._material.viscous_stress(change, change / h, sections, damping)
        lost: FloatArray = self.lengths * np.einsum("mi,mi->m", stress, change)
        return lost

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """Add energy and momenta of the chosen (m,) cells, see ``flexfem.core.nodes.motion``."""
        add_cell_motion(self.cells.memory, self._inertias, chosen, block.nodes.memory, motion)


def _rates(block: FrameBlock, shifts: FloatArray, *, inertial: bool) -> FloatArray:
    """Changes (n, 2, 36) of local velocities and accelerations along local twists."""
    rates = np.empty((len(block.frames), 2, 36))
    step_rates(block.nodes.memory, shifts, inertial, rates)
    return rates
