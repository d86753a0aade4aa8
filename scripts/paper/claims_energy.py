"""The claims of the paper's sections 1 to 4: the equations, and how well ode45 keeps the energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from paper import measures
from paper.claim import FITTED, Claim, judged, near
from paper.config import Run
from paper.printed import PRINTED
from paper.runs import Runs
from spring_pendulum_env import Parameters, energy, equilibrium, physics, simulate
from spring_pendulum_env.equilibria import BODY_STATE

FloatArray = NDArray[np.float64]

SMALL = 1.0
"""Per cent of energy error: what the paper allows itself."""

NEIGHBOURS = 10
"""Starts that differ by rounding alone, from which a solver's error is asked for."""


def claims(runs: Runs) -> list[Claim]:
    """In the order of the paper."""
    return [
        passing_through(),
        same_equations(),
        least_action(runs),
        small_error(runs),
        greatest_distance(runs),
        figure_3(runs),
        figure_4(runs),
        measure(runs),
        below_one_per_cent(runs),
        figure_6(runs),
        mean_error(runs),
    ]


def passing_through() -> Claim:
    """One spring; the mass falls past the anchor, at a distance or close by."""
    parameters = {"k1": 50.0, "k2": 0.0}
    errors = {}
    for miss in (0.3, 0.001):
        start = np.zeros(12)
        start[[0, 2]] = miss, 2.2
        run = simulate(parameters, start, (0.0, 3.0), "ode45")
        alone = measures.of_one_mass(parameters, run.states)
        errors[miss] = 100 * physics.energy_error(alone[-1] - alone[0], alone[0])
    far, close = errors.values()
    return Claim(
        "1",
        "That masses pass through each other or through the springs can be ignored.",
        judged(far < SMALL, exceptions=close > SMALL),
        "Bodies are points, so it can, until a spring's length comes near zero: there its force turns round, and has "
        f"no direction at zero itself. A mass that falls past the anchor at {min(errors) * 1000:g} mm costs ode45 "
        f"{close:.2g} % of the energy in 3 s, one at {max(errors)} m {far:.2g} %.",
    )


def same_equations() -> Claim:
    """Newton's equations against the Lagrangian's, drag added."""
    states = measures.random_starts({}, 100, 0)
    mismatch = measures.lagrangian_mismatch({"m1": 0.9, "m2": 2.3, "k1": 120, "k2": 70, "R1": 0.3, "R2": 0.2}, states)
    return Claim(
        "3",
        "The Lagrangian gives all six of the accelerations that the forces gave.",
        judged(mismatch < 1e-12),
        "At 100 random states with drag m a, -dV/dq - R v of equation (34) and equations (25) to (30) agree to "
        f"{mismatch:.0e} of the forces. As printed (14) and (35) don't: see the misprints.",
    )


def least_action(runs: Runs) -> Claim:
    """The action of neighbouring paths, over a short and a long time."""
    motion = runs.config.chaotic
    short = motion.duration / 50
    near_by = measures.action_changes(motion.constants, motion.start, short)
    whole = measures.action_changes(motion.constants, motion.start, motion.duration)
    return Claim(
        "3",
        "The actual path is the minimum of a certain quantity.",
        judged(bool(near_by.min() > 0), exceptions=bool(whole.min() < 0)),
        "The action is stationary, and least only over short times. On Figure 5's motion all six neighbouring paths "
        f"(one coordinate displaced by 1 mm) have more of it over {short:g} s ({near_by.min():.1e} J s and up); over "
        f"its {motion.duration:g} s {int((whole < 0).sum())} of them have less (down to {whole.min():.1e} J s).",
    )


def small_error(runs: Runs) -> Claim:
    """What the relative tolerance has to do with the error of the result."""
    motion = runs.config.spinning
    loose, fine = 100 * runs.spinning.energy_error, 100 * runs.spinning_finer.energy_error
    tight = 100 * runs.ode45(motion, motion.duration, 1e-6).energy_error
    return Claim(
        "4",
        "ode45 approximates the actual path, but the error is very small.",
        judged(tight < SMALL, exceptions=loose > SMALL),
        "RelTol bounds the error of a step, not that of the result. On Figure 3's motion energy errors are "
        f"{loose:.1f} % at {motion.rtol:g}, {fine:.2f} % at {motion.finer_rtol:g} ({loose / fine:.0f} times less for "
        f"ten times less) and {tight:.1g} % at 1e-06.",
    )


def greatest_distance(runs: Runs) -> Claim:
    """The turning points of the spinning pair, and what else than the energy they hang on."""
    motion = runs.config.spinning
    start: FloatArray = np.array(motion.start)
    found = runs.spinning_extremes
    spread = float(np.ptp(found.longest))
    widest = _distance_at_rest(motion.constants, float(energy(motion.constants, start)))
    drifting = start.copy()
    drifting[[8, 11]] += 1.0
    away = simulate(motion.constants, drifting, (0.0, motion.duration)).states[-1, :6].reshape(2, 3)
    distance = float(np.linalg.norm(away, axis=1).max())
    return Claim(
        "4",
        "Without gravity the masses spin around each other, and the greatest distance stays the same since the "
        "energy is conserved.",
        judged(spread < 1e-6, exceptions=distance > widest > found.longest[0] + 1e-3),
        f"Integrated to 1e-12, all {len(found.longest)} greatest lengths of the spring in {motion.duration:g} s are "
        f"{found.longest[0]:.4g} m to {spread:.0e} m. But energy alone doesn't fix it: with this one and no spin it "
        f"would be {widest:.2f} m; angular momentum must be kept too. And about a fixed centre only where the total "
        f"momentum is zero: with 1 m/s along z a mass is {distance:.0f} m away in the end.",
    )


def _distance_at_rest(parameters: Parameters, joule: float) -> float:
    """How far apart two free masses at rest have an energy."""

    def excess(distance: float) -> float:
        state = np.zeros(12)
        state[3] = distance
        return float(energy(parameters, state)) - joule

    return float(brentq(excess, parameters.L2, 1e6))


def figure_3(runs: Runs) -> Claim:
    motion, run = runs.config.spinning, runs.spinning
    final, mean = 100 * run.energy_error, 100 * run.mean_energy_error
    lengths = measures.spring_lengths(run.states)[:, 1] / 2
    first, last = lengths[: len(lengths) // 10].max(), lengths[-len(lengths) // 10 :].max()
    circle = _speed_of_a_circle(motion.constants, np.array(motion.start))
    faster: FloatArray = np.array(motion.start)
    faster[6:] *= circle / np.abs(faster[6:]).max()
    gained = simulate(motion.constants, faster, (0.0, motion.duration), "ode45", motion.rtol, motion.atol)
    ours, other = (_errors_of_neighbours(motion, method) for method in ("ode45", "RK45"))
    true = near(final, PRINTED["figure 3, final"]) and near(abs(mean), PRINTED["figure 7, mean"]) and last < first - 0.1
    return Claim(
        "4, Figures 3 and 7",
        "At the default tolerance the masses move towards the centre, with an energy error of 32.35 % at the end and "
        "of 19.765 % in the mean.",
        judged(true, exceptions=not near(other.max(), PRINTED["figure 3, final"])),
        f"With fitted constants {final:.2f} % and {abs(mean):.2f} %: the energy falls, and the greatest distance from "
        f"the centre goes from {first:.2f} to {last:.2f} m. The step control decides: SciPy's RK45, the same pair at "
        f"the same tolerances, gains or loses {'less' if 2 * other.max() < final else 'not always less'} than half as "
        f"much from each of {NEIGHBOURS} starts that differ by rounding alone. (How much is chance; ode45 has "
        f"{ours.min():.1f} to {ours.max():.1f} % from all of them.) And the spin: "
        f"at {np.abs(motion.start[6:]).max():g} m/s it is slow, as the paper says; at the {circle:.0f} m/s of a circle "
        f"the energy {'rises' if gained.energy[-1] > gained.energy[0] else 'falls'} by "
        f"{100 * gained.energy_error:.1f} %.",
    )


def _errors_of_neighbours(motion: Run, method: str) -> FloatArray:
    """Final energy errors, per cent, from starts that differ by rounding alone."""
    found = []
    for number in range(NEIGHBOURS):
        start = np.array(motion.start) * (1 + 4 * number * np.finfo(float).eps)
        run = simulate(motion.constants, start, (0.0, motion.duration), method, motion.rtol, motion.atol)
        found.append(100 * run.energy_error)
    return np.array(found)


def _speed_of_a_circle(parameters: Parameters, start: FloatArray) -> float:
    """How fast mass 1 must move for two free masses to keep their distance."""
    apart = start[:3] - start[3:6]
    force = np.linalg.norm(physics.spring_force(*[*apart, parameters.k2, parameters.L2]))
    return float((force * np.linalg.norm(start[:3]) / parameters.m1) ** 0.5)


def figure_4(runs: Runs) -> Claim:
    run = runs.spinning_finer
    final = 100 * run.energy_error
    last = measures.spring_lengths(run.states)[-len(run.times) // 10 :, 1].max() / 2
    return Claim(
        "4, Figure 4",
        "At a tolerance of 1e-4 the error is 0.57 %.",
        judged(near(final, PRINTED["figure 4, final"]), exceptions=FITTED),
        f"With the same fitted constants {final:.3f} %; the greatest distance from the centre stays {last:.2f} m.",
    )


def measure(runs: Runs) -> Claim:
    """Equation (42) hangs on where heights are counted from."""
    run, p = runs.chaotic, runs.config.chaotic.constants
    change = run.energy[-1] - run.energy[0]
    rest = float(energy(p, equilibrium(p, "hanging-hanging")[BODY_STATE]))
    printed = 100 * run.energy_error
    above = 100 * abs(change) / (run.energy[0] - rest)
    weight = float(physics.static_load(p.m1, p.m2, p.g))
    height = run.energy[0] / weight if weight > 0 else np.inf
    return Claim(
        "4, equation (42)",
        "The relative change of the total energy measures the error.",
        judged(runs.spinning.energy_error > runs.spinning_finer.energy_error, exceptions=above < 0.9 * printed),
        "Without gravity it does (it falls with the tolerance, above). With gravity the zero of the energy is a "
        f"choice: Figure 5's run lost {-change:.2f} J, which is {printed:.3f} % of its {run.energy[0]:.0f} J counted "
        f"from the anchor's height, {above:.3f} % of what it has above hanging rest, and infinitely much with heights "
        f"counted from {height:.1f} m above the anchor.",
    )


def below_one_per_cent(runs: Runs) -> Claim:
    single = measures.of_one_mass(runs.config.single.constants, runs.single.states)
    errors = {
        "Figure 4": 100 * runs.spinning_finer.energy_error,
        "Figure 5": 100 * runs.chaotic.energy_error,
        "Figure 8": 100 * runs.periodic.energy_error,
        "Figure 9": 100 * float(physics.energy_error(single[-1] - single[0], single[0])),
    }
    listed = ", ".join(f"{name} {error:.2g} %" for name, error in errors.items())
    return Claim(
        "4",
        "All figures from Figure 4 on have errors below 1 %.",
        judged(max(errors.values()) < SMALL, exceptions=100 * runs.spinning.energy_error > SMALL),
        f"Ours: {listed} (Figure 9, mass 1 alone, at a tolerance of {runs.config.single.rtol:g}). But for Figure 7, "
        "which shows Figure 3's run.",
    )


def figure_6(runs: Runs) -> Claim:
    run = runs.chaotic
    change = measures.per_cent(run.energy)
    dive = measures.time_of_last_fall(run.times, run.energy)
    before = np.abs(change[run.times < dive - 0.5]).max()
    final, mean = 100 * run.energy_error, 100 * run.mean_energy_error
    true = (
        near(final, PRINTED["figure 5, final"])
        and near(abs(mean), PRINTED["figure 5, mean"])
        and abs(dive - PRINTED["figure 6, dive"]) < 0.5
        and before < final / 3
    )
    return Claim(
        "4, Figures 5 and 6",
        "In the chaotic run the energy is fairly constant until about 9.5 s, when it takes a dive: 0.28 % in the "
        "end, 0.0253 % in the mean.",
        judged(true, exceptions=FITTED),
        f"With fitted constants {final:.3f} % and {abs(mean):.4f} %; until {dive - 0.5:.1f} s the change stays within "
        f"{before:.3f} %, and half of the fall is behind at {dive:.2f} s.",
    )


def mean_error(runs: Runs) -> Claim:
    """The paper's mean is signed, and one over the solver's points."""
    run = runs.chaotic
    signed = abs(100 * run.mean_energy_error)
    change = measures.per_cent(run.energy)
    unsigned = float(np.abs(change).mean())
    in_time = abs(float(np.trapezoid(change, run.times)) / run.times[-1])
    final = 100 * run.energy_error
    spin = abs(100 * runs.spinning.mean_energy_error) / (100 * runs.spinning.energy_error)
    return Claim(
        "4",
        "The mean error is much smaller, since most of the time there was much less error.",
        judged(signed < final / 2 and unsigned < final, exceptions=unsigned > 1.5 * signed or spin > 0.5),
        f"Its formula keeps signs, so that gains and losses cancel: on Figure 6 {signed:.4f} %, but {unsigned:.4f} % "
        f"without signs, and {in_time:.4f} % as a mean over time instead of over the solver's points. Where the "
        f"energy only falls, as in Figure 7, it is {100 * spin:.0f} % of the final error. It gives a fraction, "
        "negative for a loss; the paper prints per cent without the sign.",
    )
