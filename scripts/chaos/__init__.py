"""Order and chaos: the map over start angle and energy, and the share of chaotic starts, with their pictures."""
