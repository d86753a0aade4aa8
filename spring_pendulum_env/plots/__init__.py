"""Figures that a paper could use, of motions, trainings and comparisons, from plain arrays.

Okabe and Ito's colours are told apart with any colour vision; lines differ in their style too, so that a print in
grey can be read. Nothing here touches a display or matplotlib's global state. matplotlib is imported by what draws:

    from spring_pendulum_env import plots
    run = simulate(parameters, state, times)
    motion = plots.Motion("chaotic", run.parameters, run.times, run.states)
    plots.save(plots.energy([motion]), "energy")          # energy.png and energy.svg
"""

from spring_pendulum_env.plots.motions import Motion, energy, paths, phase_portraits, spring_lengths
from spring_pendulum_env.plots.style import COLOURS, MASSES, STYLES, save
from spring_pendulum_env.plots.trainings import comparison, learning_curves

__all__ = [
    "COLOURS",
    "MASSES",
    "STYLES",
    "Motion",
    "comparison",
    "energy",
    "learning_curves",
    "paths",
    "phase_portraits",
    "save",
    "spring_lengths",
]
