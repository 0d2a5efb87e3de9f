# SPDX-License-Identifier: LGPL-3.0-or-later
"""Deployable mesh reflector: a ring truss with two nets, opened by one cable.

A ring of ``--bays`` parallelograms: battens of the height stand at the corners of a regular
polygon, longerons join their lower and upper ends, all of them tubes, hinged across each bay. When
it is folded, longerons are nearly parallel to the battens, every second one of which is raised by a
longeron's length. Gears at the upper hinges give two neighbouring bays the same angle. A telescopic
diagonal of each bay, with a damper, gets shorter as it opens; one cable runs along all diagonals
over eyelets at their ends, and a winch hauls it in, with zero speed at the start and at the end. A
latch locks each bay that reaches the angle ``--latch-angle``. One batten is held.

The front net hangs from the upper ends of the battens, the rear net from the lower ones: triangles
of ``--rings`` rings, paraboloids with edge cables, tied to one another inside ``--tied`` of the
radius. Their plan is that of constant force densities (Schek, Comput. Methods Appl. Mech. Eng. 3
(1974) 115-134); heights of tied nodes are those of the paraboloids, and the ties' forces follow.
Folded, all of their cables are slack. They become taut when the ring opens. Cables do not touch.

``--bays`` must be a multiple of 6, and ``--rings`` one of bays / 6, not of bays / 6 alone: an edge
cable in one piece between two battens would be as long as the longeron beside it, and taut in the
folded ring. ``--depth`` is less than half of the height, or the nets would cross. Coordinates of
the nets are 18 times rings (rings + 1), and 6; with ``--bays 24 --rings 104`` there are 196,566.

History: ``radius``, half of the distance of opposite battens, m; ``level``, largest difference of
the heights of battens, m; ``cable_tension``, ``cable_end_tension`` (N) and ``cable_stretch`` (m) of
the driving cable; ``centre_x, centre_y, centre_z``, the middle of the front net, m;
``surface_rms``, root mean square of the distances of at most a hundred nodes of it inside the ties
from their places in the design, m; ``gap``, largest distance of two points that a joint holds
together, m: how well all loops are closed; and the energies, J: ``energy_kinetic``,
``energy_strain``, ``energy_gravity``, ``energy_work``, ``energy_dissipation`` and
``energy_balance``.

Slack cables have little damping of their own (``--slack-damping``), by which nodes follow their
neighbours. Without it a net is a gas of nodes that rebound from their cables, in other places in
each step: 14 instead of 4.4 iterations a step, and latches that close from 40 s on.
Nets of many rings in long steps take fewer iterations with ``--dissipating-catch``, and with less
slack damping, beyond which rows of their nodes buckle in a step (2e-6 s with 104 rings and 0.5 s).

Expected: all latches close from 46.8 to 47.1 s, ``radius`` ends at 3.0005 m, ``level`` at 8 mm, and
the middle of the front net within 1.3 mm of the design (``surface_rms``). The winch does 9.72 J of
work; 3.94 J stay in the nets, dampers take 5.78 J, and 0.0035 J are numerical dissipation.

Paper: Li, Liu, Tian, Hu, Song, Proc. IMechE K 230 (2016), deploys a reflector with more than
190,000 coordinates. Run: ``mpirun -n 2 python cases/mesh_reflector.py``.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

import flexfem as ff

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
UP = np.array([0.0, 0.0, 1.0])
SECTORS = 6  # of the nets
SLACK = 1e-3  # by which folded cables are shorter than without tension
SAMPLES = 100  # nodes of the front net that the history tells of


@dataclass(frozen=True)
class Ring:
    """Geometry of the ring; m, rad."""

    bays: int
    radius: float
    height: float

    @property
    def longeron(self) -> float:
        """Length of a longeron."""
        return 2.0 * self.radius * math.sin(math.pi / self.bays)

    @property
    def turns(self) -> Array:
        """Directions of the battens (N,) from the middle."""
        return 2.0 * math.pi * np.arange(self.bays) / self.bays

    def feet(self, angle: float) -> Array:
        """Lower ends of the battens (N, 3), with so large an angle between them and longerons."""
        r = self.radius * math.sin(angle)
        raised = (np.arange(self.bays) % 2) * self.longeron * math.cos(angle)
        return np.column_stack([r * np.cos(self.turns), r * np.sin(self.turns), raised])

    def across(self, bay: int) -> Array:
        """Axis of the hinges of a bay, outwards."""
        turn = 2.0 * math.pi * (bay + 0.5) / self.bays
        return np.array([math.cos(turn), math.sin(turn), 0.0])

    def ends(self, bay: int) -> tuple[int, int]:
        """Battens at whose lower and upper end a bay's diagonal is."""
        first, second = bay, (bay + 1) % self.bays
        return (first, second) if first % 2 == 0 else (second, first)

    def diagonal(self, bay: int, angle: float) -> tuple[Array, Array]:
        """Both ends of a bay's diagonal."""
        low, high = self.ends(bay)
        feet = self.feet(angle)
        return feet[low], feet[high] + self.height * UP


@dataclass(frozen=True)
class Nets:
    """Both nets and their ties: design, forces and folded state; m, N."""

    ring: Ring
    rings: int
    depth: float
    tied: float
    density: float
    edge_force: float
    stiffness: float
    edge_stiffness: float

    @cached_property
    def plan(self) -> tuple[Array, Numbers, Numbers]:
        """Nodes (n, 2) of a triangular grid, cables (m, 2), and the ring (n,) of each node."""
        n, corner = self.rings, self.ring.radius * np.exp(2j * np.pi * np.arange(7) / SECTORS)
        number, places, rings = {(0, 0, 0): 0}, [0j], [0]
        for j in range(1, n + 1):
            for s in range(SECTORS):
                for i in range(j):
                    number[j, s, i] = len(places)
                    places.append((corner[s] * (j - i) + corner[s + 1] * i) / n)
                    rings.append(j)

        def node(j: int, s: int, i: int) -> int:
            return number[j, (s + i // j) % SECTORS, i % j] if j else 0

        pairs = set()
        for s in range(SECTORS):
            for j in range(1, n + 1):
                for i in range(j):
                    pairs.add((node(j, s, i), node(j, s, i + 1)))
                    pairs.add((node(j - 1, s, i), node(j, s, i)))
                    pairs.add((node(j - 1, s, i), node(j, s, i + 1)))
        cables = np.array(sorted({(min(pair), max(pair)) for pair in pairs}))
        plan = np.array(places)
        return np.column_stack([plan.real, plan.imag]), cables, np.array(rings)

    @property
    def on_edge(self) -> npt.NDArray[np.bool_]:
        """True for the cables (m,) along the edge."""
        _, cables, ring_of = self.plan
        found: npt.NDArray[np.bool_] = (ring_of[cables] == self.rings).all(axis=1)
        return found

    @property
    def corners(self) -> Numbers:
        """Nodes at the battens, in their order."""
        count = SECTORS * self.rings
        first = len(self.plan[0]) - count
        found: Numbers = first + np.arange(self.ring.bays) * (count // self.ring.bays)
        return found

    @cached_property
    def design(self) -> tuple[Array, Array, Numbers, Array, Array]:
        """Nodes (n, 3) of the front and of the rear net, tied ones, tensions of cables and ties."""
        from scipy.sparse import csr_array, diags_array
        from scipy.sparse.linalg import spsolve

        plan, cables, ring_of = self.plan
        count, corners = len(plan), self.corners
        pieces = SECTORS * self.rings // self.ring.bays
        q = np.where(self.on_edge, self.edge_force * pieces / self.ring.longeron, self.density)
        ends = (np.repeat(np.arange(len(cables)), 2), cables.ravel())
        signs = np.tile([1.0, -1.0], len(cables))
        C = csr_array((signs, ends), shape=(len(cables), count))
        D = (C.T @ diags_array(q) @ C).tocsc()

        def solved(values: Array, known: Numbers) -> Array:
            """Values that are in equilibrium at all other nodes."""
            free = np.setdiff1d(np.arange(count), known)
            found = values.copy()
            found[free] = spsolve(D[free][:, free], -(D[free][:, known] @ values[known]))
            return found

        places = plan.copy()
        places[corners] = self.ring.feet(0.5 * math.pi)[:, :2]
        places = solved(places, corners)
        sag = self.depth * (1.0 - (places**2).sum(axis=1) / self.ring.radius**2)
        tied = np.flatnonzero(ring_of <= self.tied * self.rings)
        sag = solved(sag, np.union1d(tied, corners))
        front = np.column_stack([places, self.ring.height - sag])
        rear = np.column_stack([places, sag])
        lengths = np.linalg.norm(front[cables[:, 0]] - front[cables[:, 1]], axis=1)
        return front, rear, tied, q * lengths, (D @ sag)[tied]

    @cached_property
    def members(self) -> tuple[Numbers, Array, Array]:
        """Cables (k, 2) of front, rear and ties, their stiffness and rest length (k,)."""
        front, rear, tied, tension, ties = self.design
        cables = self.plan[1]
        count = len(front)
        pairs = np.concatenate([cables, cables + count, np.column_stack([tied, tied + count])])
        places = np.concatenate([front, rear])
        lengths = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
        own = np.where(self.on_edge, self.edge_stiffness, self.stiffness)
        stiffness = np.concatenate([own, own, np.full(len(tied), self.stiffness)])
        forces = np.concatenate([tension, tension, ties])
        if not (forces > 0.0).all():  # those of cables are positive
            raise ValueError(
                f"ties near the edge would have to press with tied {self.tied:g}: take a smaller "
                "one, of which there are fewer"
            )
        return pairs, stiffness, lengths / (1.0 + forces / stiffness)

    def folded(self, angle: float) -> Array:
        """Places (2 n, 3) of all nodes between the folded battens, where all cables are slack."""
        from scipy.optimize import minimize
        from scipy.sparse import csr_array

        pairs, _, rest = self.members
        places, fixed = self._guess(angle)
        free = np.setdiff1d(np.arange(len(places)), fixed)
        bound, rows = (1.0 - SLACK) * rest, np.repeat(np.arange(len(pairs)), 2)
        signs = np.tile([-1.0, 1.0], len(pairs))
        C = csr_array((signs, (rows, pairs.ravel())), shape=(len(pairs), len(places)))
        back = C.T.tocsr()

        def excess(flat: Array) -> tuple[float, Array]:
            """Half the squares of all lengths beyond the bounds, and the derivative."""
            places[free] = flat.reshape(-1, 3)
            along = C @ places
            lengths = np.linalg.norm(along, axis=1)
            over = np.maximum(lengths - bound, 0.0)
            slopes = back @ ((over / lengths)[:, np.newaxis] * along)
            return 0.5 * float(over @ over), slopes[free].ravel()

        options = {"maxiter": 5000, "ftol": 0.0, "gtol": 1e-14}
        found = minimize(excess, places[free].ravel(), jac=True, method="L-BFGS-B", options=options)
        places[free] = found.x.reshape(-1, 3)
        lengths = np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1)
        worst = float((lengths / rest).max()) - 1.0
        if worst > 0.0:
            raise ValueError(
                "the folded nets do not fit between the battens with edge_force "
                f"{self.edge_force:g}, depth {self.depth:g} and tied {self.tied:g}: a cable would "
                f"be stretched by {100.0 * worst:.2g} %; smaller ones leave more room, and so do a "
                "smaller net_tension or start_angle and stiffer nets"
            )
        return places

    def _guess(self, angle: float) -> tuple[Array, Numbers]:
        """Sectors of the polygon mapped onto those of the folded ring, and the nodes at battens."""
        front, rear, *_ = self.design
        ring, corners, feet = self.ring, self.corners, self.ring.feet(angle)
        turn = np.arctan2(front[:, 1], front[:, 0]) % (2.0 * math.pi)
        first = np.minimum((turn * ring.bays / (2.0 * math.pi)).astype(int), ring.bays - 1)
        second = (first + 1) % ring.bays
        sides = np.stack([front[corners][first, :2], front[corners][second, :2]], axis=2)
        parts = np.linalg.solve(sides, front[:, :2, np.newaxis])
        middle = feet[:, 2].mean() * UP
        low = middle + parts[:, 0] * (feet[first] - middle) + parts[:, 1] * (feet[second] - middle)
        high = low + (front[:, 2:] - rear[:, 2:]) * UP
        low[corners], high[corners] = feet, feet + ring.height * UP
        return np.concatenate([high, low]), np.concatenate([corners, corners + len(front)])


def build(
    *, bays: int, rings: int, elements: int, radius: float, height: float, depth: float,
    tied: float, net_tension: float, edge_force: float, net_stiffness: float,
    edge_stiffness: float, net_mass: float, net_damping: float, slack_damping: float,
    dissipating_catch: bool, start_angle: float, latch_angle: float, deployment: float, haul: float,
    driving_stiffness: float, brake: float, diameter: float, wall: float, youngs_modulus: float,
    density: float, damping: float,
) -> ff.Model:  # fmt: skip
    """The ring with its drive, and both nets."""
    if bays % SECTORS:
        raise ValueError(f"bays must be a multiple of {SECTORS}, got {bays}")
    if rings % (bays // SECTORS):
        raise ValueError(f"rings must be a multiple of bays / {SECTORS}, got {rings}")
    if rings == bays // SECTORS:
        raise ValueError(
            f"rings must be {2 * rings} at least with {bays} bays, got {rings}: edge cables in one "
            "piece between battens would be taut in the folded ring"
        )
    if 2.0 * depth >= height:
        raise ValueError(
            f"depth must be less than half of the height, {0.5 * height:g} m, got {depth:g}: the "
            "nets would cross"
        )
    if start_angle >= latch_angle:
        raise ValueError(f"start_angle must be less than latch_angle, got {start_angle}")
    if 2.0 * wall >= diameter:
        raise ValueError(f"wall must be less than half of diameter, got {wall}")
    ring, start = Ring(bays, radius, height), math.radians(start_angle)
    nets = Nets(ring, rings, depth, tied, net_tension, edge_force, net_stiffness, edge_stiffness)
    metal = ff.Material(youngs_modulus, 0.3, density)
    tube = ff.Section.tube(1e-3 * (diameter - 2.0 * wall), 1e-3 * diameter, metal)
    feet = ring.feet(start)
    heads = feet + height * UP
    lines = {f"batten_{k}": (feet[k], heads[k]) for k in range(bays)}
    for k in range(bays):
        j = (k + 1) % bays
        lines |= {f"lower_{k}": (feet[k], feet[j]), f"upper_{k}": (heads[k], heads[j])}
    model = ff.Model("mesh_reflector", mesh=ff.LineMesh.straight(lines, elements))
    model.add(*(ff.Beam(name, tube, damping=damping) for name in lines))
    model.add(ff.Rigid("arm", ff.Ground(feet[0]), foot(0)))
    for k in range(bays):
        _add_bay(model, ring, k, start, math.radians(latch_angle))
        _add_diagonal(model, ring, k, start, tube, brake)
    for k in range(1, bays):
        bay = f"upper_{k - 1}", f"upper_{k}"
        model.add(
            ff.Gear(f"gear_{k}", head(k), ff.Marker(bay[0], "end"), head(k),
                    ff.Marker(bay[1], "start"), axis=ring.across(k - 1),
                    second_axis=ring.across(k), ratio=-1.0)
        )  # fmt: skip
    _add_drive(model, ring, start, deployment, haul, driving_stiffness)
    net = {"mass_per_length": net_mass, "damping": net_damping}
    net |= {"slack_damping": slack_damping, "dissipating_catch": dissipating_catch}
    _add_nets(model, nets, start, net)
    model.add(ff.Probe("ring", [foot(k) for k in range(bays)], ("radius", "level"), _measure))
    hinged = [one for one in model.joints if isinstance(one, ff.Revolute | ff.Spherical)]
    ends = [marker for one in hinged for marker in one.markers]
    model.add(ff.Probe("loops", ends, ("gap",), _gap))
    model.add(ff.EnergyProbe())
    return model


def foot(k: int) -> ff.Marker:
    """Lower end of a batten."""
    return ff.Marker(f"batten_{k}", "start")


def head(k: int) -> ff.Marker:
    """Upper end of a batten."""
    return ff.Marker(f"batten_{k}", "end")


def _measure(t: float, *feet: ff.MarkerState) -> tuple[float, float]:
    """Half of the distance of opposite battens, and the largest difference of heights."""
    places = np.array([one.position for one in feet])
    across = places[0, :2] - places[len(feet) // 2, :2]
    return 0.5 * float(np.linalg.norm(across)), float(np.ptp(places[:, 2]))


def _gap(t: float, *ends: ff.MarkerState) -> tuple[float]:
    """Largest distance of two points, one after the other, that a joint holds together."""
    places = np.array([one.position for one in ends])
    return (float(np.linalg.norm(places[::2] - places[1::2], axis=1).max()),)


def _add_bay(model: ff.Model, ring: Ring, k: int, start: float, latch: float) -> None:
    """Hinges of the longerons of a bay and its latch."""
    j, axis = (k + 1) % ring.bays, ring.across(k)
    for level, place in (("lower", foot), ("upper", head)):
        for batten, end in ((k, "start"), (j, "end")):
            bar = ff.Marker(f"{level}_{k}", end)
            hinge = ff.Revolute(f"hinge_{level}_{k}_{end}", place(batten), bar, axis=axis)
            model.add(hinge)
            if (level, end) == ("lower", "start"):
                model.add(ff.Lock(f"lock_{k}", hinge, locked=False))
    feet = ring.feet(start)
    along = (feet[j] - feet[k]) / ring.longeron
    upwards = 1.0 if k % 2 == 0 else -1.0

    def closing(t: float, batten: ff.MarkerState, bar: ff.MarkerState) -> float:
        rise = upwards * float((batten.rotation @ UP) @ (bar.rotation @ along))
        return rise - math.cos(latch)

    model.add(
        ff.Event(f"latch_{k}", (foot(k), ff.Marker(f"lower_{k}", "start")), closing,
                 [ff.LockJoint(f"lock_{k}")], direction=-1)
    )  # fmt: skip


def _add_diagonal(
    model: ff.Model, ring: Ring, k: int, start: float, tube: ff.Section, brake: float
) -> None:
    """The telescopic diagonal of a bay: two tubes, a damper between both ends."""
    low, high = ring.ends(k)
    a, b = ring.diagonal(k, start)
    shortest = math.hypot(ring.longeron, ring.height)
    along = (b - a) / np.linalg.norm(b - a)
    length = min(0.55 * float(np.linalg.norm(b - a)), 0.95 * shortest)
    axis = ring.across(k)
    turn = np.stack([along, axis, np.cross(along, axis)], axis=1)
    mass = tube.mass_per_length * length
    inertia = length * np.diag(tube.inertia)[3:]
    inertia = inertia + mass * length**2 / 12.0 * np.array([0.0, 1.0, 1.0])
    shape, half = ff.Cylinder(0.01, length), 0.5 * length
    for name, middle in ((f"outer_{k}", a + half * along), (f"inner_{k}", b - half * along)):
        model.add(ff.RigidBody(name, mass, inertia, position=middle, rotation=turn, shape=shape))
    outer = ff.Marker(f"outer_{k}", offset=(-half, 0.0, 0.0))
    inner = ff.Marker(f"inner_{k}", offset=(half, 0.0, 0.0))
    model.add(
        ff.Revolute(f"foot_{k}", foot(low), outer, axis=axis),
        ff.Cylindrical(
            f"telescope_{k}", ff.Marker(f"outer_{k}"), ff.Marker(f"inner_{k}"), axis=along
        ),
        ff.Spherical(f"head_{k}", head(high), inner),
    )
    if brake:
        model.add(ff.SpringDamper(f"brake_{k}", foot(low), head(high), damping=brake))


def _add_drive(
    model: ff.Model, ring: Ring, start: float, deployment: float, haul: float, stiffness: float
) -> None:
    """The cable along all diagonals, which a winch hauls in."""
    path: list[ff.Marker | ff.Eyelet] = [foot(0)]
    path += [ff.Eyelet(head(k) if k % 2 else foot(k)) for k in range(1, ring.bays)]
    path.append(foot(0))
    longest = float(np.linalg.norm(np.subtract(*ring.diagonal(0, start))))
    shortest = math.hypot(ring.longeron, ring.height)
    hauled = ff.SmoothStep(0.0, deployment, 0.0, -(ring.bays * (longest - shortest) + haul))
    model.add(
        ff.Cable("drive", path, axial_stiffness=stiffness, paid_out=hauled,
                 damping=1e-2 * stiffness / (ring.bays * longest)),
        ff.CableProbe("cable", "drive"),
    )  # fmt: skip


def _add_nets(model: ff.Model, nets: Nets, start: float, net: dict[str, Any]) -> None:
    """Both nets and their ties, folded, at the ends of the battens."""
    pairs, stiffness, rest = nets.members
    front, _, tied, *_ = nets.design
    corners, count = nets.corners, len(front)
    sample = tied[:: -(-len(tied) // SAMPLES)]
    sets = {f"front_{k}": [int(node)] for k, node in enumerate(corners)}
    sets |= {f"rear_{k}": [int(node) + count] for k, node in enumerate(corners)}
    sets |= {f"sample_{i}": [int(node)] for i, node in enumerate(sample)}
    mesh = ff.ElementMesh(nets.folded(start), pairs, "interval", nodes=sets)
    model.add(ff.CableNet("nets", mesh, stiffness, rest_length=rest, **net))
    for k in range(nets.ring.bays):
        model.add(
            ff.Spherical(f"front_{k}", head(k), ff.Marker("nets", f"front_{k}")),
            ff.Spherical(f"rear_{k}", foot(k), ff.Marker("nets", f"rear_{k}")),
        )
    # the held batten stays where it is, beside its place in the design
    design = front[sample] + nets.ring.feet(start)[0] - nets.ring.feet(0.5 * math.pi)[0]

    def surface(t: float, *nodes: ff.MarkerState) -> tuple[float]:
        apart = np.array([node.position for node in nodes]) - design
        return (math.sqrt(float((apart**2).sum(axis=1).mean())),)

    markers = [ff.Marker("nets", f"sample_{i}") for i in range(len(sample))]
    model.add(
        ff.PositionProbe("centre", markers[0]),
        ff.Probe("surface", markers, ("surface_rms",), surface),
    )


def results(history: Mapping[str, Array]) -> dict[str, float]:
    """Radius, height differences and deviation of the front net at the end; energies."""
    names = ("radius", "level", "surface_rms", "energy_strain", "energy_work")
    found = {name: float(history[name][-1]) for name in names}
    largest = {"balance": history["energy_balance"], "gap": history["gap"]}
    return found | {f"largest_{name}": float(np.abs(h).max()) for name, h in largest.items()}


CASE = ff.Case(
    name="mesh_reflector",
    summary="deployable ring truss with two nets of cables, opened by one cable",
    description=__doc__,
    build=build,
    options=(
        ff.Option("bays", int, 12, "of the ring", minimum=6),
        ff.Option("rings", int, 4, "of triangles of a net", minimum=1, maximum=1000),
        ff.Option("elements", int, 2, "of each batten and longeron", minimum=1),
        ff.Option("radius", float, 3.0, "of the deployed ring", unit="m", above=0.0),
        ff.Option("height", float, 1.5, "of the battens", unit="m", above=0.0),
        ff.Option("depth", float, 0.4, "of each paraboloid", unit="m", above=0.0),
        ff.Option("tied", float, 0.6, "part of the radius inside which nets are tied", minimum=0.0,
                  maximum=1.0),
        ff.Option("net_tension", float, 20.0, "force density of the nets", unit="N/m", above=0.0),
        ff.Option("edge_force", float, 80.0, "of the edge cables, about", unit="N", above=0.0),
        ff.Option("net_stiffness", float, 1e4, "EA of the nets and ties", unit="N", above=0.0),
        ff.Option("edge_stiffness", float, 1e5, "EA of the edge cables", unit="N", above=0.0),
        ff.Option("net_mass", float, 2e-3, "of all cables of the nets", unit="kg/m", above=0.0),
        ff.Option("net_damping", float, 1e-3, "of them, proportional to stiffness", unit="s",
                  minimum=0.0),
        ff.Option("slack_damping", float, 1e-5, "the same, slack or taut", unit="s", minimum=0.0),
        ff.Option("dissipating_catch", bool, False, "cables that become taut lose energy"),
        ff.Option("start_angle", float, 5.0, "between battens and longerons", unit="deg",
                  above=0.0, maximum=90.0),
        ff.Option("latch_angle", float, 89.99, "at which bays lock", unit="deg", above=0.0,
                  maximum=90.0),
        ff.Option("deployment", float, 50.0, "time that the winch takes", unit="s", above=0.0),
        ff.Option("haul", float, 0.02, "what it hauls in beyond the deployed length", unit="m",
                  minimum=0.0),
        ff.Option("driving_stiffness", float, 1e5, "EA of the driving cable", unit="N", above=0.0),
        ff.Option("brake", float, 20.0, "damper of each diagonal", unit="N s/m", minimum=0.0),
        ff.Option("diameter", float, 30.0, "of the tubes", unit="mm", above=0.0),
        ff.Option("wall", float, 1.0, "of the tubes", unit="mm", above=0.0),
        ff.Option("youngs_modulus", float, 1e11, "of the tubes", unit="N/m^2", above=0.0),
        ff.Option("density", float, 1600.0, "of the tubes", unit="kg/m^3", above=0.0),
        ff.Option("damping", float, 1e-4, "of the tubes, proportional to stiffness", unit="s",
                  minimum=0.0),
    ),
    dt=0.05,
    t_end=60.0,
    integrator="energy_momentum",
    rho_inf=0.9,
    iteration_matrix="updated",  # taut cables are others in each iteration
    # in 0.2 of 50 s the winch does next to nothing: forces would be those of rounding
    smoke={"elements": 1, "t_end": 0.2, "deployment": 6.0},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
