"""The double spring pendulum: its parameters and its equations.

The system is the one of J. Pierce, "Double Spring Pendulum": an anchor at q0, spring 1 to mass m1 at q1, spring 2 to
mass m2 at q2, in three dimensions with z up, linear springs, gravity and air resistance proportional to velocity.
Equation numbers below are the paper's. Its anchor is the origin for ever; here the anchor may also be a body of mass
m0 on a gantry that bears the static load and on which a force acts. An axis along which the anchor is held has an
inverse mass of zero, so the paper's system is the same formula with all three axes held.

Every formula of the package stands here, once, as plain arithmetic on scalars: component by component, `** 0.5` for the
root, no branches. So the same functions run on floats, NumPy arrays, torch tensors, SymPy and CasADi symbols, complex
numbers (complex-step derivatives), and inside numba's compiled loops.

Misprints of the paper, where the code follows the Lagrangian (equations 31 to 34):

- Equation (12) multiplies the spring's force by the vector r1; it must be the unit vector r1-hat, as in (13).
- The text before (3) says that the unit vector points from the first mass to the origin; (3) to (5) give the opposite
  one, from the origin to the mass. The signs of (13) and (14) are right for the latter.
- The text before (12) calls the length of spring 1 "R_1", which later means a drag coefficient; |r1| is meant.
- Equation (14) has Y_2 and Z_2 under the root; it must be X_1, Y_1, Z_1, as in (13).
- Equation (35) has a minus before (Z_1 - Z_2)^2 inside the root; it must be a plus, as in (34).
- The text before (38) announces the derivative of L by X_1; what (38) gives is the one by X_1'.
- The text before (40) says "solving for dL/dX_1"; what is solved for is m_1 X_1''.

The single-letter ones, (12), (14) and (35), may be faults of the text extraction that we read rather than of the paper.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

Scalar = Any
"""Anything with arithmetic: float, complex, NumPy array, torch tensor, SymPy or CasADi symbol."""

AXES = "xyz"


@dataclasses.dataclass(frozen=True)
class Parameters:
    """The constants of one pendulum, in SI units. Immutable and validated.

    Raises:
        ValueError: a value isn't a finite number, a mass isn't positive, or another constant is negative.
    """

    m0: float = 1.0  # kg, the anchor (actuated modes only)
    m1: float = 1.0  # kg, the mass between the springs
    m2: float = 1.0  # kg, the last mass
    k1: float = 100.0  # N/m, spring 1, from the anchor to m1
    k2: float = 100.0  # N/m, spring 2, from m1 to m2
    L1: float = 1.0  # m, unstretched length of spring 1
    L2: float = 1.0  # m, unstretched length of spring 2
    R0: float = 0.0  # kg/s, air resistance on the anchor
    R1: float = 0.0  # kg/s, air resistance on m1
    R2: float = 0.0  # kg/s, air resistance on m2
    g: float = 9.81  # m/s2, gravity, downwards

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            try:
                number = math.nan if isinstance(value, (str, bool)) else float(value)
            except (TypeError, ValueError, OverflowError):
                number = math.nan
            positive = field.name in ("m0", "m1", "m2")
            if not math.isfinite(number) or number < 0 or (positive and number == 0):
                allowed = "a finite number > 0" if positive else "a finite number >= 0"
                raise ValueError(f"parameter {field.name} = {value!r}: must be {allowed}")
            object.__setattr__(self, field.name, number)

    @classmethod
    def of(cls, value: Parameters | Mapping[str, float] | None) -> Parameters:
        """Parameters from a mapping of any subset of the names; what is missing keeps its default.

        Raises:
            ValueError: `value` is no mapping, holds an unknown name, or a value that isn't allowed.
        """
        return cls().replace(value)

    def replace(self, changes: Parameters | Mapping[str, float] | None) -> Parameters:
        """A copy with some constants changed; raises like `of`."""
        if isinstance(changes, Parameters):
            return changes
        if changes is None:
            return self
        if not isinstance(changes, Mapping):
            raise ValueError(f"parameters = {changes!r}: must be a mapping of names to numbers, or Parameters")
        if not changes:
            return self
        names = self.names()
        for name in changes:
            if name not in names:
                raise ValueError(f"unknown parameter {name!r}: must be one of {', '.join(names)}")
        return dataclasses.replace(self, **changes)

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The names of the constants, in the order of the fields."""
        return tuple(field.name for field in dataclasses.fields(cls))

    def as_dict(self) -> dict[str, float]:
        """The constants as a plain mapping, JSON-able."""
        return {name: getattr(self, name) for name in self.names()}

    def constants(self, actuated_axes: str = AXES) -> tuple[float, ...]:
        """The numbers that `accelerations` takes after the force, in its order.

        Args:
            actuated_axes: the axes along which the anchor moves; along the others its inverse mass is zero.
        """
        anchor = (1.0 / self.m0 if axis in actuated_axes else 0.0 for axis in AXES)
        load = static_load(self.m1, self.m2, self.g)
        return (*anchor, 1.0 / self.m1, 1.0 / self.m2, self.k1, self.k2, self.L1, self.L2, self.g, load)

    def drag_rates(self) -> tuple[float, float, float]:
        """The rates at which drag alone slows the anchor, m1 and m2, 1/s: R / m."""
        return self.R0 / self.m0, self.R1 / self.m1, self.R2 / self.m2


def length(dx: Scalar, dy: Scalar, dz: Scalar) -> Scalar:
    """Length of a vector, equations (4), (7) and (10)."""
    return (dx * dx + dy * dy + dz * dz) ** 0.5


def nonzero(number: Scalar) -> Scalar:
    """A number, or 1 where it is zero: what keeps a quotient by it finite."""
    return number + 1 * (number == 0)


def spring_force(dx: Scalar, dy: Scalar, dz: Scalar, k: Scalar, L: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Force of a spring on its far end, N: k (L/|d| - 1) d, equations (14), (16) and (18).

    A spring of exactly zero length pulls in no direction: d is zero there, and the comparison keeps L/|d| finite.
    """
    d = length(dx, dy, dz)
    tension = k * (L / nonzero(d) - 1)
    return tension * dx, tension * dy, tension * dz


def static_load(m1: Scalar, m2: Scalar, g: Scalar) -> Scalar:
    """What the gantry bears, N: the weight of both masses (that of the anchor is carried too and appears nowhere)."""
    return (m1 + m2) * g


def accelerations_under(
    f1x: Scalar, f1y: Scalar, f1z: Scalar,
    f2x: Scalar, f2y: Scalar, f2z: Scalar,
    ux: Scalar, uy: Scalar, uz: Scalar,
    w0x: Scalar, w0y: Scalar, w0z: Scalar, w1: Scalar, w2: Scalar, g: Scalar, load: Scalar,
) -> tuple[Scalar, ...]:  # fmt: skip
    """Accelerations of the anchor, m1 and m2 without drag, m/s2: equations (25) to (30), and the anchor's own.

    Args: `spring_force` of spring 1 and of spring 2, N; force on the anchor, N; the inverse masses (that of the anchor
    for each axis, zero where it is held), 1/kg; gravity; and the static load on the gantry, N.
    """
    return (
        (ux - f1x) * w0x,
        (uy - f1y) * w0y,
        (uz - f1z + load) * w0z,
        (f1x - f2x) * w1,
        (f1y - f2y) * w1,
        (f1z - f2z) * w1 - g,
        f2x * w2,
        f2y * w2,
        f2z * w2 - g,
    )


def accelerations(
    x0: Scalar, y0: Scalar, z0: Scalar,
    x1: Scalar, y1: Scalar, z1: Scalar,
    x2: Scalar, y2: Scalar, z2: Scalar,
    ux: Scalar, uy: Scalar, uz: Scalar,
    w0x: Scalar, w0y: Scalar, w0z: Scalar, w1: Scalar, w2: Scalar,
    k1: Scalar, k2: Scalar, L1: Scalar, L2: Scalar, g: Scalar, load: Scalar,
) -> tuple[Scalar, ...]:  # fmt: skip
    """Accelerations of the anchor, m1 and m2 without drag, m/s2, from where they are.

    Args: positions, m; force on the anchor, N; then `Parameters.constants()`: the inverse masses (that of the anchor
    for each axis, zero where it is held), 1/kg, the springs, gravity, and the static load on the gantry, N.
    """
    force1 = spring_force(x1 - x0, y1 - y0, z1 - z0, k1, L1)
    force2 = spring_force(x2 - x1, y2 - y1, z2 - z1, k2, L2)
    return accelerations_under(
        force1[0], force1[1], force1[2], force2[0], force2[1], force2[2],
        ux, uy, uz, w0x, w0y, w0z, w1, w2, g, load,
    )  # fmt: skip


def derivatives(
    x0: Scalar, y0: Scalar, z0: Scalar, x1: Scalar, y1: Scalar, z1: Scalar, x2: Scalar, y2: Scalar, z2: Scalar,
    vx0: Scalar, vy0: Scalar, vz0: Scalar, vx1: Scalar, vy1: Scalar, vz1: Scalar, vx2: Scalar, vy2: Scalar, vz2: Scalar,
    ux: Scalar, uy: Scalar, uz: Scalar,
    w0x: Scalar, w0y: Scalar, w0z: Scalar, w1: Scalar, w2: Scalar,
    k1: Scalar, k2: Scalar, L1: Scalar, L2: Scalar, g: Scalar, load: Scalar,
    c0: Scalar, c1: Scalar, c2: Scalar,
) -> tuple[Scalar, ...]:  # fmt: skip
    """Time derivative of the state (positions, then velocities), drag included: equations (25) to (30).

    Args: the state, the force on the anchor, `Parameters.constants()`, `Parameters.drag_rates()`.
    """
    a = accelerations(
        x0, y0, z0, x1, y1, z1, x2, y2, z2, ux, uy, uz, w0x, w0y, w0z, w1, w2, k1, k2, L1, L2, g, load
    )  # fmt: skip
    return (
        vx0, vy0, vz0, vx1, vy1, vz1, vx2, vy2, vz2,
        a[0] - c0 * vx0, a[1] - c0 * vy0, a[2] - c0 * vz0,
        a[3] - c1 * vx1, a[4] - c1 * vy1, a[5] - c1 * vz1,
        a[6] - c2 * vx2, a[7] - c2 * vy2, a[8] - c2 * vz2,
    )  # fmt: skip


def weighted_squares(
    vx0: Scalar, vy0: Scalar, vz0: Scalar, vx1: Scalar, vy1: Scalar, vz1: Scalar, vx2: Scalar, vy2: Scalar, vz2: Scalar,
    a0: Scalar, a1: Scalar, a2: Scalar,
) -> Scalar:  # fmt: skip
    """a0 |v0|^2 + a1 |v1|^2 + a2 |v2|^2: with the drag coefficients R the power that drag dissipates, W."""
    return (
        a0 * (vx0 * vx0 + vy0 * vy0 + vz0 * vz0)
        + a1 * (vx1 * vx1 + vy1 * vy1 + vz1 * vz1)
        + a2 * (vx2 * vx2 + vy2 * vy2 + vz2 * vz2)
    )


def spring_energy(dx: Scalar, dy: Scalar, dz: Scalar, k: Scalar, L: Scalar) -> Scalar:
    """Energy stored in a spring, J: k (|d| - L)^2 / 2."""
    stretch = length(dx, dy, dz) - L
    return 0.5 * k * stretch * stretch


def kinetic_energy(
    vx0: Scalar, vy0: Scalar, vz0: Scalar, vx1: Scalar, vy1: Scalar, vz1: Scalar, vx2: Scalar, vy2: Scalar, vz2: Scalar,
    m0: Scalar, m1: Scalar, m2: Scalar,
) -> Scalar:  # fmt: skip
    """Kinetic energy of the moving bodies, J: equation (33) and the anchor's own."""
    return 0.5 * weighted_squares(vx0, vy0, vz0, vx1, vy1, vz1, vx2, vy2, vz2, m0, m1, m2)


def potential_energy(
    x0: Scalar, y0: Scalar, z0: Scalar, x1: Scalar, y1: Scalar, z1: Scalar, x2: Scalar, y2: Scalar, z2: Scalar,
    m1: Scalar, m2: Scalar, k1: Scalar, k2: Scalar, L1: Scalar, L2: Scalar, g: Scalar,
) -> Scalar:  # fmt: skip
    """Energy of the springs and of the masses' height above the anchor, J: equation (34).

    Height is counted from the anchor since the gantry that carries it bears the load: moving the whole costs nothing.
    """
    return (
        spring_energy(x1 - x0, y1 - y0, z1 - z0, k1, L1)
        + spring_energy(x2 - x1, y2 - y1, z2 - z1, k2, L2)
        + m1 * g * (z1 - z0)
        + m2 * g * (z2 - z0)
    )


def total_energy(
    x0: Scalar, y0: Scalar, z0: Scalar, x1: Scalar, y1: Scalar, z1: Scalar, x2: Scalar, y2: Scalar, z2: Scalar,
    vx0: Scalar, vy0: Scalar, vz0: Scalar, vx1: Scalar, vy1: Scalar, vz1: Scalar, vx2: Scalar, vy2: Scalar, vz2: Scalar,
    m0: Scalar, m1: Scalar, m2: Scalar, k1: Scalar, k2: Scalar, L1: Scalar, L2: Scalar, g: Scalar,
) -> Scalar:  # fmt: skip
    """Kinetic plus potential energy, J."""
    return kinetic_energy(vx0, vy0, vz0, vx1, vy1, vz1, vx2, vy2, vz2, m0, m1, m2) + potential_energy(
        x0, y0, z0, x1, y1, z1, x2, y2, z2, m1, m2, k1, k2, L1, L2, g
    )


def energy_error(change: Scalar, start: Scalar) -> Scalar:
    """Equation (42): |change of energy that nothing accounts for| / |energy at the start|; absolute where that is 0.

    Where a force drives or drag brakes, `change` is what remains after work and dissipation are taken off.
    """
    return abs(change) / nonzero(abs(start))


def fastest_frequency(w0: Scalar, w1: Scalar, w2: Scalar, k1: Scalar, k2: Scalar) -> Scalar:
    """Angular frequency of the faster stretching mode of the two springs in line, rad/s; inverse masses in 1/kg.

    The larger root of the two-by-two problem of the spring extensions; with the defaults and the anchor pinned it is
    10 phi = 16.18 rad/s, phi the golden ratio.
    """
    a = k1 * (w0 + w1)
    b = k2 * (w1 + w2)
    half_difference = 0.5 * (a - b)
    return (0.5 * (a + b) + (half_difference * half_difference + k1 * k2 * w1 * w1) ** 0.5) ** 0.5


def momentum(
    vx0: Scalar, vy0: Scalar, vz0: Scalar, vx1: Scalar, vy1: Scalar, vz1: Scalar, vx2: Scalar, vy2: Scalar, vz2: Scalar,
    m0: Scalar, m1: Scalar, m2: Scalar,
) -> tuple[Scalar, Scalar, Scalar]:  # fmt: skip
    """Momentum of the moving bodies, kg m/s. Its horizontal part is kept where the anchor is free or k1 = 0."""
    return (
        m0 * vx0 + m1 * vx1 + m2 * vx2,
        m0 * vy0 + m1 * vy1 + m2 * vy2,
        m0 * vz0 + m1 * vz1 + m2 * vz2,
    )


def angular_momentum(
    x0: Scalar, y0: Scalar, z0: Scalar, x1: Scalar, y1: Scalar, z1: Scalar, x2: Scalar, y2: Scalar, z2: Scalar,
    vx0: Scalar, vy0: Scalar, vz0: Scalar, vx1: Scalar, vy1: Scalar, vz1: Scalar, vx2: Scalar, vy2: Scalar, vz2: Scalar,
    m0: Scalar, m1: Scalar, m2: Scalar,
) -> tuple[Scalar, Scalar, Scalar]:  # fmt: skip
    """Angular momentum of the moving bodies about the origin, kg m2/s. Its z component is kept without drag or force
    wherever the anchor is pinned at the origin or free; with the anchor pinned and g = 0 all of it is."""
    return (
        m0 * (y0 * vz0 - z0 * vy0) + m1 * (y1 * vz1 - z1 * vy1) + m2 * (y2 * vz2 - z2 * vy2),
        m0 * (z0 * vx0 - x0 * vz0) + m1 * (z1 * vx1 - x1 * vz1) + m2 * (z2 * vx2 - x2 * vz2),
        m0 * (x0 * vy0 - y0 * vx0) + m1 * (x1 * vy1 - y1 * vx1) + m2 * (x2 * vy2 - y2 * vx2),
    )
