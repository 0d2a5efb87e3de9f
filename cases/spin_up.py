# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spin-up of a flexible link: dynamic stiffening, and the results of a theory without it.

The outboard link of a space manipulator, a box of 8/3 m and a channel of 16/3 m of aluminium,
rotates about an axis parallel to its axis a3 that its root is ``--hub-radius`` away from:
``omega = 6/15 (t - 15/(2 pi) sin(2 pi t/15))`` rad/s for t <= 15 s, then 6 rad/s (``--speed``,
``--spin-up-time``). The beam lags behind (u2 < 0), then centrifugal forces straighten it. The mass
centre of the channel is ``--eccentricity`` away from its axis along a3, so that the beam bends out
of the plane (u3) and twists. No gravity.

Theories (``--theory``):

- ``consistent``: assumed modes with the stretch of the axis as coordinate: stiffens with the spin
- ``premature``: assumed modes with displacements that are linear from the start: no stiffening
- ``conventional``: the same of early codes, which move mass points on the axis: no moments of
  inertia of sections, no eccentric mass centres; without stiffening it diverges
- ``beam``: geometrically exact beam elements with a prescribed root
- ``floating``: bodies in floating frames with geometric stiffening, ``--bodies`` in each segment

``--leave-out`` takes effects out of the assumed modes: stiffening, extension, in_plane,
out_of_plane, torsion, warping, shear_2 and shear_3 (shear), torsional_inertia, rotary_inertia_2 and
rotary_inertia_3 (rotary_inertia), eccentricity_2 and eccentricity_3 (eccentricity), and
section_inertia, sections in the equations of motion, but not in the modes. ``--rotations vector``
rotates sections about the vector theta, not about a1, a2 and a3 in sequence. The tip may start from
``--initial-u2`` and so on, bent as by loads there.

``consistent`` is linear in the deformation, and so is each body of ``floating``. With the hub of 8
m and the eccentricity the channel is near lateral buckling while it is spun up and twists by tens
of degrees: there small errors grow. From the exact beam's lag of 0.385 m and twist of 42.8 degrees
``consistent`` is 4 % and 22 % off at the peaks, 0.8, 1.9 and 0.8 degrees at 8, 10 and 12 s, and
settles as the exact beam does; with ``--rotations vector`` it is 21, 22 and 12 degrees off then.
``floating`` with eight bodies in each segment is 3 % and 11 % off at the peaks and 0.9, 0.2 and 0.1
degrees then; with ``--bodies 4 --body-modes 4`` it is 19 % and 48 % off at the peaks. ``beam`` and
``floating`` need steps of 0.012 s or less, or ``--rho-inf 0.8``: with ``--dt 0.02`` they rotate by
0.12 rad in a step, and vibrations along the link grow until steps fail, from 16 or 17 s on: the run
ends there, or the shorter steps that replace them leave the channel twisting by 20 degrees and
more, as it warns. Without hub and eccentricity ``consistent`` and ``floating`` follow the exact
beam within 0.1 % of the largest lag, 0.2 m.

History: of the tip in the axes of the base, ``u2`` (m, in the plane of rotation), ``u3`` (m, along
the spin axis), ``theta1`` (rad, twist), ``s`` (m, stretch along the deformed axis; of ``beam`` the
sum of the elements' extensions).

Figure of theories, with axes that cut off diverging curves:
``flexfem sweep spin_up --vary theory=consistent,conventional,beam --plot u2,u3,theta1 --clip``.
Run: ``python cases/spin_up.py --theory beam --output results/beam``.
"""

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

import flexfem as ff
from flexfem import research

LINK = tuple(option.name for option in research.LINK_OPTIONS)


def build(*, hub_radius: float, speed: float, spin_up_time: float, **given: Any) -> Any:
    """The outboard link on its prescribed base, by the chosen theory."""
    link = research.outboard_link(**{name: given.pop(name) for name in LINK})
    still, turn = research.constant_angle(0.0), research.spin_up_angle(speed, spin_up_time)
    base = research.manipulator_base(still, turn, still, link_1=0.0, link_2=hub_radius)
    return research.beam_by_theory(link, base, "spin_up", **given)


def results(
    history: Mapping[str, npt.NDArray[np.float64]], *, spin_up_time: float
) -> dict[str, float]:
    """Largest lag and twist, and means after the spin-up."""
    out = {
        "u2_min": float(history["u2"].min()),
        "u3_min": float(history["u3"].min()),
        "theta1_largest": float(np.abs(history["theta1"]).max()),
    }
    after = history["t"] >= spin_up_time
    if after.any():
        out |= {f"{name}_mean": float(history[name][after].mean()) for name in research.TIP_COLUMNS}
    return out


CASE = ff.Case(
    name="spin_up",
    summary="spin-up of a flexible link: dynamic stiffening by five theories",
    description=__doc__,
    build=build,
    options=(
        ff.Option("hub_radius", float, 8.0, "from the spin axis to the root", unit="m", minimum=0),
        ff.Option("speed", float, 6.0, "after the spin-up", unit="rad/s"),
        ff.Option("spin_up_time", float, 15.0, "from rest to the speed", unit="s", above=0),
        *research.THEORY_OPTIONS,
        *research.LINK_OPTIONS,
    ),
    dt=0.01,
    t_end=30.0,
    smoke={"elements": 6, "assumed_modes": 4, "bodies": 2, "t_end": 0.1},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
