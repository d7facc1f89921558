"""The human study: who compares what, where the votes are kept, and what they say."""
