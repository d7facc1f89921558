"""How a stage runs: cached, recorded, locked, in a process of its own."""
