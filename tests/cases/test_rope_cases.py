# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometry of the cases of contact, and what they refuse."""

import inspect
import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexfem._types import FloatArray
from flexfem.case import load_case
from flexfem.model.model import Model

pytestmark = pytest.mark.serial


def built(name: str, **given: object) -> Model:
    case = load_case(name)
    values = case.values(given)
    return case.build(**{option.name: values[option.name] for option in case.options})


def inside(points: FloatArray, outline: FloatArray) -> FloatArray:
    """Signed distances (k,) of points (k, 2) to a polygon (n, 2), negative inside."""
    start, end = outline, np.roll(outline, -1, axis=0)
    way, to = end - start, points[:, np.newaxis] - start
    part = np.clip((to * way).sum(-1) / (way**2).sum(-1), 0.0, 1.0)
    distance = np.linalg.norm(to - part[..., np.newaxis] * way, axis=-1).min(axis=1)
    y = points[:, 1, np.newaxis]
    crossed = (start[:, 1] > y) != (end[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = start[:, 0] + (y - start[:, 1]) / way[:, 1] * way[:, 0]
    odd = (crossed & (points[:, :1] < at)).sum(axis=1) % 2 == 1
    signed: FloatArray = np.where(odd, -distance, distance)
    return signed


@pytest.mark.parametrize(("teeth", "degrees"), [((20, 30), 20.0), ((8, 9), 30.0), ((18, 55), 20.0)])
def test_teeth_are_conjugate(teeth: tuple[int, int], degrees: float) -> None:
    gear = load_case("gear_pair").build.__globals__["Gear"]
    angle, backlash = math.radians(degrees), 0.1
    one, other = (gear(z, 1.0, angle, backlash, 1.0, 1.0) for z in teeth)
    away, parts = one.pitch + other.pitch, 8
    first = one._section(parts, 0.0)[0] @ [1.0, 1j]
    second = other._section(parts, math.pi + math.pi / teeth[1])[0] @ [1.0, 1j]
    gaps = []
    for turn in np.linspace(0.0, 2.0 * math.pi / teeth[0], 13):
        a = first * np.exp(1j * turn)
        b = second * np.exp(-1j * turn * teeth[0] / teeth[1]) + away
        near = a[np.abs(a - away) < 1.1 * other.tip], b[np.abs(b) < 1.1 * one.tip]
        a, b, near_a, near_b = (np.column_stack([c.real, c.imag]) for c in (a, b, *near))
        gaps += [inside(near_a, b).min(), inside(near_b, a).min()]
    # involutes in the middle of their backlash are half of it apart along the line of action, at
    # any angle; chords lie inside by their sag, 2e-3 modules here. Teeth turned by half a degree,
    # or of another pressure angle, differ by 0.05
    least = 0.5 * backlash * math.cos(angle)
    assert least - 1e-9 <= min(gaps) < least + 2e-3
    model = built("gear_pair", pinion_teeth=teeth[0], wheel_teeth=teeth[1],
                  pressure_angle=degrees, bore=0.005)  # fmt: skip
    mass = model["wheel"].mass
    area = np.sum((np.conj(second) * np.roll(second, -1)).imag) * 0.5 * 0.005**2
    bore = model["wheel"].shape.points[-2 * teeth[1] :, :2] @ [1.0, 1j]
    area -= np.sum((np.conj(bore) * np.roll(bore, -1)).imag) * 0.5
    np.testing.assert_allclose(mass, 7850.0 * 0.01 * area, rtol=0.01)


def test_teeth_that_interfere_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"teeth: the tips of 60 teeth interfere .* 10 at .* 20 deg"
    ):
        built("gear_pair", pinion_teeth=10, wheel_teeth=60, bore=0.005)
    with pytest.raises(ValueError, match=r"bore: .* 20 teeth, 0.04375 m, got 0.05"):
        built("gear_pair", bore=0.05)
    with pytest.raises(ValueError, match=r"backlash must be above .* 0.04 modules, got 0.03"):
        built("gear_pair", backlash=0.03)


def crossings(points: FloatArray) -> list[tuple[float, float, bool]]:
    """Crossings of a polyline seen along Z: places along it, and True if the first is above."""
    found = []
    for i, (a, b) in enumerate(pairwise(points)):
        for j, (c, d) in enumerate(pairwise(points[: max(i - 1, 0)])):
            matrix = np.column_stack([(b - a)[:2], (c - d)[:2]])
            if abs(np.linalg.det(matrix)) < 1e-15:
                continue
            s, t = np.linalg.solve(matrix, (c - a)[:2])
            if 0.0 <= s < 1.0 and 0.0 <= t < 1.0:
                found.append((i + s, j + t, (a + s * (b - a))[2] > (c + t * (d - c))[2]))
    return found


def test_rope_is_knotted() -> None:
    points = built("knot", elements=60, apart=3.0).mesh.points
    met = crossings(points)
    # three crossings, above and below in turn along the rope: that is a trefoil, while a loop that
    # falls open has two of one kind one after the other
    assert len(met) == 3
    along = sorted([(s, up) for s, _, up in met] + [(t, not up) for _, t, up in met])
    assert all(up != after for (_, up), (_, after) in pairwise(along))
    with pytest.raises(ValueError, match=r"apart must be above 1.05 diameters, got 1.02"):
        built("knot", apart=1.02)


def test_ropes_that_may_overlap_are_refused() -> None:
    with pytest.raises(ValueError, match=r"spacing must be above 0.045.* 2 degrees .* got 0.1 and"):
        built("rope_heap", tilt=2.0, spacing=0.04)


def test_moments_of_a_tape_spring_are_those_of_theory() -> None:
    case = load_case("tape_spring")
    theory = case.build.__globals__["moment_of_long_tape"]
    radius, angle, thick, young, nu = 0.015, 0.4, 1e-4, 131e9, 0.3
    found = theory(np.array([1e-2, 1e3]), radius, angle, thick, young, nu)
    # at first a beam of a shallow section; one of another width by 1 % is stiffer by 5 %
    beam = young * thick * (radius * angle) ** 5 / (720.0 * radius**2) + young * (
        radius * angle * thick**3 / 12.0
    )
    assert found[0] / 1e-2 == pytest.approx(beam, rel=1e-3)
    # then a strip that is flat across and bent as a plate; without its stiffness across, 0.91
    plate = young * thick**3 / (12.0 * (1.0 - nu**2))
    assert found[1] == pytest.approx(radius * angle * plate * (1e3 + nu / radius), rel=0.02)


def test_results_of_a_tape_spring_are_those_of_its_history() -> None:
    case = load_case("tape_spring")
    values = {option.name: option.default for option in case.options}
    t = np.linspace(0.0, 1.0, 11)
    whole = math.radians(values["fold"])
    angle = whole * np.minimum(t / 0.5, 1.0)
    history = {
        "t": t, "angle": angle, "gap": np.where(t > 0.45, 1e-4, 5e-4),
        "turn_my": np.where(t > 0.45, -9.0, -0.02), "contact_closed": 1.0 * (t > 0.45),
        "energy_kinetic": 0.1 * (t > 0.7), "energy_strain": 0.03 * np.abs(angle),
    }  # fmt: skip
    history["turn_my"][1] = -0.5
    names = inspect.signature(case.results).parameters
    found = case.results(history, **{name: values[name] for name in names if name in values})
    # the drive's moment once layers touch is no peak of the tape
    assert found["peak_moment"] == 0.5
    assert found["fold_moment"] == pytest.approx(0.03)
    assert found["least_gap"] == 1e-4
    # kinetic energy that comes from nowhere
    assert found["energy_made"] == pytest.approx(0.1 / (0.03 * abs(whole)))
    assert found["steady_moment"] == pytest.approx(0.02994, rel=1e-3)


def test_link_of_a_clamped_rod() -> None:
    case = load_case("plectoneme")
    writhe, twist = (case.build.__globals__[name] for name in ("writhe_of", "twist_of"))
    flat = np.array([[-1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 2.0, 0.0], [-1.0, 1.0, 0.01],
                     [1.0, 0.0, 0.01]])  # fmt: skip
    # it crosses itself once, whichever way it is seen, right-handed; and left-handed
    assert writhe(flat) == pytest.approx(1.0, abs=0.02)
    assert writhe(flat * [1.0, 1.0, -1.0]) == pytest.approx(-writhe(flat), abs=1e-12)
    tangled = np.cumsum(np.random.default_rng(3).normal(size=(30, 3)), axis=0)
    tangled[-1, 0] = tangled[0, 0] + 10.0
    frames = Rotation.random(30, random_state=3).as_matrix()
    start, turned = (Rotation.from_rotvec([angle, 0.0, 0.0]).as_matrix() for angle in (0.0, 0.7))
    frames[[0, -1]] = start, turned
    # both together are the turn of the end and whole turns, however the rod lies between; half or
    # twice of one of them, or one of the other sign, is no whole number
    rest = writhe(tangled) + twist(tangled, frames) - 0.7 / (2.0 * math.pi)
    assert abs(writhe(tangled)) > 0.1
    assert abs(rest - round(rest)) < 1e-6
    along = np.column_stack([np.linspace(0.0, 1.0, 41), np.zeros((41, 2))])
    turning = Rotation.from_rotvec(np.outer(np.linspace(0.0, -12.0, 41), [1.0, 0.0, 0.0]))
    assert twist(along, turning.as_matrix()) == pytest.approx(-6.0 / math.pi, rel=1e-12)


def test_plectoneme_is_that_of_theory() -> None:
    theory = load_case("plectoneme").build.__globals__["plectoneme"]
    angle, bending, radius = 0.3, 2e-3, 4e-3
    sine, double = math.sin(angle), math.cos(2.0 * angle)
    tension = bending / radius**2 * sine**4 * (0.5 + 1.0 / double)
    torque = 2.0 * bending / radius * sine**3 * math.cos(angle) / double
    # another root of the cubic has no angle, or one beyond 45 degrees
    assert theory(tension, bending, radius) == pytest.approx((angle, torque), rel=1e-9)
    assert theory(-tension, bending, radius) == (0.0, 0.0)
    with pytest.raises(ValueError, match=r"approach must be below the length, 1 m, got 1"):
        built("plectoneme", approach=1.0)
