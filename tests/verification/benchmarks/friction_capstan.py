# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rope that is drawn over a cylinder with friction (Euler, Eytelwein), from the case ``capstan``.

Of a rope of radius r over a cylinder of radius R, friction acts at R and the tension at R + r, so
that the tensions are as exp(mu angle R/(R + r)). What touches is the middle of the chord of each
element, whose force its two nodes share equally: with chords of the angle a the exponent is less by
about a^2/4 of it.
"""

import math

from flexfem.cli import load_case
from tests.verification.result import Result

#: Ratio of the radii of the cylinder and of the axis of the rope.
LEVER = 0.1 / 0.10025


def drawn(angle: float, friction: float, elements: int) -> float:
    """Ratio of the tensions."""
    given = {"angle": angle, "friction": friction, "elements": elements}
    outcome = load_case("capstan").run(**given, quiet=True)
    if outcome.status != "ok":
        raise RuntimeError(f"capstan {given}: {outcome.status}")
    return float(outcome.summary["results"]["ratio"])


def line(turns: float, friction: float, elements: int) -> Result:
    """Ratio beside that of Euler for a rope without a radius."""
    angle = 2.0 * math.pi * turns
    return Result(
        f"rope over {turns:g} turns, friction {friction:g}", "ratio of the tensions",
        math.exp(friction * angle), "exp(mu angle)", drawn(angle, friction, elements),
        f"{elements} elements, h = 1 ms", 1e-2,
    )  # fmt: skip


def results(full: bool = True) -> list[Result]:
    """Quarter, half and whole turns; tests run the case with fewer elements."""
    del full
    lines = [line(turns, mu, 40) for turns in (0.25, 0.5) for mu in (0.1, 0.3)]
    lines += [line(1.0, 0.1, 40), line(1.0, 0.3, 80)]
    coarse, right = drawn(2.0 * math.pi, 0.3, 40), math.exp(0.6 * math.pi * LEVER)
    # chords of twice the length are off by four times as much; a rope that touches with its nodes
    # only has a larger ratio than that of the formula
    return [
        *lines,
        Result("rope over 1 turns, friction 0.3", "ratio of the tensions", right,
               "exp(mu angle R/(R + r))", coarse, "40 elements, h = 1 ms", 1.5e-2),
        Result("rope over 1 turns, friction 0.3", "error with 40 elements over that with 80", 4.0,
               "chords", (right - coarse) / (right - lines[-1].ours), "h = 1 ms", 0.25),
    ]  # fmt: skip
