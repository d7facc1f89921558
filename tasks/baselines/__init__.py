"""Stages of the baselines: other methods with the inputs and outputs of ours."""
