"""Stage 3, intent: what the sentence asks for."""
