# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of ``contact_peers.py``: numbers, places, and what is measured; without flexfem.

The numbers are the defaults of ``cases/sheet_landing.py`` (without gravity, so that only contact
can change the energy) and ``billiards.py``; the rope over a cylinder has its own.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from time import process_time
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sheet:
    """A square sheet that falls flat onto the plane z = 0."""

    side: float = 0.3
    nodes: int = 13
    thickness: float = 1e-3
    youngs_modulus: float = 5e6
    poisson_ratio: float = 0.45
    density: float = 1100.0
    speed: float = 0.63
    height: float = 2e-3
    t_end: float = 0.02

    @property
    def mass(self) -> float:
        """In kg."""
        return self.density * self.thickness * self.side**2

    @property
    def masses(self) -> Array:
        """Of the nodes (n,), row by row, kg."""
        line = np.ones(self.nodes)
        line[[0, -1]] = 0.5
        parts = np.outer(line, line).ravel()
        return self.mass * parts / parts.sum()


@dataclass(frozen=True)
class Break:
    """Break shot of billiards in space."""

    rows: int = 5
    boxes: int = 4
    radius: float = 0.028575
    mass: float = 0.17
    spacing: float = 1e-4
    box_side: float = 0.06
    box_mass: float = 0.2
    speed: float = 8.0
    run_up: float = 0.05
    t_end: float = 0.1

    @property
    def ball_places(self) -> Array:
        """Centres (b, 3), the cue ball first."""
        pitch = 2.0 * self.radius + self.spacing
        places = [(-pitch - self.run_up, 0.0, 0.0)]
        for row in range(self.rows):
            x = 0.5 * math.sqrt(3.0) * pitch * row
            places += [(x, pitch * (k - 0.5 * row), 0.0) for k in range(row + 1)]
        return np.array(places)

    @property
    def box_places(self) -> Array:
        """Centres (c, 3)."""
        x = self.ball_places[-1, 0] + self.radius + self.spacing + 0.5 * self.box_side
        y = (self.box_side + self.spacing) * (np.arange(self.boxes) - 0.5 * (self.boxes - 1))
        return np.column_stack([np.full(self.boxes, x), y, np.zeros(self.boxes)])

    @property
    def masses(self) -> Array:
        """Of balls and boxes, kg."""
        return np.repeat([self.mass, self.box_mass], [len(self.ball_places), self.boxes])

    @property
    def inertias(self) -> Array:
        """Moments of inertia of balls and boxes, kg m^2."""
        ball, box = 0.4 * self.mass * self.radius**2, self.box_mass * self.box_side**2 / 6.0
        return np.repeat([ball, box], [len(self.ball_places), self.boxes])

    def depth(self, balls: Array, boxes: Array, rotations: Array) -> float:
        """Deepest overlap of balls (b, 3) with each other and with boxes (c, 3), (c, 3, 3), m."""
        apart = np.linalg.norm(balls[:, np.newaxis] - balls, axis=2)
        gap = (apart + np.eye(len(balls))).min() - 2.0 * self.radius
        inside = np.einsum("cij,bci->bcj", rotations, balls[:, np.newaxis] - boxes)
        over = np.abs(inside) - 0.5 * self.box_side
        outside = np.linalg.norm(np.maximum(over, 0.0), axis=2)
        distance = outside + np.minimum(over.max(axis=2), 0.0) - self.radius
        return max(-min(gap, float(distance.min(initial=1.0))), 0.0)


@dataclass(frozen=True)
class Capstan:
    """A rope over a fixed cylinder; both ends are loaded, then one is drawn away."""

    friction: float = 0.3
    angle: float = math.pi
    elements: int = 40
    radius: float = 0.1
    diameter: float = 5e-4
    free_length: float = 0.02
    youngs_modulus: float = 1e10
    density: float = 1400.0
    damping: float = 1e-3
    tension: float = 1.0
    loading: float = 0.02
    pull_speed: float = 0.02
    t_end: float = 0.1

    @property
    def area(self) -> float:
        """Of the rope's section, m^2."""
        return 0.25 * math.pi * self.diameter**2

    @property
    def bending(self) -> float:
        """Bending stiffness of the rope, N m^2."""
        return self.youngs_modulus * math.pi * self.diameter**4 / 64.0

    @property
    def exact(self) -> float:
        """Ratio of the forces at both ends."""
        return math.exp(self.friction * self.angle)

    def line(self) -> Array:
        """Points (n, 2) of the rope from its heavy end, whose segments touch the cylinder."""
        part = self.angle / self.elements
        around = (self.radius + 0.5 * self.diameter) / math.cos(0.5 * part)
        angles = part * np.arange(self.elements, -1, -1)
        wound = around * np.column_stack([np.cos(angles), np.sin(angles)])
        count = math.ceil(self.free_length / (around * part))
        away = np.arange(1, count + 1)[:, np.newaxis] * (self.free_length / count)
        heavy = wound[0] + away[::-1] * [-math.sin(self.angle), math.cos(self.angle)]
        return np.vstack([heavy, wound, wound[-1] - away * [0.0, 1.0]])

    def load(self, t: float) -> float:
        """Force at the light end, N."""
        part = min(t / self.loading, 1.0)
        return self.tension * part**3 * (10.0 - 15.0 * part + 6.0 * part**2)

    def speed(self, t: float) -> float:
        """Speed of the heavy end, m/s."""
        return self.pull_speed * min(t / self.loading, 1.0)

    def drawn(self, t: float) -> float:
        """Way of the heavy end, m."""
        gained = min(t, self.loading)
        return self.pull_speed * (t - gained + 0.5 * gained**2 / self.loading)


@dataclass
class Figures:
    """What one run gives.

    Attributes:
        energy: at the start and after each step, J; parts that a program does not tell are missing.
        depths: deepest penetration in each step, m.
        pulls: time and force of the heavy end of the rope, (s, N).
        momenta: kg m/s.
        seconds: of the processor, without what is spent on measuring.
    """

    energy: list[float] = field(default_factory=list)
    depths: list[float] = field(default_factory=list)
    pulls: list[tuple[float, float]] = field(default_factory=list)
    momenta: list[Array] = field(default_factory=list)
    seconds: float = 0.0

    def timed(self, work: Callable[[], Any]) -> Any:
        """Do some work of the program, and count its time."""
        begin = process_time()
        found = work()
        self.seconds += process_time() - begin
        return found

    def aside(self, work: Callable[[], Any]) -> Any:
        """Measure inside of timed work, and leave its time out."""
        begin = process_time()
        found = work()
        self.seconds -= process_time() - begin
        return found

    def of_bodies(self, scene: Break, velocities: Array, spins: Array) -> None:
        """Take kinetic energy and momentum of balls and boxes from velocities (n, 3)."""
        moving = scene.masses @ (velocities**2).sum(axis=1)
        self.energy.append(0.5 * float(moving + scene.inertias @ (spins**2).sum(axis=1)))
        self.momenta.append(scene.masses @ velocities)

    def summary(self, t_end: float) -> dict[str, float]:
        """Energy made and lost, depth, momentum and ratio of forces, and time of the processor."""
        found = {"seconds": self.seconds / t_end}
        if self.energy:
            energy = np.array(self.energy)
            found["made"] = float((energy.max() - energy[0]) / energy[0])
            found["lost"] = float((energy[0] - energy[-1]) / energy[0])
        if self.depths:
            found["depth"] = float(max(*self.depths, 0.0))
        if self.momenta:
            moved = np.linalg.norm(np.array(self.momenta) - self.momenta[0], axis=1).max()
            found["momentum"] = float(moved / np.linalg.norm(self.momenta[0]))
        if self.pulls:
            pulls = np.array(self.pulls)
            found["force"] = float(pulls[pulls[:, 0] >= 0.9 * t_end, 1].mean())
        return found
