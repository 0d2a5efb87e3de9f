# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact by a barrier: nothing penetrates, and no energy is made.

``surface`` makes cells of the collision surfaces of each contact, ``pairs`` finds those that may
touch and evaluates them, ``rows`` hands them to the linear solvers, and ``contacts`` joins all
contacts of a system on a rank with the nodes that carry them.
"""
