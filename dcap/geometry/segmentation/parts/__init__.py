"""Named parts of one instance, by the rule of its category."""
