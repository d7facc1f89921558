"""What stages show to whoever answers their questions: views, surroundings, pictures."""
