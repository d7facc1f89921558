"""USD stages, by Pixar's library in a process of its own."""
