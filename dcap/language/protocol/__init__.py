"""What is asked and what may be answered: one protocol for all clients."""
