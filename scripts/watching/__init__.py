"""What scripts/watch.py is made of: who plays, an episode of it, and the window, film or page that shows it."""
