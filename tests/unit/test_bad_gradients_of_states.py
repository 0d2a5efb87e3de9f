# SPDX-License-Identifier: LGPL-3.0-or-later
"""What gradients of equilibria, frequencies and buckling loads refuse: in one line of the page."""

import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

RUBBER = ff.Material(5e6, 0.3, 1100.0)
STATICS, MODES = {"load_steps": 1, "quiet": True}, {"modes": 2, "frames": 0, "quiet": True}


def rod(*more, height: float = 0.01) -> ff.Model:
    mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)]}, elements=2)
    end = ff.Marker("rod", "end")
    model = ff.Model("rod", mesh=mesh)
    model.add(
        ff.Beam("rod", ff.Section.rectangle(0.02, height, RUBBER)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
        ff.PointForce("push", end, (0.0, 0.0, -0.01)),
        ff.PositionProbe("tip", end),
        *more,
    )
    return model


def free() -> ff.Model:
    """A free body beside one on a spring."""
    model = ff.Model("free")
    model.add(
        ff.RigidBody("body", 1.0, (1.0, 1.0, 1.0)),
        ff.RigidBody("held", 1.0, (1.0, 1.0, 1.0), position=(1.0, 0.0, 0.0)),
        ff.SpringDamper("spring", ff.Ground((1.0, 0.0, 1.0)), ff.Marker("held"), stiffness=10.0),
    )
    return model


def driven() -> ff.Model:
    model, bob = ff.Model("driven"), ff.Marker("bob")
    model.add(
        ff.RigidBody("bob", 1.0, (1.0, 1.0, 1.0), position=(1.0, 0.0, 0.0)),
        ff.Revolute("pin", ff.Ground(), ff.Marker("bob", offset=(-1, 0, 0)), axis=(0, 1, 0)),
        ff.PrescribedAngle("motor", ff.Ground(), bob, axis=(0, 1, 0)),
        ff.PositionProbe("tip", bob),
    )
    return model


def linear(**more) -> ff.LinearOptions:
    return ff.LinearOptions(**more)


def statics(**more) -> ff.StaticOptions:
    return ff.StaticOptions(**STATICS, **more)


def modes(**more) -> ff.ModeOptions:
    return ff.ModeOptions(**{**MODES, **more})


END = ff.Marker("rod", "end")
STOP = ff.LimitStop("stop", ff.Ground(), END, axis=(0, 0, 1), upper=5.0, stiffness=10.0)
OTHER = ff.CampbellOptions(spin_end=1.0)
WRONG = [
    ("along arc lengths only the end of the path", {
        "of": "mean:tip_z", "options": statics(arc_length=0.1)}),
    ("along arc lengths only the end of the path", {
        "of": "rms:t", "options": statics(arc_length=0.1)}),
    ("buckling:1 is not differentiated with a stop_column", {
        "of": "buckling:1", "options": statics(stop_column="tip_z", stop_value=-0.01)}),
    ("equilibria with critical_points True have no", {"options": statics(critical_points=True)}),
    ("equilibria with linear True have no", {"options": statics(linear=True)}),
    ("output_at names the column tip_z", {"options": statics(output_at="tip_z=-0.1")}),
    ("'frequency:1' is not of the form", {"of": "frequency:1"}),
    ("'buckling:x' must end with a number from 1", {"of": "buckling:x"}),
    ("'frequency:0' must end with a number from 1", {"of": "frequency:0", "options": modes()}),
    ("numbers are frequency:1, damping:1 and so on, got final:tip_z", {"options": modes()}),
    ("modes must not exceed the 12 degrees", {"of": "frequency:99", "options": modes()}),
    ("there is no column \"tip_w\", did you mean", {"of": "final:tip_w"}),
    ("'frequency:2-1' must end with a number from 1, or a first and", {
        "of": "frequency:2-1", "options": modes()}),
    ("modes 1 to 2 have one frequency", {
        "of": "frequency:1", "options": modes(), "model": rod(height=0.02)}),
    ("mode 1 does not oscillate", {
        "of": "frequency:1", "options": modes(), "model": free(), "wrt": ["body.mass"]}),
    ("there is no buckling:1, 0 buckling loads", {
        "of": "buckling:1", "options": statics(t_end=1e-20)}),
    ("StaticOptions, ModeOptions or LinearOptions, got Campbell", {"options": OTHER}),
    ("numbers are gain:OUTPUT/INPUT@HZ and", {"options": linear()}),
    ("numbers are gain:OUTPUT/INPUT@HZ and", {"of": "gain:tip_z/push@-1", "options": linear()}),
    ("numbers are gain:OUTPUT/INPUT@HZ and", {"of": "gain:tip_z/push@x", "options": linear()}),
    ("linear models have no output \"tip_w\", did you mean", {
        "of": "gain:tip_w/push@1", "options": linear()}),
    ("linear models have no input \"pull\"", {"of": "gain:tip_z/pull@1", "options": linear()}),
    ("linear models reduced to 4 modes have no", {
        "of": "gain:tip_z/push@1", "options": linear(modes=4)}),
    ("linear models about a checkpoint's state", {
        "of": "gain:tip_z/push@1", "options": linear(state="a.h5")}),
    ("phase:tip_y/push@1\" has no derivative, as push", {
        "of": "phase:tip_y/push@1", "options": linear()}),
    ("tip_z/motor@0\" is infinite, as the input of a drive", {
        "of": "gain:tip_z/motor@0", "options": linear(), "model": driven(), "wrt": ["bob.mass"]}),
    ("check compares adjoint and tangent", {"check": True}),
    ("modes about a checkpoint's state", {"of": "frequency:1", "options": modes(state="a.h5")}),
    ("no derivatives of stops and other unilateral", {"model": rod(STOP)}),
    ("nothing to derive, name functionals", {"of": []}),
]  # fmt: skip


@pytest.mark.parametrize(("text", "given"), WRONG, ids=[text[:24] for text, _ in WRONG])
def test_wrong_arguments(text, given):
    chosen = {"model": rod(), "of": "final:tip_z", "wrt": ["rod.damping"], "options": statics()}
    with pytest.raises((ValueError, TypeError)) as raised:
        ff.gradient(**{**chosen, **given})
    message = str(raised.value)
    assert "\n" not in message
    assert text in message
    assert_on_page(message)


def _refused(build, values, text):
    with pytest.raises(ValueError, match=text) as raised:
        ff.gradient(build, "final:tip_z", values, statics())
    assert_on_page(str(raised.value))


def test_parameters_without_derivatives():
    """A model that jumps beside a value, and one that ends there."""
    _refused(lambda h: rod(height=0.01 if h > 1.0 else 0.02), {"h": 1.0}, "the equations jump")

    def build(part: float) -> ff.Model:
        if part > 1.0:
            raise ValueError("more than the whole")
        return rod(height=0.01 * part)

    _refused(build, {"part": 1.0}, 'different "part" is refused: more than the whole')

    def exchanged(h: float) -> ff.Model:
        """Rows that change places beside a height of 1, where they have no forces."""
        ends = [END, ff.Marker("rod", "end", offset=(0.0, 0.0, 0.01))]
        rows = [
            ff.PointOnPlane(name, ff.Ground(), end, axis=(0.0, 1.0, 0.0))
            for name, end in zip("ab", ends if h == 1.0 else ends[::-1], strict=True)
        ]
        return rod(*rows, height=0.01 * h)

    _refused(exchanged, {"h": 1.0}, "the equations jump")


def test_a_mechanism_has_no_derivative():
    """Equilibria that are searched with help are differentiated without."""
    body = ff.RigidBody("bob", 1.0, (1.0, 1.0, 1.0), position=(0.0, 0.0, 1.0))
    with pytest.raises(RuntimeError, match="can move without stiffness") as raised:
        ff.gradient(rod(body), "final:tip_z", ["bob.mass"], statics(stabilise=True))
    assert_on_page(str(raised.value))


def stepped(height: float) -> ff.Model:
    """A rod that is stiffer by a hundredth from its height on."""
    return rod(height=height * (1.0 if height < 0.01 else 1.003))


@pytest.mark.parametrize(
    ("of", "options"),
    [
        ("frequency:1", modes()),
        ("buckling:1", statics()),
        ("gain:tip_z/push@1", linear()),
        ("final:tip_z", statics()),
    ],
)
def test_what_jumps(of, options):
    """Derivatives beside a jump are the jump over the step of the differences."""
    with pytest.raises(ValueError, match='jump where "height" changes') as caught:
        ff.gradient(stepped, of, {"height": 0.01}, options)
    assert_on_page(str(caught.value))
