"""The numbers that the paper prints."""

from __future__ import annotations

from collections.abc import Mapping

PRINTED: Mapping[str, float] = {
    "figure 3, final": 32.35,
    "figure 7, mean": 19.765,
    "figure 4, final": 0.57,
    "figure 5, final": 0.28,
    "figure 5, mean": 0.0253,
    "figure 6, dive": 9.5,
}
"""Energy errors in per cent (section 4; the mean ones printed without their sign), and the time of the dive, s."""

FIGURE_9_X = (-20.0, 20.0)
FIGURE_9_Z = (-25.0, 5.0)
"""Ends of the axes of Figure 9, m. MATLAB ends axes at the next tick beyond the curve; ticks are 10 and 5 apart."""
