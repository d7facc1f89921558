"""Questions and their possible answers: one protocol for all clients."""
