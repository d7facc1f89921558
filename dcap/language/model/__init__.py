"""The clients behind which a model answers, now or when it was recorded."""
