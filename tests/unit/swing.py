# SPDX-License-Identifier: LGPL-3.0-or-later
"""A small mechanism for pages of results, with names that are code where they become markup."""

import flexfem as ff

__all__ = ["EVIL", "EVIL_COLUMN", "hoist", "mechanism"]

#: Names that are code where they are taken for markup.
EVIL = "</script><script>window.caught=1</script>"
EVIL_COLUMN = "<img src=x onerror=window.caught=1>"


def mechanism() -> ff.Model:
    """A box on a beam that bends, on a hinge, with names that mean harm."""
    steel = ff.Material(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
    mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}, elements=4)
    model = ff.Model("swing", mesh=mesh)
    model.add(
        ff.Beam("rod", ff.Section.tube(0.02, 0.03, steel), damping=1e-3),
        ff.RigidBody(EVIL, 1.0, (0.1, 0.2, 0.3), position=(1.0, 0.0, 0.0)),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("rod", "start"), axis=(0.0, 1.0, 0.0)),
        ff.Rigid("weld", ff.Marker("rod", "end"), ff.Marker(EVIL)),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.PositionProbe(EVIL_COLUMN, ff.Marker(EVIL)),
    )
    return model


def hoist() -> ff.Model:
    """Two masses on a cable over a sheave with friction, and one on a cable without stretch."""
    model = ff.Model("hoist")
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    for name, mass, x in (("heavy", 3.0, -0.2), ("light", 1.5, 0.2), ("bob", 1.0, 1.2)):
        model.add(ff.RigidBody(name, mass, (0.01, 0.01, 0.01), position=(x, 0.0, -1.0)))
    sheave = ff.Sheave(ff.Ground(), 0.2, (0.0, 1.0, 0.0), friction=0.1)
    model.add(
        ff.Cable(EVIL, [ff.Marker("heavy"), sheave, ff.Marker("light")], tension_only=False),
        ff.Cable("stay", [ff.Ground((0.8, 0.0, 0.0)), ff.Marker("bob")], tension_only=False),
        ff.CableProbe("pull", EVIL),
    )
    return model
