"""What scripts/reproduce_paper.py is made of: config, runs, the evidence for each claim, pictures and report."""
