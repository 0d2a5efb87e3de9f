# SPDX-License-Identifier: LGPL-3.0-or-later
"""Deployment of a space manipulator with a flexible outboard link.

Links L1 and L2 are rigid, 8 m each; the outboard link is a box of 8/3 m and a channel of 16/3 m of
aluminium whose mass centre is ``--eccentricity`` away from its axis along a3. Joint 1 rotates L1
about the vertical, joints 2 and 3 have horizontal axes. Folded at the start (all angles pi), each
angle changes by ``-D (t - T/(2 pi) sin(2 pi t/T))/T`` within T = 15 s (``--duration``): D1 = pi/2,
D2 = 3 pi/4 and D3 = ``--outer-turn`` pi (1: the arm ends stretched; 0.5: the source's other
reading). No gravity.

Theories (``--theory``), see also the case ``spin_up``: ``consistent``, ``premature`` and
``conventional`` assumed modes, geometrically exact ``beam`` elements, bodies in ``floating``
frames. The motion is slow: stiffening hardly matters. Deflections reach 1.6 per cent of the length,
where ``consistent`` is off by 1 to 2 per cent of the largest u2 and u3 and ``conventional`` by 3 to
4; without eccentric mass centres that does not twist. The thin channel is also twisted by bending
moments in two planes, of second order in the deflections: the exact twist takes another course on
the way, by up to 29 per cent of its peak. ``floating``, whose bodies rotate with the channel,
follows it: already with ``--bodies 2 --body-modes 4`` it is 0.5 per cent off in both deflections
and 5 in the twist.

History: of the tip in the axes of the base, L2's end, ``u2`` (m, in the plane of joints 2 and 3),
``u3`` (m, across), ``theta1`` (rad, twist), ``s`` (m, stretch along the deformed axis; of ``beam``
the sum of the elements' extensions).

Figure of theories: ``flexfem sweep manipulator_deployment --vary
theory=consistent,conventional,beam --plot u2,u3,theta1 --clip``.
Run: ``python cases/manipulator_deployment.py --theory beam --output results/beam``.
"""

import math
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

import flexfem as ff
from flexfem import research

LINK = tuple(option.name for option in research.LINK_OPTIONS)
JOINTS = ("inner", "middle", "outer")


def build(*, duration: float, link_1: float, link_2: float, **given: Any) -> Any:
    """The outboard link on its prescribed base, by the chosen theory."""
    link = research.outboard_link(**{name: given.pop(name) for name in LINK})
    starts, turns = (
        [math.pi * given.pop(f"{joint}_{what}") for joint in JOINTS] for what in ("start", "turn")
    )
    angles = [
        research.smooth_turn(start, -turn, duration)
        for start, turn in zip(starts, turns, strict=True)
    ]
    base = research.manipulator_base(*angles, link_1=link_1, link_2=link_2)
    return research.beam_by_theory(link, base, "deployment", **given)


def results(history: Mapping[str, npt.NDArray[np.float64]], *, duration: float) -> dict[str, float]:
    """Extremes during the deployment, and amplitudes of the vibration that is left."""
    out = {}
    after = history["t"] >= duration
    for name in research.TIP_COLUMNS:
        values = history[name]
        out |= {f"{name}_min": float(values.min()), f"{name}_max": float(values.max())}
        if after.any():
            out[f"{name}_left"] = float(0.5 * np.ptp(values[after]))
    return out


def turn(joint: str, number: int, by: float) -> ff.Option:
    """Option of a joint's turn."""
    text = f"of joint {number} backwards, in multiples of pi"
    return ff.Option(f"{joint}_turn", float, by, text, minimum=-2, maximum=2)


CASE = ff.Case(
    name="manipulator_deployment",
    summary="deployment of a space manipulator with a flexible outboard link, by five theories",
    description=__doc__,
    build=build,
    options=(
        ff.Option("link_1", float, 8.0, "length of the inner rigid link", unit="m", minimum=0),
        ff.Option("link_2", float, 8.0, "length of the outer rigid link", unit="m", minimum=0),
        ff.Option("duration", float, 15.0, "of the turns", unit="s", above=0),
        turn("inner", 1, 0.5),
        turn("middle", 2, 0.75),
        turn("outer", 3, 1.0),
        *(
            ff.Option(f"{joint}_start", float, 1.0, "angle in multiples of pi", minimum=-2,
                      maximum=2)
            for joint in JOINTS
        ),
        *research.THEORY_OPTIONS,
        *research.LINK_OPTIONS,
    ),
    dt=0.01,
    t_end=30.0,
    smoke={"elements": 6, "assumed_modes": 4, "bodies": 2, "t_end": 0.1},
    results=results,
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
