# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass, momenta and kinetic energy of a system or of some of its bodies."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.core.nodes import motion
from flexfem.layout.inner_forces import InnerForces
from flexfem.layout.node_loads import NodeForces
from flexfem.model.model import Model
from flexfem.system.system import System

__all__ = ["ChosenBodies", "MomentumMeter"]


class ChosenBodies:
    """Some bodies, as masks over elements, masses, forces and rows.

    Attributes:
        cells: mask over the elements of this rank for each part, empty for rigid bodies.
        masses, forces: one mask for each part; line_forces: masks over those inside elements.
        nodes: mask over the owned nodes of each part.
        sides: (t, 2) True for sides of the rows' terms at chosen bodies, the ground included.
    """

    def __init__(self, system: System, model: Model, names: Sequence[str] | None) -> None:
        """Find the bodies.

        Args:
            system: the system.
            model: its model.
            names: names of bodies, None for all.
        """
        self._parts = system.parts
        member = {
            part.kind: np.array(
                [names is None or body.name in names for body in part.family.bodies], dtype=np.bool_
            )
            for part in system.parts
        }
        self.cells: list[BoolArray] = []
        self.masses: list[BoolArray] = []
        self.forces: list[BoolArray] = []
        self.line_forces: list[list[BoolArray]] = []
        self.nodes: list[BoolArray] = []
        for part in system.parts:
            body = np.empty(0, dtype=np.int64) if part.elements is None else part.elements.body
            self.cells.append(member[part.kind][body])
            of_node = member[part.kind][part.node_body]
            self.nodes.append(of_node[: part.block.owned])
            self.masses.append(of_node[part.masses.nodes])
            self.forces.append(of_node[part.forces.nodes])
            self.line_forces.append([member[part.kind][f.body] for f in part.line_forces])
        numbers = zip(system.interface.kind, system.body_of_node, strict=True)
        of_interface = [bool(member[int(kind)][body]) for kind, body in numbers]
        # the ground's interface node is -1, the last one
        self.sides: BoolArray = np.array([*of_interface, True])[system.constraints.term_nodes]

    def loads(self, part: int) -> list[tuple[NodeForces | InnerForces, BoolArray]]:
        """Forces on a part, and masks of those that act on chosen bodies."""
        forces = self._parts[part]
        inside = zip(forces.line_forces, self.line_forces[part], strict=True)
        return [(forces.forces, self.forces[part]), *inside]

    def motion(self) -> FloatArray:
        """(11,) energy, mass and momenta on this rank, see ``flexfem.core.nodes.motion``."""
        out = np.zeros(motion.WIDTH)
        for part, cells, masses in zip(self._parts, self.cells, self.masses, strict=True):
            if part.elements is not None:
                part.elements.add_motion(part.block, cells, out)
            part.masses.add_motion(part.block, masses, out)
        return out


class MomentumMeter:
    """Momenta and centre of mass of some bodies.

    Attributes:
        mass: of the bodies, kg.
    """

    def __init__(self, system: System, model: Model, bodies: Sequence[str] | None = None) -> None:
        """Choose the bodies by name, None for all (collective: sums their mass)."""
        self._chosen = ChosenBodies(system, model, bodies)
        self.mass: float = system.comm.allreduce(float(self._chosen.motion()[motion.MASS]))

    def update(self) -> FloatArray:
        """(9,) share of this rank in momentum, angular momentum and centre of mass."""
        state = self._chosen.motion()
        centre = state[motion.FIRST : motion.LINEAR] / self.mass
        return np.concatenate([state[motion.LINEAR :], centre])
