# SPDX-License-Identifier: LGPL-3.0-or-later
"""A result folder as one HTML file that shows it: motion to turn and play, colours, histories.

``instants`` reads what is there and chooses what is shown, ``layers`` make of every series what
moves and how, ``packing`` makes it small, ``document`` puts all of it and the program of the page
(``web/``) into one file.
"""
