# SPDX-License-Identifier: LGPL-3.0-or-later
"""Types of elements of gmsh by their numbers."""

__all__ = ["CELLS", "ELEMENTS", "ORDER", "POINT"]

POINT = 15

# Numbers of nodes by the number of the type; a hexahedron of order 9 has 1000
_SHAPES = {
    "Point": {15: 1},
    "Line": {1: 2, 8: 3, 26: 4, 27: 5, 28: 6, 62: 7, 63: 8, 64: 9, 65: 10, 66: 11, 84: 1},
    "Triangle": {
        2: 3, 9: 6, 20: 9, 21: 10, 22: 12, 23: 15, 24: 15, 25: 21, 42: 28, 43: 36, 44: 45, 45: 55,
        46: 66, 52: 18, 53: 21, 54: 24, 55: 27, 56: 30, 85: 1,
    },
    "Quadrilateral": {
        3: 4, 10: 9, 16: 8, 36: 16, 37: 25, 38: 36, 39: 12, 40: 16, 41: 20, 47: 49, 48: 64, 49: 81,
        50: 100, 51: 121, 57: 24, 58: 28, 59: 32, 60: 36, 61: 40, 86: 1,
    },
    "Tetrahedron": {
        4: 4, 11: 10, 29: 20, 30: 35, 31: 56, 32: 22, 33: 28, 71: 84, 72: 120, 73: 165, 74: 220,
        75: 286, 79: 34, 80: 40, 81: 46, 82: 52, 83: 58, 87: 1,
    },
    "Hexahedron": {
        5: 8, 12: 27, 17: 20, 88: 1, 92: 64, 93: 125, 94: 216, 95: 343, 96: 512, 97: 729, 98: 1000,
        99: 32, 100: 44, 101: 56, 102: 68, 103: 80, 104: 92, 105: 104,
    },
    "Prism": {6: 6, 13: 18, 18: 15, 89: 1, 90: 40, 91: 75},
    "Pyramid": {
        7: 5, 14: 14, 19: 13, 118: 30, 119: 55, 120: 91, 121: 140, 122: 204, 123: 285, 124: 385,
        125: 21,
    },
}  # fmt: skip
_DIMENSIONS = {"Point": 0, "Line": 1, "Triangle": 2, "Quadrilateral": 2}

#: Name, dimension and number of nodes of each type.
ELEMENTS = {
    number: (f"{shape} {nodes}", _DIMENSIONS.get(shape, 3), nodes)
    for shape, types in _SHAPES.items()
    for number, nodes in types.items()
}

#: Kinds of cells of those that have a place in a mesh.
CELLS = {
    1: "line", 2: "triangle", 3: "quad", 4: "tetra", 5: "hexahedron", 6: "wedge", 7: "pyramid",
    8: "line3", 9: "triangle6", 10: "quad9", 11: "tetra10", 12: "hexahedron27", 16: "quad8",
    17: "hexahedron20", 18: "wedge15", 19: "pyramid13",
}  # fmt: skip

_EDGES = [8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]
#: Gmsh's place of each node of VTK's order; those of wedges and pyramids need corners only.
ORDER = {
    "tetra10": [*range(8), 9, 8],
    "hexahedron20": [*range(8), *_EDGES],
    "hexahedron27": [*range(8), *_EDGES, 22, 23, 21, 24, 20, 25, 26],
}
