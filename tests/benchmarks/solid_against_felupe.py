# SPDX-License-Identifier: LGPL-3.0-or-later
"""Large bending of a rubber block: flexfem against FElupe on the same mesh.

FElupe (PyPI) is a code of its own for hyperelastic solids in NumPy. Both solve the same equations,
neo-Hookean quadratic tetrahedra with four points and dead forces at the same nodes, in as many load
steps; displacements must agree to round-off of Newton's method. With FElupe installed::

    python tests/benchmarks/solid_against_felupe.py --counts 8 2 2

FElupe may be in another environment, ``--felupe PYTHON``: each code runs in a process of its own.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

MU, BULK, PRESSURE, STEPS = 1e6, 5e6, 2e4, 5
SIZES = (1.0, 0.2, 0.2)


def flexfem(counts: list[int], file: Path) -> None:
    """Solve with flexfem; write nodes, cells, forces and displacements to a file."""
    import ufl

    import flexfem as ff
    from flexfem.simulation.statics import StaticSteps

    def energy(F, p):
        J = ufl.det(F)
        return p.mu / 2 * (J ** (-2 / 3) * ufl.inner(F, F) - 3) + p.bulk / 2 * (J - 1) ** 2

    mesh = ff.SolidMesh.box(SIZES, counts, "tetrahedron")
    law = ff.laws.Hyperelastic(energy, {"mu": MU, "bulk": BULK})
    solid = ff.Solid("block", law, mesh, density=1000.0, fixed={"x0": "xyz"})
    model = ff.Model("block")
    model.add(solid, ff.SurfaceTraction("push", "block", "x1", (0.0, 0.0, PRESSURE)))
    options = ff.StaticOptions(load_steps=STEPS, tolerance=1e-10, output=file.parent / "results")
    start = time.perf_counter()
    steps: list[StaticSteps] = []
    made = StaticSteps.__init__

    def keep(self, *given, **named):
        made(self, *given, **named)
        steps.append(self)

    StaticSteps.__init__ = keep
    outcome = ff.solve_static(model, options)
    seconds = time.perf_counter() - start
    block = steps[0].system.parts[0].block
    u = np.empty_like(solid.points)
    u[block.node_ids] = block.frames[:, :3] - block.start_frames[:, :3]
    nodes, areas = solid.figure.area_weights("block", "x1")
    np.savez(
        file, points=solid.points, cells=solid.nodes.cells, u=u, held=solid.held.all(axis=1),
        nodes=nodes, forces=areas[:, np.newaxis] * [0.0, 0.0, PRESSURE],
    )  # fmt: skip
    print(json.dumps({"seconds": seconds, "status": str(outcome.status)}))


#: The same for FElupe, in a script without flexfem; edges of tetrahedra in its order.
FELUPE = """
import json, sys, time
import felupe as fem
import numpy as np
data = np.load(sys.argv[1])
cells = data["cells"][:, [0, 1, 2, 3, 9, 6, 8, 7, 5, 4]]
start = time.perf_counter()
mesh = fem.Mesh(data["points"], cells, "tetra10")
region = fem.RegionQuadraticTetra(mesh)
field = fem.FieldContainer([fem.Field(region, dim=3)])
held = {"held": fem.Boundary(field[0], mask=data["held"])}
dof0, dof1 = fem.dof.partition(field, held)
ext0 = fem.dof.apply(field, held, dof0)
body = fem.SolidBody(fem.NeoHooke(mu=float(sys.argv[2]), bulk=float(sys.argv[3])), field)
for step in range(1, int(sys.argv[4]) + 1):
    load = fem.PointLoad(field, data["nodes"], values=data["forces"] * step / int(sys.argv[4]))
    fem.newtonrhapson(items=[body, load], dof0=dof0, dof1=dof1, ext0=ext0, tol=1e-12, verbose=0)
seconds = time.perf_counter() - start
u = field[0].values
gap = float(np.abs(u - data["u"]).max())
print(json.dumps({"seconds": seconds, "largest": float(np.abs(u).max()), "gap": gap}))
"""


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", type=int, nargs=3, default=[8, 2, 2], help="cells along axes")
    parser.add_argument("--felupe", default=sys.executable, help="Python that has FElupe")
    parser.add_argument("--own", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.own:
        flexfem(args.counts, args.own)
        return
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "block.npz"
        counts = ["--counts", *map(str, args.counts)]
        own = [sys.executable, __file__, "--own", str(file), *counts]
        script = Path(folder) / "peer.py"
        script.write_text(FELUPE)
        peer = [args.felupe, str(script), str(file), str(MU), str(BULK), str(STEPS)]
        for name, command in (("flexfem", own), ("flexfem again", own), ("felupe", peer)):
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            print(name, done.stdout.strip().splitlines()[-1])


if __name__ == "__main__":
    main()
