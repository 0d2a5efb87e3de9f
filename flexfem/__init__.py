# SPDX-License-Identifier: LGPL-3.0-or-later
"""Flexible multibody dynamics with finite elements on DOLFINx and PETSc.

The public names are flat and loaded on first use::

    import flexfem as ff

    beam = ff.Beam("crank", ff.Section.circle(0.02, ff.Material(210e9, 0.3, 7850.0)))

so that building a model, and ``--help``, import neither DOLFINx nor PETSc nor numba.

Notation, the same in all modules (SI units throughout):

H = (x, R)         frame: position x in inertial components, R (3x3) maps from the frame to them
H <- H exp(w)      increments act from the right, in the frame's own axes
w = (u, theta)     increment of a frame: translation first, rotation second
v = (V, Omega)     twist in the frame's own axes: V = R^T dx/dt, Omega the body angular velocity
[x, R]             a frame in arrays: 12 numbers, x (3) then R row by row (9)
e1, e2, e3         axes of a beam's section: e1 the tangent, e2 and e3 in the section's plane
(gamma, kappa)     beam strains: extension, two shears along e2, e3, twist, bendings about e2, e3
(n, m)             stress resultants of a section: normal and shear forces, torque, bending moments
stiffness (6x6)    of a section, in the order of the strains
inertia (6x6)      of a section per length, acting on v: [[m I, -S], [S, J]], S = skew(rho A c)
Phi, G, lambda     constraints, their Jacobian dPhi = G w, their multipliers
r                  residual: r_inertial + r_internal - r_external + G^T lambda = 0
M, C, K            mass, damping and stiffness matrices: derivatives of r
A                  iteration matrix of a step: M, C and K combined, scaled by beta h^2
beta h^2           scale of all equations of a step; their multipliers are beta h^2 lambda
t                  time, or the load factor in statics, iterations of a relaxation
h, rho_inf         time step; spectral radius of an integrator at infinite frequency
"""

import atexit
import sys
import warnings
from importlib import import_module
from types import SimpleNamespace
from typing import Any

from flexfem import _leaving, launch
from flexfem._packages import without_collection

if launch.launched_in_parallel():
    # a script may fail on one rank before it comes to anything of ours
    sys.excepthook = launch.excepthook
    # or leave it, while others wait for it
    _leaving.note_exits()
    atexit.register(_leaving.leave)
    launch.limit_threads()
    launch.sleep_while_waiting()

__version__ = "0.1.0"

# The one list of public names: where each is defined.
_MODULES = {
    "Material": "materials.material",
    "OrthotropicMaterial": "materials.orthotropic",
    "Section": "materials.section",
    "SectionMesh": "sections.section_mesh",
    "OrientedMaterial": "sections.section_material",
    "SectionProperties": "sections.section_properties",
    "section_properties": "sections.section_properties",
    "SectionTable": "materials.section_table",
    "ThermalStrain": "materials.thermal_strain",
    "BeamLaw": "materials.section_law",
    "LineMesh": "mesh.line_mesh",
    "read_mesh": "mesh.line_mesh",
    "SurfaceMesh": "mesh.surface_mesh",
    "read_surface_mesh": "mesh.surface_mesh",
    "NurbsCurve": "mesh.nurbs.curve",
    "read_curves": "mesh.curve_files",
    "build_mesh": "mesh.library",
    "build_surface_mesh": "mesh.library",
    "ElementMesh": "mesh.element_mesh",
    "BodyMesh": "mesh.body_mesh",
    "build_body_mesh": "mesh.body_mesh",
    "read_body_mesh": "mesh.body_mesh",
    "BeamData": "io.beams.beam_data",
    "read_section_table": "io.beams.section_stations",
    "read_beamdyn": "io.beams.beamdyn",
    "read_windio": "io.beams.windio",
    "Pose": "core.pose",
    "Beam": "model.bodies.basic",
    "Shell": "model.bodies.shell",
    "SHELL_ELEMENTS": "model.bodies.shell",
    "ModalDamping": "model.modal_damping",
    "weld": "model.weld",
    "Contact": "model.contact",
    "ContactProbe": "model.contact",
    "RigidCylinder": "model.rigid_surface",
    "RigidMesh": "model.rigid_surface",
    "RigidObstacle": "model.rigid_surface",
    "RigidPlane": "model.rigid_surface",
    "RigidSphere": "model.rigid_surface",
    "ShellSection": "materials.shell_section",
    "Ply": "materials.shell_section",
    "ShellLaw": "materials.section_law",
    "RigidBody": "model.bodies.basic",
    "FloatingBody": "model.bodies.floating_body",
    "UFLBody": "model.bodies.ufl_body",
    "CableNet": "model.bodies.cable_net",
    "Solid": "families.solid.body",
    "SolidMesh": "families.solid.meshes.mesh",
    "StoredSolidMesh": "families.solid.meshes.stored",
    "store_solid_mesh": "families.solid.meshes.store",
    "SolidMarker": "families.solid.body",
    "SolidProbe": "families.solid.probes",
    "SurfacePressure": "families.solid.loads",
    "SurfaceTraction": "families.solid.loads",
    "Body": "model.bodies.base",
    "NodeSetMarker": "model.bodies.mesh_body",
    "PointMass": "model.bodies.basic",
    "Many": "model.many",
    "each": "model.many",
    "BodyLine": "reduction.body_line",
    "ElasticPolynomial": "reduction.elastic_polynomial",
    "Box": "model.bodies.shapes",
    "Sphere": "model.bodies.shapes",
    "Cylinder": "model.bodies.shapes",
    "Capsule": "model.bodies.shapes",
    "SurfaceShape": "model.bodies.shapes",
    "CompoundShape": "model.bodies.shapes",
    "Marker": "core.marker",
    "Carrier": "core.marker",
    "ShellLine": "core.marker",
    "SurfaceMarker": "core.marker",
    "AmplitudeMarker": "core.marker",
    "SlidingMarker": "core.marker",
    "Ground": "core.marker",
    "gradient": "gradients.gradient",
    "tangent_motion": "gradients.gradient",
    "Gradient": "gradients.gradient",
    "TangentMotion": "gradients.gradient",
    "Functional": "gradients.motion.functionals",
    "misfit": "gradients.motion.functionals",
    "minimize": "gradients.minimize",
    "Optimum": "gradients.minimize",
    "identify": "gradients.identify",
    "Identification": "gradients.identify",
    "uncertainty": "gradients.uncertainty",
    "Uncertainty": "gradients.uncertainty",
    "jax_function": "gradients.jax_function",
    "torch_function": "gradients.torch_function",
    "MovableMesh": "gradients.shapes.movable_mesh",
    "ParameterSearch": "gradients.parameter_search",
    "FoundParameters": "gradients.parameter_search",
    "Probe": "model.probes.base",
    "PositionProbe": "model.probes.base",
    "MarkerState": "model.probes.base",
    "Event": "model.event",
    "LockJoint": "model.event",
    "ReleaseJoint": "model.event",
    "Rebound": "model.event",
    "Stop": "model.event",
    "ElongationProbe": "model.probes.measured",
    "EnergyProbe": "model.probes.measured",
    "MomentumProbe": "model.probes.measured",
    "ReactionProbe": "model.probes.measured",
    "ReductionErrorProbe": "model.probes.measured",
    "AggregateProbe": "model.probes.aggregate",
    "CableProbe": "model.probes.cable",
    "StrainProbe": "model.probes.measured",
    "ShellEnergyProbe": "model.probes.measured",
    "ShellStrainProbe": "model.probes.measured",
    "Controller": "model.controller",
    "FmuController": "model.fmu_controller",
    "PID": "control.pid",
    "StateSpace": "control.state_space",
    "Model": "model.model",
    "Interface": "reduction.reduced_body",
    "Recovery": "reduction.reduced_body",
    "ReducedBody": "reduction.reduced_body",
    "LinearBody": "reduction.fem.body.linear_body",
    "MassField": "reduction.fem.body.linear_body",
    "solid_body": "reduction.fem.solid",
    "plane_body": "reduction.fem.solid",
    "beam_body": "reduction.fem.beam",
    "shell_body": "reduction.fem.shell",
    "euler_bernoulli_body": "reduction.fem.euler_bernoulli",
    "reduce_body": "reduction.fem.reduce",
    "read_materials": "io.tables.section_table",
    "read_sections": "io.tables.section_table",
    "read_history": "io.tables.history",
    "View": "io.view.document",
    "view": "io.view.document",
    "save_reduced_body": "io.hdf5.reduced_body",
    "load_reduced_body": "io.hdf5.reduced_body",
    "Joint": "core.joint",
    "AxisJoint": "core.joint",
    "Row": "core.row",
    "RowKind": "core.row",
    "Term": "core.row",
    "Spherical": "joints.spherical",
    "Sliding": "joints.sliding",
    "PrescribedSlide": "joints.prescribed_slide",
    "SlideStop": "joints.slide_stop",
    "Revolute": "joints.revolute",
    "Prismatic": "joints.prismatic",
    "Cylindrical": "joints.cylindrical",
    "Rigid": "joints.rigid",
    "PointOnLine": "joints.point_on_line",
    "PointOnPlane": "joints.point_on_plane",
    "Universal": "joints.universal",
    "RevoluteSpherical": "joints.revolute_spherical",
    "ConstantVelocity": "joints.constant_velocity",
    "Screw": "joints.screw",
    "Planar": "joints.planar",
    "Gear": "joints.gear",
    "Coupling": "joints.coupling",
    "Pulley": "joints.pulley",
    "Cable": "joints.cable",
    "Cam": "joints.cam",
    "Catenary": "joints.catenary",
    "Eyelet": "joints.cable_guides",
    "Sheave": "joints.cable_guides",
    "CustomJoint": "joints.custom_joint",
    "CustomForce": "joints.custom_force",
    "Curve": "core.curves.curve",
    "Ends": "joints.force",
    "Force": "joints.force",
    "Distance": "joints.distance",
    "Generic": "joints.generic",
    "RigidNodes": "joints.rigid_nodes",
    "RigidPoints": "joints.rigid_points",
    "HingeLine": "joints.hinge_line",
    "ClampedLine": "joints.clamped_line",
    "PrescribedTranslation": "joints.prescribed_translation",
    "PrescribedRotation": "joints.prescribed_rotation",
    "PrescribedAngle": "joints.prescribed_angle",
    "PrescribedDisplacement": "joints.prescribed_displacement",
    "PrescribedDistance": "joints.prescribed_distance",
    "SpringDamper": "joints.spring_damper",
    "TorsionalSpringDamper": "joints.torsional_spring_damper",
    "Bushing": "joints.bushing",
    "LimitStop": "joints.limit_stop",
    "JointFriction": "joints.joint_friction",
    "Lock": "joints.lock",
    "Actuator": "joints.actuator",
    "Gravity": "loads.gravity",
    "Load": "core.load",
    "PointForce": "loads.point_force",
    "PointMoment": "loads.point_moment",
    "LineLoad": "loads.line_load",
    "LineTable": "loads.line_table",
    "EdgeLoad": "loads.edge_load",
    "SurfaceLoad": "loads.surface_load",
    "Pressure": "loads.pressure",
    "Table": "loads.amplitude",
    "Spline": "loads.amplitude",
    "SmoothStep": "loads.amplitude",
    "TimeFunction": "loads.amplitude",
    "read_urdf": "robots.urdf",
    "Robot": "robots.robot",
    "BeamLink": "robots.flexible",
    "FloatingLink": "robots.flexible",
    "assemble": "kinematics.assemble",
    "inverse_dynamics": "kinematics.inverse_dynamics",
    "InverseDynamics": "kinematics.inverse_dynamics",
    "LeastEffort": "kinematics.distribution",
    "LeastPower": "kinematics.distribution",
    "LeastJointForces": "kinematics.distribution",
    "describe": "inspection.description",
    "Description": "inspection.description",
    "check": "inspection.check",
    "Finding": "inspection.finding",
    "Case": "case",
    "load_case": "case",
    "sweep": "studies.sweep",
    "Workers": "studies.workers",
    "sensitivities": "studies.sensitivities",
    "Sensitivity": "studies.sensitivities",
    "Option": "options",
    "GridOption": "options",
    "VectorOption": "options",
    "grid_nodes": "options",
    "RunOptions": "analyses.dynamics",
    "ModeOptions": "analyses.modes",
    "CampbellOptions": "analyses.modes",
    "RotorOptions": "analyses.modes",
    "LinearOptions": "analyses.modes",
    "StaticOptions": "analyses.statics",
    "RelaxationOptions": "analyses.relaxation",
    "RELAXATION": "analyses.relaxation",
    "MODES": "analyses.modes",
    "CAMPBELL": "analyses.modes",
    "ROTOR": "analyses.modes",
    "STATICS": "analyses.statics",
    "Outcome": "simulation.run.outcome",
    "FunctionError": "_faults",
    "simulate": "simulation.dynamics",
    "solve_static": "simulation.statics",
    "relax": "simulation.relaxation",
    "find_modes": "simulation.modes",
    "sweep_spin": "simulation.campbell",
    "sweep_rotor": "simulation.rotor",
    "linearize": "simulation.linear_model",
    "LinearModel": "simulation.linear_model",
    "main": "cli",
    "plot": "cli.pictures",
    "render": "cli.pictures",
    "run_case": "studies.separate_run",
    "shipped_data": "resources",
}
# Names that are modules, or hold the public names of several.
_NAMESPACES = {
    "laws": (
        "core.laws",
        "families.solid.laws.energies",
        "families.solid.laws.history",
        "families.solid.laws.tables",
    ),
    "research": ("research",),
}
__all__ = [*_MODULES, *_NAMESPACES, "__version__"]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name in _NAMESPACES:
        modules = [import_module(f"flexfem.{module}") for module in _NAMESPACES[name]]
        value: Any = modules[0] if len(modules) == 1 else _merged(modules)
    elif name in _MODULES:
        with without_collection():
            value = getattr(import_module(f"flexfem.{_MODULES[name]}"), name)
    else:
        return _moved(name)
    globals()[name] = value
    return value


def _merged(modules: list[Any]) -> SimpleNamespace:
    """Public names of several modules."""
    return SimpleNamespace(**{n: getattr(module, n) for module in modules for n in module.__all__})


def _moved(name: str) -> Any:
    """A name of the package of studies, which was here in version 0.1 and warns."""
    research = import_module("flexfem.research")
    if name not in research.__all__:
        raise AttributeError(f"module 'flexfem' has no attribute '{name}'")
    warnings.warn(
        f"flexfem.{name} is flexfem.research.{name} now", DeprecationWarning, stacklevel=3
    )
    return getattr(research, name)


def __dir__() -> list[str]:
    """List the public names, also those not loaded yet."""
    return sorted({*globals(), *__all__})
