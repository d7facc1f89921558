"""What a sentence means and which of the listed choices it picks: one seam, several clients, a lexicon in files."""
