# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact by a barrier: nothing penetrates, and no energy is made.

``surface`` makes cells and obstacles of the collision surfaces of each contact, ``kinds`` finds and
evaluates the pairs of both kinds, ``grouped`` their groups with dissipation, ``pairs`` has those of
one contact, ``rows`` hands them to the linear solvers, and ``contacts`` joins all contacts of a
system on a rank with the nodes that carry them.
"""
