"""Reference trajectories to 30 digits, by two methods that share no equation and no integrator."""
