"""The pose of a method that proposes one and simulates nothing."""
