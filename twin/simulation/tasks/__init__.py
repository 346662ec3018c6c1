"""The kinds of tasks of twin, each in a folder of its own: its table, referee, simulated surgeon, checks and report."""
