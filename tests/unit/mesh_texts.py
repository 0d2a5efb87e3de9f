# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small mesh files as other programs write them."""

#: A frame of two legs and a beam of second order, millimetres.
ABAQUS_FRAME = """\
*Heading
** written by hand
*Node, nset=ALL
1, 0., 0., 0.
2, 0., 0., 500.
3, 0., 0., 1000.
*NODE
 7, 1000.,, 1.0E3
 8, 2000., 0.D0, 1000.
 9, 2000., 0., 0.
*Element, type=B31, elset=LEGS
1, 1, 2
2, 2, 3
*Element, type=b32, elset=Beam
4, 3, 7,
8
*Element, type=B33, elset=legs
5, 8, 9
*Element, type=CONN3D2, elset=HINGE
6, 3, 8
*Nset, nset=FEET
1, 9
*Nset, nset=TOP_LEFT
3
*NSET, NSET=CORNERS
TOP_LEFT, 8
*Nset, nset="left leg", generate
 1, 3, 1
*Elset, elset=FRAME
LEGS, BEAM
*Elset, elset=NOTHING
*Node Output
U, V
*Step
*End Step
"""

#: One part placed twice, as Abaqus/CAE writes it.
ABAQUS_ASSEMBLY = """\
*Heading
*Part, name=ROD
*Node
      1,           0.,           0.,           0.
      2,           1.,           0.,           0.
      3,           2.,           0.,           0.
*Element, type=B31
1, 1, 2
2, 2, 3
*Nset, nset=TIP
 3,
*Elset, elset=ROOT_CELL
 1,
*End Part
*Part, name=PIN
*Node
1, 0., 0., 0.
2, 0., 0., 1.
*Element, type=B31, elset=PIN_CELLS
1, 1, 2
*End Part
*Assembly, name=Assembly
*Instance, name=First, part=ROD
*End Instance
*Instance, name=Second, part=ROD
          1.,           0.,           0.
          1.,           0.,           0.,           1.,           0.,           1.,          90.
*End Instance
*Instance, name=Pin-1, part=PIN
0., 0., 5.
*End Instance
*Nset, nset=ENDS, instance=First
 1,
*Nset, nset=ENDS, instance=Second
 3,
*Elset, elset=RODS, instance=First, generate
 1, 2, 1
*Elset, elset=RODS, instance=second
 1, 2
*Elset, elset=_inner, internal, instance=First
 1,
*Nset, nset=SECOND_TIP
Second.TIP
*End Assembly
"""

#: Parts without a mesh, which is in their instances, as Abaqus/CAE writes independent ones.
ABAQUS_INSTANCES = """\
*Heading
*Part, name=rod
*End Part
*Part, name=pin
*Node
1, 0., 0., 0.
*Nset, nset=foot
1
*End Part
*Assembly, name=Assembly
**
*Instance, name=rod-1, part=rod
*Node
      1,           0.,           0.,           0.
      2,           1.,           0.,           0.
      3,           2.,           0.,           0.
*Element, type=B31
1, 1, 2
2, 2, 3
*Nset, nset=all, generate
 1,  3,  1
*Elset, elset=cells, generate
 1,  2,  1
*Beam Section, elset=cells, material=steel, section=circ
0.01
0., 0., -1.
*End Instance
**
*Instance, name=pin-1, part=pin
          1.,           2.,           0.
          1.,           2.,           0.,           1.,           2.,           1.,          90.
*Node
2, 3., 0., 0.
*Element, type=B31
1, 1, 2
*Elset, elset=cells
1
*Nset, nset=tip
2
*End Instance
**
*Node
1, 9., 9., 9.
*Nset, nset=left, instance=rod-1
 1,
*Nset, nset=right, instance=ROD-1, generate
 3, 3, 1
*Nset, nset=reference
 1,
*Elset, elset=_half, internal, instance=rod-1
 2,
*Elset, elset=both
rod-1.cells, pin-1.cells
*End Assembly
*Material, name=steel
"""

#: Two plates at a right angle, with a stiffener along the common edge; cells of 3 and 4 nodes.
ABAQUS_PLATES = """\
*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 2, 0, 0
4, 0, 1, 0
5, 1, 1, 0
6, 2, 1, 0
7, 0, 0, 1
8, 1, 0, 1
*ELEMENT, TYPE=S4R, ELSET=FLOOR
1, 1, 2, 5, 4
*ELEMENT, TYPE=S3, ELSET=FLOOR
2, 2, 3, 6
3, 2, 6, 5
*ELEMENT, TYPE=S4, ELSET=WALL
4, 1, 2, 8, 7
*ELEMENT, TYPE=B31, ELSET=STIFFENER
5, 1, 2
*NSET, NSET=BACK
4, 5, 6
*NSET, NSET=CORNER
3
*NSET, NSET=FLOOR_NODES, ELSET=FLOOR
*SURFACE, NAME=RIGHT, TYPE=ELEMENT
2, E2
*SURFACE, NAME=TOP, TYPE=ELEMENT
WALL, E3
"""

#: Free, small and large fields, continuations, properties, materials and sets.
NASTRAN_FRAME = """\
SOL 101
CEND
SET 5 = 1 THRU 3,
        9 $ grid points
SET 6 = 11
BEGIN BULK
PBARL   7       3               TUBE
+       0.1     0.09
PSHELL,8,3,0.01
MAT1,3,2.1+11,,0.3,7850.
GRID    1               0.      0.      0.
GRID*                  2                              0.              0.
*                  1.0E3
GRID,3,,1.+3,0.,1000.
GRID    9               1000.   1000.   1000.
GRID,4,,0.,1000.,1000.
CBAR    11      7       1       2       1.      0.      0.
CBAR    12      7       2       3       1.0     0.0     0.0     +A
+A                      0.      0.      10.
CQUAD4  21      8       2       3       9       4       30.     0.5
CTRIA3,22,9,1,2,3,45.
CONROD,31,1,3,4,1.E-4
CBUSH,41,1,1,2
SET1    8       21      THRU    30
SET3,9,GRID,4,9
ENDDATA
this is not read
"""

#: Two hexahedra in two layers, with faces by a surface and by nodes; metres.
ABAQUS_BLOCK = """\
*NODE
 1, 0, 0, 0
 2, 1, 0, 0
 3, 1, 2, 0
 4, 0, 2, 0
 5, 0, 0, 1
 6, 1, 0, 1
 7, 1, 2, 1
 8, 0, 2, 1
 9, 0, 0, 4
10, 1, 0, 4
11, 1, 2, 4
12, 0, 2, 4
*ELEMENT, TYPE=C3D8R, ELSET=LOWER
1, 1, 2, 3, 4, 5, 6, 7, 8
*ELEMENT, TYPE=C3D8, ELSET=UPPER
2, 5, 6, 7, 8, 9, 10, 11,
12
*NSET, NSET=BOTTOM
1, 2, 3, 4
*SURFACE, NAME=TOP
2, S2
*SURFACE, NAME=SIDE, TYPE=ELEMENT
LOWER, S3
UPPER, S3
"""

#: A cell of each solid shape that fill a box of 3 x 1 x 1 with a roof over its last third.
ABAQUS_MIXED = """\
*NODE
 1, 0, 0, 0
 2, 1, 0, 0
 3, 1, 1, 0
 4, 0, 1, 0
 5, 0, 0, 1
 6, 1, 0, 1
 7, 1, 1, 1
 8, 0, 1, 1
 9, 2, 0, 0
10, 2, 1, 0
11, 2, 0, 1
12, 2, 1, 1
13, 0.5, 0.5, 2
14, 0.5, -1, 1.5
*ELEMENT, TYPE=C3D8, ELSET=ALL
1, 1, 2, 3, 4, 5, 6, 7, 8
*ELEMENT, TYPE=C3D6, ELSET=ALL
2, 2, 9, 3, 6, 11, 7
3, 9, 10, 3, 11, 12, 7
*ELEMENT, TYPE=C3D5, ELSET=ALL
4, 5, 6, 7, 8, 13
*ELEMENT, TYPE=C3D4, ELSET=ALL
5, 5, 6, 13, 14
*SURFACE, NAME=END
1, S6
*NSET, NSET=FRONT
1, 2, 9, 5, 6, 11
"""

#: Legacy VTK: two triangles and a quadrilateral with materials and marked points.
VTK_SHEET = """\
# vtk DataFile Version 2.0
sheet
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 6 double
0 0 0  1 0 0  1 1 0  0 1 0  2 0 0  2 1 0
CELLS 3 13
3 0 1 2
3 0 2 3
4 1 4 5 2
CELL_TYPES 3
5
5
9
CELL_DATA 3
SCALARS material int 1
LOOKUP_TABLE default
0 0 4
SCALARS thickness double 1
LOOKUP_TABLE default
0.1 0.1 0.2
POINT_DATA 6
SCALARS mark int 1
LOOKUP_TABLE default
0 7 7 0 0 3
"""
