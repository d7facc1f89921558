"""Settings of all tests: random examples are the same in every run, so that a green gate stays green."""

from hypothesis import settings

settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")
