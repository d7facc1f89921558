"""A quasi-static contact solver for soft and rigid bodies: arrays in, arrays out; imports nothing else of this
project."""
