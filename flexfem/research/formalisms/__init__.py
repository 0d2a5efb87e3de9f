# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equations of motion that UFL derives from energies, by four formalisms of mechanics.

Bodies are described in floating frames, ``r_M = r_O + R (r + u)``, with every degree of freedom of
a DOLFINx mesh as an elastic coordinate. Written by hand are positions of material points, their
densities and a strain energy; velocities, accelerations, inertia, gyroscopic and centrifugal terms
and all Jacobians come out of ``ufl.derivative``.

frames        coordinates of planar and spatial floating frames
matter        material and elements of a body: beams, plane stress, solids
derivation    energies of a body, and the equations of the four formalisms
counting      sizes of the derived expressions and of the generated code
study         declaration of a comparison
joints        constraints and forces between bodies as UFL expressions
mechanism     declaration of bodies, joints and forces
coordinates   the coordinates as loops over cells take them
compiled      kernels and connectivity of a body or a joint
nodes         meshes of the bodies, and the coordinates of their nodes
equations     the equations of a mechanism: residuals, matrices, constraints
formalism     the four formalisms as equations for accelerations
motion        one formalism as equations to be integrated

All energies are functions of the coordinates q of a mechanism: for each body those of its frame,
then its free elastic ones. A mechanism is on every rank as a whole: its bodies are coupled by few,
dense equations, which cost less than the messages of their distribution.
"""
