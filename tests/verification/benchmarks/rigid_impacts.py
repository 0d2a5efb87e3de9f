# SPDX-License-Identifier: LGPL-3.0-or-later
"""Impacts of rigid bodies: restitution, bounces, friction, an elastic ground."""

import numpy as np

import flexfem as ff
from tests.verification.motions import run_undamped
from tests.verification.result import Result

GRAVITY = 9.81


def ball(name: str, radius: float, **options) -> ff.RigidBody:
    """A ball of 1 kg."""
    inertia = 0.4 * radius**2 * np.eye(3)
    return ff.RigidBody(name, 1.0, inertia, shape=ff.Sphere(radius), **options)


def restitution(part: float, dt: float, integrator: str) -> list[Result]:
    """Two equal balls at 8 m/s, reach 50 um: impacts of one step, and of tens of them."""
    model, radius, speed = ff.Model("impact"), 0.03, 8.0
    for name, x, v in (("a", 0.0, speed), ("b", 2 * radius + 2e-4, 0.0)):
        model.add(ball(name, radius, position=(x, 0.0, 0.0), velocity=(v, 0.0, 0.0)))
        model.add(
            ff.Probe(f"rate_{name}", ff.Marker(name), (f"v_{name}",), lambda t, s: s.velocity[:1])
        )
    soft = 5e9 if dt <= 1e-6 else None
    model.add(
        ff.Contact("c", "a", "b", restitution=part, reach=5e-5, stiffness=soft), ff.EnergyProbe()
    )
    history = run_undamped(model, dt, max(4 * dt, 8e-5), integrator=integrator).history
    left = history["v_b"][-1] - history["v_a"][-1]
    # with e = 0 the balls hardly move apart, and the barrier has some of it still
    lost = (history["energy_dissipation"] + history["energy_strain"])[-1] / (0.25 * speed**2)
    case, mesh = "two balls, restitution", f"h = {dt:g} s, {integrator}"
    # round-off of the iterations; a step of the impact that is not subject to the loss has 0.1
    return [
        Result(case, f"speed apart with e = {part:g}, m/s", part * speed, "e v", left, mesh, 1e-6,
               speed),
        Result(case, f"energy lost with e = {part:g}", 1 - part**2, "1 - e^2", lost, mesh, 1e-5, 1),
    ]  # fmt: skip


def bounces(count: int) -> list[Result]:
    """A ball bounces between two walls, e = 1."""
    radius, gap, speed, dt = 0.05, 2.4e-3, 1.0, 1e-3
    model = ff.Model("bounces")
    walls = [
        ff.RigidPlane(ff.Ground((0, 0, -side * (radius + 0.5 * gap)), np.diag([1, side, side])))
        for side in (1.0, -1.0)
    ]
    model.add(
        ball("b", radius, velocity=(0.3, 0.0, speed)),
        ff.Contact("walls", "b", surfaces=walls, reach=1e-4), ff.EnergyProbe(),
        ff.MomentumProbe("p"),
        ff.Probe("rate", ff.Marker("b"), ("vz",), lambda t, s: s.velocity[2:]),
    )  # fmt: skip
    history = run_undamped(model, dt, count * gap / speed).history
    energy = history["energy_kinetic"] + history["energy_strain"]
    times = int((np.diff(np.sign(history["vz"])) != 0).sum())
    drift = float(np.ptp(energy)) / energy[0] / times
    mesh, case = f"{times} bounces, h = {dt:g} s", "ball between walls, e = 1"
    # a force at the end of a step gains and loses per cents
    return [
        Result(case, "drift of the energy in a bounce", 0.0, "conservation", drift, mesh, 1e-9),
        Result(case, "drift of the momentum along the walls in a bounce, N s", 0.0, "conservation",
               float(np.ptp(history["p_px"])) / times, mesh, 1e-12),
    ]  # fmt: skip


def dropped(part: float, dt: float) -> list[Result]:
    """A ball is dropped and bounces until it rests (Zeno)."""
    height, radius = 0.5, 0.05
    model = ff.Model("dropped")
    model.add(
        ff.Gravity((0.0, 0.0, -GRAVITY)), ball("b", radius, position=(0.0, 0.0, radius + height)),
        ff.Contact("ground", "b", surfaces=ff.RigidPlane(ff.Ground()), restitution=part,
                   reach=1e-4),
        ff.ContactProbe("touch", "ground"),
        ff.Probe("rate", ff.Marker("b"), ("vz",), lambda t, s: s.velocity[2:]),
    )  # fmt: skip
    first = np.sqrt(2.0 * height / GRAVITY)
    end = first * (1.0 + part) / (1.0 - part)
    found = run_undamped(model, dt, 1.1 * end)
    history, case, cut = found.history, "dropped ball, e = 0.5", found.summary["rejected_steps"]
    moving = np.flatnonzero(np.abs(history["vz"]) > 2.0 * GRAVITY * dt)
    rest = history["t"][moving[-1]]
    impulse = float((history["touch_fz"][1:] * np.diff(history["t"])).sum())
    change = GRAVITY * history["t"][-1] + history["vz"][-1]
    mesh, still = f"h = {dt:g} s", 1e-3 if dt <= 1e-3 else 1e-2
    return [
        # the last bounces, shorter than a step; without the loss of one bounce 0.3
        Result(case, "rest after, s", end, "t1 (1 + e)/(1 - e)", rest, mesh, 3e-2),
        # what is left of the motion
        Result(case, "force at rest, N", GRAVITY, "m g", history["touch_fz"][-1], mesh, still),
        # means over steps of forces that settle to 1e-8; without restitution twice as much
        Result(case, "impulse of the ground, N s", change, "momentum", impulse, mesh, 1e-8),
        Result(case, "rejected steps", 0.0, "no cut steps", cut, mesh, 0.5),
    ]


def elastic_ground(dt: float) -> list[Result]:
    """Mass on elastic ground (V5.01.108 of code_aster): free flight, then half a sine."""
    mass, stiffness, g, v0, gap = 1.0, 100.0, 10.0, -1.0, 2.0
    model = ff.Model("elastic_ground")
    place = ff.Ground((0.0, 0.0, gap))
    model.add(
        ff.Gravity((0.0, 0.0, -g)),
        ff.RigidBody("mass", mass, np.eye(3), position=(0, 0, gap), velocity=(0, 0, v0)),
        ff.LimitStop("ground", place, ff.Marker("mass"), axis=(0, 0, 1), lower=-gap,
                     stiffness=stiffness),
        ff.Probe("way", ff.Marker("mass"), ("z",), lambda t, s: s.position[2:]),
    )  # fmt: skip
    hit = (v0 + np.sqrt(v0**2 + 2.0 * g * gap)) / g
    omega, speed, sag = np.sqrt(stiffness / mass), v0 - g * hit, mass * g / stiffness
    deepest = -sag - np.hypot(sag, speed / omega)
    # back at the ground's level after the phase in which the sine is negative
    phase = np.pi + 2.0 * np.arctan2(sag * omega, -speed)
    back = hit + phase / omega
    history = run_undamped(model, dt, back + 0.1).history
    fly = back + 0.1 - hit - phase / omega
    last = -speed * fly - 0.5 * g * fly**2
    z, t, mesh = history["z"], history["t"], f"h = {dt:g} s"
    end = float(np.interp(back + 0.1, t, z))
    case = "mass on elastic ground"
    # second order: (omega h)^2 / 12 of the way, and the step in which the contact begins
    return [
        Result(case, "deepest point, m", deepest, "closed form", float(z.min()), mesh, 1e-4),
        Result(case, "height 0.1 s after the impact, m", last, "closed form", end, mesh, 1e-3),
    ]


def sliding(scale: float) -> list[Result]:
    """A block slides on a plane until friction stops it, at several scales."""
    mu, root = 0.3, np.sqrt(scale)
    size, speed = scale * np.array([0.2, 0.2, 0.1]), 0.3 * root
    inertia = scale**3 / 12.0 * np.diag((size**2).sum() - size**2)
    model = ff.Model("block")
    model.add(
        ff.Gravity((0.0, 0.0, -GRAVITY)),
        ff.RigidBody("block", scale**3, inertia, position=(0, 0, size[2] / 2 + 2e-4 * scale),
                     velocity=(speed, 0, 0), shape=ff.Box(size)),
        ff.Contact("ground", "block", surfaces=ff.RigidPlane(ff.Ground()), friction=mu,
                   restitution=0.0),
        ff.Probe("way", ff.Marker("block"), ("x",), lambda t, s: s.position[:1]),
    )  # fmt: skip
    found = run_undamped(model, 2e-3 * root, 0.12 * root).history["x"][-1]
    exact = speed**2 / (2.0 * mu * GRAVITY)
    mesh = f"scale {scale:g}, h = {2e-3 * root:.3g} s"
    # the step in which it stops; Coulomb's friction with a lagged normal force misses 1e-2
    return [Result("block on a plane", "way to stop, m", exact, "v^2/(2 mu g)", found, mesh, 2e-3)]


def results(full: bool = True) -> list[Result]:
    """All lines; fewer of them, and fewer bounces, for tests."""
    found = bounces(1000 if full else 10) + elastic_ground(1e-3 if full else 2e-3)
    found += dropped(0.5, 1e-3 if full else 2e-3)
    schemes = ("generalized_alpha", "stabilized_index2", "energy_momentum")
    for integrator in schemes if full else ():
        for part in (0.0, 0.5, 0.9):
            for dt in (1e-3, 1e-5, 4e-7):
                found += restitution(part, dt, integrator)
    for scale in (1.0, 0.1, 0.01) if full else ():
        found += sliding(scale)
    return found
