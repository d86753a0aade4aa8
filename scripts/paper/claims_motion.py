"""The claims of the paper's section 5: which motions there are, and where air resistance leads them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from paper import measures
from paper.claim import FITTED, Claim, judged
from paper.printed import FIGURE_9_X, FIGURE_9_Z
from paper.runs import Runs, is_chaotic
from spring_pendulum_env import Parameters, equilibrium, linearise, normal_modes, physics, simulate
from spring_pendulum_env.dynamics import LyapunovExponent, quantities
from spring_pendulum_env.equilibria import BODY_STATE

FloatArray = NDArray[np.float64]

CLOSED = 1e-9
"""m and m/s: an orbit that misses its start by less is closed."""


def claims(runs: Runs) -> list[Claim]:
    """In the order of the paper."""
    return [
        two_free_masses(runs),
        one_mass(runs),
        figure_9(runs),
        always_periodic(runs),
        figure_8(runs),
        figure_5(runs),
        periodic_or_chaotic(runs),
        resistance(runs),
    ]


def number(found: LyapunovExponent) -> str:
    """An exponent with its standard error."""
    return f"{found.exponent:.3f} ± {found.standard_error:.3f} 1/s"


def none_found(found: LyapunovExponent) -> str:
    """That an exponent can't be told from zero."""
    return f"{abs(found.exponent):.4f} 1/s, not told from zero: a regular motion shows {found.resolution:.4f}"


def two_free_masses(runs: Runs) -> Claim:
    motion = runs.config.spinning
    times = np.linspace(0.0, motion.duration / 4, 101)
    start: FloatArray = np.array(motion.start)
    start[8] += 1.0  # some momentum, in another direction than the spin
    still = simulate(motion.constants, start, times).states
    falling = simulate(motion.constants.replace({"g": Parameters().g}), start, times).states
    momentum = quantities(motion.constants, still).momentum
    drift = float(np.abs(momentum - momentum[0]).max())
    relative = [states[:, 3:6] - states[:, :3] for states in (still, falling)]
    apart = float(np.abs(relative[1] - relative[0]).max())
    return Claim(
        "4",
        "With k1 = 0 the system acts like two independent masses connected by a spring.",
        judged(drift < 1e-8 and apart < 1e-6),
        f"The momentum of both is kept to {drift:.0e} kg m/s in {times[-1]:g} s; with gravity the two fall together, "
        f"and their motion about each other is the same to {apart:.0e} m.",
    )


def one_mass(runs: Runs) -> Claim:
    """Mass 2 doesn't vanish with its spring: it falls, and counts in equation (42)."""
    motion, orbit = runs.config.single, runs.single_orbit
    duration = motion.periods * orbit.period
    errors = {}
    for height in (0.0, 1000.0):
        start = orbit.state.copy()
        start[5] = height
        run = simulate(orbit.parameters, start, (0.0, duration), "ode45", motion.rtol, motion.atol)
        errors[height] = 100 * run.energy_error
        alone = measures.of_one_mass(orbit.parameters, run.states)
    elsewhere = np.r_[orbit.state[:3], 7.0, -3.0, 900.0, orbit.state[6:9], 0.0, 5.0, 0.0]
    here, there = (simulate(orbit.parameters, start, (0.0, orbit.period)) for start in (orbit.state, elsewhere))
    alike = float(np.abs(there.states[-1, :3] - here.states[-1, :3]).max())
    of_mass_1 = 100 * float(physics.energy_error(alone[-1] - alone[0], alone[0]))
    low, high = errors[0.0], errors[1000.0]
    return Claim(
        "5",
        "With k2 = 0 the model is one spring and one mass.",
        judged(alike < CLOSED, exceptions=low > 1.2 * high),
        f"For mass 1 it is: wherever mass 2 starts, it moves the same to {alike:.0e} m. Mass 2 still falls freely, "
        f"and equation (42) counts its energy: {low:.3f} % on Figure 9's motion where it starts at the anchor's "
        f"height and {high:.3f} % a kilometre above, against {of_mass_1:.3f} % of mass 1 alone.",
    )


def figure_9(runs: Runs) -> Claim:
    orbit, run = runs.single_orbit, runs.single
    x, z = run.states[:, 0], run.states[:, 2]
    inside = FIGURE_9_X[0] <= x.min() and x.max() <= FIGURE_9_X[1] and FIGURE_9_Z[0] <= z.min()
    fills = inside and 0 < z.max() <= FIGURE_9_Z[1] and z.min() < -20 and max(-x.min(), x.max()) > 10
    ellipse = orbit.parameters.replace({"L1": 0.0, "k1": orbit.parameters.m1 * orbit.parameters.g / 10.0})
    beside = np.array([18.0, 0, -10.0, 0, 0, 0, 0, 0, 14 * (ellipse.k1 / ellipse.m1) ** 0.5, 0, 0, 0])
    drawn = simulate(ellipse, beside, np.linspace(0, 7, 141)).states
    wide, low, high = np.abs(drawn[:, 0]).max(), drawn[:, 2].min(), drawn[:, 2].max()
    return Claim(
        "5, Figure 9",
        "A single spring-mass moves periodically, X within 20 and Z from about -25 to 5.",
        judged(orbit.closure < CLOSED and fills, exceptions=FITTED),
        f"This start does: X from {x.min():.1f} to {x.max():.1f} m, Z from {z.min():.1f} to {z.max():.1f} m, closed "
        f"to {orbit.closure:.0e} after {orbit.period:.3f} s, and {'stable' if orbit.stable else 'unstable'}. It had "
        "to be searched for: most starts near it don't close. Of a spring with L1 = 0 every start does, and k1 = "
        f"{ellipse.k1:.2f} N/m fills the same axes with an ellipse (X within {wide:.0f}, Z from {low:.1f} to "
        f"{high:.1f} m): perhaps what the paper drew.",
    )


def always_periodic(runs: Runs) -> Claim:
    """Where it is so, and a start that isn't."""
    pendulum = runs.config.elastic_pendulum
    vertical = runs.vertical_orbit
    chaotic = [start for start in runs.pendulum_starts if start.chaotic]
    regular = [start for start in runs.pendulum_starts if not start.chaotic]
    space = runs.in_space_exponent
    turns = np.concatenate([found.turns for _, found in runs.no_gravity]) / (2 * np.pi)
    kept = max(float(np.ptp(found.longest)) for _, found in runs.no_gravity)
    linear_miss = _miss_without_rest_length(runs)
    off_plane = _distance_from_plane(runs)
    true_in_part = vertical.closure < CLOSED and kept < 1e-8 and off_plane < 1e-8 and linear_miss < 1e-8
    if not true_in_part:
        raise ArithmeticError("the motions that theory says are periodic don't close: the integration is at fault")
    largest = max(runs.pendulum_starts, key=lambda start: start.exponent.exponent).exponent
    others = ", the others regular" if len(chaotic) < len(runs.pendulum_starts) else ""
    if regular:
        others += f" (at most {none_found(max(regular, key=lambda start: start.exponent.exponent).exponent)})"
    return Claim(
        "5",
        "The motion of a single spring-mass is always periodic without air resistance.",
        judged(not chaotic and not is_chaotic(space) and bool(np.ptp(turns) < 1e-6)),
        f"With L1 = 0 it is (closed to {linear_miss:.0e} m after 2 pi sqrt(m/k)), and on the vertical below the "
        f"anchor (closed to {vertical.closure:.0e}, yet unstable to a push sideways at "
        f"{pendulum.vertical_amplitude:g} m: multiplier {np.abs(vertical.multipliers).max():.1f}). Without gravity "
        f"the motion stays in a plane (to {off_plane:.0e} m) and only the length is periodic (to {kept:.0e} m); the "
        f"angle between greatest lengths goes from {turns.min():.3f} to {turns.max():.3f} turns with the speed, "
        "steadily, so that orbits close only where it is a fraction, and are quasi-periodic else. With gravity and "
        f"L1 > 0, at one energy {len(chaotic)} of {len(runs.pendulum_starts)} starts in a plane are chaotic (up to "
        f"{number(largest)}){others}; and the start in space has {number(space)}.",
    )


def _miss_without_rest_length(runs: Runs) -> float:
    """By how much the motion of a spring of rest length 0 misses its start after 2 pi sqrt(m/k), m."""
    pendulum = runs.config.elastic_pendulum
    p = pendulum.constants.replace({"L1": 0.0})
    run = simulate(p, pendulum.in_space, [0.0, 2 * np.pi * (p.m1 / p.k1) ** 0.5], rtol=1e-13, atol=1e-13)
    return float(np.abs(run.states[1, :3] - run.states[0, :3]).max())


def _distance_from_plane(runs: Runs) -> float:
    """How far a motion without gravity gets from the plane that it starts in, m."""
    start: FloatArray = np.array(runs.config.elastic_pendulum.in_space)
    start[6:9] = 1.0, -2.0, 0.5
    run = simulate(runs.config.no_gravity.constants, start, np.linspace(0.0, 10.0, 201))
    normal = np.cross(start[:3], start[6:9])
    return float(np.abs(run.states[:, :3] @ normal).max() / np.linalg.norm(normal))


def figure_8(runs: Runs) -> Claim:
    orbit = runs.periodic_orbit
    largest = float(np.abs(orbit.multipliers).max())
    return Claim(
        "5, Figure 8",
        "The double spring-mass can move periodically.",
        judged(orbit.closure < CLOSED),
        f"From our start both masses are back after {orbit.period:.4f} s to {orbit.closure:.0e}; no small "
        f"displacement grows (largest Floquet multiplier {largest:.6f}).",
    )


def figure_5(runs: Runs) -> Claim:
    found, duration = runs.chaotic_exponent, runs.config.chaotic.duration
    growth = float(np.exp(found.exponent * duration))
    return Claim(
        "5, Figure 5",
        "Figure 5 shows chaotic motion, which follows no specific pattern.",
        judged(is_chaotic(found), exceptions=growth < 1e4),
        f"With our start its largest Lyapunov exponent is {number(found)} over {found.times[-1]:,.0f} s. In the "
        f"{duration:g} s of the figure small errors grow {growth:,.0f}-fold, so the figure alone can't tell it from a "
        "long regular motion. And chaos has a rule: the equations, and energy and angular momentum about the "
        "vertical kept.",
    )


def periodic_or_chaotic(runs: Runs) -> Claim:
    """The vertical motion of the default pendulum is linear, with two frequencies that have no common period."""
    omega = normal_modes(None, "hanging-hanging").frequencies.real
    shapes = normal_modes(None, "hanging-hanging").shapes
    vertical = [number for number in range(6) if np.abs(shapes[[2, 5], number]).max() > 0.1]
    slow, fast = omega[vertical]
    golden = (1 + 5**0.5) / 2
    start = equilibrium(None, "hanging-hanging")[BODY_STATE]
    start[[2, 5]] += 0.05 * shapes[[2, 5]][:, vertical].sum(axis=1)
    found = runs.exponent(Parameters(), start)
    both = is_chaotic(runs.chaotic_exponent) and runs.periodic_orbit.closure < CLOSED
    third = not is_chaotic(found) and abs(fast / slow - golden**2) < 1e-9
    return Claim(
        "5",
        "The motion of the double spring-mass can be periodic or chaotic, depending on the start.",
        judged(both, exceptions=third),
        "Both occur, and a third kind between them: quasi-periodic motion. On the vertical the default pendulum is "
        f"linear with frequencies {slow:.4f} and {fast:.4f} rad/s; their ratio, the golden one squared to "
        f"{abs(fast / slow - golden**2):.0e}, is irrational, so that with both it never repeats, yet its exponent is "
        f"{none_found(found)}.",
    )


def resistance(runs: Runs) -> Claim:
    """Where random starts end, and those that end elsewhere or nowhere."""
    air = runs.config.resistance
    p = air.constants
    starts = measures.random_starts(p, air.starts, air.seed)
    ends = measures.moved(p, starts, air.duration)
    wanted = np.abs(equilibrium(p, "hanging-hanging")[[5, 8]] - [0.0, equilibrium(p, "hanging-hanging")[5]])
    settled = (np.abs(measures.spring_lengths(ends) - wanted).max(axis=1) < CLOSED) & (
        np.abs(ends[:, 6:]).max(axis=1) < CLOSED
    )
    rate = -float(np.linalg.eigvals(linearise(p, "hanging-hanging", pinned=True)).real.max())
    upright = equilibrium(p, "inverted-inverted")[BODY_STATE]
    upright[[2, 5]] += 0.05
    pressed = measures.spring_lengths(measures.moved(p, [upright], 60.0))[0]
    let_go = p.replace({"k1": 0.0})
    speed = -measures.moved(let_go, starts[:1], 300.0)[0, 8]
    return Claim(
        "5",
        "With air resistance the motion always stops in the end, the springs stretched only to account for gravity.",
        judged(bool(settled.all()), exceptions=bool((pressed < [p.L1, p.L2]).all()) and speed > 1),
        f"{settled.sum()} of {len(starts)} random starts (R = {p.R1:g} kg/s) end with springs of L1 + (m1 + m2) g / "
        f"k1 = {wanted[0]:.4f} m and L2 + m2 g / k2 = {wanted[1]:.4f} m, to {CLOSED:g} m within {air.duration:g} s; "
        f"what is left decays as exp(-{rate:.2f} t) and is never quite nothing. Two conditions: off the vertical "
        f"(straight up above the anchor it ends with springs pressed to {pressed[0]:.4f} and {pressed[1]:.4f} m), and "
        f"both springs there (with k1 = 0 the masses fall for ever, at {speed:.1f} m/s).",
    )
