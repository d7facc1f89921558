"""Stage 3, intent: reading of the sentence."""
