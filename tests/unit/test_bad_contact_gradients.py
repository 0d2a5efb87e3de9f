# SPDX-License-Identifier: LGPL-3.0-or-later
"""What gradients of motions with contacts refuse."""

import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

OPTIONS = ff.RunOptions(dt=1e-3, t_end=4e-3)


def falling(*more, **contact) -> ff.Model:
    """A sheet on its way to the ground."""
    surface = ff.SurfaceMesh.rectangle("sheet", (0.2, 0.1), (2, 1))
    model = ff.Model("falling", surface=surface)
    rubber = ff.ShellSection.isotropic(0.002, ff.Material(5e6, 0.3, 1100.0))
    ground = ff.RigidPlane(ff.Ground((0.0, 0.0, -0.003)))
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Shell("sheet", rubber, velocity=(0.0, 0.0, -1.0)),
        ff.Contact("landing", "sheet", surfaces=ground, **contact),
        ff.PositionProbe("p", ff.Marker("sheet", "sheet_bottom_left")),
        *more,
    )
    return model


def _stopped_bead():
    """A wire with a bead and a stop."""
    wire = ff.NurbsCurve.line((0.0, 0.0, 1.0), (0.4, 0.0, 1.0), degree=3, elements=2)
    slide = ff.Sliding("slide", ff.Carrier("wire"), ff.Marker("bead"))
    return (
        ff.Beam("wire", ff.Section.circle(0.01, ff.Material(2e9, 0.3, 1100.0)), curve=wire),
        ff.RigidBody("bead", 0.1, (1e-5,) * 3, position=(0.1, 0.0, 1.0)),
        slide,
        ff.SlideStop("end", slide, upper=0.3, stiffness=1e3),
    )


SPEED = ff.Probe(
    "rate", ff.Marker("sheet", "sheet_bottom_left"), ("rate",), lambda t, s: (s.acceleration[2],)
)


@pytest.mark.parametrize(
    ("text", "of", "model"),
    [
        ('Contact "landing": restitution has no', "p_z", falling(restitution=0.5)),
        (
            "there are no derivatives of impulses with friction or damping of penalties yet",
            "p_z",
            falling(
                ff.RigidBody("bob", 1.0, (1.0, 1.0, 1.0)),
                ff.LimitStop(
                    "end", ff.Ground(), ff.Marker("bob"), axis=(1, 0, 0), upper=9.0, stiffness=10.0
                ),
                law="penalty",
                friction=0.3,
            ),
        ),
        (
            "which has no derivatives with damping of contacts by the penalty yet",
            "p_z",
            falling(
                ff.Event(
                    "late",
                    ff.Marker("sheet", "sheet_bottom_left"),
                    lambda t, s: t - 1e-3,
                    ff.Stop(),
                ),
                law="penalty",
                damping=1e-3,
            ),
        ),
        (
            "there are no derivatives of stops of sliders yet",
            "p_z",
            falling(*_stopped_bead(), law="barrier"),
        ),
        (
            "there are no derivatives of accelerations in steps with impulses yet",
            "rate",
            falling(SPEED, law="barrier"),
        ),
    ],
)
def test_contacts(text, of, model):
    with pytest.raises(ValueError) as raised:  # noqa: PT011
        ff.gradient(model, f"mean:{of}", ["gravity[2]"], OPTIONS)
    message = str(raised.value)
    assert text in message
    assert_on_page(message)
