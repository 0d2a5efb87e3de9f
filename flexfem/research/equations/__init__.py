# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equations of motion in a vector of coordinates: as the studies of single papers integrate them.

vector_equations  base class of the equations, their state and pictures, protocol of a scheme
vector_stepper    common parts of schemes in time
vector_alpha      generalized-alpha for such equations
run.stepping      equations with their scheme: halved steps, state of a checkpoint
run.records       history, pictures and progress
run.simulate      a run from its start or a checkpoint to the results
"""
