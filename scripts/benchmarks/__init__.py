"""What scripts/benchmark.py is made of: a module for each section, the peers, the clock and the report."""
