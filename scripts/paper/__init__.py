"""What scripts/reproduce_paper.py is made of: the config, the runs, the evidence for each claim, pictures and report."""
