# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of shells in models and systems, on any number of ranks."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.core.status import Status
from flexfem.families.shells.family import ShellFamily
from flexfem.solvers.linear import tangent
from tests.unit.contact_motion import check_tangents, moved, same_on_ranks, sheet
from tests.unit.refusals import assert_on_page

THICK = 1e-3
SECTION = ff.ShellSection.isotropic(THICK, ff.Material(2e8, 0.3, 1000.0))


def impact(*, low=(0.0, 0.0, 0.0), tilt=0.0, speed=(0.0, 0.0, -1.0), against="low", **options):
    """A sheet that flies onto another one."""
    meshes = [sheet("low", 8, 0.3, low), sheet("up", 7, 0.2, (0.013, 0.021, 1.5e-3), tilt)]
    model = ff.Model("impact", surface=ff.SurfaceMesh.join(meshes))
    model.add(ff.Shell("low", SECTION), ff.Shell("up", SECTION, velocity=speed))
    model.add(ff.Contact("hit", "up", against, **options))
    model.add(ff.MomentumProbe("momentum"), ff.EnergyProbe(), ff.ContactProbe("touch", "hit"))
    return model


@pytest.mark.parametrize(
    "friction",
    [pytest.param(0.0, marks=pytest.mark.serial), pytest.param(0.3, marks=pytest.mark.three_ranks)],
)
def test_same_motion_on_any_number_of_ranks(friction):
    model = impact(friction=friction, speed=(0.5, 0.2, -1.0))
    alone = same_on_ranks(model, 20, tolerance=1e-10)
    if MPI.COMM_WORLD.rank == 0:
        assert alone["touch_penetration"].max() > 1e-5


def folded(nodes, opening):
    """Two panels, hinged at y = 0, that close: the upper one falls onto the lower one."""
    length, x = 0.3, np.linspace(0.0, 0.1, 4)

    def place(parameters):
        way = abs(parameters[:, 1])
        z = np.where(parameters[:, 1] > 0.0, opening * way, 0.0)
        return np.column_stack([parameters[:, 0], way, z])

    y = np.linspace(0.0, length, nodes)
    meshes = [
        ff.SurfaceMesh.grid("low", x, y - length, place), ff.SurfaceMesh.grid("up", x, y, place)
    ]  # fmt: skip
    model = ff.Model("fold", surface=ff.SurfaceMesh.join(meshes))
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    edges = dict.fromkeys(("low_bottom", "low_left", "low_right"), "clamped")
    model.add(ff.Shell("low", SECTION, edges=edges), ff.Shell("up", SECTION))
    lines = ff.ShellLine("low", "low_top"), ff.ShellLine("up", "up_bottom")
    model.add(ff.HingeLine("hinge", *lines))
    model.add(ff.Contact("pile", ["low", "up"], ["low", "up"]), ff.ContactProbe("touch", "pile"))
    return model


@pytest.mark.parametrize("nodes", [7, 61])
def test_panels_do_not_touch_beside_their_hinge_at_the_start(nodes):
    """Nearer than their thickness there, whether nodes of the mesh lie in that part or not."""
    _, history = moved(folded(nodes, 0.02), 1)
    if MPI.COMM_WORLD.rank:
        return
    # at the full thickness nodes of the fine mesh penetrate by more than half of it
    assert history["touch_closed"][0] == 0.0


@pytest.mark.serial
def test_hinged_panels_do_not_pass_through_each_other():
    """Also where they are nearer than their thickness everywhere at the start."""
    model = folded(31, 2e-3)
    simulation, history = moved(model, 100)
    assert history["touch_closed"][0] == 0.0 < history["touch_closed"].max()
    block = simulation.system.parts[0].block
    heights = np.empty(len(block.node_ids))
    heights[block.node_ids] = block.frames[:, 2]
    low, up = (heights[model.surface.body_nodes(name)].reshape(31, 4) for name in ("low", "up"))
    apart = up - low[::-1]
    # in parts of that at the start; measured 0.48, and -18 with hardly any force
    assert (apart[3:] / (2e-3 * np.linspace(0.0, 0.3, 31)[3:, np.newaxis])).min() > 0.2


def test_tangents_are_the_derivative_of_the_forces():
    simulation, _ = moved(impact(friction=0.3, damping=1e-4, speed=(0.5, 0.2, -1.0)), 4)
    simulation.system.contacts[0].time += 1e-4
    # measured 1e-8; without the forces from other ranks 1e-1
    assert check_tangents(simulation.system)[0] > 0.0


def test_recorded_friction_is_what_acts_on_nodes_that_bounce():
    """A sheet that slides and touches in every fourth step or so, each time for two or three."""
    model = ff.Model("bounce", surface=sheet("up", 6, 0.2, (0.0, 0.0, 5.1e-4)))
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)), ff.Shell("up", SECTION, velocity=(1.0, 0.0, 0.0)),
        ff.Contact("floor", "up", surfaces=ff.RigidPlane(ff.Ground()), friction=0.3),
        ff.MomentumProbe("momentum"), ff.ContactProbe("touch", "floor"),
    )  # fmt: skip
    _, history = moved(model, 100, dt=1e-3, tolerance=1e-9, rho_inf=1.0)
    if MPI.COMM_WORLD.rank:
        return
    assert 0.1 < np.mean(history["touch_closed"] > 0.0) < 0.6
    given = history["momentum_px"] - history["momentum_px"][0]
    assert given[-1] < -0.2 * history["momentum_px"][0]
    # forces that the normal force of the same instant limits are less than half of it
    np.testing.assert_allclose(1e-3 * history["touch_fx"].sum(), given[-1], rtol=1e-6)


def test_impact_keeps_the_momenta_and_loses_what_is_reported():
    _, history = moved(impact(stiffness=1e6), 40, tolerance=1e-11)
    if MPI.COMM_WORLD.rank:
        return
    assert history["touch_penetration"].max() > 0.3 * THICK
    assert history["touch_fz"].max() == pytest.approx(history["touch_normal"].max(), rel=1e-3)
    momentum = np.stack([history[f"momentum_p{a}"] for a in "xyz"])
    start = abs(momentum[:, 0]).max()
    # measured 1e-9, of Newton's tolerance; forces on one side alone would reverse it
    np.testing.assert_allclose(momentum - momentum[:, :1], 0, atol=1e-7 * start)
    spin = np.stack([history[f"momentum_l{a}"] for a in "xyz"])
    # angular momentum is kept to the scheme's order; measured 1e-5
    np.testing.assert_allclose(spin - spin[:, :1], 0, atol=1e-3 * abs(spin).max())
    kinetic = history["energy_kinetic"]
    assert kinetic.min() < 0.9 * kinetic[0]
    # contacts that last ten steps lose 1 % to the scheme's damping; without stored energy 10 %
    assert abs(history["energy_balance"]).max() < 0.03 * kinetic[0]


@pytest.mark.serial
def test_springs_are_known_again_by_node_and_surface():
    """Whatever touches beside them: forces of the last iteration serve the next one."""
    model = impact(speed=(0.5, 0.2, -1.0))
    floor = ff.RigidPlane(ff.Ground((0.0, 0.0, 5e-4)))
    model.add(ff.Contact("floor", "up", surfaces=floor))
    simulation, _ = moved(model, 3)
    contacts = simulation.system.contacts[0]
    contacts.evaluate()
    every = contacts.rows()
    known = dict(zip(every.keys.tolist(), every.slopes.tolist(), strict=True))
    assert len(known) == len(every.keys) > 20
    made = contacts.triangles()[0][0]
    made.slaves.offsets[::2] = -1.0
    contacts.evaluate()
    less = contacts.rows()
    # if keys counted contacts, those that are left would have keys of others
    assert 10 < len(less.keys) < len(known)
    found = [known[key] for key in less.keys.tolist()]
    np.testing.assert_allclose(less.slopes, found, rtol=1e-12)


@pytest.mark.serial
def test_policies_find_the_same_motion():
    ends = []
    for policy in ("updated", "frozen"):
        model = impact(friction=0.2, speed=(0.5, 0.2, -1.0))
        simulation, _ = moved(model, 15, iteration_matrix=policy, tolerance=1e-11)
        ends.append(simulation.system.parts[0].block.frames[:, :3].copy())
        counters = simulation.system.counters
        if policy == "frozen":
            # measured 1 and 3.1 a step: contact does not ask for new factors
            assert counters.factorizations == 1
            assert counters.newton_iterations < 15 * 8
    # Newton's tolerance; measured 1e-12
    np.testing.assert_allclose(*ends, atol=1e-9)


@pytest.mark.parametrize(("steps", "closed"), [(1, False), (8, True)])
def test_fresh_matrices_change_their_pattern_with_closed_contacts_alone(steps, closed, monkeypatch):
    """Open contacts leave the nest, and with it the order of its elimination, as it is."""
    nests, create = [], tangent.create_nest_matrix
    monkeypatch.setattr(
        tangent, "create_nest_matrix", lambda *given: nests.append(1) or create(*given)
    )
    moved(impact(), steps, iteration_matrix="updated")
    # two at the start: of lumped masses, which have no couplings, and of steps
    assert (len(nests) > steps + 1) if closed else (len(nests) == 2)


@pytest.mark.serial
def test_sheet_at_rest_on_a_plane_weighs_what_it_does():
    model = ff.Model("rest", surface=sheet("sheet", 5, 0.1, (0, 0, THICK / 2 - 1e-6)))
    model.add(ff.Shell("sheet", SECTION), ff.Gravity((0, 0, -10.0)))
    plane = ff.RigidPlane(ff.Ground((0, 0, 0)))
    model.add(ff.Contact("floor", "sheet", surfaces=plane, stiffness=1e6, damping=2e-3))
    model.add(ff.ContactProbe("touch", "floor"))
    _, history = moved(model, 150)
    # weight 0.1 N on 0.01 m^2, pressure 10 Pa
    assert history["touch_fz"][-1] == pytest.approx(0.1, rel=1e-3)
    assert history["touch_penetration"][-1] == pytest.approx(1e-5, rel=1e-3)


@pytest.mark.serial
def test_automatic_stiffness_holds_what_few_nodes_carry():
    """A sheet that is laid on a ball with long steps."""
    radius = 0.05
    model = ff.Model("laid", surface=sheet("sheet", 13, 0.15, (0, 0, radius + THICK / 2 + 1e-5)))
    model.add(ff.Shell("sheet", SECTION), ff.Gravity((0, 0, -10.0)))
    model.add(ff.Contact("on", "sheet", surfaces=ff.RigidSphere(ff.Ground(), radius)))
    model.add(ff.ContactProbe("touch", "on"), ff.EnergyProbe())
    # a millionth of a metre, the usual tolerance, is a hundredth of the penetration
    _, history = moved(model, 60, dt=1e-3, tolerance=1e-7)
    # measured 0.14; with the same force per penetration at any depth 0.84
    assert history["touch_penetration"].max() < 0.2 * THICK
    # measured 2e-4 lost, nothing gained
    assert history["energy_balance"].max() < 1e-3 * history["energy_strain"].max()


@pytest.mark.serial
def test_fast_sheet_does_not_get_through():
    model = impact(speed=(0.0, 0.0, -20.0))  # 4 mm a step, four times the thickness
    simulation, _ = moved(model, 15)
    block = simulation.system.parts[0].block
    up = simulation.serial.family(ShellFamily).body_of_node[block.node_ids] == 1
    # the lower sheet is hit and goes ahead
    assert block.frames[up, 2].min() > block.frames[~up, 2].min()
    assert simulation.system.contacts[0].measure("hit")[1] < 2e-3


@pytest.mark.serial
def test_restart_goes_on_as_before():
    model = impact(friction=0.3, stiffness=1e6, speed=(0.5, 0.2, -1.0))
    whole, _ = moved(model, 16, tolerance=1e-11)
    first, _ = moved(model, 10, tolerance=1e-11)
    state = first.system.state()
    assert first.system.contacts[0].groups[0].triangles[0].closed.pulls.any()
    second, _ = moved(model, 0, tolerance=1e-11)
    second.system.restore(state)
    contacts, again = first.system.contacts[0], second.system.contacts[0]
    for before, after in zip(contacts.groups[0].triangles, again.groups[0].triangles, strict=True):
        kept, same = before.closed, after.closed
        np.testing.assert_array_equal(same.slaves, kept.slaves)
        # copies
        np.testing.assert_array_equal(same.pulls, kept.pulls)
        np.testing.assert_array_equal(same.pushes, kept.pushes)
    for one in (first, second):
        for _ in range(6):
            assert one.advance(2e-4) is Status.OK
    ends = [s.system.parts[0].block.frames[:, :3] for s in (whole, first, second)]
    np.testing.assert_array_equal(ends[0], ends[1])
    # the same equations from the same state; friction forgotten gives 1e-6
    np.testing.assert_allclose(ends[2], ends[0], atol=1e-10)


@pytest.mark.serial
@pytest.mark.parametrize("role", ["bodies", "against"])
def test_rigid_bodies_touch_with_shapes_or_surfaces(role: str) -> None:
    model = impact()
    model.add(ff.RigidBody("ball", 1.0, (1.0, 1.0, 1.0), position=(0.0, 0.0, 1.0)))
    roles = {"bodies": "up", "against": "low"} | {role: "ball"}
    model.add(ff.Contact("more", **roles))
    message = r'"ball", which is a RigidBody without shape: .* surfaces=\[RigidSphere\(Marker\("b'
    with pytest.raises(ValueError, match=message):
        model.validate()


@pytest.mark.serial
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"low": (0, 0, 1.2e-3)}, 'Contact "hit": at the start Shell "up" penetrates .*0.0007 m'),
        ({"tilt": 0.1}, 'Contact "hit": at the start Shell "up" intersects Shell "low"'),
        ({"against": "none"}, 'Contact "hit": against: Model "impact" has no body .* "none"'),
        ({"friction": -1.0}, 'Contact "hit": friction must not be negative'),
        ({"against": ()}, 'Contact "hit": it needs bodies, and others or surfaces'),
        (
            {"against": ("up", "low"), "law": "penalty"},
            'Contact "hit": against must be others than the bodies',
        ),
        ({"skin": 0.0}, 'Contact "hit": skin must be positive'),
        (
            {"surfaces": ff.RigidSphere(ff.Ground((0, 0, 0)), 0.05)},
            'Contact "hit": at the start Shell "up" penetrates a rigid sphere by 0.0',
        ),
    ],
)
def test_bad_input(options, message):
    with pytest.raises(ValueError, match=message) as raised:
        moved(impact(**options), 0)
    assert_on_page(str(raised.value))
